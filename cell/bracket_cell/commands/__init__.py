"""The command line, one module for each group of commands; only `bracket_cell.__main__` imports it."""

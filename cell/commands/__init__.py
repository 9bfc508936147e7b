"""The command line, one module for each group of commands; only `cell.__main__` imports it."""

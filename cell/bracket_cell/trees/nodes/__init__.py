"""The cell's leaves, named for what the two algorithms say; only `bracket_cell.running` imports it."""

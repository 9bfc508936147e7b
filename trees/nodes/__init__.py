"""The cell's leaves, named for what the two algorithms say; only `cell.running` imports it."""

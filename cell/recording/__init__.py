"""Writes the MCAP log of a run; `cell.run`, `cell.viewing` and `cell.log` may import it."""

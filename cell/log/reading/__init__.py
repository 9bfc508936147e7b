"""Reads MCAP logs, damaged ones too, as ticks, frames and messages; all other rooms of `cell.log` import it."""

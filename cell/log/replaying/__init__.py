"""Ticks a recorded tree again on recorded inputs and compares; `telling` and `training` may import it."""

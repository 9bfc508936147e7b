"""Observers of a run: they count and measure, and have no power over it."""

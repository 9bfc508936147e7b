"""Turns logs into training data; only `cell.commands` imports it."""

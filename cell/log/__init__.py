"""Logs that exist: reading, replaying, telling what happened, training data; `cell.commands` imports it."""

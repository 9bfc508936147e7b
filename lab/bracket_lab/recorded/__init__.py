"""Logs of runs as data for training."""

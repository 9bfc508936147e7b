"""Ticks a tree again on a log and compares."""

"""Reads logs, also damaged ones."""

"""Behaviour-tree controller for a human-robot assembly cell."""

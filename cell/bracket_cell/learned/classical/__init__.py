"""Perception, first version: classical image processing behind the protocols of the ground."""

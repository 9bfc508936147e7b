"""Perception, first version: classical image processing behind the protocols of cell.interfaces.perception."""

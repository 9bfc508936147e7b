"""Reads tree files: elements with places, the library of trees."""

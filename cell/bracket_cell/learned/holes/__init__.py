"""Reads what stands in the holes of the plate, with a trained network on crops of the rectified plate."""

"""Detectors on drawn frames."""

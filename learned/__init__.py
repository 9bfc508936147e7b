"""Planners and detectors: their graphs, data sets, training and shipped weights."""

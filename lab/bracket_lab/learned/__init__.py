"""Networks, data sets and training of planners and detectors."""

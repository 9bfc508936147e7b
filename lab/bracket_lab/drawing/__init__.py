"""Labelled training data from the simulated world, whose labels are the truth."""

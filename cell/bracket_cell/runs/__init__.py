"""Assembles one whole run: options, heading, viewers, result; and one calibration."""

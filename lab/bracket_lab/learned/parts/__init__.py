"""Training and scoring of part detectors."""

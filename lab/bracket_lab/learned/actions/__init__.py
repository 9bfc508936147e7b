"""Training and scoring of action detectors."""

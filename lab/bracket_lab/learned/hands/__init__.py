"""Training and scoring of hand trackers."""

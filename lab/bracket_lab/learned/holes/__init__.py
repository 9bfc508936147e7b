"""Training and scoring of hole readers."""

"""Own pictures as training data."""

"""Makes training data from logs."""

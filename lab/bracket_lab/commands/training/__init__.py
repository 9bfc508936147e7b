"""Trains networks: a record for each, the data that they learn from, and all that are shipped."""

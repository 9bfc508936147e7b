"""The node library: leaves named for what the two algorithms say."""

"""The types that all packages share, and the protocols of devices."""

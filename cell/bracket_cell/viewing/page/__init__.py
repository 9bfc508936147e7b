"""The operator's page: what the cell sees, believes, does and asks, in a browser on this machine."""

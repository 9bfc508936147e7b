"""Pictures, and the process that makes them."""

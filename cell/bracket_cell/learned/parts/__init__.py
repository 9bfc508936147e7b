"""Finds parts in the wrist camera's view with trained networks: a centre net, and one that refines poses."""

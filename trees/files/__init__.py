"""Reads, checks and builds tree files; `trees.nodes`, `trees.views` and `cell` may import it."""

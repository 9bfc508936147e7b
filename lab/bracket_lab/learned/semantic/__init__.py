"""Training and scoring of semantic planners."""

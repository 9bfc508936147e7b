"""Training and scoring of grasp planners."""

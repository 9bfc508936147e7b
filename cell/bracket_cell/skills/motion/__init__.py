"""Geometry and trajectories; knows no gripper command and no tick."""

"""Grasp planners: is the required part graspable in the clutter, and which parts must move first (section 3.2)."""

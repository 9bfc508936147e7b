"""Experiments on grasp planners that anyone can repeat (Tables 2 and 3, and more)."""

"""Speaks to hardware: gripper, signals, checked arm."""

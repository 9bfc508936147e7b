"""Processes beside the controller's: how they begin and end, what is said to them, and detectors that run in one."""

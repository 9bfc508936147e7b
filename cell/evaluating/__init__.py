"""Whole runs judged by the simulator's truth: faults in every state, encounters with a person. Commands use it."""

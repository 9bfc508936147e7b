"""Objects that lie on each other: files of VMRD, planners of what to take first, and their scores."""

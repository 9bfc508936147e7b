"""Objects that lie on each other: files of VMRD and REGRAD, planners of what to take first, and their scores."""

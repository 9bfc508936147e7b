"""Evaluations of detectors, planners, faults and whole assemblies; left out of a wheel."""

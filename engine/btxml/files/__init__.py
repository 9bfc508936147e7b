"""Reads, checks and compiles tree files."""

"""Tests of files, planners and scores of stacks."""

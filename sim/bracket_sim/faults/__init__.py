"""Faults put into a run on purpose: devices that fail, frames that are lost."""

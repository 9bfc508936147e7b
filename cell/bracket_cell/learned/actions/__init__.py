"""Trained action detectors: which of the product's actions the last 45 frames of the hand show."""

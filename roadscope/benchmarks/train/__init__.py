"""Trains the detectors that learn from pictures."""

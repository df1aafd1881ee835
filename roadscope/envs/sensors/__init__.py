"""Measurements of a rig, with their truth."""

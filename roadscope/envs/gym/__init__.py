"""Sensors as Gymnasium environments."""

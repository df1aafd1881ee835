"""Trains the camera detector from rendered pictures."""

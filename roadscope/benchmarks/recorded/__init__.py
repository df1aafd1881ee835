"""Recorded traffic in place of simulated: its suite, its episodes, its scores."""

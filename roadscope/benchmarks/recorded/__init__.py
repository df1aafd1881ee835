"""Recorded data in place of simulated traffic: suites, episodes, rules and scores."""

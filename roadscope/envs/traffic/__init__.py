"""Traffic: recordings of highway-env, and our own scenarios."""

"""Jobs, one entry on one episode each: planned, run in parallel, kept."""

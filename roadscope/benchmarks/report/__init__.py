"""Shows results as tables, files and pictures."""

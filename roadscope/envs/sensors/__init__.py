"""What a rig measures, and the truth beside it."""

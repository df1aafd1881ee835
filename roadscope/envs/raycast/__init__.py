"""Where rays meet the world."""

"""Where the world becomes an image."""

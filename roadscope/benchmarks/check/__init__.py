"""A plug-in of one's own against its contract."""

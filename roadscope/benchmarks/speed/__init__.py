"""How fast the package's parts are, beside others where they are installed."""

"""How long the parts of the package take on this machine."""

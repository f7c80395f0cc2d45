"""One scan to evidence per cell."""

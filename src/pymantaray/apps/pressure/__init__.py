"""Sea pressure at a depth."""

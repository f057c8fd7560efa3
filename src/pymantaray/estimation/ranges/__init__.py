"""Models of ranges, and candidates of arrivals."""

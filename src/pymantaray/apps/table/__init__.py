"""Tables of travel times for use on board."""

"""The command `mantaray`."""

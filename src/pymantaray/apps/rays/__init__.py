"""Eigenrays, travel times and paths between positions in a table."""

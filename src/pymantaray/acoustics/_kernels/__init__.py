"""Compiled ray machinery: Numba only, no allocation in the inner loops, workspaces passed in."""

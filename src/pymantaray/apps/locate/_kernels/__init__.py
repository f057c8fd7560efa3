"""Kernels of the survey solver."""

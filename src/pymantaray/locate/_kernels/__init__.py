"""Kernels of the solver of surveys."""

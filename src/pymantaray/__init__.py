"""MantaRay: what the real ocean does to acoustic ranges, and to the positions estimated from them."""

__version__ = "0.1.0"

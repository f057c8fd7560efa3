"""A figure and a sensor for MantaRay from another package."""

"""The study `factories.TINY` and runs of it with other sections."""

from tiny_study import fly_tiny, run_tiny, tiny

__all__ = ["fly_tiny", "run_tiny", "tiny"]

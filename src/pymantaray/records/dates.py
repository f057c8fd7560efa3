"""Seconds between instants, also for spans that 64-bit nanoseconds do not cover."""

from typing import Any

import numpy as np

from pymantaray.arrays import Array

_SECOND = np.timedelta64(1_000_000_000, "ns")
_LONGEST = 9.2e9  # s; 2**63 ns are 292 years


def seconds_since(times: Any, start: Any) -> Array:
    """Seconds from one instant to others; their difference may be more than 292 years."""
    whole = np.asarray(np.asarray(times, "M8[s]") - np.asarray(start, "M8[s]"), dtype=float)
    if not np.any(np.abs(whole) > _LONGEST):
        return np.asarray((times - start) / _SECOND, dtype=float)
    parts = (
        instant - instant.astype("M8[s]") for instant in (np.asarray(times), np.asarray(start))
    )
    after, before = (np.asarray(part / _SECOND, dtype=float) for part in parts)
    return np.asarray(whole + after - before)

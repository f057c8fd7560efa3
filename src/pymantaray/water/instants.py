"""Instants of a configuration."""

import datetime as dt

import numpy as np


def utc_instant(time: dt.datetime) -> np.datetime64:
    """Instant of a configuration's time, in UTC if it names no zone."""
    if time.tzinfo is not None:
        time = time.astimezone(dt.UTC).replace(tzinfo=None)
    return np.datetime64(time, "ns")

"""Instants of a configuration."""

import datetime as dt

import numpy as np


def utc_instant(time: dt.datetime) -> np.datetime64:
    """Convert a configuration's time to an instant; a time without a zone is UTC."""
    if time.tzinfo is not None:
        time = time.astimezone(dt.UTC).replace(tzinfo=None)
    return np.datetime64(time, "ns")

"""A made-up atlas for figures and pages."""

import numpy as np
import xarray as xr

CONVENTIONS = ["transmitter", "receiver", "mean", "chord", "nominal"]


def made_atlas(times=1, seed=2):
    """
    An atlas of 4 x 5 columns with land, an edge, a shallow place and one without a direct path.
    """
    rng = np.random.default_rng(seed)
    worst = rng.uniform(0.1, 40.0, (times, 4, 5, 5, 2, 3))
    lost = rng.uniform(0.0, 0.4, (times, 4, 5, 2, 3))
    status = np.zeros((times, 4, 5), dtype="i1")
    status[:, 0], status[:, 1, 0] = 2, 1
    worst[status > 0], lost[status > 0] = np.nan, np.nan
    worst[:, 2, 2], lost[:, 2, 2] = np.nan, np.nan  # shallow
    worst[:, 3, 3], lost[:, 3, 3] = np.nan, 1.0
    place = ("time", "lat", "lon")
    return xr.Dataset(
        {
            "worst_range_error": ((*place, "convention", "pair", "distance"), worst),
            "no_direct_path": ((*place, "pair", "distance"), lost),
            "column_status": (place, status),
        },
        {
            "time": np.datetime64("2014-07-15T12", "ns")
            + np.timedelta64(1, "D") * np.arange(times),
            "lat": 77.0 + 0.5 * np.arange(4),
            "lon": -2.0 + np.arange(5),
            "convention": CONVENTIONS,
            "distance": [2e3, 5e3, 1e4],
            "safe": [1.0, 5.0, 20.0],
            "transmitter_depth": ("pair", [20.0, 20.0]),
            "receiver_depth": ("pair", [20.0, 800.0]),
        },
        {"ocean": "Test Sea (synthetic)", "synthetic": 1},
    )

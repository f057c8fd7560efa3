"""Named random streams: each use of random numbers has its own generator, selected by name."""

import hashlib
import json

import numpy as np

from pymantaray.errors import GeometryError


def stream(root_seed: int, realization: int, *names: str) -> np.random.Generator:
    """
    Random generator for one named use in one realization.

    The seed includes a hash of the names, so a new sensor or vehicle does not change other draws.

    Parameters
    ----------
    root_seed : int
        Seed of the study. Must not be negative.
    realization : int
        Index of the Monte Carlo realization. Must not be negative.
    *names : str
        Name of the use, from coarse to fine, for example ``"sensing", "A", "odometry"``.

    Returns
    -------
    numpy.random.Generator
        PCG64 generator. The same arguments always give the same draws.

    Examples
    --------
    >>> a = stream(1, 0, "sensing", "A", "depth").standard_normal()
    >>> b = stream(1, 0, "sensing", "A", "depth").standard_normal()
    >>> a == b
    True
    """
    if root_seed < 0 or realization < 0:
        raise GeometryError(
            f"stream: root_seed {root_seed}, realization {realization}; neither may be negative"
        )
    digest = hashlib.sha256(json.dumps(names).encode()).digest()
    words = np.frombuffer(digest, dtype="<u4").tolist()
    return np.random.Generator(
        np.random.PCG64(np.random.SeedSequence([root_seed, realization, *words]))
    )

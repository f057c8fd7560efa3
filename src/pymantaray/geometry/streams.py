"""Named random streams: each use of randomness has its own generator, found by name."""

import hashlib
import json

import numpy as np

from pymantaray.errors import GeometryError


def stream(root_seed: int, realization: int, *names: str) -> np.random.Generator:
    """
    Random generator of one named use in one realization.

    The names are hashed into the seed, so that a new sensor or vehicle moves no other draw.

    Parameters
    ----------
    root_seed : int
        Seed of the whole study. Must not be negative.
    realization : int
        Index of the Monte Carlo realization. Must not be negative.
    *names : str
        The use, from coarse to fine, for example ``"sensing", "A", "odometry"``.

    Returns
    -------
    numpy.random.Generator
        PCG64 generator; the same arguments always give the same draws.

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
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([root_seed, realization, *words])))

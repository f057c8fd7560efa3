"""Build a travel-time table from any water."""

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from pymantaray.acoustics import Medium
from pymantaray.apps.table.build import Box, build_tree
from pymantaray.apps.table.cells import Tree, joined
from pymantaray.apps.table.samples import Radial
from pymantaray.apps.table.table import TravelTimeTable
from pymantaray.config.door.water import Source, open_water
from pymantaray.errors import OnlineError
from pymantaray.jobs.progress import Progress
from pymantaray.sensing.water import Water

Limits = tuple[float, float] | tuple[float, float, float]
MAX_BYTES = 1_000_000
_STEPS = 64  # smallest cells along an axis without a step


def build_table(
    water: Water | Source,
    source_depth: Limits,
    receiver_depth: Limits,
    horizontal_range: Limits,
    *,
    tolerance: float = 0.05,
    node: tuple[float, float] = (0.0, 0.0),
    sectors: int = 1,
    ensemble: Sequence[Water | Source] = (),
    max_bytes: int = MAX_BYTES,
    progress: Progress | None = None,
) -> TravelTimeTable:
    """
    Build a travel-time table.

    Parameters
    ----------
    water : Water, or a source for `open_water`
        Sound speed, sea bed, the selection of arrivals and their allowed reflections. Water that
        varies is taken at its start.
    source_depth, receiver_depth, horizontal_range : tuple of float
        Lower limit, upper limit and optionally a step: the largest size of the smallest cells,
        which bound shadows. Default step: 1/64 of the extent. [m]
    tolerance : float
        Bound of the error of the interpolated range at a given travel time, for rays less than 84
        degrees from the horizontal; steeper rays are treated as rays of 84 degrees. [m]
    node : tuple of float
        North and east of the source in the local frame of the water. [m]
    sectors : int
        Number of sectors of bearing, each with the water along its central bearing; the first
        sector is centred on north.
    ensemble : sequence of Water or sources
        Other possible oceans. The standard deviation over these and ``water`` becomes that of the
        range.
    max_bytes : int
        Largest allowed size of the table in memory. [B]
    progress : callable, optional
        Called with ``"table"``, the estimated percentage of the work of each sector that is done,
        summed over the sectors, and 100 for each sector. A sample of the cells is solved first, and
        tells how much work the others are.

    Returns
    -------
    TravelTimeTable

    Raises
    ------
    OnlineError
        If a limit is invalid or the table would be too large.

    Notes
    -----
    Cells of source depth, receiver depth and range are halved until the mean slowness (travel time
    over straight distance), interpolated from its values and gradients at the eight corners, has at
    most half of the allowed error at 27 other points.

    Examples
    --------
    Continues the example of `pymantaray.apps.table`:

    >>> from pymantaray.apps.table import build_table
    >>> build_table(medium, (50.0, 60.0), (400.0, 410.0), (100.0, 2000.0), tolerance=0.5).upper
    (60.0, 410.0, 2000.0)
    """
    members = [
        entry if isinstance(entry, Water) else open_water(entry) for entry in (water, *ensemble)
    ]
    box = _box(source_depth, receiver_depth, horizontal_range)
    if not (math.isfinite(tolerance) and tolerance > 0.0):
        raise OnlineError(f"`tolerance` is {tolerance}; a positive length in metres is needed")
    if sectors < 1:
        raise OnlineError(f"sectors is {sectors}; at least 1 is needed")
    trees: list[Tree] = []
    for sector in range(sectors):
        bearing = 2.0 * math.pi * sector / sectors
        radials = [_radial(member, node, bearing) for member in members]
        size = sum(tree.nbytes for tree in trees)
        share = None if progress is None else partial(_report, progress, sector, sectors)
        trees.append(
            build_tree(
                box, radials, tolerance, max_bytes=max_bytes, other_bytes=size, progress=share
            )
        )
    return TravelTimeTable(
        box.lower, box.upper, float(tolerance), joined(trees), _record(members[0], node, trees)
    )


def _report(progress: Progress, sector: int, sectors: int, share: float) -> None:
    """Report the share of a sector's work in percent."""
    progress("table", 100 * sector + math.floor(100.0 * share + 1e-6), 100 * sectors)


def _radial(water: Water, node: tuple[float, float], bearing: float) -> Radial:
    """Vertical plane of a water, with its reception."""
    medium, _ = water.at_start
    assert isinstance(medium, Medium)
    heard = water.reception
    return Radial(
        medium,
        heard.arrival,
        heard.max_surface_bounces,
        heard.max_bottom_bounces,
        heard.spreading_cutoff_db,
        float(node[0]),
        float(node[1]),
        bearing,
    )


def _box(*limits: Limits) -> Box:
    """Limits and smallest cells; an error if a limit is invalid."""
    names = (
        "`source_depth`",
        "`receiver_depth`",
        "`horizontal_range`",
    )
    lower = []
    upper = []
    smallest = []
    for name, values in zip(names, limits, strict=True):
        numbers = [float(value) for value in values]
        if len(numbers) not in (2, 3) or not all(math.isfinite(value) for value in numbers):
            raise OnlineError(
                f"{name} is {tuple(values)}; a lower limit, an upper limit and optionally a step"
                " are needed"
            )
        first, last = numbers[:2]
        step = numbers[2] if len(numbers) == 3 else (last - first) / _STEPS
        if not (first < last and 0.0 < step <= last - first and first >= 0.0):
            raise OnlineError(
                f"{name} is {tuple(values)}; allowed: 0 <= lower < upper and 0 < step <= upper -"
                " lower"
            )
        lower.append(first)
        upper.append(last)
        smallest.append(step)
    if lower[2] <= 0.0:
        raise OnlineError(f"{names[2]} begins at 0; a positive lower limit is needed, such as 10 m")
    return Box(tuple(lower), tuple(upper), tuple(smallest))  # type: ignore[arg-type]


def _record(water: Water, node: tuple[float, float], trees: list[Tree]) -> dict[str, Any]:
    """Description of a table for its file."""
    heard = water.reception
    return {
        "water": {name: str(value) for name, value in water.record.items()},
        "arrival": heard.arrival,
        "max_surface_bounces": heard.max_surface_bounces,
        "max_bottom_bounces": heard.max_bottom_bounces,
        "cutoff_db": heard.spreading_cutoff_db,
        "node_m": [float(value) for value in np.asarray(node, dtype=float)],
        "cells": [len(tree.corner) for tree in trees],
    }

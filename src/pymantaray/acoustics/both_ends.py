"""
Solve links whose search left unresolved intervals from the other end as well, and merge the direct
rays of both searches.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics._kernels import layout as at
from pymantaray.arrays import Array
from pymantaray.records import RayStatus

if TYPE_CHECKING:
    from pymantaray.acoustics._kernels.layout import Results

# Two rows within all three are one ray: travel time [s], launch and arrival angle [rad]
_SAME_TIME = 1e-7
_SAME_ANGLE = 1e-4
_IDENTITY = [at.TRAVEL_TIME, at.LAUNCH_ANGLE, at.ARRIVAL_ANGLE]
_WITHOUT_ARRIVAL = (RayStatus.SHADOW, RayStatus.WEAK, RayStatus.BLOCKED)
# Outcomes of both searches without an arrival, the one that says most last: a ray exists that the
# other search did not find
_KNOWLEDGE = (RayStatus.UNRESOLVED, RayStatus.SHADOW, RayStatus.BLOCKED, RayStatus.WEAK)


def unresolved_links(results: Results) -> NDArray[np.intp]:
    """
    Indices of the links whose search left intervals that may contain more rays, or found signs of
    rays that it does not follow.
    """
    return np.flatnonzero(results.info[:, at.RESOLVED] < 1.0)


def merged(results: Results, links: NDArray[np.intp], other: Results) -> Results:
    """
    Results of all links, with the direct rays of some links that only the search from the other end
    found.

    A link is resolved if either search is. other has one entry for each of the links.
    """
    starts = np.concatenate([[0], np.cumsum(results.counts)])
    other_starts = np.concatenate([[0], np.cumsum(other.counts)])
    counts = results.counts.copy()
    status = results.status.copy()
    info = results.info.copy()
    rows = [results.rows[starts[i] : starts[i + 1]] for i in range(len(counts))]
    for k, i in enumerate(links):
        more = _only_in(other.rows[other_starts[k] : other_starts[k + 1]], rows[i])
        if len(more):
            together = np.concatenate([rows[i], more])
            rows[i] = together[np.argsort(together[:, at.TRAVEL_TIME], kind="stable")]
            counts[i] = len(together)
            status[i] = RayStatus.OK
            info[i, at.MARGIN] = 0.0
        elif not counts[i]:
            info[i, at.MARGIN] = np.fmin(info[i, at.MARGIN], other.info[k, at.MARGIN])
            status[i] = max(status[i], other.status[k], key=_KNOWLEDGE.index)
        info[i, at.RESOLVED] = min(
            info[i, at.COMPLETE], max(info[i, at.RESOLVED], other.info[k, at.RESOLVED])
        )
    return type(results)(np.concatenate(rows), counts, status, info)


def _only_in(rows: Array, known: Array) -> Array:
    """
    Direct rays that have no partner of their own among known rays; the nearest in time are partners
    first.
    """
    direct = rows[rows[:, at.SURFACE_BOUNCES] + rows[:, at.BOTTOM_BOUNCES] == 0.0]
    distance = np.abs(direct[:, None, _IDENTITY] - known[None, :, _IDENTITY])
    pairs = np.argwhere((distance < (_SAME_TIME, _SAME_ANGLE, _SAME_ANGLE)).all(axis=2))
    alone = np.ones(len(direct), dtype=bool)
    free = np.ones(len(known), dtype=bool)
    for i, j in pairs[np.argsort(distance[*pairs.T, 0], kind="stable")]:
        if alone[i] and free[j]:
            alone[i] = free[j] = False
    missing: Array = direct[alone]
    return missing


def without_certificate(results: Results) -> Results:
    """
    Results in which links without an arrival and with unresolved intervals have the status
    UNRESOLVED.
    """
    unsure = (results.info[:, at.RESOLVED] == 0.0) & np.isin(results.status, _WITHOUT_ARRIVAL)
    return results._replace(status=np.where(unsure, np.int8(RayStatus.UNRESOLVED), results.status))

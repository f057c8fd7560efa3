"""What each link's receiver ranges on: rays, the current along them, their loss, and the one arrival chosen."""

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics import (
    Currents,
    Medium,
    Rule,
    choose_arrivals,
    current_delays,
    find_eigenrays,
    quadrature,
    select,
    trace_paths,
)
from pymantaray.records import Arrivals, FirstArrivals, RayStatus
from pymantaray.sensing.detection import Detector

Array = NDArray[np.float64]
_BLOCK = 512  # links whose ray paths are held at a time
Progress = Callable[[int, int], None]
"""Told how many parts of the work are done, and how many there are."""


class Reception(NamedTuple):
    """
    Outcome of every link in both directions, one row per link.

    The slowness vectors of both directions point from source to receiver. The arrivals' travel times are
    those in water at rest.
    """

    arrivals: Arrivals
    there: FirstArrivals
    """From source to receiver."""
    back: FirstArrivals
    """From receiver to source."""
    probability: Array | None
    """Shape (n_links, 2): that the arrival there and the one back are heard; None without a detector."""
    loss_db: Array | None = None
    """Transmission loss of each arrival; None without a detector. [dB]"""
    delay: Array | None = None
    """What the current adds to each travel time from source to receiver; None at rest. [s]"""


def receive(
    medium: Medium,
    source: Array,
    receiver: Array,
    *,
    spreading_cutoff_db: float | None = 15.0,
    max_surface_bounces: int = 0,
    max_bottom_bounces: int = 0,
    rule: Rule = "direct",
    currents: Currents | None = None,
    detector: Detector | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Reception:
    """
    Find the arrivals of links and pick the one that each receiver ranges on.

    Parameters
    ----------
    medium : Medium
    source, receiver : ndarray, shape (n_links, 3)
        [m]
    spreading_cutoff_db, max_surface_bounces, max_bottom_bounces, threads
        As in `pymantaray.acoustics.find_eigenrays`.
    rule : {"direct", "first", "strongest"}
        As in `pymantaray.acoustics.select`. ``strongest`` goes by the transmission loss if there is
        a detector, else by the spreading alone.
    currents : Currents, optional
        By default the water is at rest.
    detector : Detector, optional
        By default every arrival is heard.
    progress : callable, optional
        Told how many links are done and how many there are to do; each counts once to find its rays, once more to
        follow them if there is a current or a detector, and by ``direct`` with bounces once more without.

    Returns
    -------
    Reception
        By ``direct``, time and status of a link do not depend on the bounces allowed: a link without a
        direct arrival has the status that it has where none are.
    """
    n = len(source)
    again = rule == "direct" and bool(max_surface_bounces or max_bottom_bounces)
    total = n * (1 + (currents is not None or detector is not None) + again)
    arrivals = find_eigenrays(
        medium,
        source,
        receiver,
        max_surface_bounces,
        max_bottom_bounces,
        spreading_cutoff_db,
        threads=threads,
        progress=_from(progress, 0, total),
    )
    delay, loss = _along_rays(
        medium, source, receiver, arrivals, currents, detector, threads, _from(progress, n, total)
    )
    there = select(arrivals, rule, loss_db=loss, delay=delay)
    if again:
        lost = there.status != RayStatus.OK
        bare = find_eigenrays(
            medium,
            source[lost],
            receiver[lost],
            spreading_cutoff_db=spreading_cutoff_db,
            threads=threads,
            progress=_from(progress, total - int(np.count_nonzero(lost)), total),
        )
        if np.any(bare.status == RayStatus.OK):
            raise AssertionError("a direct arrival was lost among those that bounce")
        status, margin = there.status.copy(), there.shadow_margin.copy()
        status[lost], margin[lost] = bare.status, bare.shadow_margin
        there = replace(there, status=status, shadow_margin=margin)
    back, probability = there, None
    if delay is not None:
        against = select(arrivals, rule, loss_db=loss, delay=-delay)
        back = replace(against, status=there.status, shadow_margin=there.shadow_margin)
    if detector is not None and loss is not None:
        heard = detector.sonar.probability_heard(loss)
        probability = np.full((arrivals.status.size, 2), np.nan)
        for way, d in enumerate((delay, None if delay is None else -delay)):
            link, row = choose_arrivals(arrivals, rule, loss_db=loss, delay=d)
            probability[link, way] = heard[row]
    return Reception(arrivals, there, back, probability, loss_db=loss, delay=delay)


def join(parts: Sequence[Reception]) -> Reception:
    """
    Make one reception of several, their links one after the other.

    Parameters
    ----------
    parts : sequence of Reception
        At least one; all with a detector or all without, and so with currents.

    Returns
    -------
    Reception
    """
    before = np.cumsum([0, *(part.arrivals.status.size for part in parts)])
    link = np.concatenate([part.arrivals.link + n for part, n in zip(parts, before[:-1], strict=True)])
    return Reception(
        arrivals=Arrivals(**_columns([part.arrivals for part in parts]) | {"link": link}),
        there=FirstArrivals(**_columns([part.there for part in parts])),
        back=FirstArrivals(**_columns([part.back for part in parts])),
        probability=_joined([part.probability for part in parts]),
        loss_db=_joined([part.loss_db for part in parts]),
        delay=_joined([part.delay for part in parts]),
    )


def _joined(parts: Sequence[Array | None]) -> Array | None:
    there = [part for part in parts if part is not None]
    return np.concatenate(there) if there else None


def _columns(records: Sequence[Arrivals] | Sequence[FirstArrivals]) -> dict[str, Any]:
    return {f.name: np.concatenate([getattr(r, f.name) for r in records]) for f in fields(records[0])}


def _from(progress: Progress | None, before: int, total: int) -> Progress | None:
    """Progress of a part of the work that begins when so much is done."""
    if progress is None:
        return None
    return lambda done, _: progress(before + done, total)


def _along_rays(
    medium: Medium,
    source: Array,
    receiver: Array,
    arrivals: Arrivals,
    currents: Currents | None,
    detector: Detector | None,
    threads: int | None,
    progress: Progress | None,
) -> tuple[Array | None, Array | None]:
    """Delay by the current and transmission loss of each arrival, None for what is not asked for."""
    if currents is None and detector is None:
        return None, None
    delay, loss = np.zeros(arrivals.link.size), np.zeros(arrivals.link.size)
    for start in range(0, arrivals.status.size, _BLOCK):
        stop = min(start + _BLOCK, arrivals.status.size)
        rows = slice(*np.searchsorted(arrivals.link, [start, stop]))
        part = _part(arrivals, slice(start, stop), rows)
        paths = trace_paths(medium, source[start:stop], receiver[start:stop], part, threads=threads)
        if currents is not None:
            delay[rows] = current_delays(quadrature(paths), currents, part.link.size)
        if detector is not None:
            loss[rows] = detector.loss_db(medium, source[start:stop], receiver[start:stop], part, paths)
        if progress is not None:
            progress(stop, arrivals.status.size)
    return (None if currents is None else delay), (None if detector is None else loss)


def _part(arrivals: Arrivals, links: slice, rows: slice) -> Arrivals:
    """Arrivals of a run of links."""
    cut = {"arrival": rows, "n_links": links}
    columns = {f.name: getattr(arrivals, f.name)[cut[f.metadata["dims"][0]]] for f in fields(arrivals)}
    return Arrivals(**columns | {"link": columns["link"] - links.start})

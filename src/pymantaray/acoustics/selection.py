"""
Selection of the arrival of a link for its range: the direct, the first or the strongest arrival, or
the first if none is direct.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.arrays import Array
from pymantaray.errors import AcousticsError
from pymantaray.records import Arrivals, FirstArrivals, RayStatus

ArrivalRule = Literal["direct", "first", "strongest", "direct-or-first"]
"""
Rule that selects an arrival: the earliest without a reflection, the earliest of all, the one with
the smallest loss, or the earliest of all only where each has a reflection.
"""
NEAR_DB = 1.0
"""
Change of the cut-off by which a selection is tested; selections that it changes are marked. [dB]
"""

SHORT_LINK = 1.0
"""
Links below this length are between transducers of one instrument, whose echoes the cut-off does not
compare with it. [m]
"""


class Chosen(NamedTuple):
    """Links with a selected arrival in ascending order, and the row of each arrival."""

    link: NDArray[np.int64]
    row: NDArray[np.int64]


def choose_arrivals(
    arrivals: Arrivals,
    rule: ArrivalRule,
    *,
    loss_db: ArrayLike | None = None,
    delay: ArrayLike | None = None,
    detected: NDArray[np.bool_] | None = None,
) -> Chosen:
    """
    Select at most one arrival of each link.

    Parameters
    ----------
    arrivals : Arrivals
        From `find_eigenrays`.
    rule : {"direct", "first", "strongest", "direct-or-first"}
        ``direct``: the earliest arrival without a reflection. ``first``: the earliest of all.
        ``strongest``: the one with the smallest loss, or the earliest of equal ones.
        ``direct-or-first``: as ``direct``, and as ``first`` on links without a direct arrival.
    loss_db : array_like, shape (n_arrivals,), optional
        Loss for ``strongest``; NaN counts as infinite. Default: ``spreading_db``, which lacks
        reflection, absorption and distance. [dB]
    delay : array_like, shape (n_arrivals,), optional
        Delays to add to the travel times before their comparison, see `current_delays`. [s]
    detected : ndarray of bool, shape (n_arrivals,), optional
        False for arrivals that are not detected and cannot be selected.

    Returns
    -------
    Chosen
        Links with a selected arrival in ascending order, and its row.

    Examples
    --------
    Continues the example of `pymantaray.acoustics`:

    >>> from pymantaray.acoustics import choose_arrivals
    >>> choose_arrivals(arrivals, "strongest", loss_db=[72.0, 70.0]).row
    array([1])
    """
    if rule not in get_args(ArrivalRule):
        raise AcousticsError(
            f"arrival rule {rule!r}; allowed are {', '.join(get_args(ArrivalRule))}"
        )
    time = _delayed(arrivals, delay)
    allowed = np.ones(time.size, dtype=bool) if detected is None else detected
    reflected = (arrivals.surface_bounces > 0) | (arrivals.bottom_bounces > 0)
    if rule == "direct":
        allowed = allowed & ~reflected
    keys = [time]
    if rule == "direct-or-first":
        keys.insert(0, reflected.astype(float))
    if rule == "strongest":
        keys.insert(
            0,
            arrivals.spreading_db if loss_db is None else _one_each("loss_db", loss_db, time.size),
        )
    return first_rows(arrivals.link, keys, allowed)


def first_rows(
    link: NDArray[np.int64], keys: Sequence[Array], allowed: NDArray[np.bool_]
) -> Chosen:
    """First allowed row of each link in the order of the keys, the most important key first."""
    order = np.lexsort([*reversed(keys), link])
    order = order[allowed[order]]
    links = link[order]
    begins = np.ones(links.size, dtype=bool)
    np.not_equal(links[1:], links[:-1], out=begins[1:])
    return Chosen(link=links[begins].astype(np.int64), row=order[begins].astype(np.int64))


def is_near_cutoff(arrivals: Arrivals, cutoff_db: float, rule: ArrivalRule) -> NDArray[np.bool_]:
    """
    True for each link (n_links,) on which a spreading cut-off that is `NEAR_DB` higher or lower
    would change the selected arrival.

    The arrivals must be from a search with a cut-off that is `NEAR_DB` higher than ``cutoff_db``
    [dB].
    """
    if not _too_weak(arrivals, cutoff_db - NEAR_DB).any():
        return np.zeros(arrivals.status.size, dtype=bool)
    picks = []
    for cutoff in (cutoff_db - NEAR_DB, cutoff_db, cutoff_db + NEAR_DB):
        link, row = choose_arrivals(arrivals, rule, detected=~_too_weak(arrivals, cutoff))
        pick = np.full(arrivals.status.size, -1)
        pick[link] = row
        picks.append(pick)
    return np.asarray((picks[0] != picks[1]) | (picks[2] != picks[1]))


def within_cutoff(arrivals: Arrivals, cutoff_db: float) -> Arrivals:
    """
    Arrivals within a lower cut-off [dB] than that of their search; a link that loses all of its
    arrivals is WEAK with miss distance 0.
    """
    strong = ~_too_weak(arrivals, cutoff_db)
    if strong.all():
        return arrivals
    rows = arrivals.at({"arrival": strong})
    status = arrivals.status
    weak = (status == RayStatus.OK) & (np.bincount(rows.link, minlength=status.size) == 0)
    return replace(rows, status=np.where(weak, np.int8(RayStatus.WEAK), status))


def _too_weak(arrivals: Arrivals, cutoff_db: float) -> NDArray[np.bool_]:
    """True for each arrival that a cut-off discards."""
    short = arrivals.chord_travel_time * arrivals.source_sound_speed < SHORT_LINK
    return np.asarray((arrivals.spreading_db > cutoff_db) & ~short[arrivals.link])


def select(
    arrivals: Arrivals,
    rule: ArrivalRule,
    *,
    loss_db: ArrayLike | None = None,
    delay: ArrayLike | None = None,
) -> FirstArrivals:
    """
    Select one arrival of each link by a rule.

    Parameters
    ----------
    arrivals, rule, loss_db, delay
        As in `choose_arrivals`.

    Returns
    -------
    FirstArrivals
        One row per link; travel times include the delay. By ``direct``, a link whose arrivals are
        all reflected has status SHADOW and shadow margin NaN: the solver gives one margin for all
        numbers of reflections. Solve it without reflections to learn whether its direct rays are
        blocked or weak. ``first`` without a delay is the same as `Arrivals.first`.

    Examples
    --------
    Continues the example of `pymantaray.acoustics`:

    >>> from pymantaray.acoustics import select
    >>> print(select(arrivals, "first").travel_time.round(4))
    [2.0659]
    """
    link, row = choose_arrivals(arrivals, rule, loss_db=loss_db, delay=delay)
    picked = arrivals.of_links(link, row, _delayed(arrivals, delay)[row])
    passed_over = (arrivals.status == RayStatus.OK) & np.isnan(picked.travel_time)
    return replace(
        picked,
        status=np.where(passed_over, np.int8(RayStatus.SHADOW), arrivals.status),
        shadow_margin=np.where(passed_over, np.nan, arrivals.shadow_margin),
    )


def _delayed(arrivals: Arrivals, delay: ArrayLike | None) -> Array:
    time: Array = arrivals.travel_time
    return time if delay is None else time + _one_each("delay", delay, time.size)


def _one_each(name: str, values: ArrayLike, n: int) -> Array:
    array = np.asarray(values, dtype=float)
    if array.shape != (n,):
        raise AcousticsError(f"{name}: shape {array.shape}; {n} arrivals need one value each")
    return array

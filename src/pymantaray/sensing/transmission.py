"""Sound between pairs of ends: receptions in both directions, losses, leaks and selection."""

from dataclasses import replace
from typing import NamedTuple, Protocol

import numpy as np

from pymantaray.acoustics import (
    ArrivalRule,
    Leakage,
    Medium,
    find_eigenrays,
    find_leaks,
    quadrature,
    trace_paths,
)
from pymantaray.acoustics.currents import Currents, current_delays
from pymantaray.acoustics.eigenrays import solved_backwards
from pymantaray.acoustics.selection import NEAR_DB, is_near_cutoff, within_cutoff
from pymantaray.arrays import Array, Codes, Mask
from pymantaray.errors import SensingError
from pymantaray.jobs.progress import CountProgress
from pymantaray.records import Arrivals, RayStatus
from pymantaray.sensing.detection import Detector
from pymantaray.sensing.receptions import (
    NO_RAY,
    AlongRays,
    Receptions,
    receptions_of,
    select_receptions,
    values_at,
    with_detection,
    with_leaks,
    within_cone,
)

LinkEnds = tuple[Array, Array]
"""Positions of the sources and of the receivers of links, each of shape (n_links, 3). [m]"""
_BLOCK = 512  # links whose ray paths are in memory at a time
_WITHOUT_RAY = (RayStatus.SHADOW, RayStatus.WEAK, RayStatus.BLOCKED, RayStatus.UNRESOLVED)


class ReceptionOptions(NamedTuple):
    """
    Arrivals that every receiver can detect, and the one that it ranges on.

    Parameters
    ----------
    spreading_cutoff_db : float or None
        Maximum spreading of an eigenray that counts as an arrival, see
        `pymantaray.acoustics.find_eigenrays`. [dB]
    max_surface_bounces, max_bottom_bounces : int
        Maximum numbers of reflections of an arrival.
    arrival : {"direct", "first", "strongest", "direct-or-first"}
        Rule that selects the arrival of a range, see `pymantaray.acoustics.select`.
    detector : Detector, optional
        Model of the probability of detection. Default: every arrival is detected.
    leakage : Leakage, optional
        Model of sound that arrives without a ray, at the detector's frequency. Default: no such
        sound.
    cone : float, optional
        Half-angle of the fan of launch angles of the transmitter, centred on the chord. Rays
        launched outside the fan are lost. [rad]
    threads : int, optional
        Threads of the ray solver; the result does not depend on it.
    solved : EarlierLinks, optional
        Memory of solved links; the result does not depend on it.
    """

    spreading_cutoff_db: float | None = 15.0
    max_surface_bounces: int = 0
    max_bottom_bounces: int = 0
    arrival: ArrivalRule = "direct"
    detector: Detector | None = None
    leakage: Leakage | None = None
    cone: float | None = None
    threads: int | None = None
    solved: "EarlierLinks | None" = None


DIRECT = ReceptionOptions()
"""Direct arrivals only, all of them detected."""


class Transmission(NamedTuple):
    """Sound between pairs of ends: arrivals, receptions, and outcomes of links."""

    arrivals: Arrivals
    """Eigenrays of all links; their travel times are those in water at rest."""
    status: Codes
    """
    `RayStatus` of each link by the selection rule; the same in both directions, except that a cone
    may lose the rays of one.
    """
    near_cutoff: Mask
    """True for links on which 1 dB of the cut-off changes the selection, in water at rest."""
    receptions: Receptions

    def selected(self, name: str) -> Array:
        """
        Return a column of the receptions at the selected rows.

        Parameters
        ----------
        name : str
            Field of `Receptions`.

        Returns
        -------
        ndarray, shape (2, n_links)
            Values by direction and link; NaN without a selected reception.
        """
        return values_at(
            getattr(self.receptions, name), self.receptions.selected_rows(self.status.size)
        )


class EarlierLinks(Protocol):
    """Memory of solved links, which solves only new ones."""

    def find(
        self,
        source: Array,
        receiver: Array,
        medium: Medium,
        reception: ReceptionOptions,
        *,
        currents: Currents | None = None,
        progress: CountProgress | None = None,
    ) -> Transmission:
        """Receptions of links, as from `find_receptions`."""


def find_receptions(
    source: Array,
    receiver: Array,
    medium: Medium,
    reception: ReceptionOptions = DIRECT,
    *,
    currents: Currents | None = None,
    progress: CountProgress | None = None,
) -> Transmission:
    """
    Find all receptions between pairs of ends, in both directions.

    Parameters
    ----------
    source, receiver : ndarray, shape (n_links, 3)
        Positions ``(north, east, down)`` in the local frame. [m]
    medium : Medium
    reception : ReceptionOptions
        By default direct arrivals, all of them detected.
    currents : Currents, optional
        Their first-order effect on travel times. By default the water is at rest.
    progress : callable, optional
        Called with the number of finished steps and the total. Each link has one step for its rays,
        one for the search for direct rays alone, and one for the paths of its rays, as far as these
        are needed.

    Returns
    -------
    Transmission

    Notes
    -----
    With the rule ``direct``, travel time and status of a link do not depend on the allowed bounces:
    a link without a direct arrival has the status that it has if no bounces are allowed. With
    ``direct-or-first``, travel times of links with a direct arrival do not depend on them.

    Examples
    --------
    Continues the example of `pymantaray.sensing`:

    >>> from pymantaray.sensing import ReceptionOptions, find_receptions
    >>> ends = truth.position[:1, 0], truth.position[1:, 0]
    >>> sound = find_receptions(*ends, medium, ReceptionOptions(max_surface_bounces=1))
    >>> print(sound.status, sound.receptions.travel_time.round(4), sound.receptions.selected)
    [0] [1.393  1.3993 1.393  1.3993] [1 0 1 0]
    """
    if reception.solved is not None:
        fresh = reception._replace(solved=None)
        return reception.solved.find(
            source, receiver, medium, fresh, currents=currents, progress=progress
        )
    ends = (source, receiver)
    n = len(source)
    needs_paths = currents is not None or reception.detector is not None
    reflections_allowed = reception.max_surface_bounces > 0 or reception.max_bottom_bounces > 0
    needs_direct_search = reception.arrival in ("direct", "direct-or-first") and reflections_allowed
    total = n * (1 + needs_direct_search + needs_paths)

    def progress_from(before: int) -> CountProgress | None:
        return None if progress is None else lambda done, _: progress(before + done, total)

    max_bounces = reception.max_surface_bounces, reception.max_bottom_bounces
    arrivals, near_cutoff = _rays(reception, medium, ends, max_bounces, progress_from(0))
    status = _status(arrivals, reception.arrival)
    # the outcome of links without a direct arrival must not depend on the allowed bounces (Notes)
    if needs_direct_search:
        missing = np.flatnonzero(_status(arrivals, "direct") != RayStatus.OK)
        missing_ends = source[missing], receiver[missing]
        direct, near_direct = _rays(
            reception, medium, missing_ends, (0, 0), progress_from(2 * n - missing.size)
        )
        near_cutoff[missing] |= near_direct
        # direct-or-first: a link with a reflected arrival has a range
        has_reflection = (status[missing] == RayStatus.OK) & (reception.arrival != "direct")
        status[missing] = np.where(has_reflection, np.int8(RayStatus.OK), direct.status)
        arrivals = arrivals.with_more(vars(direct) | {"link": missing[direct.link]})
    last = progress_from(n * (1 + needs_direct_search))
    along = _along_rays(reception, medium, currents, ends, arrivals, last)
    receptions = receptions_of(arrivals, along)
    if reception.detector is not None:
        receptions = with_detection(receptions, reception.detector.sonar)
    if reception.leakage is not None:
        receptions = _with_leaks(receptions, status, ends, medium, reception, currents)
    if reception.cone is not None:
        receptions = within_cone(receptions, source, receiver, reception.cone)
    receptions = select_receptions(receptions, reception.arrival)
    # a link has a status of its own: it is lost if the cone loses its rays in both directions
    if reception.cone is not None:
        is_lost = (receptions.selected_rows(n) < 0).all(axis=0)
        status[is_lost & (status == RayStatus.OK)] = RayStatus.SHADOW
    # a link without a ray has the status of the sound that reaches its receiver
    if reception.leakage is not None:
        for path, code in NO_RAY.items():
            status[receptions.link[receptions.path == path]] = code
    return Transmission(arrivals, status, near_cutoff, receptions)


def _status(arrivals: Arrivals, rule: ArrivalRule) -> Codes:
    """
    Status of links by a rule.

    It is SHADOW for links with reflected arrivals only, if the rule is ``direct``.
    """
    status: Codes = arrivals.status.copy()
    if rule == "direct":
        is_reflected = (arrivals.surface_bounces > 0) | (arrivals.bottom_bounces > 0)
        has_direct = np.bincount(arrivals.link[~is_reflected], minlength=status.size) > 0
        status[(status == RayStatus.OK) & ~has_direct] = RayStatus.SHADOW
    return status


def _rays(
    reception: ReceptionOptions,
    medium: Medium,
    ends: LinkEnds,
    bounces: tuple[int, int],
    progress: CountProgress | None,
) -> tuple[Arrivals, Mask]:
    """Arrivals of links, and True for links on which 1 dB of the cut-off changes the selection."""
    cutoff = reception.spreading_cutoff_db
    wide = find_eigenrays(
        medium,
        *ends,
        *bounces,
        None if cutoff is None else cutoff + NEAR_DB,
        threads=reception.threads,
        progress=progress,
    )
    if cutoff is None:
        return wide, np.zeros(wide.status.size, dtype=bool)
    return within_cutoff(wide, cutoff), is_near_cutoff(wide, cutoff, reception.arrival)


def _with_leaks(
    receptions: Receptions,
    status: Codes,
    ends: LinkEnds,
    medium: Medium,
    reception: ReceptionOptions,
    currents: Currents | None,
) -> Receptions:
    """Add receptions of leaked or scattered sound on links without a ray."""
    detector = reception.detector
    leakage = reception.leakage
    if leakage is None or detector is None:
        raise SensingError(
            "ReceptionOptions: leakage needs a detector, because it depends on the frequency; add"
            " a detector, or remove leakage"
        )
    dark = np.flatnonzero(np.isin(status, _WITHOUT_RAY))
    source, receiver = (end[dark] for end in ends)
    # trace in the direction of the rays, so that both ends give the same result
    backwards = solved_backwards(source, receiver)[:, None]
    start = np.where(backwards, receiver, source)
    end = np.where(backwards, source, receiver)
    direct = reception.arrival == "direct"
    leaks = find_leaks(
        medium,
        start,
        end,
        leakage,
        detector.sonar.frequency_hz,
        bounces=(0, 0) if direct else (reception.max_surface_bounces, reception.max_bottom_bounces),
        spreading_cutoff_db=reception.spreading_cutoff_db,
        threads=reception.threads,
    )
    leak_ends = start[leaks.link], leaks.place
    along = _along_rays(
        reception, medium, currents, leak_ends, leaks.arrivals, None, with_tails=False
    )
    with_leaks_added = with_leaks(
        receptions, dark[leaks.link], leaks, along, backwards[leaks.link, 0]
    )
    return with_detection(with_leaks_added, detector.sonar)


def _along_rays(
    reception: ReceptionOptions,
    medium: Medium,
    currents: Currents | None,
    ends: LinkEnds,
    arrivals: Arrivals,
    progress: CountProgress | None,
    *,
    with_tails: bool = True,
) -> AlongRays:
    """
    Delay by the current and loss of each arrival; None if not needed.

    The loss includes sound behind caustics if `with_tails`.
    """
    if currents is None and reception.detector is None:
        return AlongRays(None, None)
    if medium.surface.roughness is not None and np.any(arrivals.surface_bounces):
        if currents is not None or reception.detector is None:
            raise SensingError(
                "currents along rays: they need the paths of the rays, which are not traced under"
                " rough ice; leave out `ice_slope_deg`, or use `currents='rest'`"
            )
        return AlongRays(None, reception.detector.loss_db(medium, *ends, arrivals, None))
    delay = np.zeros(arrivals.link.size)
    loss = np.zeros(arrivals.link.size)
    for start in range(0, arrivals.status.size, _BLOCK):
        stop = min(start + _BLOCK, arrivals.status.size)
        rows = slice(*np.searchsorted(arrivals.link, [start, stop]))
        part = arrivals.at({"arrival": rows, "n_links": slice(start, stop)})
        part = replace(part, link=part.link - start)
        source, receiver = (end[start:stop] for end in ends)
        paths = trace_paths(medium, source, receiver, part, threads=reception.threads)
        if currents is not None:
            delay[rows] = current_delays(quadrature(paths), currents, part.link.size)
        if reception.detector is not None:
            tails = None
            if with_tails and reception.leakage is not None:
                max_bounces = reception.max_surface_bounces, reception.max_bottom_bounces
                tails = reception.detector.tails(
                    medium, source, receiver, part, max_bounces, reception.threads
                )
            loss[rows] = reception.detector.loss_db(medium, source, receiver, part, paths, tails)
        if progress is not None:
            progress(stop, arrivals.status.size)
    return AlongRays(
        None if currents is None else delay, None if reception.detector is None else loss
    )

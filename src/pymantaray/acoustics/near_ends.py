"""
Links whose ends coincide or nearly do, such as those of echo sounders: direct rays in closed form,
reflected rays by the solver.

The solver needs a direction from source to receiver and divides by their distance. Such links are
solved with ends that are a micrometre apart, which changes the travel time of a reflected ray by
less than a nanosecond. The direct ray between the true ends is straight. The cut-off compares rays
with spherical spreading over the distance of the ends. Within one instrument this says nothing
about an echo, so links shorter than `SHORT_LINK` keep all of theirs.
"""

from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics.medium import Medium
from pymantaray.acoustics.selection import SHORT_LINK
from pymantaray.arrays import Array, Mask
from pymantaray.records import Arrivals, RayStatus

NEAR = 1e-6
"""
Distance of the ends that the solver gets, to which the spreading of reflected rays refers. [m]
"""
_DIRECT_TIME = 1e-8  # s; direct rays of the moved ends are shorter


def nearly_coincident(source: Array, receiver: Array) -> Mask:
    """True for each link whose ends (n, 3) differ by less than a micrometre along each axis."""
    return np.asarray((np.abs(receiver - source) < NEAR).all(axis=1))


def separated(medium: Medium, source: Array, receiver: Array) -> tuple[Array, Mask]:
    """
    Receivers (n, 3) for the solver, those that coincide with their source moved north or south, and
    which links have these.
    """
    near = nearly_coincident(source, receiver)
    if not near.any():
        return receiver, near
    out = receiver.copy()
    step = _steps(source[near])
    inside = medium.north.size == 1 or source[near, 0] + step <= medium.north[-1]
    out[near] = source[near]
    out[near, 0] += np.where(inside, step, -step)
    return out, near


def _steps(source: Array) -> Array:
    """Distances that the numbers of positions can represent. [m]"""
    return np.maximum(NEAR, 8.0 * np.spacing(np.abs(source[:, 0])))


def with_direct_rays(arrivals: Arrivals, source: Array, receiver: Array, near: Mask) -> Arrivals:
    """
    Arrivals of links whose receivers were moved, with the direct rays between the true ends as the
    first of these links.
    """
    if not near.any():
        return arrivals
    direct = (arrivals.surface_bounces == 0) & (arrivals.bottom_bounces == 0)
    kept = np.flatnonzero(~(near[arrivals.link] & direct & (arrivals.travel_time < _DIRECT_TIME)))
    links = np.flatnonzero(near & (arrivals.status != RayStatus.OUTSIDE))
    own = _direct_rays(arrivals, links, receiver[links] - source[links])
    further = np.where(near, 20.0 * np.log10(_steps(source) / NEAR), 0.0)
    arrivals = replace(arrivals, spreading_db=arrivals.spreading_db + further[arrivals.link])
    # the direct ray is the first of its link
    order = np.argsort(np.concatenate([2 * arrivals.link[kept] + 1, 2 * links]), kind="stable")
    n_arrivals = arrivals.link.size
    columns = {}
    for column in fields(arrivals):
        values = getattr(arrivals, column.name)
        if column.name in own and len(values) == n_arrivals:
            columns[column.name] = np.concatenate([values[kept], own[column.name]])[order]
    chord, margin, status = (
        np.array(values)
        for values in (arrivals.chord_travel_time, arrivals.shadow_margin, arrivals.status)
    )
    chord[links] = own["travel_time"]
    margin[links] = 0.0
    status[links] = RayStatus.OK
    return replace(
        arrivals, **columns, chord_travel_time=chord, shadow_margin=margin, status=status
    )


def of_one_instrument(source: Array, receiver: Array) -> NDArray[np.intp]:
    """Links whose ends (n, 3) are less than `SHORT_LINK` apart."""
    # each axis first, so that no square overflows
    near = (np.abs(receiver - source) < SHORT_LINK).all(axis=1)
    links = np.flatnonzero(near)
    distance = np.linalg.norm(receiver[links] - source[links], axis=1)
    return np.asarray(links[distance < SHORT_LINK])


def with_echoes(arrivals: Arrivals, links: NDArray[np.intp], echoes: Arrivals) -> Arrivals:
    """Arrivals with those of some links replaced."""
    columns = {}
    for column in ("status", "shadow_margin", "complete"):
        values = np.array(getattr(arrivals, column))
        values[links] = getattr(echoes, column)
        columns[column] = values
    others = replace(arrivals.at({"arrival": ~np.isin(arrivals.link, links)}), **columns)
    rows = {field.name: getattr(echoes, field.name) for field in fields(echoes)}
    return others.with_more(rows | {"link": links[echoes.link]})


def _direct_rays(arrivals: Arrivals, links: NDArray[np.intp], step: Array) -> dict[str, Array]:
    """Rows of the straight rays of links by column; directions are NaN between equal positions."""
    largest = np.abs(step).max(axis=1, keepdims=True, initial=0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        unit = step / largest  # lengths below 1e-154 m have no square
        unit /= np.linalg.norm(unit, axis=1, keepdims=True)
        length = np.where(
            largest[:, 0] > 0.0, largest[:, 0] * np.linalg.norm(step / largest, axis=1), 0.0
        )
    speed = arrivals.source_sound_speed[links]
    angle = np.arctan2(unit[:, 2], np.hypot(unit[:, 0], unit[:, 1]))
    none = np.zeros(links.size)
    return {
        "link": links,
        "travel_time": length / speed,
        "surface_bounces": none,
        "bottom_bounces": none,
        "turning_points": none,
        "caustics": none,
        "launch_angle": angle,
        "arrival_angle": angle,
        "spreading_db": np.where(length > 0.0, 0.0, np.nan),
        "source_slowness": unit / speed[:, None],
        "receiver_slowness": unit / speed[:, None],
        "ray_axis": none,
    }

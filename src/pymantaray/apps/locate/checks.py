"""Checks for impossible input before and after a solve."""

import math

import numpy as np

from pymantaray.acoustics import Medium
from pymantaray.apps.locate.evidence import posterior
from pymantaray.apps.locate.solve import SurveySolution
from pymantaray.apps.locate.starts import mean_speed
from pymantaray.apps.locate.survey import Survey, TravelDirection
from pymantaray.apps.locate.travel_times import transducers
from pymantaray.arrays import Array
from pymantaray.errors import LocateError
from pymantaray.geometry.longitude import wrap_longitude
from pymantaray.records.text_table import check_speed

_MAX_DISTANCE = 100_000.0  # m; no node answers from a greater distance
_MILLISECONDS = (300.0, 3000.0)  # ratio of measured to expected times with a wrong unit
_MIN_STEPS = 10  # between pings, to compare headings with the course
# mean resultant length of course minus heading of a platform that heads along its course
_MIN_RESULTANT = 0.8
_LEVER_GAIN = 0.6  # ratio of the rms of residuals with the better sign
_LEVER_CHI_SQUARE = 200.0
_MAX_EXTRAPOLATION = 10.0  # m of a node below a profile's last level, or 1 % of its depth
_MAX_HEIGHT = (
    2.0  # m of a transducer above the surface: waves; more is another reference of heights
)
_RARE = 0.05  # fraction of pings that may exceed it, as errors of single heights do
_MAX_BELOW_BED = 1.0  # m of a node
_ON_BOUNDARY = 2e-3  # m
_AXES = ("forward", "starboard", "down")


def check_places(
    where: str, platform: tuple[Array, Array], node: tuple[float, float], name: str
) -> None:
    """
    Raise an error if the distance of platform and node implies a wrong sign or order of
    coordinates. [degrees]
    """
    lat = float(np.median(platform[0]))
    lon = float(np.median(platform[1]))
    if _distance(lat, lon, *node) < _MAX_DISTANCE:
        return
    advice = "check both"
    for lat_2, lon_2, what in (
        (lat, -lon, "one of the longitudes has the wrong sign (east or west)"),
        (-lat, lon, "one of the latitudes has the wrong sign (north or south)"),
        (-lat, -lon, "latitude and longitude of one have the wrong sign"),
        (lon, lat, "latitude and longitude of one are exchanged"),
    ):
        if _distance(lat_2, lon_2, *node) < _MAX_DISTANCE:
            advice = what
    away = _distance(lat, lon, *node) / 1000.0
    raise LocateError(
        f"{where}: the platform is at {lat:.4f}, {lon:.4f} and node {name} at {node[0]:.4f},"
        f" {node[1]:.4f}, {away:,.0f} km apart; {advice}"
    )


def _distance(lat: float, lon: float, lat_2: float, lon_2: float) -> float:
    """Distance on a sphere. [m]"""
    a = math.radians(lat)
    b = math.radians(lat_2)
    turn = math.radians(float(wrap_longitude(np.asarray(lon_2 - lon))))
    inner = math.sin((b - a) / 2.0) ** 2 + math.cos(a) * math.cos(b) * math.sin(turn / 2.0) ** 2
    return 2.0 * 6371e3 * math.asin(min(1.0, math.sqrt(max(inner, 0.0))))


def check_survey(survey: Survey, medium: Medium) -> None:
    """Raise an error for impossible units and signs before the solve."""
    _check_times(survey)
    own = ~survey.between_nodes
    check_speed(
        survey.time[own], survey.transmit_position[own], f"{survey.source}: time", LocateError
    )
    moved_to_water(survey, medium, np.array(survey.lever.offset))
    for node in survey.nodes:
        if node.position[2] < 0.0:
            raise LocateError(
                f"node {node.name}: its prior depth is {node.position[2]:g} m, above the surface;"
                " depths are positive down"
            )
    _check_turn_around(survey)
    _check_attitude(survey)
    _check_units(survey, medium)
    for node in survey.nodes:
        if node.position[2] > _deepest(medium, node.position[2]):
            raise LocateError(
                f"profile: it ends at {medium.depth[-1]:g} m, above node {node.name} at"
                f" {node.position[2]:g} m; extend it down to the node"
            )


def check_solution(solution: SurveySolution, medium: Medium) -> None:
    """
    Raise an error for a profile that ends above a node, or a lever arm with a wrong sign, after the
    solve.
    """
    for name, place in zip(solution.unknowns.survey.names, solution.positions, strict=True):
        if place[2] > _deepest(medium, place[2]):
            raise LocateError(
                f"profile: it ends at {medium.depth[-1]:g} m, above node {name} at {place[2]:.0f}"
                " m; extend it down to the node"
            )
    _check_lever(solution)


def moved_to_water(survey: Survey, medium: Medium, lever: Array) -> tuple[str, ...]:
    """
    Notes about transducers outside the water, whose rays end at its boundary; too many too far
    outside raise an error.
    """
    ends = [end[~survey.between_nodes] for end in transducers(survey, lever)]
    count = len(ends[0])
    if not count:
        return ()
    height = np.maximum(-ends[0][:, 2], -ends[1][:, 2])
    in_ice = np.maximum(*(medium.surface_depth(end) - np.maximum(end[:, 2], 0.0) for end in ends))
    below = np.maximum(*(end[:, 2] - medium.bottom_depth(end) for end in ends))
    notes = []
    for size, where, question in (
        (
            height,
            "above the surface",
            "are these ellipsoidal heights, or has the lever arm the wrong sign?",
        ),
        (below, "below the sea bed", "check the depths and the sea bed."),
        (in_ice, "above the underside of the ice", ""),
    ):
        outside = int(np.count_nonzero(size > _ON_BOUNDARY))
        if not outside:
            continue
        line = (
            f"{survey.source}: the transducer is up to {size.max():.1f} m {where} in {outside} of"
            f" {count} pings"
        )
        if question and np.count_nonzero(size > _MAX_HEIGHT) > _RARE * count:
            raise LocateError(
                f"{line}; {question} Depths must be positive down from the sea surface"
            )
        notes.append(f"{line}; its rays end there")
    return tuple(notes)


def below_bed(solution: SurveySolution, medium: Medium) -> tuple[str, ...]:
    """
    Notes about nodes below the sea bed, whose rays end at the bed; more than a metre raises an
    error.
    """
    place = solution.positions
    depth = place[:, 2] - medium.bottom_depth(place)
    notes = []
    for k in np.flatnonzero(depth > _ON_BOUNDARY):
        name = solution.unknowns.survey.names[k]
        bed = place[k, 2] - depth[k]
        line = (
            f"node {name} at {place[k, 2]:.1f} m is below the sea bed of the water at {bed:.1f} m"
        )
        if depth[k] > _MAX_BELOW_BED:
            raise LocateError(f"{line}; give a deeper sea bed (bathymetry), or check its pings")
        notes.append(f"{line}; its rays end at the bed")
    return tuple(notes)


def _deepest(medium: Medium, depth: float) -> float:
    return float(medium.depth[-1]) + max(_MAX_EXTRAPOLATION, 0.01 * depth)


def _check_times(survey: Survey) -> None:
    falls = np.flatnonzero(np.diff(survey.time) < 0.0)
    if falls.size:
        row = int(falls[0]) + 1
        raise LocateError(
            f"{survey.where(row)}: time {survey.time[row]:.3f} s is before the time of the previous"
            f" ping, {survey.time[row - 1]:.3f} s; times must not decrease; sort the rows"
        )


def _check_turn_around(survey: Survey) -> None:
    delay = np.array([node.turn_around for node in survey.nodes])[survey.node]
    long = (survey.direction == TravelDirection.TWO_WAY) & (delay >= np.median(survey.travel_time))
    if long.any():
        row = int(np.argmax(long))
        raise LocateError(
            f"turn-around time of node {survey.names[survey.node[row]]} is {delay[row]:g} s, longer"
            " than most two-way times; write milliseconds as '13 ms'"
        )


def _check_attitude(survey: Survey) -> None:
    """Raise an error if headings match the course only as radians."""
    heading = survey.transmit_attitude[:, 0]
    as_radians = np.degrees(heading)  # numbers of the file, interpreted as radians
    if np.ptp(as_radians) < 0.5:
        return
    moved = np.diff(survey.transmit_position[:, :2], axis=0)
    gone = np.linalg.norm(moved, axis=1) > 0.5
    if gone.sum() < _MIN_STEPS:
        return
    course = np.arctan2(moved[:, 1], moved[:, 0])[gone]
    fits = {
        kind: float(np.abs(np.mean(np.exp(1j * (course - angle[:-1][gone])))))
        for kind, angle in (("degrees", heading), ("radians", as_radians))
    }
    if fits["radians"] > max(_MIN_RESULTANT, fits["degrees"] + 0.2):
        raise LocateError(
            f"{survey.source}: headings from {as_radians.min():.2f} to {as_radians.max():.2f} match"
            " the course only as radians; write attitudes in degrees"
        )


def _check_units(survey: Survey, medium: Medium) -> None:
    """
    Raise an error if times are in milliseconds: a thousand times too long for the prior positions.
    """
    near, _ = transducers(survey, np.array(survey.lever.offset))
    nodes = np.array([node.position for node in survey.nodes])
    alone = ~survey.between_nodes
    if not alone.any():
        return
    distance = np.linalg.norm(near - nodes[survey.node], axis=1)[alone]
    speed = mean_speed(medium, 0.0, float(nodes[:, 2].max()))
    two_way = survey.direction[alone] == TravelDirection.TWO_WAY
    expected = distance / speed * np.where(two_way, 2.0, 1.0)
    ratio = float(np.median(survey.travel_time[alone] / np.maximum(expected, 1e-6)))
    low, high = _MILLISECONDS
    if low < 1.0 / max(ratio, 1e-9) < high:
        raise LocateError(
            f"{survey.source}: travel times are {1.0 / ratio:,.0f} times shorter than those of the"
            f" prior positions (median {np.median(survey.travel_time):g} s); they must be in the"
            " unit of their column's name"
        )
    if low < ratio < high and np.median(survey.travel_time) > 5.0:
        raise LocateError(
            f"{survey.source}: travel times are {ratio:,.0f} times those of the prior positions"
            f" (median {np.median(survey.travel_time):g} s); they must be in seconds; divide"
            " milliseconds by 1000"
        )


def _check_lever(solution: SurveySolution) -> None:
    """Raise an error if another sign of a known lever arm explains the residuals much better."""
    unknowns = solution.unknowns
    fit = solution.posterior
    at = solution.unknowns.slices["lever"]
    lever = solution.values[at]
    if not np.any(np.abs(lever) > 0.1) or any(unknowns.survey.lever.sigma):
        return
    products = solution.products
    best = (1.0, lever)
    now = fit.squares * fit.sigma**2
    for axes in range(1, 8):
        turned = np.array([-value if axes >> k & 1 else value for k, value in enumerate(lever)])
        if np.array_equal(np.abs(turned - lever) > 0.1, np.zeros(3, dtype=bool)):
            continue
        move = np.zeros(unknowns.size)
        move[at] = turned - lever
        right = products.right - products.normal @ move
        squares = products.squares - 2.0 * products.right @ move + move @ products.normal @ move
        other = posterior(
            products._replace(right=right, squares=float(squares)),
            unknowns,
            solution.values,
            fit.hyperparameters,
            sigma=fit.sigma,
            steps=1,
        )
        gain = other.squares * fit.sigma**2 / max(now, 1e-300)
        if gain < best[0] - 1e-6:
            best = gain, turned
    saved = (1.0 - best[0]) * fit.squares
    if np.sqrt(best[0]) < _LEVER_GAIN and saved > _LEVER_CHI_SQUARE:
        wrong = [name for name, a, b in zip(_AXES, lever, best[1], strict=True) if a != b]
        raise LocateError(
            f"{unknowns.survey.source}: lever arm {', '.join(f'{x:g}' for x in lever)} m (forward,"
            f" starboard, down): residuals decrease to {100.0 * np.sqrt(best[0]):.0f} % with the"
            f" other sign of {' and '.join(wrong)}; change the sign"
        )

"""Checks for impossible input before and after a solve."""

from dataclasses import replace

import numpy as np

from pymantaray.acoustics import Medium
from pymantaray.apps.locate.earth import in_water
from pymantaray.apps.locate.evidence import posterior
from pymantaray.apps.locate.solve import SurveySolution
from pymantaray.apps.locate.survey import LeverArm, Survey, TravelDirection
from pymantaray.apps.locate.travel_times import transducers
from pymantaray.arrays import Array
from pymantaray.errors import LocateError
from pymantaray.records.text_table import check_speed

_MILLISECONDS = (300.0, 3000.0)  # ratio of measured to expected times with a wrong unit
_NOMINAL_SPEED = 1500.0  # m/s
_MIN_STEPS = 10  # between pings, to compare headings with the course
# mean resultant length of course minus heading of a platform that heads along its course
_MIN_RESULTANT = 0.8
_MIN_LEVER = 0.1  # m; the sign of a shorter one is not checked
_LEVER_GAIN = 0.6  # ratio of the rms of residuals with the better sign
_LEVER_CHI_SQUARE = 200.0
_MAX_EXTRAPOLATION = 10.0  # m of a node below a profile's last level, or 1 % of its depth
_MAX_HEIGHT = 2.0  # m of a transducer above the surface (waves); more is another vertical datum
_RARE = 0.05  # fraction of pings that may exceed it, as errors of single heights do
_MAX_BELOW_BED = 1.0  # m of a node
_ON_BOUNDARY = 2e-3  # m
_AXES = ("forward", "starboard", "down")


def check_survey(survey: Survey, medium: Medium) -> None:
    """Raise an error for impossible units and signs before the solve."""
    _check_times(survey)
    from_platform = ~survey.between_nodes
    check_speed(
        survey.time[from_platform],
        survey.transmit_position[from_platform],
        f"{survey.source}: time",
        LocateError,
    )
    _notes_outside_water(survey, medium, np.array(survey.lever.offset))
    for node in survey.nodes:
        if node.position[2] < 0.0:
            raise LocateError(
                f"node {node.name}: its prior depth is {node.position[2]:g} m, above the surface;"
                " depths are positive down"
            )
    delay = np.array([node.turn_around for node in survey.nodes])[survey.node]
    is_long = delay >= np.median(survey.travel_time)
    is_long &= survey.direction == TravelDirection.TWO_WAY
    if is_long.any():
        row = int(np.argmax(is_long))
        raise LocateError(
            f"turn-around time of node {survey.names[survey.node[row]]} is {delay[row]:g} s, longer"
            " than most two-way times; write milliseconds as '13 ms'"
        )
    _check_attitude(survey)
    _check_units(survey)
    for node in survey.nodes:
        _check_depth(medium, node.name, node.position[2])


def check_solution(solution: SurveySolution, medium: Medium) -> tuple[str, ...]:
    """
    Notes about nodes and transducers outside the water; too far outside raises an error.

    A profile that ends above a node and a wrong sign of the lever arm raise an error, too.
    """
    notes = _notes_below_bed(solution, medium)
    for name, position in zip(solution.unknowns.survey.names, solution.positions, strict=True):
        _check_depth(medium, name, position[2])
    _check_lever(solution)
    lever = solution.unknowns.lever(solution.values)
    return notes + _notes_outside_water(solution.unknowns.survey, medium, lever)


def _check_depth(medium: Medium, name: str, depth: float) -> None:
    """Raise an error for a profile that ends above a node."""
    if depth > float(medium.depth[-1]) + max(_MAX_EXTRAPOLATION, 0.01 * depth):
        raise LocateError(
            f"profile: it ends at {medium.depth[-1]:g} m, above node {name} at {depth:.0f} m;"
            " extend it down to the node"
        )


def _notes_outside_water(survey: Survey, medium: Medium, lever: Array) -> tuple[str, ...]:
    """
    Notes about transducers outside the water, whose rays end at its boundary.

    Too many too far outside raise an error.
    """
    ends = [
        in_water(survey, medium, end[~survey.between_nodes]) for end in transducers(survey, lever)
    ]
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


def _notes_below_bed(solution: SurveySolution, medium: Medium) -> tuple[str, ...]:
    """
    Notes about nodes below the sea bed, whose rays end at the bed.

    More than a metre raises an error.
    """
    position = in_water(solution.unknowns.survey, medium, solution.positions)
    depth = position[:, 2] - medium.bottom_depth(position)
    notes = []
    for k in np.flatnonzero(depth > _ON_BOUNDARY):
        name = solution.unknowns.survey.names[k]
        bed_depth = position[k, 2] - depth[k]
        line = (
            f"node {name} at {position[k, 2]:.1f} m is below the sea bed of the water at"
            f" {bed_depth:.1f} m"
        )
        if depth[k] > _MAX_BELOW_BED:
            raise LocateError(f"{line}; give a deeper sea bed (bathymetry), or check its pings")
        notes.append(f"{line}; its rays end at the bed")
    return tuple(notes)


def _check_times(survey: Survey) -> None:
    has_clock = np.array([node.offset_sigma > 0.0 for node in survey.nodes])
    is_known = ~has_clock[survey.node] & ~has_clock[np.maximum(survey.partner, 0)]
    survey.refuse(
        "travel_time",
        (survey.travel_time <= 0.0) & is_known,
        "positive seconds, or a clock offset with `offset_sigma`",
    )
    falls = np.flatnonzero(np.diff(survey.time) < 0.0)
    if falls.size:
        row = int(falls[0]) + 1
        raise LocateError(
            f"{survey.where(row)}: time {survey.time[row]:.3f} s is before the time of the previous"
            f" ping, {survey.time[row - 1]:.3f} s; times must not decrease; sort the rows"
        )


def _check_attitude(survey: Survey) -> None:
    """Raise an error if headings match the course only as radians."""
    heading = survey.transmit_attitude[:, 0]
    as_radians = np.degrees(heading)  # numbers of the file, interpreted as radians
    if np.ptp(as_radians) < 0.5:
        return
    step = np.diff(survey.transmit_position[:, :2], axis=0)
    has_moved = np.linalg.norm(step, axis=1) > 0.5
    if has_moved.sum() < _MIN_STEPS:
        return
    course = np.arctan2(step[:, 1], step[:, 0])[has_moved]
    fits = {
        kind: float(np.abs(np.mean(np.exp(1j * (course - angle[:-1][has_moved])))))
        for kind, angle in (("degrees", heading), ("radians", as_radians))
    }
    if fits["radians"] > max(_MIN_RESULTANT, fits["degrees"] + 0.2):
        raise LocateError(
            f"{survey.source}: headings from {as_radians.min():.2f} to {as_radians.max():.2f} match"
            " the course only as radians; write attitudes in degrees"
        )


def _check_units(survey: Survey) -> None:
    """Raise an error for times in milliseconds, a thousand times those of the prior positions."""
    transmit_position, _ = transducers(survey, np.array(survey.lever.offset))
    nodes = np.array([node.position for node in survey.nodes])
    from_platform = ~survey.between_nodes
    if not from_platform.any():
        return
    distance = np.linalg.norm(transmit_position - nodes[survey.node], axis=1)[from_platform]
    two_way = survey.direction[from_platform] == TravelDirection.TWO_WAY
    expected_time = distance / _NOMINAL_SPEED * np.where(two_way, 2.0, 1.0)
    ratio = float(np.median(survey.travel_time[from_platform] / np.maximum(expected_time, 1e-6)))
    low, high = _MILLISECONDS
    times = f"of the prior positions (median {np.median(survey.travel_time):g} s); they must be in"
    if low < 1.0 / max(ratio, 1e-9) < high:
        raise LocateError(
            f"{survey.source}: travel times are {1.0 / ratio:,.0f} times shorter than those"
            f" {times} the unit of their column's name"
        )
    if low < ratio < high and np.median(survey.travel_time) > 5.0:
        raise LocateError(
            f"{survey.source}: travel times are {ratio:,.0f} times those {times} seconds; divide"
            " milliseconds by 1000"
        )


def _check_lever(solution: SurveySolution) -> None:
    """Raise an error if a known lever arm explains the residuals much better with other signs."""
    unknowns = solution.unknowns
    stated = np.array(unknowns.survey.lever.offset)
    is_long = np.abs(stated) > _MIN_LEVER
    if not is_long.any() or any(unknowns.survey.lever.sigma):
        return
    # compare the stated one with one that is estimated with the other unknowns
    sigma = 2.0 * np.abs(stated) + _MIN_LEVER
    arm = LeverArm(unknowns.survey.lever.offset, (sigma[0], sigma[1], sigma[2]))
    known = replace(unknowns, lever_doubt=0.0)
    fit, free = (
        posterior(
            solution.products,
            columns,
            solution.values,
            solution.posterior.hyperparameters,
            sigma=solution.posterior.sigma,
            steps=1,
        )
        for columns in (known, replace(known, survey=unknowns.survey.assign(lever=arm)))
    )
    estimate = unknowns.lever(solution.values + free.change)
    is_wrong = is_long & (estimate * np.sign(stated) < -0.5 * np.abs(stated))
    ratio = np.sqrt(free.squares / max(fit.squares, 1e-300))
    if is_wrong.any() and ratio < _LEVER_GAIN and fit.squares - free.squares > _LEVER_CHI_SQUARE:
        wrong = " and ".join(name for name, is_it in zip(_AXES, is_wrong, strict=True) if is_it)
        raise LocateError(
            f"{unknowns.survey.source}: lever arm {', '.join(f'{value:g}' for value in stated)} m"
            f" (forward, starboard, down): residuals decrease to {100.0 * ratio:.0f} % with the"
            f" other sign of {wrong}; change the sign"
        )

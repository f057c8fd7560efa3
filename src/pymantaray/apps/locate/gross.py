"""Reasons for unused pings: flag, no ray, answer of another node, later echo, or gross error."""

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.apps.locate.earth import in_water
from pymantaray.apps.locate.evidence import robust_sigma
from pymantaray.apps.locate.solve import SurveySolution
from pymantaray.apps.locate.survey import Survey, TravelDirection
from pymantaray.apps.locate.travel_times import Legs, predict, transducers
from pymantaray.arrays import Array
from pymantaray.records import RayStatus
from pymantaray.records.status import RAY_STATUS_WORDS

_MAX_EXAMINED = 2000  # gross errors
_MAX_DEVIATION = 10.0  # standard deviations between a ping and its explanation
_MIN_TOLERANCE = 1e-3  # s


def reasons(solution: SurveySolution, medium: Medium) -> NDArray[np.str_]:
    """Reason for each unused ping; empty for used pings."""
    survey = solution.unknowns.survey
    legs = solution.legs
    out = np.full(len(survey), "", dtype=object)
    for status in np.unique(legs.status[legs.status != RayStatus.OK]):
        word = RAY_STATUS_WORDS[RayStatus(int(status))].label
        out[legs.status == status] = f"no ray: {word}"
    out[survey.flagged] = "flagged in the file"
    gross = np.flatnonzero(~solution.used & (out == ""))
    residual = solution.linear.residual
    for ping in gross:
        out[ping] = f"gross error of {1e3 * residual[ping]:+.3g} ms"
    if gross.size:
        examined = gross[:_MAX_EXAMINED]
        tolerance = max(_MAX_DEVIATION * robust_sigma(residual[solution.used]), _MIN_TOLERANCE)
        for row, why in _explanations(solution, medium, examined, tolerance).items():
            out[row] = f"{why} ({1e3 * residual[row]:+.3g} ms)"
    return out.astype(str)


def _explanations(
    solution: SurveySolution, medium: Medium, rows: NDArray[np.int64], tolerance: float
) -> dict[int, str]:
    """Explanations by another node or a reflected path, by row."""
    survey = solution.unknowns.survey.rows(rows)
    out = _echoes(solution, medium, survey, rows, tolerance)
    from_platform = ~survey.between_nodes
    for k, node in enumerate(solution.unknowns.survey.nodes):
        others = np.flatnonzero(from_platform & (survey.node != k))
        if not others.size:
            continue
        renamed = survey.rows(others).assign(node=np.full(others.size, k))
        legs = predict(
            renamed, medium, solution.positions, solution.unknowns.lever(solution.values)
        )
        predicted_time = legs.travel_time * _slowing(solution, rows[others]) + np.where(
            renamed.direction == TravelDirection.TWO_WAY, node.turn_around, 0.0
        )
        for i in np.flatnonzero(np.abs(renamed.travel_time - predicted_time) < tolerance):
            out[int(rows[others[i]])] = f"answer of {node.name}"
    return out


def _slowing(solution: SurveySolution, rows: NDArray[np.int64]) -> Array:
    return np.asarray(solution.unknowns.slowing(solution.values)[rows])


def _echoes(
    solution: SurveySolution,
    medium: Medium,
    survey: Survey,
    rows: NDArray[np.int64],
    tolerance: float,
) -> dict[int, str]:
    """Explanations by reflections at the surface or the sea bed on one or both legs, by row."""
    out: dict[int, str] = {}
    candidates = np.flatnonzero(
        ~survey.between_nodes & (survey.direction == TravelDirection.TWO_WAY)
    )
    candidates = candidates[solution.linear.residual[rows[candidates]] > 0.0]
    if not candidates.size:
        return out
    pings = survey.rows(candidates)
    lever = solution.unknowns.lever(solution.values)
    legs: Legs = predict(pings, medium, solution.positions, lever)
    start = in_water(pings, medium, transducers(pings, lever)[0])
    start[:, 2] = np.maximum(start[:, 2], 1e-3)
    arrivals = find_eigenrays(
        medium,
        start,
        in_water(pings, medium, solution.positions)[pings.node],
        max_surface_bounces=1,
        max_bottom_bounces=1,
    )
    slowing = _slowing(solution, rows[candidates])
    residual = solution.linear.residual[rows[candidates]]
    is_reflected = (arrivals.surface_bounces + arrivals.bottom_bounces) > 0
    for link, time, surface, bottom in zip(
        arrivals.link[is_reflected],
        arrivals.travel_time[is_reflected],
        arrivals.surface_bounces[is_reflected],
        arrivals.bottom_bounces[is_reflected],
        strict=True,
    ):
        delay = (time - 0.5 * legs.travel_time[link]) * slowing[link]
        for times, where in ((1.0, "on one leg"), (2.0, "on both legs")):
            if abs(residual[link] - times * delay) < tolerance:
                out[int(rows[candidates[link]])] = (
                    f"later echo, {surface} surface and {bottom} bottom reflections {where}"
                )
    return out

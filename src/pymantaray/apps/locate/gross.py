"""Reasons for unused pings: flag, no ray, answer of another node, later echo, or gross error."""

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.apps.locate.earth import in_water
from pymantaray.apps.locate.evidence import robust_sigma
from pymantaray.apps.locate.solve import SurveySolution
from pymantaray.apps.locate.survey import TravelDirection
from pymantaray.apps.locate.travel_times import predict
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
    survey = solution.unknowns.survey
    slowing = solution.unknowns.slowing(solution.values)
    lever = solution.unknowns.lever(solution.values)
    rows = rows[~survey.between_nodes[rows]]
    is_late = solution.linear.residual[rows] > 0.0
    is_two_way = survey.direction[rows] == TravelDirection.TWO_WAY
    out = _echoes(solution, medium, rows[is_late & is_two_way], tolerance)
    for k, node in enumerate(survey.nodes):
        others = rows[survey.node[rows] != k]
        if not others.size:
            continue
        renamed = survey.rows(others).assign(node=np.full(others.size, k))
        legs = predict(renamed, medium, solution.positions, lever)
        is_two_way = renamed.direction == TravelDirection.TWO_WAY
        time = legs.travel_time * slowing[others] + np.where(is_two_way, node.turn_around, 0.0)
        is_answer = np.abs(renamed.travel_time - time) < tolerance
        out |= dict.fromkeys(others[is_answer].tolist(), f"answer of {node.name}")
    return out


def _echoes(
    solution: SurveySolution, medium: Medium, rows: NDArray[np.int64], tolerance: float
) -> dict[int, str]:
    """Explanations by reflections at the surface or the sea bed on one or both legs, by row."""
    out: dict[int, str] = {}
    if not rows.size:
        return out
    pings = solution.unknowns.survey.rows(rows)
    start = in_water(pings, medium, solution.transducers()[0][rows])
    start[:, 2] = np.maximum(start[:, 2], 1e-3)
    arrivals = find_eigenrays(
        medium,
        start,
        in_water(pings, medium, solution.positions)[pings.node],
        max_surface_bounces=1,
        max_bottom_bounces=1,
    )
    slowing = solution.unknowns.slowing(solution.values)[rows]
    both_legs = solution.legs.travel_time[rows]
    residual = solution.linear.residual[rows]
    bounces = zip(arrivals.surface_bounces, arrivals.bottom_bounces, strict=True)
    for link, time, (surface, bottom) in zip(
        arrivals.link, arrivals.travel_time, bounces, strict=True
    ):
        delay = (time - 0.5 * both_legs[link]) * slowing[link]
        for count, where in ((1.0, "on one leg"), (2.0, "on both legs")):
            if surface + bottom and abs(residual[link] - count * delay) < tolerance:
                out[int(rows[link])] = (
                    f"later echo, {surface} surface and {bottom} bottom reflections {where}"
                )
    return out

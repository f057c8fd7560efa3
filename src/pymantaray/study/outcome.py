"""How a run went, in a few numbers for the manifest and for warnings."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pymantaray.records import Estimates, RayStatus, SolveStatus, VehicleStatus
from pymantaray.study.mission import Mission


def summarize(mission: Mission, estimates: Estimates) -> dict[str, Any]:
    """
    Count what happened to links, vehicles and solves.

    Parameters
    ----------
    mission : Mission
    estimates : Estimates

    Returns
    -------
    dict
        ``links``: attempts by `RayStatus`; ``stopped_vehicles``: status and time by name;
        ``unhealthy_solves``: condition, realization and `SolveStatus` of each solve that is not OK; with a
        detector, ``expected_unheard``: mean number of attempts with an arrival that a realization does not hear;
        where receivers err, ``expected_mistaken``: mean number that take another arrival for the direct one.
    """
    status = mission.observations.range_status
    truth = mission.truth
    stopped = {
        str(name): {
            "status": VehicleStatus(int(row[-1])).name,
            "time_s": float(truth.time[np.argmax(row != VehicleStatus.ACTIVE)]),
        }
        for name, row in zip(truth.name, truth.status, strict=True)
        if row[-1] != VehicleStatus.ACTIVE
    }
    unhealthy = [
        {
            "condition": str(estimates.condition[c]),
            "realization": int(estimates.realization[r]),
            "status": SolveStatus(int(estimates.solve_status[c, r])).name,
        }
        for c, r in np.argwhere(estimates.solve_status != SolveStatus.OK)
    ]
    hearing = mission.hearing
    chance = {} if hearing is None else {"expected_unheard": _expected_unheard(status, mission)}
    if mission.candidates is not None:
        chance["expected_mistaken"] = mission.candidates.expected_mistaken
    return {
        "range_attempts": int(status.size),
        "links": {member.name: int(np.count_nonzero(status == member)) for member in RayStatus},
        **chance,
        "stopped_vehicles": stopped,
        "unhealthy_solves": unhealthy,
    }


def _expected_unheard(status: NDArray[np.int8], mission: Mission) -> float:
    probability = None if mission.hearing is None else mission.hearing.probability
    if mission.candidates is not None:
        taken = mission.candidates
        probability = np.bincount(taken.attempt, taken.probability, minlength=status.size)
    return 0.0 if probability is None else float(np.sum(1.0 - probability[status == RayStatus.OK]))

"""
Estimate of time and disk space of a sweep before it runs, from finished points or from known costs
of studies.
"""

import tempfile
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import NamedTuple

from pymantaray.apps.study.mission import mission_size
from pymantaray.apps.sweep.definition import Sweep
from pymantaray.apps.sweep.keys import FLEET, OCEAN, POINT, RAYS, STAGES
from pymantaray.apps.sweep.plan import SweepPlan
from pymantaray.config.door.study import Study, build_study
from pymantaray.errors import SweepError

_OCEAN_SECONDS = 1.2
_MEDIUM_SECONDS = 0.2
_SECONDS_PER_STEP, _SECONDS_PER_LINK, _SECONDS_PER_POSE = 4e-8, 1e-4, 2e-5
"""
CPU time per physics step of a vehicle, per link and per pose in one solve, measured on `quick` with
one thread. [s]
"""
_POINT_BYTES = 4096  # one block of most file systems, enough for three conditions
_SAMPLE = 100  # points whose size is read


class Cost(NamedTuple):
    """Cost of one task."""

    seconds: Mapping[str, float]
    """Seconds by kind of task."""
    stage_bytes: int | None
    """Size of one ocean, fleet and rays; None if not measured."""
    origin: str


class Estimate(NamedTuple):
    """Cost of a sweep."""

    seconds: float
    """Time with one worker. [s]"""
    unshared_seconds: float
    """Time with one worker without shared stages. [s]"""
    point_bytes: int
    stage_bytes: int | None
    """Size of one ocean, fleet and rays; None if not measured."""
    origin: str


def estimate(plan: SweepPlan, points: Collection[str], cost: Cost) -> Estimate:
    """Time and disk space of some points of a plan."""
    n = len(points)
    alone = n * sum(cost.seconds[kind] for kind in (*STAGES, POINT))
    stages = sum(cost.seconds[stage] * plan.count(stage, points) for stage in STAGES)
    shared = stages + n * cost.seconds[POINT]
    return Estimate(shared, alone, n * _POINT_BYTES, cost.stage_bytes, cost.origin)


def known_cost(sweep: Sweep) -> Cost:
    """Cost of tasks in the preset `quick`, scaled to studies of this size."""
    count = len(sweep)
    points = [k * count // min(count, _SAMPLE) for k in range(min(count, _SAMPLE))]
    sizes = [_seconds(build_study(sweep.point(point))) for point in points]
    mean = {kind: fmean(size[kind] for size in sizes) for kind in (*STAGES, POINT)}
    return Cost(mean, None, "the preset quick, scaled by steps, links and poses")


def _seconds(study: Study) -> dict[str, float]:
    size = mission_size(study)
    links = size.pings * ((size.vehicles - 1) / 2 + len(study.ranging.landmarks))
    solves = study.realizations * len(study.conditions)
    return {
        OCEAN: _OCEAN_SECONDS,
        FLEET: _SECONDS_PER_STEP * size.vehicles * size.steps,
        RAYS: _MEDIUM_SECONDS + _SECONDS_PER_LINK * links,
        POINT: _SECONDS_PER_POSE * solves * size.vehicles * size.samples,
    }


def cost_of(contents: Sequence[Mapping[str, Mapping[str, float]]]) -> Cost | None:
    """Cost of tasks in finished points; None if there is none."""
    seconds = [content["seconds"] for content in contents if "seconds" in content]
    if not seconds:
        return None
    mean = {stage: fmean(s[stage] for s in seconds) for stage in STAGES}
    mean[POINT] = fmean(sum(v for kind, v in s.items() if kind not in STAGES) for s in seconds)
    return Cost(mean, None, f"{len(seconds)} finished points")


def measured_cost(sweep: Sweep) -> Cost:
    """Cost of the first point on this machine, measured after a run that compiles the kernels."""
    from pymantaray.apps.sweep.results import open_sweep
    from pymantaray.apps.sweep.runner import run_sweep

    first = Sweep(sweep.point(0), seeds=[1, 2])
    with tempfile.TemporaryDirectory(prefix="mantaray-") as folder:
        run_sweep(Sweep(sweep.point(0)), Path(folder, "warm"), workers=1)
        run_sweep(first, Path(folder, "measured"), workers=1, keep_stages=True)
        results = open_sweep(Path(folder, "measured"))
        cost = cost_of(results.contents)
        if cost is None:
            raise SweepError(
                f"the first point fails: {next(iter(results.status().failures), 'no line')}"
            )
        stages = sum(file.stat().st_size for file in Path(folder, "measured", "stages").iterdir())
    return Cost(cost.seconds, stages, "the first point on this machine")

"""Task of a worker: one shared stage or one point, written to the store before the task returns."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from pymantaray.apps.study import Run, open_run
from pymantaray.apps.study.manifest import (
    Stopwatch,
    estimator_notes,
    fleet_notes,
    ocean_notes,
)
from pymantaray.apps.study.mission import (
    assemble_mission,
    mission_picture,
    range_draws,
    with_notes,
)
from pymantaray.apps.study.realization import RealizationSolver, collect_results
from pymantaray.apps.study.runner import refuse_too_large, run_study
from pymantaray.apps.study.store import run_in_memory
from pymantaray.apps.sweep.keys import POINT, point_content, point_name
from pymantaray.apps.sweep.stages import Stages
from pymantaray.config import StudyConfig
from pymantaray.config.door.study import Study, build_study
from pymantaray.evaluation import ALL_LINKS
from pymantaray.installation import code_version
from pymantaray.jobs.folder import MANIFEST
from pymantaray.jobs.pool import run_in_store
from pymantaray.jobs.store import Store

_CONSISTENCY = {"median_ratio": "ratio", "inside": "inside", "tests": "tests"}


@dataclass(frozen=True)
class SweepTask:
    """Stage or point to compute, with all data for it."""

    kind: str
    keys: Mapping[str, str]
    config: StudyConfig
    shared: frozenset[str]
    """Stages that stay in the store."""
    studies: bool = False
    """True if the run folder of each point is written."""
    version: str = field(default_factory=code_version)

    @property
    def key(self) -> str:
        """Key of the stage or point."""
        return self.keys[self.kind]


def run_task(url: str, task: SweepTask) -> str | None:
    """
    Run a task unless the store has its result; return the error line of a failure, else None.
    Errors of the store are raised.
    """
    # a stage records its failure itself
    failed = point_name(task.key, failed=True) if task.kind == POINT else None
    return run_in_store(url, task, _compute, failed)


def _compute(store: Store, task: SweepTask) -> None:
    study = build_study(task.config)
    stages = Stages(study, task.keys, store, task.shared)
    if task.kind != POINT:
        stages.ensure(task.kind)
    elif not store.has(point_name(task.key)):
        content = _solve(task, study, stages, store)
        store.write(point_name(task.key), point_content(content))
        store.remove(point_name(task.key, failed=True))


def _solve(task: SweepTask, study: Study, stages: Stages, store: Store) -> dict[str, Any]:
    """Summary of a point, and the duration of its stages."""
    watch = Stopwatch()
    refuse_too_large(study, 1)
    ocean = with_notes(stages.ocean, stages.medium)
    truth = stages.fleet
    ranging = stages.rays
    with watch.stage("realizations"):
        mission = assemble_mission(study, ocean, truth, ranging)
        if study.ocean.own_ice:
            draws = range_draws(study, ocean, (stages.medium, truth, ranging))
            mission = replace(mission, draws=draws)
        if task.studies:
            assert store.folder is not None  # `run_sweep` accepts studies in a folder only
            folder = store.folder / "studies" / task.key
            if not (folder / MANIFEST).exists():
                mission = replace(mission, picture=mission_picture(study, mission, stages.medium))
                run_study(task.config, folder, workers=1, mission=mission)
            run = open_run(folder)
        else:
            run = run_in_memory(study, mission)
            solver = RealizationSolver.of(run)
            solved = [solver.solve(realization) for realization in range(study.realizations)]
            results = collect_results(run, solved)._asdict()
            # with the precision of a run's files, so that a point is its study to the last digit
            saved = {name: results[name].as_saved() for name in ("estimates", "covariances")}
            vars(run).update(results | saved)
    with watch.stage("summary"):
        summary = summarize_point(run)
    seconds = stages.seconds | watch.seconds
    notes = [*ocean_notes(run.ocean.attrs), *fleet_notes(study, run.ocean.attrs)]
    notes += estimator_notes(run)
    origin = {"key": task.key, "version": task.version, "notes": notes}
    return {**origin, "synthetic": run.synthetic, **summary, "seconds": seconds}


def summarize_point(run: Run) -> dict[str, Any]:
    """
    Results of a study in a sweep: errors and consistency of each condition, and counts of links.
    NaN is null.
    """
    tables = run.tables
    conditions = {
        row.pop("condition"): row for row in tables["ate_pooled"].frame.to_dict("records")
    }
    for row in tables["ping_error"].frame.to_dict("records"):
        conditions[row["condition"]] |= {
            f"ping_{name}": v for name, v in row.items() if name not in {"condition", "n"}
        }
    if "consistency" in tables:
        for row in tables["consistency"].frame.to_dict("records"):
            conditions[row["condition"]] |= {
                f"{row['statistic']}_nees_{name}"
                if row["statistic"] != "ranges"
                else f"ranges_nis_{name}": row[of]
                for of, name in _CONSISTENCY.items()
            }
    dropouts = _all_links(tables["dropouts"].frame.to_dict("records"))
    errors = _all_links(tables["range_error"].frame.to_dict("records"))
    links = dropouts | {
        f"range_error_{name}": value for name, value in errors.items() if name.endswith("_m")
    }
    return {
        "conditions": {name: _plain(row) for name, row in conditions.items()},
        "links": _plain(
            {"dropout_percent" if name == "percent" else name: v for name, v in links.items()}
        ),
    }


def _all_links(rows: list[dict[Any, Any]]) -> dict[str, Any]:
    row = next(row for row in rows if row["category"] == ALL_LINKS)
    return {str(name): value for name, value in row.items() if name != "category"}


def _plain(row: Mapping[Any, Any]) -> dict[str, Any]:
    return {
        str(name): None if isinstance(value, float) and math.isnan(value) else value
        for name, value in row.items()
    }

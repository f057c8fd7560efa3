"""Run of a whole study: mission, realizations and files."""

import logging
import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from pymantaray.apps.study.graphs import write_graphs
from pymantaray.apps.study.manifest import (
    Stopwatch,
    checksums,
    describe_run,
    estimator_notes,
)
from pymantaray.apps.study.mission import Mission, mission_size, simulate_mission
from pymantaray.apps.study.realization import (
    RealizationQueue,
    RealizationResult,
    SolverInputs,
    collect_results,
    start_solver,
)
from pymantaray.apps.study.references import citation
from pymantaray.apps.study.store import Run, open_run, run_in_memory, summarize
from pymantaray.config.door.fleet import with_tracks
from pymantaray.config.door.study import Study, build_study
from pymantaray.config.sections import StudyConfig
from pymantaray.entry_points import extension_keys
from pymantaray.errors import StudyError
from pymantaray.jobs import run_folder
from pymantaray.jobs.checkpoint import Checkpoint
from pymantaray.jobs.folder import MANIFEST, staged_folder
from pymantaray.jobs.keys import digest
from pymantaray.jobs.pool import Pool, ProcessPool, run_tasks
from pymantaray.jobs.progress import Progress
from pymantaray.records import Estimates, whole_file, write_netcdf
from pymantaray.records.writing import pack

LOG = logging.getLogger(__name__)
_CURRENTS = ("current_north", "current_east")
_CURRENT_STEP = 1e-5  # m/s; of currents in a file if rays do not need them
# bytes of memory, as measured on the presets: a pose in a solution, in a graph that is solved, a
# range attempt
_POSE_BYTES = 160
_GRAPH_BYTES = 4000
_LINK_BYTES = 500
_MAX_STEPS = 1e13  # vehicles x physics steps
_REALIZATIONS_PER_WORKER = 3


def run_study(
    config: StudyConfig,
    out: str | Path | None = None,
    *,
    workers: int | None = None,
    progress: Progress | None = None,
    mission_ready: Callable[[Path], Iterator[None]] | None = None,
    mission: Mission | None = None,
) -> Run:
    """
    Run a study and write its data.

    Parameters
    ----------
    config : StudyConfig
        From `load_study`.
    out : str or pathlib.Path, optional
        A new or empty folder for the results. Default: a dated folder in ``runs``, to which
        ``runs/latest`` then points. A study with a named folder that takes longer than half a
        minute saves finished parts in ``<out>.unfinished``; the same call resumes after any
        interruption.
    workers : int, optional
        Number of processes that solve realizations. Default: one per core, at most one for every
        three realizations. Results do not depend on it.
    progress : callable, optional
        Called with the name of a stage, the number of its finished parts and the total.
    mission_ready : callable, optional
        Called before other processes solve the realizations, with the folder of all data that they
        do not change. This process takes the steps of the returned iterator until all realizations
        are solved.
    mission : Mission, optional
        Mission of the configuration, if it has already been simulated.

    Returns
    -------
    Run
        Results, read from ``out`` at their first use; `pymantaray.apps.study.write_report` adds
        tables and figures.

    Raises
    ------
    MantaRayError
        If the folder is not empty or in use, or the configuration cannot be run. Nothing is left on
        disk.

    Examples
    --------
    Continues the example of `pymantaray.apps.study`:

    >>> from pymantaray.apps.study import run_study
    >>> run = run_study(load_study("quick", realizations=1, **hours), workers=1)
    >>> run.estimates.condition.tolist(), run.estimates.position.shape[2:]
    (['odometry', 'straight', 'refracted'], (11, 19, 3))
    """
    if not config.fleet.trajectories and "duration_h" not in config.mission.model_fields_set:
        LOG.warning(
            "mission.duration_h is not given: the mission lasts %g h", config.mission.duration_h
        )
    # refuse what cannot run before there is a folder
    study = build_study(with_tracks(config))
    count = study.realizations if study.solves else 0
    workers = worker_count(count, workers)
    refuse_too_large(study, workers)
    _refuse_missing_files(study)
    references = citation(study.config)  # read before the files can change
    report = progress or (lambda *_: None)
    watch = Stopwatch()
    if out is not None and (Path(out) / MANIFEST).is_file():  # a stop at its end left a checkpoint
        Checkpoint(Path(out).resolve(), "realizations").clear()
    # mission and realizations; an interrupted run resumes
    with staged_folder(out, study.name) as (stage, folder):
        kept = Checkpoint(folder if out is not None and mission is None else None, "realizations")
        with ProcessPool(start_solver, workers) if workers > 1 else Pool(start_solver) as pool:
            inputs = _restore(kept, study, stage)
            if inputs is None:
                mission = mission or simulate_mission(study, watch, report)
                with watch.stage("files"):
                    inputs = checksums(study.files)  # computed before the files can change
                    _write_mission(study, mission, stage)
                kept.use(_job_key(study, inputs))
            known = Run(stage) if mission is None else run_in_memory(study, mission)
            notes = estimator_notes(known)
            solved = kept.results(count, RealizationResult.from_bytes)
            with kept.saving(stage, solved, RealizationResult.to_bytes) as keep:
                steps: Iterable[None] = ()
                if mission_ready is not None and workers > 1:
                    steps = mission_ready(stage)
                if study.solves:
                    with watch.stage("realizations"):
                        _solve(known, stage, pool, solved, keep, report, steps)
        # results, and the manifest that describes them
        report("files", 0, 1)
        estimates = None
        with watch.stage("files"):
            if study.solves:
                estimates = _write_results(known, [solved[n] for n in range(count)], stage)
        outcome = summarize(known, estimates)
        content = describe_run(
            study,
            inputs,
            watch,
            references=references,
            ocean=known.ocean.attrs,
            workers=workers,
            worker_memory_mib=pool.peak_memory_mib,
        )
        content["estimators"] = {"notes": notes}
        content["solve_cpu_seconds"] = _cpu_seconds(solved)
        content["from_batch_m"] = _from_batch(solved)
        content["outcome"] = outcome
        run_folder.write_manifest(content, stage)
        report("files", 1, 1)
    kept.clear()
    return open_run(folder)


def _restore(kept: Checkpoint, study: Study, stage: Path) -> dict[str, str] | None:
    """
    Copy the files of a mission that an earlier call saved to a stage; return the checksums of its
    input, or None without one.
    """
    if not kept.exists:
        return None
    inputs = checksums(study.files)
    kept.use(_job_key(study, inputs))
    return inputs if kept.restore(stage) else None


def _job_key(study: Study, inputs: Mapping[str, str]) -> str:
    content = {"study": study.toml, "extensions": extension_keys(study.sensors)}
    return digest("study", {**content, "inputs": dict(inputs)}, {})


def _solve(
    run: Run,
    folder: Path,
    pool: Pool,
    solved: dict[int, RealizationResult],
    keep: Callable[[], None],
    report: Progress,
    steps: Iterable[None],
) -> None:
    """
    Solve the unsolved realizations, write the graphs of the first into a folder, and take steps of
    other work of this process while it would wait.
    """
    count = run.study.realizations
    graphs = folder / run_folder.PYFG
    graphs.mkdir()

    def ended(number: int, one: RealizationResult) -> None:
        solved[number] = one
        keep()
        report("realizations", len(solved), count)

    report("realizations", len(solved), count)
    queue = RealizationQueue((n for n in range(count) if n not in solved), ended)

    def meanwhile() -> Iterator[None]:
        write_graphs(run, 0, graphs, "realization-0-", compact=True)
        yield
        yield from steps

    others = meanwhile()
    if queue.left:
        pool.give(SolverInputs.of(run), folder)
        run_tasks(queue, pool, meanwhile=others)
    else:
        next(others)


def _cpu_seconds(solved: Mapping[int, RealizationResult]) -> dict[str, list[float]]:
    """CPU time of every solve, by condition, in the order of the realizations. [s]"""
    ordered = [solved[number].solutions for number in sorted(solved)]
    return {
        name: [round(one[name].seconds, 3) for one in ordered]
        for name in (ordered[0] if ordered else ())
    }


def _from_batch(solved: Mapping[int, RealizationResult]) -> dict[str, list[float]]:
    """
    Largest distance of each usable solve by GTSAM from that of the batch solver, by condition. [m]
    """
    out: dict[str, list[float]] = {}
    for number in sorted(solved):
        for name, solution in solved[number].solutions.items():
            if math.isfinite(solution.from_batch):
                out.setdefault(name, []).append(solution.from_batch)
    return out


def _write_results(run: Run, solved: Sequence[RealizationResult], folder: Path) -> Estimates:
    results = collect_results(run, solved)
    results.estimates.save(folder / run_folder.ESTIMATES)
    results.covariances.save(folder / run_folder.COVARIANCES)
    if results.unknowns is not None:
        results.unknowns.save(folder / run_folder.UNKNOWNS)
    return results.estimates


def refuse_too_large(study: Study, workers: int) -> None:
    """
    Raise an error, before any work, if a study needs more memory than this machine has or takes
    weeks.
    """
    n_vehicles, n_samples, n_steps, n_pings = mission_size(study)
    n_solves = study.realizations * len(study.conditions)
    n_links = n_pings * (n_vehicles + len(study.ranging.landmarks))
    needed = (
        n_vehicles * n_samples * (_POSE_BYTES * n_solves + _GRAPH_BYTES * workers)
        + _LINK_BYTES * n_links
    ) / 2**30
    there = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    size = f"{study.name}: {n_vehicles} vehicles x"
    if needed > there:
        raise StudyError(
            f"{size} {n_samples:.3g} samples x {n_solves:.3g} solves x {_POSE_BYTES} bytes,"
            f" {_GRAPH_BYTES} bytes a pose in each of {workers} workers and {n_links:.3g} links x"
            f" {_LINK_BYTES} bytes are {needed:.3g} GiB of memory; this machine has {there:.3g}"
        )
    if n_vehicles * n_steps > _MAX_STEPS:
        raise StudyError(
            f"{size} {n_steps:.3g} physics steps are more than {_MAX_STEPS:g}, which take a day;"
            " give a longer physics_step_s"
        )


def _refuse_missing_files(study: Study) -> None:
    """
    Raise an error for missing files of conditions before the mission runs; files of the ocean are
    read first anyway.
    """
    for condition in study.conditions:
        for file in condition.files:
            if not Path(file).exists():
                raise StudyError(
                    f"condition {condition.name}: {file}: cannot be read: No such file or directory"
                )


def _write_mission(study: Study, mission: Mission, folder: Path) -> None:
    with whole_file(folder / run_folder.CONFIG) as file:
        file.write_text(study.toml, encoding="utf-8")
    local = mission.ocean.local.copy()
    if not study.sound.currents:
        for name in [name for name in _CURRENTS if name in local]:
            pack(local.variables[name], _CURRENT_STEP)
    write_netcdf(local, folder / run_folder.OCEAN)
    write_netcdf(mission.ocean.profile, folder / run_folder.PROFILE)
    with whole_file(folder / run_folder.REGION) as file:
        mission.ocean.region.to_csv(file)
    for record, name in (
        (mission.truth, run_folder.TRUTH),
        (mission.links, run_folder.LINKS),
        (mission.arrivals, run_folder.ARRIVALS),
        (mission.measurements, run_folder.MEASUREMENTS),
        (mission.ranging_truth, run_folder.RANGING_TRUTH),
        (mission.hearing, run_folder.HEARING),
        (mission.draws, run_folder.RANGING_DRAWS),
        (mission.candidates, run_folder.CANDIDATES),
    ):
        if record is not None:
            record.save(folder / name)
    if mission.picture is not None:
        write_netcdf(mission.picture, folder / run_folder.RAY_PICTURE)


def worker_count(realizations: int, asked: int | None = None) -> int:
    """
    Number of processes for some realizations, at least one; by default at most one per core and one
    for every three realizations, because a process takes as long to start as it takes to solve a
    few short ones.
    """
    by_default = min(os.cpu_count() or 1, -(-realizations // _REALIZATIONS_PER_WORKER))
    return max(1, min(by_default if asked is None else asked, realizations))

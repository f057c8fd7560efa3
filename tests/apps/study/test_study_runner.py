"""
A whole small study: what is on disk is what was computed, the same whoever computes it, or nothing.
"""

import copy
import datetime as dt
import hashlib
import pickle
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from factories import TINY, assert_same, changed, names_in, python
from refusals import refused

from pymantaray.apps.study import open_run, run_study, runner
from pymantaray.apps.study.manifest import Stopwatch, checksums, describe_run, estimator_notes
from pymantaray.apps.study.mission import simulate_mission
from pymantaray.apps.study.realization import SolverInputs, start_solver
from pymantaray.apps.study.runner import worker_count
from pymantaray.apps.study.store import Run, run_in_memory, summarize
from pymantaray.config import parse_study
from pymantaray.config.door.estimators import EstimatorFactory
from pymantaray.config.door.study import build_study
from pymantaray.config.estimators import STANDARD, ConditionSection
from pymantaray.errors import FleetError, JobError, StudyError
from pymantaray.estimation import (
    CONDITIONS,
    GraphSolver,
    SolveOptions,
    build_graph,
    dead_reckon,
    read_pyfg,
)
from pymantaray.jobs.run_folder import ESTIMATES
from pymantaray.records import RayStatus, SolveStatus, VehicleStatus

STEP = 0.401e-3  # m; half of the steps in which a file holds positions
DEAD_RECKONING = {"study": {"realizations": 1}, "conditions": ["odometry"]}


def test_the_standard_conditions_are_those_of_the_estimation(tiny_run):
    """Written down twice, because the configuration is read before what estimates is imported."""
    assert set(STANDARD) == set(CONDITIONS)
    factory, truth = EstimatorFactory(tiny_run), tiny_run.truth
    for name, expected in CONDITIONS.items():
        made = factory.estimator(ConditionSection(name=name), 0)
        assert made.initial[0] is truth.position
        made = replace(
            made, initial=None, model_is_right=made.model_is_right and not made.dead_reckoned
        )
        assert made == expected or vars(made) == vars(expected)


SOLVE = """
import pickle, sys
from pathlib import Path
from pymantaray.apps.study.realization import start_solver
solved = start_solver(*pickle.loads(Path(sys.argv[1]).read_bytes()))(1)
print(*solved.solutions)
print(*{"xarray", "pandas", "pydantic", "gsw", "pyproj"} & set(sys.modules))
"""


def test_a_worker_of_the_paper_s_conditions_imports_the_solver(tiny_run, tmp_path):
    sent = tmp_path / "sent"
    sent.write_bytes(pickle.dumps((SolverInputs.of(tiny_run), tiny_run.path)))
    done = python(SOLVE, sent)
    names, heavy = done.stdout.split("\n")[:2]
    assert names.split() == tiny_run.estimates.condition.tolist(), done.stderr
    assert heavy == ""


def test_run_folder_holds_every_file_and_nothing_else(tiny_run):
    assert names_in(tiny_run.path) == [
        "arrivals.nc", "config.toml", "covariances.nc", "estimates.nc", "links.nc", "manifest.json",
        "measurements.nc",
        "ocean.nc", "profile.nc", "pyfg", "ranging_truth.nc", "ray_picture.nc", "region.csv",
        "truth.nc",
    ]  # fmt: skip
    assert names_in(tiny_run.path / "pyfg") == [
        f"realization-0-{name}.pyfg.gz" for name in ("refracted", "straight-all", "straight")
    ]


def test_numbers_of_every_file_of_a_run_stay(tiny_run, as_stored):
    records = ("arrivals", "ranging_truth", "measurements")
    as_stored(tiny_run.path, without="^/(manifest|" + "|".join(records) + ")|iterations|gradient")
    of_run = {name: getattr(tiny_run, name) for name in records}
    apart = {"apart": tiny_run.ranging_truth.distance, "outcome": tiny_run.manifest["outcome"]}
    as_stored(of_run | apart, name="records")
    graphs = {
        file.name: read_pyfg(file)[0]["range"].column("distance")
        for file in sorted((tiny_run.path / "pyfg").iterdir())
    }
    as_stored(graphs, name="graphs")


def test_opened_again_a_run_gives_the_same(tiny_run, tiny_config):
    again = open_run(tiny_run.path)
    assert again.config == tiny_config
    assert (
        "range_sigma = 1.0" in (tiny_run.path / "config.toml").read_text()
    )  # defaults are written out
    assert_same(again.estimates, tiny_run.estimates)
    assert again.region.loc["synthetic"].item() == "yes"
    assert again.synthetic


def test_samples_pings_and_attempts_follow_the_mission(tiny_run):
    time = tiny_run.truth.time
    np.testing.assert_array_equal(time, np.arange(0, 4 * 3600 + 1, 200))
    o = tiny_run.measurements
    assert set(time[o.range_sample]) == {3600, 7200, 10800, 14400}
    assert o.range_status.size == 4 * 4 * (
        3 + 2
    )  # pings x transmitters x (other vehicles + landmarks)
    assert tiny_run.manifest["outcome"]["range_attempts"] == o.range_status.size
    assert tiny_run.manifest["outcome"]["links"]["OK"] == np.count_nonzero(
        o.range_status == RayStatus.OK
    )
    assert tiny_run.links.sample.size == tiny_run.arrivals.status.size


def test_solves_are_healthy_and_ranges_help(tiny_run):
    """
    Also the refracted ones, whose range errors of 100 m make the optimum repel undamped steps.
    """
    e = tiny_run.estimates
    assert (e.solve_status == SolveStatus.OK).all(), e.solve_status
    error = np.linalg.norm(e.position - tiny_run.truth.position, axis=-1)
    rmse = dict(zip(e.condition, np.sqrt((error**2).mean(axis=(1, 2, 3))), strict=True))
    assert rmse["straight"] < rmse["no-ranges"] <= rmse["odometry"]


def test_summary_lists_every_solve_that_is_not_healthy(tiny_run):
    status = tiny_run.estimates.solve_status.copy()
    status[1, 0], status[3, 1] = SolveStatus.FAILED, SolveStatus.OVER_CHI_SQUARE
    of_run = {
        name: getattr(tiny_run, name)
        for name in ("measurements", "truth", "hearing", "candidates", "arrivals")
    }
    summary = summarize(SimpleNamespace(**of_run), replace(tiny_run.estimates, solve_status=status))
    assert summary["unhealthy_solves"] == [
        {"condition": "no-ranges", "realization": 0, "status": "FAILED"},
        {"condition": "refracted", "realization": 1, "status": "OVER_CHI_SQUARE"},
    ]
    assert summary | {"unhealthy_solves": []} == tiny_run.manifest["outcome"]


def test_noise_of_a_realization_can_be_drawn_again(tiny_run):
    for realization in (0, 1):
        position, _ = dead_reckon(tiny_run.noisy_measurements(realization))
        stored = tiny_run.estimates.position[0, realization]
        np.testing.assert_allclose(position, stored, rtol=0, atol=STEP)
    refused(StudyError, "realization 2: the run has 0 to 1", tiny_run.noisy_measurements, 2)


def test_pyfg_of_the_first_realization_starts_at_the_truth(tiny_run):
    graph, values = read_pyfg(tiny_run.path / "pyfg" / "realization-0-refracted.pyfg.gz")
    np.testing.assert_allclose(values.position, tiny_run.truth.position.reshape(-1, 3), atol=1e-9)
    heard = tiny_run.measurements.range_status == RayStatus.OK
    np.testing.assert_allclose(
        graph["range"].column("distance").ravel(),
        tiny_run.noisy_measurements(0).refracted_range[heard],
        rtol=5e-12,
    )


def test_dead_reckoned_start_reaches_the_same_optimum(run_tiny, tiny_run):
    sections = {"study": {"realizations": 1}, "conditions": ["refracted"]}
    other = run_tiny(estimator={"start": "dead-reckoning"}, **sections).estimates
    np.testing.assert_allclose(
        other.position[0, 0], tiny_run.estimates.position[3, 0], rtol=0, atol=1e-3
    )


@pytest.mark.parametrize("ranges", ["straight", "refracted"])
def test_few_steps_lead_a_study_to_its_optimum(tiny_run, ranges):
    graph = build_graph(tiny_run.noisy_measurements(0), ranges)
    _, start = read_pyfg(tiny_run.path / "pyfg" / f"realization-0-{ranges}.pyfg.gz")
    tight = GraphSolver(SolveOptions(step_tolerance=1e-9)).solve(graph, start)
    usual = GraphSolver().solve(graph, start)
    np.testing.assert_allclose(usual.position, tight.position, rtol=0, atol=1e-5)
    assert usual.iterations <= 6  # eight and more without the curvature of odometry


def test_the_default_folder_has_a_date_and_progress_reaches_its_end(tiny, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    seen = []
    run = run_study(tiny(**DEAD_RECKONING), workers=1, progress=lambda *step: seen.append(step))
    assert run.path.parent == tmp_path / "runs"
    assert run.path.name.startswith("tiny-2")
    assert open_run("runs/latest").path == run.path
    assert [s for s in seen if s[0] == "realizations"] == [("realizations", i, 1) for i in range(2)]
    last = {stage: (done, total) for stage, done, total in seen}
    assert list(last) == ["ocean", "fleet", "rays", "realizations", "files"]
    assert all(done == total for done, total in last.values())


def test_the_rays_of_a_lone_vehicle_are_done_at_once():
    tree = changed(copy.deepcopy(TINY), DEAD_RECKONING)
    tree["landmarks"], tree["fleet"]["vehicles"] = [], tree["fleet"]["vehicles"][:1]
    steps = []
    study = build_study(parse_study(tree))
    mission = simulate_mission(study, Stopwatch(), lambda *step: steps.append(step))
    assert mission.measurements.range_status.size == 0
    run = run_in_memory(study, mission)
    assert run.study is study
    assert run.profile is mission.ocean.profile
    last = {stage: (done, total) for stage, done, total in steps}
    assert last == dict.fromkeys(("ocean", "fleet", "rays"), (1, 1))


def test_vehicle_that_leaves_stops_and_the_study_goes_on(run_tiny):
    away = {"twist": [0, 0, 0, 3.0, 0, 0], "heading_deg": 90.0}
    sections = {"study": {"realizations": 1}, "conditions": ["odometry", "straight"]}
    run = run_tiny(**sections, fleet={"vehicles": {"3": away}})
    outcome = run.manifest["outcome"]
    assert outcome["stopped_vehicles"]["D"]["status"] == "LEFT_DOMAIN"
    stop = outcome["stopped_vehicles"]["D"]["time_s"]
    assert stop == pytest.approx(12000 / 3.0, abs=400)
    assert outcome["links"]["STOPPED"] > 0
    assert (run.truth.status[3, run.truth.time >= stop] == VehicleStatus.LEFT_DOMAIN).all()


def test_ray_picture_is_of_a_link_that_was_heard(tiny_run):
    picture, links, first = tiny_run.ray_picture, tiny_run.links, tiny_run.arrivals.first()
    names = tiny_run.truth.name.tolist()
    ends = (names.index(picture.attrs["source"]), names.index(picture.attrs["receiver"]))
    sample = np.searchsorted(tiny_run.truth.time, picture.attrs["time_h"] * 3600.0)
    row = (links.first == ends[0]) & (links.second == ends[1]) & (links.sample == sample)
    assert first.status[row] == RayStatus.OK
    between_vehicles = (links.first < len(names)) & (links.second < len(names))
    gain = np.where(between_vehicles, first.chord_travel_time - first.travel_time, -np.inf)
    assert gain[row] == np.nanmax(gain)


def test_full_folder_is_refused_before_any_work(tiny_config, tmp_path, monkeypatch):
    (tmp_path / "mine").write_text("x")
    monkeypatch.setattr(runner, "simulate_mission", lambda *_: pytest.fail("work was begun"))
    refused(JobError, "folder is not empty", run_study, tiny_config, tmp_path)
    assert names_in(tmp_path) == ["mine"]


@pytest.mark.parametrize(("sections", "expected"), [
    ({"mission": {"duration_h": 1e9}}, "4 vehicles x 1.8e+10 samples x 5 solves x 160 bytes"),
    ({"mission": {"duration_h": 1e308}}, "duration_h is inf s; it must be a whole multiple"),
    ({"mission": {"sampling_period_s": 1e-6, "physics_step_s": 1e-6}},
     "4 vehicles x 1.44e+10 samples"),
    ({"mission": {"physics_step_s": 1e-300}},
     "4 vehicles x 1.44e+304 physics steps are more than 1e+13"),
    ({"study": {"realizations": 10**9}}, "4 vehicles x 72 samples x 5e+09 solves x 160 bytes"),
    ({"study": {"realizations": int("9" * 4000)}}, "study.realizations: found 99999"),
    ({"fleet": {"vehicles": {"1": {"target_depth": 9e3}}}},
     "'B': target_depth is 9000 m deep, below the sea floor"),
], ids=range(7))  # fmt: skip
def test_impossible_missions_are_refused_at_once_in_one_line(tiny, tmp_path, sections, expected):
    with pytest.raises((StudyError, FleetError)) as caught:
        run_study(tiny(**{"study": {"realizations": 1}} | sections), tmp_path / "run", workers=1)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300
    assert list(tmp_path.iterdir()) == []


def test_not_a_run_is_refused(tmp_path):
    refused(StudyError, r"not a run folder: it has no manifest\.json", open_run, tmp_path)
    (tmp_path / "manifest.json").write_text('{"format": 99}')
    refused(StudyError, "run format 99; this version reads format 5", open_run, tmp_path)
    for text in ("[]", "3", "null", "[" * 100_000, '{"format"', '{"format": 5, "versions": 1}'):
        (tmp_path / "manifest.json").write_text(text)
        refused(StudyError, r"manifest\.json: (not a readable|damaged)", open_run, tmp_path)


READERS = {  # what of a run reads each file
    "arrivals.nc": "arrivals", "config.toml": "config", "covariances.nc": "covariances",
    "estimates.nc": "estimates", "links.nc": "links", "measurements.nc": "measurements",
    "ocean.nc": "ocean", "profile.nc": "profile", "ranging_truth.nc": "ranging_truth",
    "ray_picture.nc": "ray_picture", "region.csv": "region", "truth.nc": "truth",
}  # fmt: skip


@pytest.mark.parametrize("damage", ["bit", "empty", "folder", "loop", "gone"])
def test_a_damaged_file_of_a_run_is_one_line_for_its_reader(tiny_run, tmp_path, damage):
    folder = tmp_path / "run"
    shutil.copytree(tiny_run.path, folder)
    listed = {name for name in tiny_run.manifest["files"] if not name.startswith("pyfg/")}
    assert listed == READERS.keys()
    line = "damaged" if damage in ("bit", "empty") else "missing or not a regular file"
    for name, reader in READERS.items():
        path = folder / name
        whole = path.read_bytes()
        path.unlink()
        if damage == "folder":
            path.mkdir()
        elif damage == "loop":
            path.symlink_to(path)
        elif damage != "gone":
            middle = len(whole) // 2
            flipped = whole[:middle] + bytes([whole[middle] ^ 1]) + whole[middle + 1 :]
            path.write_bytes(flipped if damage == "bit" else b"")
        refused(StudyError, rf"{name}: {line}.*; restore it", getattr, open_run(folder), reader)
        path.rmdir() if damage == "folder" else path.unlink(missing_ok=True)
        path.write_bytes(whole)


def test_a_file_that_a_run_does_not_list_is_not_its_own(tiny_run, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(tiny_run.path, folder)
    shutil.copy(folder / "covariances.nc", folder / "unknowns.nc")
    assert open_run(folder).unknowns is None


def test_a_changed_number_in_a_manifest_is_one_line(tiny_run, tmp_path):
    text = (tiny_run.path / "manifest.json").read_text()
    attempts = f'"range_attempts": {tiny_run.manifest["outcome"]["range_attempts"]}'
    assert text.count(attempts) == 1
    (tmp_path / "manifest.json").write_text(text.replace(attempts, f"{attempts}0"))
    refused(StudyError, "manifest.json: damaged: .* its checksum", open_run, tmp_path)


@pytest.mark.slow
def test_workers_have_ended_when_the_manifest_tells_their_memory(tiny, tmp_path, monkeypatch):
    steps = []

    class Recorded(runner.ProcessPool):
        def __exit__(self, *error):
            super().__exit__(*error)
            steps.append("ended")

    def describe(*arguments, **options):
        steps.append("described")
        return describe_run(*arguments, **options)

    monkeypatch.setattr(runner, "ProcessPool", Recorded)
    monkeypatch.setattr(runner, "describe_run", describe)
    run_study(tiny(conditions=["odometry"]), tmp_path / "run", workers=2)
    assert steps == ["ended", "described"]


@pytest.mark.slow
def test_a_study_works_on_its_report_while_others_solve(tiny, tmp_path):
    seen = []

    def report(stage):
        while True:
            seen.append((stage / ESTIMATES).is_file())  # written after all realizations
            yield

    config = tiny(conditions=["odometry"])
    run = run_study(config, tmp_path / "run", workers=2, mission_ready=report)
    assert seen
    assert not any(seen)
    assert (run.path / ESTIMATES).is_file()


@pytest.mark.parametrize(
    ("realizations", "cores", "workers"),
    [(0, 8, 1), (1, 8, 1), (3, 8, 1), (4, 8, 2), (24, 8, 8), (25, 8, 8), (25, None, 1)],
)
def test_three_realizations_have_a_worker_if_there_are_cores(
    monkeypatch, realizations, cores, workers
):
    monkeypatch.setattr("os.cpu_count", lambda: cores)
    assert worker_count(realizations) == workers


def test_workers_that_are_asked_for_are_at_most_the_realizations():
    assert [worker_count(5, asked) for asked in (1, 3, 9)] == [1, 3, 5]


def test_conditions_with_like_measurements_share_their_bounds(tiny):
    own = [{"name": "deaf", "ranges": "none"}, {"name": "own", "ranges": "refracted"}]
    run = Run(Path())
    study = build_study(tiny(conditions=["refracted", *own]))
    vars(run).update(study=study, truth="truth", measurements="measurements")
    found = run._by_measurements(lambda *given: list(given))
    kinds = {"refracted": "straight", "deaf": "no-ranges", "own": "straight"}
    assert found == {name: ["truth", "measurements", like] for name, like in kinds.items()}
    assert found["own"] is found["refracted"]


def test_processes_solve_if_there_are_several_workers(tiny, fly_tiny, tmp_path, monkeypatch):
    asked, (mission, _) = [], fly_tiny()

    class PoolHere(runner.Pool):
        def __init__(self, start, workers):
            asked.append((start, workers))
            super().__init__(start)

    monkeypatch.setattr(runner, "ProcessPool", PoolHere)
    config = tiny(conditions=["odometry"])
    for workers in (1, 2):
        run = run_study(config, tmp_path / f"{workers}", workers=workers, mission=mission)
        assert run.manifest["machine"]["workers"] == workers
    assert asked == [(start_solver, 2)]


def test_manifest_has_seeds_versions_and_checksums(tiny, tiny_run, tmp_path, as_stored):
    manifest = tiny_run.manifest
    assert manifest["random"]["seed"] == tiny_run.config.study.seed
    of_machine = "^(files|made|machine|peak|solve_cpu|outcome|ocean.source|extensions|references)"
    as_stored(manifest, without=of_machine)
    assert manifest["versions"]["gtsam"].startswith("4.3")
    stages = {"ocean", "fleet", "medium", "rays", "picture", "realizations", "files"}
    assert set(manifest["seconds"]) == stages
    assert all(value >= 0 for value in manifest["seconds"].values())
    began = dt.datetime.fromisoformat(manifest["made"]["began"])
    assert abs(dt.datetime.now(dt.UTC) - began) < dt.timedelta(days=1)
    assert manifest["made"]["command"] is None  # the tests are not the command
    content = tmp_path / "a.nc"
    content.write_bytes(b"ocean")
    config = tiny(ocean={"source": [str(content)]})
    assert checksums(config.files) == {str(content): hashlib.sha256(b"ocean").hexdigest()}
    assert manifest["ocean"]["synthetic"] is True


def test_notes_of_files_that_estimators_assume_are_of_their_readers(tiny, tiny_run, tmp_path):
    assert estimator_notes(tiny_run) == []
    file = tmp_path / "cold.csv"
    file.write_text("depth,temperature,salinity\n0,-1.0,28\n200,-4.4,33\n600,0.5,34.8\n")
    belief = {"kind": "file", "source": [str(file)]}
    model = {"name": "assumed", "range_model": {"kind": "eigenray", "belief": belief}}
    config = tiny(conditions=[model])
    of_run = {name: getattr(tiny_run, name) for name in ("ocean", "truth")}
    run = SimpleNamespace(config=config, study=build_study(config), **of_run)
    notes = estimator_notes(run)
    assert {note[:18] for note in notes} == {"estimators: cold: "}
    assert any("freezing" in note for note in notes)


def test_notes_of_a_run_are_of_its_ocean_its_fleet_and_its_estimators(tiny_run_folder):
    run = open_run(tiny_run_folder)
    for parts in (("ocean", "fleet", "estimators"), ("estimators",), ()):
        vars(run)["manifest"] = {part: {"notes": [f"of the {part}"]} for part in parts}
        assert run.notes == [f"of the {part}" for part in parts]
    vars(run)["manifest"] = {"fleet": {}}
    assert run.notes == []


def test_files_may_go_while_realizations_are_solved(tiny, fly_tiny, tmp_path):
    bed = tmp_path / "bed.nc"
    xr.Dataset(attrs={"title": "GEBCO grid"}).to_netcdf(bed)
    config = tiny(**DEAD_RECKONING, ocean={"bathymetry": str(bed)})

    def remove(stage, *_):
        if stage == "realizations":
            bed.unlink(missing_ok=True)

    run = run_study(config, tmp_path / "run", mission=fly_tiny()[0], progress=remove)
    assert not bed.exists()
    assert any("doi:10.1002/2015EA000107" in reference for reference in run.manifest["references"])

"""
Running sweeps on this machine: one result each, the same whoever computes it, and nothing computed
twice.
"""

import json
from concurrent.futures import Future
from functools import partial

import factories
import numpy as np
import pandas as pd
import pytest
import xarray as xr

from pymantaray.apps.study import open_run, run_study
from pymantaray.apps.study.page import SYNTHETIC_NOTE
from pymantaray.apps.sweep import Sweep, run_sweep, stages, tasks
from pymantaray.apps.sweep.estimate import cost_of, estimate, known_cost
from pymantaray.apps.sweep.keys import FLEET, OCEAN, POINT, RAYS, STAGES, stage_name
from pymantaray.apps.sweep.page import write_sweep_page
from pymantaray.apps.sweep.plan import SweepPlan, SweepQueue
from pymantaray.apps.sweep.tasks import SweepTask, run_task
from pymantaray.config import parse_study
from pymantaray.config.door.ocean import MissionOcean
from pymantaray.errors import JobError
from pymantaray.evaluation import dropout_table, error_table
from pymantaray.jobs.pool import Pool
from pymantaray.jobs.processes import WorkerEndedError
from pymantaray.jobs.store import open_store
from pymantaray.pages.page import Page


@pytest.fixture
def depths(small):
    """Sweep of four points: two depths of a float, each with two noises."""
    cross = {"fleet.vehicles.B.target_depth": [200.0, 300.0], "noise.range_sigma": [1.0, 2.0]}
    return Sweep(small, cross=cross)


@pytest.fixture
def counted(monkeypatch):
    """How often each stage is computed."""
    counts = dict.fromkeys(STAGES, 0)

    def count(stage, function):
        inner = getattr(stages, function)

        def call(*arguments):
            counts[stage] += 1
            return inner(*arguments)

        monkeypatch.setattr(stages, function, call)

    for stage, function in (
        (OCEAN, "open_ocean"),
        (FLEET, "simulate_fleet"),
        (RAYS, "range_fleet"),
    ):
        count(stage, function)
    return counts


def digits(results):
    """What was found, apart from what it took."""
    return [{k: v for k, v in content.items() if k != "seconds"} for content in results.contents]


@pytest.mark.slow
def test_a_point_is_the_study_to_the_last_digit(here, small, tmp_path):
    detection = {"source_level_db": 170.0, "frequency_hz": 1e4, "bandwidth_hz": 1e3}
    tree = small.model_dump(exclude_none=True) | {"detection": detection}
    tree["study"] |= {"realizations": 2}
    tree["ranging"] = {"mistaken": "first-detected", "timing": "two-way"}
    tree["noise"]["clock_offset_sigma"] = 1e-3
    tree["acoustics"] |= {"currents": True, "max_surface_bounces": 1}
    rays = {"name": "rays", "range_model": {"kind": "eigenray", "belief": "mean"}}
    tree["conditions"] = ["straight", "refracted", rays]
    config = parse_study(tree)
    results = run_sweep(Sweep(config, seeds=[1, 2]), tmp_path / "out")
    for content, seed in zip(results.contents, (1, 2), strict=True):
        study = config.model_copy(update={"study": config.study.model_copy(update={"seed": seed})})
        run = run_study(study, tmp_path / str(seed), workers=1)
        table = error_table(run.truth, run.estimates, freedom=run.degrees_of_freedom)
        for row in table.to_dict("records"):
            point = content["conditions"][row.pop("condition")]
            assert {name: point[name] for name in row} == row
        all_links = dropout_table(run.measurements, run.truth).iloc[-1]
        assert content["links"]["unheard"] == all_links["unheard"]
    assert set(results.contents[0]["conditions"]) == {"straight", "refracted", "rays"}


@pytest.mark.slow
def test_points_in_a_profile_are_the_studies_to_the_last_digit(here, small, monkeypatch, tmp_path):
    monkeypatch.setattr(stages, "open_ocean", MissionOcean.open)
    cast = tmp_path / "cast.csv"
    depth = np.arange(0.0, 1000.0, 20.0)
    speed = 1440.0 + 8.0 * np.exp(-(((depth - 60.0) / 40.0) ** 2)) + 0.016 * depth
    pd.DataFrame({"depth": depth, "sound_speed": speed}).to_csv(cast, index=False)
    ocean = {"source": str(cast), "bathymetry": 900.0, "ice": 2.0, "thin": 0.2}
    config = parse_study(
        small.model_dump(exclude_none=True) | {"ocean": ocean, "conditions": ["refracted"]}
    )
    forms = ["smooth", "linear"]
    results = run_sweep(
        Sweep(config, cross={"acoustics.interpolation": forms}, seeds=[1, 2]), tmp_path / "out"
    )
    rows = results.table()
    for row in rows.to_dict("records"):
        changes = {name: row[name] for name in ("acoustics.interpolation", "study.seed")}
        run = run_study(
            config.with_(**changes), tmp_path / "-".join(map(str, changes.values())), workers=1
        )
        table = error_table(run.truth, run.estimates, freedom=run.degrees_of_freedom)
        assert row["rmse_m"] == table["rmse_m"].item()
    assert rows["rmse_m"].nunique() == 4


def test_stages_that_points_share_are_computed_once_and_removed(here, counted, depths, tmp_path):
    run_sweep(depths, tmp_path / "out")
    assert counted == {OCEAN: 1, FLEET: 2, RAYS: 2}
    assert not any((tmp_path / "out" / "stages").iterdir())


@pytest.mark.slow
def test_stages_from_the_store_change_no_digit(here, depths, tmp_path):
    results = run_sweep(depths, tmp_path / "kept", keep_stages=True)
    assert len(list((tmp_path / "kept" / "stages").iterdir())) == 5
    for latest in stages.LATEST.values():
        latest.cache_clear()
    for path in (tmp_path / "kept" / "points").glob("*/*"):
        path.unlink()
    again = run_sweep(depths, tmp_path / "kept")
    assert digits(again) == digits(results)
    assert not any((tmp_path / "kept" / "stages").iterdir())


def test_added_points_alone_are_computed(here, counted, noises, tmp_path):
    first = digits(run_sweep(noises(2), tmp_path / "out"))
    assert counted[RAYS] == 1
    told = []
    more = run_sweep(noises(4), tmp_path / "out", progress=lambda *numbers: told.append(numbers))
    assert told[0] == (2, 0, 4)
    assert len(told) == 3
    assert digits(more)[:2] == first
    assert counted[RAYS] == 1  # they were in memory still
    done = run_sweep(noises(2), tmp_path / "out")
    assert digits(done) == first


@pytest.mark.slow
def test_workers_change_no_digit(depths, tmp_path, monkeypatch):
    workers = run_sweep(depths, tmp_path / "workers", workers=2)
    monkeypatch.setattr("pymantaray.apps.sweep.runner.open_pool", factories.pool_here)
    alone = run_sweep(depths, tmp_path / "alone")
    assert workers.status() == alone.status() == (4, 4, 0, {})
    assert digits(workers) == digits(alone)


def test_a_point_that_fails_is_a_result_and_the_others_go_on(
    here, counted, small, tmp_path, monkeypatch, as_stored
):
    far = Sweep(
        small, cross={"fleet.vehicles.A.north": [0.0, 1e6], "noise.range_sigma": [1.0, 2.0]}
    )
    results = run_sweep(far, tmp_path / "out")
    assert [c["status"] for c in results.contents] == ["done", "done", "failed", "failed"]
    assert counted[FLEET] == 2  # the one that fails is not tried again by the second point
    ((line, count),) = results.status().failures.items()
    assert (count, results.status().open) == (2, 0)
    assert "A" in line
    assert "\n" not in line
    table = results.table()
    as_stored({"table": table, "line": line}, without="key|seconds|version")
    monkeypatch.setattr(Page, "write", lambda page, _: page)
    page = write_sweep_page(table, ["noise.range_sigma"], tmp_path, title="far", notes=["note"])
    data = json.loads(page.explorer.data)
    as_stored({"facts": page.facts, "notes": page.notes, "data": data}, name="page")
    assert (page.origin, page.citation) == ([], None)
    assert table["error"].tolist() == ["", "", "", "", line, line]
    assert np.isnan(table["mean_m"].iloc[-1])
    run_sweep(far, tmp_path / "out")
    assert counted[FLEET] == 2  # nor by another run
    run_sweep(far, tmp_path / "out", retry_failed=True)
    assert counted[FLEET] == 3


def test_the_page_of_a_sweep_says_its_water_origin_and_citation(
    here, noises, tmp_path, monkeypatch
):
    results = run_sweep(noises(2), tmp_path / "out")
    assert [content["synthetic"] for content in results.contents] == [True, True]
    assert results.synthetic
    monkeypatch.setattr(Page, "write", lambda page, _: page)
    more = {"synthetic": results.synthetic, "origin": results.origin}
    page = write_sweep_page(results.table(), ["noise.range_sigma"], tmp_path, title="x", **more)
    assert page.notes[0] == SYNTHETIC_NOTE
    (origin,) = page.origin
    rows = dict(origin.frame.to_numpy().tolist())
    assert rows["versions"] == results.contents[0]["version"]
    assert any("noise.range_sigma" in name for name in rows)
    words, bibtex = page.citation
    assert "2 points" in words
    assert "@software{mantaray," in bibtex
    assert "http" not in bibtex


def test_what_nobody_foresaw_is_a_result_with_its_traceback(here, noises, tmp_path, monkeypatch):
    monkeypatch.setattr(tasks, "summarize_point", lambda _: 1 / 0)
    results = run_sweep(noises(2), tmp_path / "out")
    assert results.status().failures == {"ZeroDivisionError: division by zero": 2}
    assert "1 / 0" in results.contents[0]["traceback"]


@pytest.mark.slow
def test_points_leave_their_studies_where_asked_for(here, noises, summaries, tmp_path):
    results = run_sweep(noises(2), tmp_path / "out", studies=True)
    for content in results.contents:
        run = open_run(tmp_path / "out" / "studies" / content["key"])
        rmse = error_table(run.truth, run.estimates).set_index("condition")["rmse_m"]
        assert {
            name: row["rmse_m"] for name, row in content["conditions"].items()
        } == rmse.to_dict()
        assert run.ray_picture.sizes
    assert summaries(run_sweep(noises(2), tmp_path / "without")) == summaries(results)


def test_a_point_leaves_a_study_of_its_own_mission_with_a_picture(
    here, counted, small, tmp_path, monkeypatch
):
    """Also of the ranges in each realization, if each has its own ice."""
    monkeypatch.setattr(stages, "open_ocean", MissionOcean.open)
    cast = tmp_path / "cast.csv"
    cast.write_text("depth,sound_speed\n0,1440\n900,1460\n")
    ice = {"ice": 2.0, "ice_slope_deg": 0.5, "ice_length": 20.0, "ice_draw": "each"}
    tree = small.model_dump(exclude_none=True) | {"conditions": ["odometry"]}
    tree["ocean"] = {"source": str(cast), "bathymetry": 900.0, "currents": "rest", **ice}
    tree["study"] |= {"realizations": 2}
    sweep = Sweep(parse_study(tree), seeds=[3])
    (content,) = run_sweep(sweep, tmp_path / "out", studies=True).contents
    run = open_run(tmp_path / "out" / "studies" / content["key"])
    assert (run.config.study.seed, counted[RAYS]) == (3, 1)
    assert set(run.manifest["seconds"]) == {"files", "realizations"}  # no mission of its own
    assert run.ray_picture.sizes
    times = [run.ranging_truth_in(k).travel_time for k in range(2)]
    np.testing.assert_array_equal(times[0], run.ranging_truth.travel_time)
    assert np.isfinite(times).any()


def test_the_table_is_tidy_and_the_dataset_has_the_swept_fields(here, small, tmp_path, as_stored):
    vehicles = small.model_dump(exclude_none=True)["fleet"]["vehicles"]
    zipped = [
        {"name": "plan", "labels": ["both", "one"], "fleet.vehicles": [vehicles, vehicles[:1]]}
    ]
    sweep = Sweep(small, cross={"noise.range_sigma": [1.0, 2.0]}, zipped=zipped)
    results = run_sweep(sweep, tmp_path / "out")
    table, dataset = results.table(), results.dataset()
    as_stored({"table": table, "dataset": dataset}, without="key|seconds|version")
    assert len(table) == 8
    assert table[["point", "condition"]].drop_duplicates().shape == (8, 2)
    assert dataset.sizes == {"noise.range_sigma": 2, "plan": 2, "condition": 2}
    dataset.to_netcdf(tmp_path / "table.nc")
    with xr.open_dataset(tmp_path / "table.nc") as again:
        one = again["rmse_m"].sel(
            {"noise.range_sigma": 2.0, "plan": "one", "condition": "straight"}
        )
        rows = table[(table["noise.range_sigma"] == 2.0) & (table["plan"] == "one")]
        assert one.item() == rows.set_index("condition")["rmse_m"]["straight"]
        assert (again["status"] == "done").all()
    for name in ("attempts", "rays_seconds"):
        assert dataset[name].dims == ("noise.range_sigma", "plan")
    assert pd.api.types.is_numeric_dtype(table["position_nees_ratio"])


def test_the_cost_of_a_sweep_is_that_of_its_steps_links_and_poses(depths, as_stored):
    plan = SweepPlan(depths)
    cost = known_cost(depths)
    as_stored([cost, estimate(plan, plan.points, cost), estimate(plan, [*plan.points][:3], cost)])
    one = {"ocean": 1.0, "fleet": 2.0, "rays": 4.0, "solve": 8.0, "write": 16.0}
    contents = [{"seconds": one}, {}, {"seconds": dict.fromkeys(one, 1.0)}]
    found = cost_of(contents)
    assert found.seconds == {"ocean": 1.0, "fleet": 1.5, "rays": 2.5, "point": 13.0}
    assert found.origin == "2 finished points"
    assert cost_of([{}]) is None


def test_each_task_follows_the_stage_that_it_needs(depths):
    plan = SweepPlan(depths)
    queue = SweepQueue(plan, set(plan.points), keep_stages=False, studies=False)
    order, removed = [], []
    while (key := queue.next()) is not None:
        order.append(queue.kind(key))
        removed += [(len(order), name) for name in queue.done(key)]
    assert order == [OCEAN, FLEET, RAYS, POINT, POINT, FLEET, RAYS, POINT, POINT]
    assert queue.left == 0
    names = plan.keys[0]
    assert removed[:2] == [(5, names[FLEET]), (5, names[RAYS])]
    assert removed[-1][0] == 9
    assert names[OCEAN] in {name for _, name in removed}


def test_workers_that_write_elsewhere_are_noticed(here, noises, tmp_path, monkeypatch):
    monkeypatch.setattr(
        "pymantaray.apps.sweep.runner.open_pool",
        lambda *_: factories.pool_here(partial(run_task, str(tmp_path / "away"))),
    )
    with pytest.raises(
        JobError,
        match=r"workers wrote 2 points to another place; all workers must have access to this one$",
    ):
        run_sweep(noises(2), tmp_path / "out")


def test_a_stage_that_another_runner_removed_is_computed_again(here, noises, tmp_path):
    sweep, store = noises(2), open_store(tmp_path)
    plan = SweepPlan(sweep)
    shared = frozenset(STAGES)
    run_task(store.url, SweepTask(RAYS, plan.keys[0], sweep.point(0), shared))
    for latest in stages.LATEST.values():
        latest.cache_clear()
    store.remove(stage_name(plan.keys[0][FLEET]))
    store.remove(stage_name(plan.keys[0][OCEAN]))
    assert run_task(store.url, SweepTask(POINT, plan.keys[0], sweep.point(0), shared)) is None


def losing_pool(number):
    """
    In place of `open_pool`: a pool in this process whose task of a number loses its worker for
    good.
    """

    class Losing(Pool):
        tasks = 0

        def submit(self, task):
            Losing.tasks += 1
            future = Future()
            if Losing.tasks == number:
                future.set_exception(WorkerEndedError("gone"))
                return future
            return super().submit(task)

        def worker_failure(self, _key, error):
            return f"a worker ended early: {error}"

    return lambda work, *_: Losing(lambda: work)


def test_a_point_with_a_lost_worker_is_a_result_and_others_continue(noises, tmp_path, monkeypatch):
    monkeypatch.setattr("pymantaray.apps.sweep.runner.open_pool", losing_pool(5))
    results = run_sweep(noises(3), tmp_path / "out")
    assert [c["status"] for c in results.contents] == ["done", "failed", "done"]
    assert results.contents[1]["error"] == "a worker ended early: gone"


def test_points_whose_stage_lost_its_worker_fail_by_its_line(noises, tmp_path, monkeypatch):
    monkeypatch.setattr("pymantaray.apps.sweep.runner.open_pool", losing_pool(3))  # of the rays
    results = run_sweep(noises(2), tmp_path / "out")
    assert results.status().failures == {"a worker ended early: gone": 2}

"""Data frames of a run against its records, and against the tables of the report."""

import numpy as np
import pandas as pd
import pytest
from refusals import refused

from pymantaray.apps.study import open_run
from pymantaray.errors import StudyError
from pymantaray.evaluation import error_table
from pymantaray.records import RayStatus


@pytest.fixture(scope="module")
def run(tiny_run_folder):
    return open_run(tiny_run_folder)


def test_ranges_have_a_row_for_each_attempt(run):
    frame, m, true = run.ranges(), run.measurements, run.ranging_truth
    names = [*m.name, *m.landmark_name]
    assert frame["transmitter"].tolist() == [names[k] for k in m.range_transmitter]
    assert frame["receiver"].tolist() == [names[k] for k in m.range_receiver]
    assert frame["status"].tolist() == [RayStatus(k).name for k in m.range_status]
    np.testing.assert_array_equal(frame["time"], m.time[m.range_sample])
    np.testing.assert_array_equal(frame["refracted_range"], true.sound_speed * true.travel_time)
    fixed = np.broadcast_to(m.landmark_position[:, None], (len(m.landmark_name), len(m.time), 3))
    place = dict(zip(names, [*run.truth.position, *fixed], strict=True))
    ends = zip(frame["transmitter"], frame["receiver"], m.range_sample, strict=True)
    apart = [np.linalg.norm(place[a][k] - place[b][k]) for a, b, k in ends]
    np.testing.assert_allclose(frame["distance"], apart, rtol=1e-12)
    assert frame["date"].iloc[0] == pd.Timestamp(run.truth.start) + pd.Timedelta(
        frame["time"].iloc[0], "s"
    )


def test_ranges_of_a_realization_have_its_noise(run):
    noisy, m = run.ranges(1), run.noisy_measurements(1)
    np.testing.assert_array_equal(noisy["straight_range"], m.straight_range)
    np.testing.assert_array_equal(noisy["distance"], run.ranges()["distance"])
    assert not np.array_equal(noisy["straight_range"], run.ranges(0)["straight_range"])


def test_errors_pool_to_the_tables_of_the_report(run):
    frame, table = run.errors(), error_table(run.truth, run.estimates, by=["vehicle"])
    np.testing.assert_allclose(
        np.linalg.norm(frame[["north", "east", "down"]], axis=1), frame["error"]
    )
    rmse = frame.groupby(["condition", "vehicle"])["error"].apply(lambda e: np.sqrt(np.mean(e**2)))
    np.testing.assert_allclose(
        table["rmse_m"],
        [rmse[key] for key in zip(table["condition"], table["vehicle"], strict=True)],
    )


def test_errors_are_estimates_less_the_truth(run):
    axes, keys = ["north", "east", "down"], ["condition", "vehicle", "time"]
    frame, poses = run.errors(), run.trajectories(1).set_index(keys)[axes]
    errors = frame[frame["realization"] == 1].set_index(keys)[axes]
    truth = poses.loc["truth"].loc[errors.index.droplevel("condition")]
    np.testing.assert_allclose(
        truth.to_numpy() + errors, poses.loc[errors.index], rtol=0, atol=1e-9
    )


def test_trajectories_are_those_of_the_records_and_lie_on_earth(run):
    frame, estimates = run.trajectories(1), run.estimates
    assert list(dict.fromkeys(frame["condition"])) == ["truth", *estimates.condition]
    shape = len(estimates.condition), *run.truth.position.shape
    for columns, truth, estimate in (
        (["north", "east", "down"], run.truth.position, estimates.position),
        (["qw", "qx", "qy", "qz"], run.truth.quaternion, estimates.quaternion),
    ):
        values = frame[columns].to_numpy().reshape(shape[0] + 1, *truth.shape)
        np.testing.assert_array_equal(values[0], truth)
        np.testing.assert_array_equal(values[1:], estimate[:, 1])
    north, east = run.truth.frame.to_local(frame["latitude"], frame["longitude"])
    np.testing.assert_allclose(np.stack([north, east]), frame[["north", "east"]].T, atol=1e-6)


def test_every_number_has_a_unit(run, as_stored):
    as_stored({"ranges": run.ranges(1), "errors": run.errors(), "poses": run.trajectories(1)})
    as_stored({"units": run.trajectories().attrs["units"]}, name="units")
    for frame in (run.ranges(), run.errors(), run.trajectories()):
        numbers = [name for name in frame.select_dtypes("float") if not name.startswith("q")]
        assert set(numbers) == set(frame.attrs["units"]) - {"date"}


def test_a_realization_that_the_run_has_not_is_refused(run):
    refused(StudyError, "realization 2: the run has 0 to 1", run.trajectories, 2)
    refused(StudyError, "realization -1: the run has 0 to 1", run.ranges, -1)

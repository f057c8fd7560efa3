"""
Plots from Python: each draws the numbers of the library on given axes, and the report draws the
same.
"""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from factories import make_arrivals
from matplotlib.figure import Figure

from pymantaray.acoustics import Medium, RayPaths
from pymantaray.apps.study.figures.register import RunResults, run_figure_specs
from pymantaray.apps.study.figures.trajectory import draw_vehicle_errors


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def plots(run):
    return {
        "range_error": run.plot.range_error,
        "position_error": lambda ax=None: run.plot.position_error("straight", ax),
        "error_by_vehicle": run.plot.error_by_vehicle,
        "fleet": run.plot.fleet,
        "sound_speed": run.plot.sound_speed,
    }


def test_every_plot_returns_the_given_axes_or_new_ones_with_labels(run, as_stored):
    before = len(plt.get_fignums())
    for name, plot in plots(run).items():
        axes = Figure().subplots()
        assert plot(axes) is axes, name
        as_stored(axes.figure, name=name)
        assert axes.get_xlabel(), name
        assert axes.get_ylabel(), name
        assert plot().has_data(), name
    assert len(plt.get_fignums()) - before == len(plots(run))


def test_the_histogram_has_all_errors_and_their_mean(run):
    axes = run.plot.range_error(log=True)
    (histogram,) = axes.patches
    errors = RunResults(run).ranges.total
    errors = errors[np.isfinite(errors)]
    counts, edges, _ = histogram.get_data()
    assert counts.sum() == errors.size
    assert edges[0] <= errors.min() < errors.max() <= edges[-1]
    (mean,) = (line for line in axes.lines if line.get_label() == "mean")
    assert mean.get_xdata()[0] == pytest.approx(errors.mean())
    assert axes.get_yscale() == "log"


def test_the_figure_by_vehicle_equals_the_figure_of_the_report(run):
    table = run.tables["ate_per_vehicle"].frame
    figure = next(
        p for p in run_figure_specs(RunResults(run)) if p.name == "error_by_vehicle"
    ).draw()
    for axes in (run.plot.error_by_vehicle(), figure.axes[0]):
        dots = [line for line in axes.lines if line.get_marker() == "o"]
        shown = np.stack([line.get_ydata() for line in dots])
        np.testing.assert_array_equal(shown.ravel(), table["rmse_m"])
        assert [tick.get_text() for tick in axes.get_xticklabels()] == run.truth.name.tolist()
        quartiles = np.concatenate(
            [np.stack(lines.get_segments())[:, :, 1] for lines in axes.collections]
        )
        np.testing.assert_array_equal(quartiles, table[["p25_m", "p75_m"]])


@pytest.mark.parametrize(("vehicles", "angle"), [(6, 0.0), (7, 90.0)])
def test_names_that_do_not_fit_side_by_side_are_upright(vehicles, angle):
    names = [f"vehicle {k:04d}" for k in range(vehicles)]  # 96 letters and gaps of two fit
    errors = dict.fromkeys(["rmse_m", "p25_m", "p75_m"], 1.0)
    axes = Figure().subplots()
    draw_vehicle_errors(axes, pd.DataFrame({"vehicle": names, "condition": "straight", **errors}))
    assert {label.get_rotation() for label in axes.get_xticklabels()} == {angle}


def test_a_medium_shows_its_profile_and_its_bed(as_stored):
    medium = Medium.from_profile(
        [0.0, 100.0, 2000.0],
        [1500.0, 1490.0, 1520.0],
        bottom_depth=1500.0,
        interpolation="linear",
    )
    axes = medium.plot()
    as_stored(axes.figure)
    (line, bed) = axes.lines
    np.testing.assert_allclose(line.get_xdata(), [1500.0, 1490.0, 1520.0])
    assert bed.get_ydata()[0] == 1500.0
    assert axes.get_ylim()[0] > axes.get_ylim()[1] == 0.0


def test_rays_have_their_distances_depths_and_styles_by_reflection(as_stored):
    down = np.array([10.0, 400.0, 10.0])
    position = np.column_stack([[0.0, 300.0, 600.0], [0.0, 400.0, 800.0], down])
    both = {"position": np.concatenate([position, position]), "slowness": np.full((6, 3), 1e-4)}
    paths = RayPaths(
        arrival=[0, 0, 0, 1, 1, 1],
        travel_time=[0, 0.3, 0.6] * 2,
        boundary=[0, 0, 0, 0, 2, 0],
        **both,
    )
    axes = paths.plot()
    as_stored(axes.figure)
    direct, reflected = axes.lines
    np.testing.assert_allclose(direct.get_xdata(), [0.0, 0.5, 1.0])
    np.testing.assert_array_equal(direct.get_ydata(), down)
    assert (direct.get_label(), reflected.get_label()) == ("direct", "bottom")
    assert axes.yaxis.get_inverted()


def test_arrivals_are_a_data_frame_with_units_in_names(as_stored):
    arrivals = make_arrivals(
        [0, 0, 2], status=(0, 1, 0), travel_time=[1.0, 1.5, 2.0], launch_angle=[0.1, 0.2, -0.1]
    )
    frame = arrivals.to_dataframe()
    as_stored(frame)
    assert frame[["link", "arrival"]].to_numpy().tolist() == [[0, 0], [0, 1], [2, 0]]
    np.testing.assert_array_equal(frame["travel_time_s"], arrivals.travel_time)
    np.testing.assert_allclose(frame["launch_angle_deg"], np.degrees(arrivals.launch_angle))
    assert repr(arrivals) == "<Arrivals: 3 arrivals, 3 links (1 shadow)>"


def test_a_run_and_its_plots_are_shown_in_one_line(run):
    assert repr(run) == f"<Run {run.path}>"
    plots = repr(run.plot)
    assert plots.startswith("<RunPlots: ")
    assert "range_error()" in plots
    for word in plots.removeprefix("<RunPlots: ").rstrip(">").split(", "):
        assert callable(getattr(run.plot, word.removesuffix("()")))

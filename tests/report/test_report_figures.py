"""Figures show the data: artists are read back and compared with what they were given."""

import numpy as np
import pytest
from matplotlib.collections import LineCollection

from pymantaray.records import RayStatus
from pymantaray.report import style
from pymantaray.report.figures import range_ends
from pymantaray.report.figures_fleet import factor_graph, fleet_layout
from pymantaray.report.figures_ocean import ray_picture, sound_speed_profiles
from pymantaray.report.figures_ranging import dropout_map, range_error_histogram, range_error_split
from pymantaray.report.figures_trajectory import ApePanel, error_over_time, pooled_ape
from pymantaray.report.style import ocean_header

HEADER = "Test Sea, synthetic ocean"


def test_every_figure_has_units_on_its_axes_and_says_synthetic(look, fakes, made, truth, measurements):
    error = measurements.refracted_range - measurements.straight_range
    ape = {"straight": np.random.default_rng(0).random((3, 4, truth.time.size))}
    fixes = np.zeros((4, truth.time.size), dtype=bool)
    figures = [
        sound_speed_profiles([("Test Sea", fakes.profile())], HEADER),
        ray_picture(fakes.rays(), HEADER),
        fleet_layout(truth, measurements, HEADER),
        factor_graph(truth, measurements, HEADER),
        range_error_histogram([("Test Sea", error)], HEADER),
        range_error_split(measurements.straight_range, error, -np.abs(error), HEADER),
        dropout_map(*range_ends(truth, measurements), measurements.range_status, HEADER),
        pooled_ape([ApePanel("log", ape, log=True), ApePanel("linear", ape, log=False)], HEADER),
        error_over_time(truth.time, list("ABCD"), ape, fixes, HEADER),
    ]
    for figure in figures:
        look.draw(figure)
        assert HEADER in look.texts(figure)
        labels = [figure.get_supxlabel(), figure.get_supylabel()]
        for axes in figure.axes:
            labels += [axes.get_xlabel(), axes.get_ylabel()]
        labels = [label for label in labels if label]
        assert len(labels) >= 2
        assert all("[" in label or label == "Ranges in a bin" for label in labels), labels
        assert figure.get_figwidth() in (style.COLUMN, style.DOUBLE)


def test_no_text_is_cut_off_and_no_legend_covers_the_header(look, fakes, truth, measurements):
    header = ocean_header({"title": "A name " * 9, "synthetic": 1, "time": "2014-07-15T12:00:00"})
    error = measurements.refracted_range - measurements.straight_range
    rng = np.random.default_rng(0)
    ape = {name: rng.gamma(3.0, 9.0, (3, 4, truth.time.size)) for name in style.CONDITION_COLOURS}
    fixes = np.zeros((4, truth.time.size), dtype=bool)
    region = "Another name " * 9
    figures = [
        sound_speed_profiles([(region, fakes.profile()), ("b", fakes.profile())], "header"),
        ray_picture(fakes.rays(), header),
        fleet_layout(truth, measurements, header),
        range_error_histogram([(region, error)], header),
        range_error_split(measurements.straight_range, error, -np.abs(error), header),
        dropout_map(*range_ends(truth, measurements), measurements.range_status, header),
        pooled_ape([ApePanel(region, ape, log=True), ApePanel("linear", ape, log=False)], header),
        error_over_time(truth.time, list("ABCD"), ape, fixes, header),
    ]
    for figure in figures:
        renderer = look.draw(figure).canvas.get_renderer()
        frame = figure.bbox.padded(1.0)
        plane = [axes for axes in figure.axes if axes.name != "3d"]
        shown = [*figure.texts, figure._suptitle, *figure.legends]
        for axes in plane:
            shown += [axes.xaxis.label, axes.yaxis.label, axes._left_title, *axes.texts]
            low, high = sorted(axes.get_xlim())
            shown += [t for t in axes.get_xticklabels() if low <= t.get_position()[0] <= high]
        for artist in shown:
            if artist.get_window_extent(renderer).width > 0.0:
                box = artist.get_window_extent(renderer)
                assert frame.containsx(box.x0), artist
                assert frame.containsx(box.x1), artist
                assert frame.containsy(box.y0), artist
                assert frame.containsy(box.y1), artist
        header_box = figure._suptitle.get_window_extent(renderer)
        for artist in [*figure.legends, *(axes._left_title for axes in plane)]:
            if artist.get_window_extent(renderer).width > 0.0:
                assert not header_box.overlaps(artist.get_window_extent(renderer)), artist


def test_profiles_are_drawn_where_there_is_water_and_depth_grows_downward(look, fakes):
    profile = fakes.profile()
    figure = look.draw(sound_speed_profiles([("One", profile), ("Other", profile)], HEADER))
    whole, upper = figure.axes
    wet = profile["count"].values > 0
    np.testing.assert_array_equal(whole.lines[0].get_xdata(), profile["mean"].values[wet])
    np.testing.assert_array_equal(whole.lines[0].get_ydata(), profile["depth"].values[wet])
    assert whole.get_ylim() == (3000.0, 0.0)
    assert upper.get_ylim() == (500.0, 0.0)
    shade = whole.collections[0].get_paths()[0].vertices
    assert shade[:, 0].min() == profile["min"].values[wet].min()
    assert shade[:, 0].max() == profile["max"].values[wet].max()
    low, high = upper.get_xlim()
    assert low < 1437.0
    assert 1450.0 < high < 1470.0, "the upper panel must not stretch to speeds of the deep"


def test_ray_picture_states_the_exaggeration_that_it_has(look, fakes):
    figure = look.draw(ray_picture(fakes.rays(n_arriving=2), HEADER))
    axes = figure.axes[0]
    (x0, y0), (x1, y1) = axes.transData.transform([(0.0, 0.0), (1.0, 1000.0)])  # 1 km each way
    expected = abs(y1 - y0) / abs(x1 - x0)
    stated = float(axes.get_title(loc="left").rpartition(" ")[2])
    assert stated == pytest.approx(expected, rel=0.05)  # two digits are shown
    assert "A to B, 8 h" in axes.get_title(loc="left")
    assert "2 direct eigenrays" in look.texts(figure)


def test_ray_picture_draws_eigenrays_over_fan_and_chord_between_ends(look, fakes):
    rays = fakes.rays()
    axes = ray_picture(rays, HEADER).axes[0]
    (direct,) = look.markers(axes, style.ORANGE)
    np.testing.assert_array_equal(direct.get_ydata(), rays["ray_depth"].values[0])
    np.testing.assert_allclose(direct.get_xdata(), rays["ray_range"].values[0] / 1e3)
    fan = [line for line in axes.lines if line.get_linewidth() < 0.5]
    assert len(fan) == 3
    assert max(line.get_zorder() for line in fan) < direct.get_zorder()
    chord = next(line for line in look.markers(axes, style.INK) if line.get_linestyle() == "--")
    np.testing.assert_allclose(chord.get_xydata(), [[0.0, 100.0], [6.0, 800.0]])
    assert axes.get_ylim()[0] > axes.get_ylim()[1]


def test_ray_picture_ends_above_a_sea_bed_that_is_far_below(look, fakes):
    rays = fakes.rays()
    deepest = max(rays["ray_depth"].values[0].max(), rays["chord_depth"].values.max())
    whole = ray_picture(rays, HEADER).axes[0].get_ylim()[0]
    assert whole == min(3.0 * deepest, rays["depth"].values[-1])
    shallow = rays.assign(ray_depth=rays["ray_depth"] / 10.0, chord_depth=rays["chord_depth"] / 10.0)
    axes = look.draw(ray_picture(shallow, HEADER)).axes[0]
    assert axes.get_ylim()[0] == pytest.approx(0.3 * deepest)
    speed = axes.collections[0].get_array()
    seen = rays["sound_speed"].where(rays["depth"] <= 0.3 * deepest, drop=True)
    assert speed.max() <= rays["sound_speed"].values.max()
    assert speed.min() == pytest.approx(float(seen.min()), abs=0.5)


def test_ray_picture_of_a_shadow_has_no_eigenray(look, fakes):
    figure = look.draw(ray_picture(fakes.rays(n_arriving=0), HEADER))
    assert "direct eigenray" not in look.texts(figure)


def test_fleet_is_drawn_east_to_the_right(truth, measurements):
    plan = fleet_layout(truth, measurements, HEADER).axes[0]
    for line, path in zip(plan.lines, truth.position, strict=False):
        np.testing.assert_allclose(line.get_xdata(), path[:, 1] / 1e3)
        np.testing.assert_allclose(line.get_ydata(), path[:, 0] / 1e3)
    starts = plan.collections[0].get_offsets()
    np.testing.assert_allclose(starts, truth.position[:, 0, [1, 0]] / 1e3)


def test_range_edges_of_the_graph_join_the_true_places_of_both_ends(look, truth, measurements):
    figure = factor_graph(truth, measurements, HEADER)
    axes = figure.axes[0]
    edges = next(c for c in axes.collections if isinstance(c, LineCollection))._segments3d * 1e3
    heard = np.flatnonzero(measurements.range_status == RayStatus.OK)
    assert len(edges) == heard.size
    length = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=-1)
    np.testing.assert_allclose(length, measurements.straight_range[heard])
    agent = np.flatnonzero(measurements.range_receiver[heard] < 4)[0]
    row = heard[agent]
    where = truth.position[measurements.range_transmitter[row], measurements.range_sample[row]]
    np.testing.assert_allclose(edges[agent, 0], where[[1, 0, 2]])
    assert f"{heard.size:,} range edges" in look.texts(figure)


def test_empty_and_degenerate_data_are_drawn_with_a_word_why(look, fakes):
    lone = fakes.Made(names=("A",), landmarks=(), pings=0)
    truth = fakes.truth(lone, np.random.default_rng(0))
    measurements = fakes.measurements(lone, truth, np.random.default_rng(0))[0]
    nothing = np.full(7, np.nan)
    every = [
        (range_error_histogram([("x", nothing)], ""), "no range was heard"),
        (range_error_histogram([("x", np.empty(0))], ""), "no range was heard"),
        (range_error_histogram([("x", np.array([3.0]))], ""), "N = 1"),
        (range_error_histogram([("x", np.zeros(5))], ""), "N = 5"),
        (range_error_split(nothing, nothing, nothing, ""), "no range was heard"),
        (dropout_map(np.empty((0, 3)), np.empty((0, 3)), np.empty(0, "i1"), ""), "no range was attempted"),
        (pooled_ape([ApePanel("p", {"straight": nothing}, log=True)], ""), "no usable solve"),
        (pooled_ape([ApePanel("p", {"straight": np.zeros(9)}, log=True)], ""), "mean 0.00 m"),
        (pooled_ape([ApePanel("p", {}, log=False)], ""), "p"),
        (fleet_layout(truth, measurements, ""), "A"),
        (factor_graph(truth, measurements, ""), "0 range edges"),
        (
            error_over_time(
                truth.time,
                ["A"],
                {"straight": np.full((2, 1, truth.time.size), np.nan)},
                np.zeros((1, truth.time.size), bool),
                "",
            ),
            "Straight",
        ),
    ]
    for figure, word in every:
        look.draw(figure)
        assert word in look.texts(figure)

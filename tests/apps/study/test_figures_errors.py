"""
Figures of range and position errors: artists are read back and compared with what they were given.
"""

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from scipy import stats

from pymantaray.apps.study.figures.ranging import (
    dropout_map,
    range_error_histogram,
    range_error_split,
)
from pymantaray.apps.study.figures.register import range_ends
from pymantaray.apps.study.figures.trajectory import (
    ApePanel,
    draw_error_distribution,
    error_over_time,
    pooled_ape,
)
from pymantaray.evaluation import range_errors
from pymantaray.plotting import style
from pymantaray.records import RayStatus

HEADER = "Test Sea, synthetic ocean"


def test_histogram_counts_every_range_once_and_marks_the_mean(look, records, as_stored):
    error = records.ranging_truth.refracted_range - records.ranging_truth.distance
    heard = error[np.isfinite(error)]
    figure = look.draw(
        range_error_histogram([("Test Sea", error), ("Other", 2.0 * error[:40])], HEADER)
    )
    as_stored(figure)
    assert len({axes.get_xlim() for axes in figure.axes}) == 1
    assert look.steps(figure.axes[2])[0].sum() == np.isfinite(error[:40]).sum()
    for axes in figure.axes[:2]:
        counts, edges = look.steps(axes)
        assert counts.sum() == heard.size
        np.testing.assert_array_equal(counts, np.histogram(heard, edges)[0])
        lines = look.vertical_lines(axes)
        assert lines[style.ORANGE] == pytest.approx(heard.mean())
        assert lines[style.INK] == 0.0
        normal = max(axes.lines, key=lambda line: len(line.get_xdata()))
        x, y = normal.get_data()
        area = np.trapezoid(y, x) / (edges[1] - edges[0])
        inside = np.diff(stats.norm(heard.mean(), heard.std(ddof=1)).cdf(edges[[0, -1]]))[0]
        assert area == pytest.approx(heard.size * inside, rel=1e-3), (
            "the normal must enclose as many ranges"
        )
        assert x[np.argmax(y)] == pytest.approx(heard.mean(), abs=x[1] - x[0])
    assert f"N = {heard.size:,}" in figure.axes[0].get_title(loc="left")
    assert figure.axes[1].get_yscale() == "log"


def test_titles_of_the_histogram_fit_beside_a_long_name(look):
    error = np.random.default_rng(1).normal(-114.19, 129.53, 4574)
    figure = look.draw(range_error_histogram([("Lofoten slope 1.2 km", error)], HEADER))
    frame = figure.bbox.padded(1.0)
    for axes in figure.axes:
        box = axes._left_title.get_window_extent(figure.canvas.get_renderer())
        assert frame.containsx(box.x0)
        assert frame.containsx(box.x1)


def test_split_draws_each_part_against_distance(look, records, as_stored):
    e, distance = range_errors(records.ranging_truth), records.ranging_truth.distance
    heard = np.isfinite(e.bending)
    figure = look.draw(range_error_split(distance, e.reference_speed, e.bending, HEADER))
    as_stored(figure)
    both, counts, alone = figure.axes
    for axes, colour, part in (
        (both, style.BLUE, e.reference_speed),
        (both, style.ORANGE, e.bending),
        (alone, style.ORANGE, e.bending),
    ):
        (points,) = look.markers(axes, colour)
        np.testing.assert_array_equal(points.get_ydata(), part[heard])
        np.testing.assert_allclose(points.get_xdata(), distance[heard] / 1e3)
    assert [int(p.get_data().values.sum()) for p in counts.patches] == [heard.sum()] * 2


def test_dropout_map_shows_every_attempt_under_its_status(look, records, as_stored):
    ends, status = (
        range_ends(records.truth, records.measurements),
        records.measurements.range_status,
    )
    figure = look.draw(dropout_map(*ends, status, HEADER))
    as_stored(figure)
    distance, depths = figure.axes
    drawn = {line.get_label(): line for line in distance.lines}
    counts = {s: int((status == s).sum()) for s in RayStatus}
    assert f"received ({counts[RayStatus.OK]:,})" in drawn
    assert f"shadow ({counts[RayStatus.SHADOW]:,})" in drawn
    assert sum(len(line.get_xdata()) for line in drawn.values()) == status.size
    weak = drawn[f"too weak ({counts[RayStatus.WEAK]:,})"]
    expected = records.ranging_truth.distance[status == RayStatus.WEAK] / 1e3
    np.testing.assert_allclose(weak.get_xdata(), expected)
    assert all((line.get_xdata() <= line.get_ydata()).all() for line in depths.lines)


def test_pooled_errors_are_shares_with_mean_and_quartiles_marked(look, as_stored):
    rng = np.random.default_rng(4)
    ape = {
        "odometry": rng.gamma(4.0, 40.0, (3, 4, 500)),
        "straight": rng.gamma(3.0, 3.0, (3, 4, 500)),
    }
    ape["straight"][0] = np.nan  # a solve that failed
    ape |= {"other": rng.gamma(3.0, 3.0, 900), "constant": 40.0 * ape["straight"]}
    panels = [ApePanel("log", ape, log=True), ApePanel("linear", ape, log=False)]
    figure = look.draw(pooled_ape(panels, HEADER))
    as_stored(figure)
    grid = np.array(figure.axes).reshape(4, 2)
    for row, values in zip(grid, ape.values(), strict=True):
        errors = values[np.isfinite(values)]
        for axes in row:
            share, edges = look.steps(axes)
            inside = np.mean((errors >= edges[0]) & (errors <= edges[-1]))
            assert share.sum() == pytest.approx(100.0 * inside)
            lines = sorted(line.get_xdata()[0] for line in axes.lines)
            np.testing.assert_allclose(
                lines, sorted([errors.mean(), *np.percentile(errors, [25, 75])])
            )
    assert [axes.get_xscale() for axes in grid[0]] == ["log", "linear"]
    reach = grid[0, 1].get_xlim()[1]
    assert reach < 4.0 * np.percentile(ape["other"], 99.9), (
        "the linear axis is that of the solved conditions, less one that is far off"
    )
    for name in ("odometry", "constant"):
        beyond = 100.0 * np.mean(ape[name][np.isfinite(ape[name])] > reach)
        assert f"{beyond:.0f} % beyond the axis" in look.texts(figure)


@pytest.mark.parametrize(("number", "words"), [(4, ""), (7, ", 1 % beyond the axis")])
def test_half_a_percent_beyond_the_axis_is_said(number, words):
    errors = {"straight": np.linspace(1.0, 2.0, 1000), "odometry": np.ones(1000)}
    errors["odometry"][:number] = 1e3
    axes = Figure().subplots()
    draw_error_distribution(axes, errors, "odometry", log=False)
    assert axes.texts[-1].get_text() == f"mean {errors['odometry'].mean():.2f} m{words}"


def test_the_band_of_error_over_time_is_between_the_quartiles(look, records):
    """Of ranks 0 to 100 the quartiles are 25 and 75."""
    time = records.truth.time
    ranks = np.random.default_rng(6).permutation(101)[:, None, None] + 1.0
    values = ranks * np.array([1.0, 2.0, 5.0, 10.0])[:, None] * np.linspace(1.0, 3.0, time.size)
    figure = look.draw(
        error_over_time(
            time, list("ABCD"), {"refracted": values}, np.zeros((4, time.size), bool), HEADER
        )
    )
    for axes, scale in zip(figure.axes, (1.0, 2.0, 5.0, 10.0), strict=False):
        (band,) = axes.collections
        assert to_hex(band.get_facecolor()[0]) == to_hex(axes.lines[0].get_color())
        corners = band.get_paths()[0].vertices
        for hour, factor in ((0.0, 1.0), (time[-1] / 3600.0, 3.0)):
            edge = corners[np.isclose(corners[:, 0], hour), 1]
            assert [edge.min(), edge.max()] == pytest.approx(
                [26.0 * scale * factor, 76.0 * scale * factor]
            )


def test_error_over_time_is_the_median_of_healthy_realizations(look, records):
    rng = np.random.default_rng(6)
    values = rng.gamma(3.0, 3.0, (5, 4, records.truth.time.size))
    values[2] = np.nan
    fixes = np.zeros((4, records.truth.time.size), dtype=bool)
    fixes[1, 10:20] = True
    errors = {"straight": values} | {f"estimator-{i}": values + i for i in range(style.DISTINCT)}
    figure = look.draw(error_over_time(records.truth.time, list("ABCD"), errors, fixes, HEADER))
    lines = [
        line for line in figure.axes[0].lines if len(line.get_xdata()) == records.truth.time.size
    ]
    assert len({line.get_color() for line in lines}) == len(errors)
    assert figure.legends[0].get_texts()[-1].get_text() == "GNSS fix"
    middle = np.median(np.delete(values, 2, axis=0), axis=0)
    labelled = [axes.xaxis.get_tick_params()["labelbottom"] for axes in figure.axes[:4]]
    assert labelled == [False, True, True, True]  # of four in three columns, two have none below
    for i, axes in enumerate(figure.axes[:4]):
        (line,) = look.markers(axes, style.BLUE)
        np.testing.assert_allclose(line.get_ydata(), middle[i])
        np.testing.assert_allclose(line.get_xdata(), records.truth.time / 3600.0)
        (rug,) = (line for line in look.markers(axes, style.SKY) if line.get_linewidth() == 0.6)
        np.testing.assert_array_equal(rug.get_xdata()[::3], records.truth.time[fixes[i]] / 3600.0)

"""
Figures of consistency, estimators and unknowns: what is drawn is what the tables say, verdicts
included.
"""

from itertools import pairwise

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex

from pymantaray.apps.study.figures.estimators import (
    consistency_over_time,
    error_and_consistency,
    unknowns_before_and_after,
)

HEADER = "Test Sea, synthetic ocean"


def curves(axes):
    return [
        line for line in axes.lines if line.get_linestyle() == "-" and len(line.get_xdata()) == 4
    ]


def test_curves_are_the_ratios_and_each_marker_says_its_verdict(look, tables, as_stored):
    table = tables.consistency
    figure = look.draw(consistency_over_time(table, HEADER))
    as_stored(figure)
    top, ranges, near = figure.axes[:3]
    horizontal = table[table["statistic"] == "horizontal"]
    assert [line.get_ydata().tolist() for line in curves(top)] == [
        part["ratio"].tolist() for _, part in horizontal.groupby("condition", sort=False)
    ]
    points = [line for line in top.lines if line.get_linestyle() == "None"]
    for inside in (True, False):
        shown = [
            y
            for p in points
            if inside == (to_hex(p.get_markerfacecolor()) != "#ffffff")
            for y in p.get_ydata()
        ]
        assert sorted(shown) == sorted(horizontal.loc[horizontal["inside"] == inside, "ratio"])
    assert len(curves(ranges)) == 2, "odometry has no ranges to judge"
    (band,) = [c for c in top.collections if isinstance(c, PolyCollection)]
    y = band.get_paths()[0].vertices[:, 1]
    assert (y.min(), y.max()) == pytest.approx((0.9, 1.1)), "of the condition with the most solves"
    assert (top.get_yscale(), near.get_yscale()) == ("log", "linear")
    bottom, roof = near.get_ylim()
    assert 0.5 < bottom < 0.85
    assert 1.15 < roof < 1.5
    sure = look.draw(consistency_over_time(table[table["condition"] != "refracted"], HEADER))
    assert [axes.get_yscale() for axes in sure.axes] == ["linear"] * 2
    one = consistency_over_time(table[table["time_h"] == 48.0], HEADER)
    assert one.axes[0].get_xlim() == (47.5, 48.5)


@pytest.mark.parametrize(
    ("ratio", "low", "high", "near"),
    [
        (0.24, 0.8, 1.1, (0.5, 1.5)),
        (0.26, 0.8, 1.1, None),
        (3.9, 0.9, 1.5, None),
        (4.1, 0.9, 1.5, (0.0, 2.25)),
    ],
)
def test_ratios_beyond_four_need_a_logarithmic_axis_and_a_near_one(tables, ratio, low, high, near):
    """The near one has 2.5 times the wider side of the band to both sides, and none below zero."""
    kinds = [("straight", "horizontal"), ("straight", "ranges")]
    table = tables.consistency_rows({kind: [1.0, 1.0, ratio, 1.0] for kind in kinds})
    grid = consistency_over_time(table.assign(low=low, high=high), HEADER).axes
    assert [axes.get_yscale() for axes in grid[:2]] == ["linear" if near is None else "log"] * 2
    assert [axes.get_ylim() for axes in grid[2:]] == [pytest.approx(near)] * (2 if near else 0)


def test_many_estimators_look_different_and_names_are_literal(look, tables):
    names = ["straight", "a$x$", *"bcdefghijkl"]
    table = tables.consistency_rows({(n, "horizontal"): [1.02, 0.98, 1.3, 1.0] for n in names})
    figure = look.draw(consistency_over_time(table, HEADER))
    lines, handles = curves(figure.axes[0]), figure.legends[0].get_lines()
    looks = {(a.get_color(), b.get_marker()) for a, b in zip(lines, handles, strict=False)}
    assert len(looks) == len(names)
    first = [line.get_xdata()[0] for line in lines]  # within half of the 12 hours between epochs
    spread = 6.0 / len(names) * np.arange(len(names))
    np.testing.assert_allclose(first, 24.0 + spread - spread.mean())
    assert r"a\$x\$" in look.texts(figure)
    assert look.texts(figure).count("no usable solve") == 1, "no ranges in this table"
    assert (
        look.texts(look.draw(consistency_over_time(table.iloc[:0], HEADER))).count(
            "no usable solve"
        )
        == 2
    )


def test_estimators_are_where_the_tables_say(look, tables, as_stored):
    figure = look.draw(
        error_and_consistency(tables.errors, tables.at_pings, tables.consistency, HEADER)
    )
    as_stored(figure)
    error, under_water, nees = figure.axes
    np.testing.assert_allclose(under_water.collections[0].get_offsets()[:3, 0], [120.0, 0.75, 25.5])
    np.testing.assert_allclose(error.collections[0].get_offsets()[:3, 0], [80.0, 12.0, 130.5])
    assert [t.get_text() for t in error.texts] == ["80.00", "12.00", "130.5"]
    assert error.get_yticklabels()[2].get_text() == "Refracted ranges"
    (dashed,) = [line for line in under_water.lines if line.get_linestyle() == "--"]
    assert dashed.get_xdata()[0] == 0.5
    assert figure.legends[0].get_texts()[0].get_text() == "lower bound"
    spans = [
        line
        for line in nees.lines
        if len(line.get_xdata()) == 2 and len(set(line.get_ydata())) == 1
    ]
    assert [tuple(line.get_xdata()) for line in spans] == [
        (0.99, 1.01),
        (0.98, 1.3),
        (150.0, 1200.0),
    ]
    points = [line for line in nees.lines if line.get_marker() == "o"]
    assert [float(line.get_xdata()[0]) for line in points] == pytest.approx([1.0, 1.01, 650.0])
    every, some, none = (line.get_markerfacecolor() for line in points)
    assert every == points[0].get_color()
    assert some not in {"white", points[1].get_color()}
    assert none == "white"
    two = look.draw(error_and_consistency(tables.errors, tables.at_pings, None, HEADER)).axes
    assert len(two) == 2
    for axes in two:
        assert {2.0, 5.0, 10.0, 20.0, 50.0, 100.0} <= {*axes.get_xticks()}


def test_numbers_of_wide_axes_are_powers_of_ten_that_do_not_touch(look, tables):
    """A NEES of 120,000, as one speed for all water has, beside one of 1."""
    wide = tables.consistency_rows(
        {("straight", "horizontal"): [1.0] * 4, ("refracted", "horizontal"): [1.2e5] * 4}
    )
    for table, hundred in ((tables.consistency, "100"), (wide, r"$\mathdefault{10^{2}}$")):
        *_, nees = look.draw(
            error_and_consistency(tables.errors, tables.at_pings, table, HEADER)
        ).axes
        low, high = nees.get_xlim()
        labels = [t for t in nees.get_xticklabels() if low <= t.get_position()[0] <= high]
        assert hundred in [t.get_text() for t in labels]
        boxes = [label.get_window_extent() for label in labels]
        assert not any(a.overlaps(b) for a, b in pairwise(boxes))


def test_unknowns_are_scaled_by_their_prior_and_names_do_not_touch(look, tables, as_stored):
    figure = look.draw(unknowns_before_and_after(tables.unknowns, HEADER))
    as_stored(figure)
    few, lots = figure.axes
    for axes, sigma, error in (
        (few, [0.1, 1.0], [0.05, 0.5]),
        (lots, np.linspace(1e-2, 1.0, 10), np.linspace(2e-2, 1.0, 10)),
    ):
        for line, expected in zip(axes.lines[1:3], (sigma, error), strict=True):
            np.testing.assert_allclose(line.get_ydata(), expected)
        boxes = [label.get_window_extent() for label in axes.get_xticklabels()]
        assert not any(a.overlaps(b) for a, b in pairwise(boxes))
    assert [t.get_text() for t in few.get_xticklabels()] == ["mode 1", "mode 2"]

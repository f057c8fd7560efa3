"""Figure of consistency: what is drawn is what the table says, bounds and verdicts included."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex

from pymantaray.evaluation.consistency import mean_chi_square_bounds
from pymantaray.report.figures_consistency import consistency_over_time

HEADER = "Test Sea, synthetic ocean"
HOURS = np.array([24.0, 48.0, 72.0, 84.0])


def make_table(ratios, *, realizations=25, failed=()):
    rows = []
    for (condition, statistic), values in ratios.items():
        n = realizations - (5 if condition in failed else 0)
        freedom = n * (22 if statistic == "horizontal" else 110)
        low, high = (float(b) for b in mean_chi_square_bounds(freedom))
        rows += [
            {"condition": condition, "time_h": t, "statistic": statistic, "realizations": n,
             "degrees_of_freedom": freedom, "ratio": v, "low": low, "high": high, "inside": low <= v <= high,
             "p_value": 0.5}
            for t, v in zip(HOURS, values, strict=True)
        ]  # fmt: skip
    return pd.DataFrame(rows)


GOOD = [1.02, 0.98, 1.3, 1.0]
FAR = [150.0, 900.0, 400.0, 1200.0]


@pytest.fixture
def table():
    return make_table(
        {
            ("odometry", "horizontal"): [0.99, 1.0, 1.01, 1.0],
            ("straight", "horizontal"): GOOD,
            ("straight", "ranges"): [1.0, 1.01, 0.99, 1.0],
            ("refracted", "horizontal"): FAR,
            ("refracted", "ranges"): [2e3, 3e3, 2e3, 4e3],
        },
        failed=("refracted",),
    )


def curves(axes):
    return [
        line for line in axes.lines if line.get_linestyle() == "-" and len(line.get_xdata()) == len(HOURS)
    ]


def points(axes):
    return [line for line in axes.lines if line.get_linestyle() == "None"]


def test_curves_are_the_ratios_and_each_marker_says_its_verdict(look, table):
    figure = look.draw(consistency_over_time(table, HEADER))
    top = figure.axes[0]
    assert top.get_yscale() == "log"
    drawn = [line.get_ydata().tolist() for line in curves(top)]
    assert drawn == [[0.99, 1.0, 1.01, 1.0], GOOD, FAR]
    inside = sum(len(p.get_ydata()) for p in points(top) if to_hex(p.get_markerfacecolor()) != "#ffffff")
    outside = [y for p in points(top) if to_hex(p.get_markerfacecolor()) == "#ffffff" for y in p.get_ydata()]
    assert inside == 7
    assert sorted(outside) == sorted([1.3, *FAR])
    ranges = curves(figure.axes[1])
    assert len(ranges) == 2, "odometry has no ranges to judge"


def test_band_is_that_of_the_condition_with_the_most_solves(look, table):
    figure = look.draw(consistency_over_time(table, HEADER))
    low, high = (float(b) for b in mean_chi_square_bounds(25 * 22))
    (band,) = [c for c in figure.axes[0].collections if isinstance(c, PolyCollection)]
    y = band.get_paths()[0].vertices[:, 1]
    assert (y.min(), y.max()) == pytest.approx((low, high))


def test_lower_row_shows_the_surroundings_of_the_band_only_where_some_are_far_off(look, table):
    far = look.draw(consistency_over_time(table, HEADER))
    assert len(far.axes) == 4
    bottom, top = far.axes[2].get_ylim()
    assert far.axes[2].get_yscale() == "linear"
    assert 0.5 < bottom < 0.88, "the band is 0.885 to 1.12"
    assert 1.12 < top < 1.5
    near = look.draw(consistency_over_time(table[table["condition"] != "refracted"], HEADER))
    assert len(near.axes) == 2
    assert {axes.get_yscale() for axes in near.axes} == {"linear"}


def test_many_estimators_look_different_and_names_are_literal(look):
    names = ["straight", "a$x$", "b", "c", "d", "e", "f", "g"]
    figure = look.draw(consistency_over_time(make_table({(n, "horizontal"): GOOD for n in names}), HEADER))
    lines = curves(figure.axes[0])
    kinds = {(line.get_color(), handle.get_marker()) for line, handle in
             zip(lines, figure.legends[0].get_lines(), strict=False)}  # fmt: skip
    assert len(kinds) == len(names)
    found = look.texts(figure)
    assert r"a\$x\$" in found
    assert "nothing to judge" in found, "no ranges in this table"


def test_a_single_epoch_and_an_empty_table_are_drawn(look, table):
    look.draw(consistency_over_time(table[table["time_h"] == 24.0], HEADER))
    figure = look.draw(consistency_over_time(table.iloc[:0], HEADER))
    assert look.texts(figure).count("nothing to judge") == 2

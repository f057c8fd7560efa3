"""Figures of consistency, estimators and unknowns: what is drawn is what the tables say, verdicts included."""

from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex

from pymantaray.report.figures_consistency import consistency_over_time
from pymantaray.report.figures_estimators import error_and_consistency
from pymantaray.report.figures_unknowns import unknowns_before_and_after

HEADER = "Test Sea, synthetic ocean"
HOURS = [24.0, 48.0, 72.0, 84.0]
SURE = [0.99, 1.0, 1.01, 1.0]
GOOD = [1.02, 0.98, 1.3, 1.0]
FAR = [150.0, 900.0, 400.0, 1200.0]


def make_table(ratios, few=()):
    """Ratios by condition and statistic at `HOURS`; bounds of 0.9 to 1.1, wider for conditions of few solves."""
    rows = []
    for (condition, statistic), values in ratios.items():
        reach = 0.15 if condition in few else 0.1
        rows += [
            {
                "condition": condition,
                "time_h": hour,
                "statistic": statistic,
                "degrees_of_freedom": 440 if condition in few else 550,
                "ratio": value,
                "low": 1.0 - reach,
                "high": 1.0 + reach,
                "inside": abs(value - 1.0) <= reach,
            }
            for hour, value in zip(HOURS, values, strict=True)
        ]
    return pd.DataFrame(rows)


@pytest.fixture
def table():
    ratios = {
        ("odometry", "horizontal"): SURE,
        ("straight", "horizontal"): GOOD,
        ("straight", "ranges"): SURE,
    }
    far = {("refracted", "horizontal"): FAR, ("refracted", "ranges"): [2e3, 3e3, 2e3, 4e3]}
    return make_table(ratios | far, few=("refracted",))


def curves(axes):
    return [
        line for line in axes.lines if line.get_linestyle() == "-" and len(line.get_xdata()) == len(HOURS)
    ]


def test_curves_are_the_ratios_and_each_marker_says_its_verdict(look, table):
    top, ranges = look.draw(consistency_over_time(table, HEADER)).axes[:2]
    assert top.get_yscale() == "log"
    assert [line.get_ydata().tolist() for line in curves(top)] == [SURE, GOOD, FAR]
    points = [line for line in top.lines if line.get_linestyle() == "None"]
    full = [p for p in points if to_hex(p.get_markerfacecolor()) != "#ffffff"]
    assert sum(len(p.get_ydata()) for p in full) == 7
    outside = [y for p in points if p not in full for y in p.get_ydata()]
    assert sorted(outside) == sorted([1.3, *FAR])
    assert len(curves(ranges)) == 2, "odometry has no ranges to judge"
    (band,) = [c for c in top.collections if isinstance(c, PolyCollection)]
    y = band.get_paths()[0].vertices[:, 1]
    assert (y.min(), y.max()) == pytest.approx((0.9, 1.1)), "of the condition with the most solves"


def test_lower_row_shows_the_surroundings_of_the_band_only_where_some_are_far_off(look, table):
    far = look.draw(consistency_over_time(table, HEADER))
    assert len(far.axes) == 4
    assert far.axes[2].get_yscale() == "linear"
    bottom, top = far.axes[2].get_ylim()
    assert 0.5 < bottom < 0.85
    assert 1.15 < top < 1.5
    near = look.draw(consistency_over_time(table[table["condition"] != "refracted"], HEADER))
    assert [axes.get_yscale() for axes in near.axes] == ["linear"] * 2


def test_many_estimators_look_different_and_names_are_literal(look, table):
    names = ["straight", "a$x$", "b", "c", "d", "e", "f", "g"]
    figure = look.draw(consistency_over_time(make_table({(n, "horizontal"): GOOD for n in names}), HEADER))
    lines, handles = curves(figure.axes[0]), figure.legends[0].get_lines()
    looks = {(a.get_color(), b.get_marker()) for a, b in zip(lines, handles, strict=False)}
    assert len(looks) == len(names)
    assert r"a\$x\$" in look.texts(figure)
    assert "nothing to judge" in look.texts(figure), "no ranges in this table"
    look.draw(consistency_over_time(table[table["time_h"] == 24.0], HEADER))
    assert look.texts(look.draw(consistency_over_time(table.iloc[:0], HEADER))).count("nothing to judge") == 2


def test_estimators_are_where_the_tables_say(look, table):
    errors = pd.DataFrame({"condition": ["odometry", "straight", "refracted", "lost"]})
    errors["rmse_m"] = [80.0, 12.0, 130.5, np.nan]
    error, nees = (figure := look.draw(error_and_consistency(errors, table, HEADER))).axes
    np.testing.assert_allclose(error.collections[0].get_offsets()[:3, 0], [80.0, 12.0, 130.5])
    assert [t.get_text() for t in error.texts] == ["80.00", "12.00", "130.5"]
    assert error.get_yticklabels()[2].get_text() == "Refracted ranges"
    (dashed,) = [line for line in error.lines if line.get_linestyle() == "--"]
    assert dashed.get_xdata()[0] == 12.0
    assert figure.legends[0].get_texts()[0].get_text() == "error, straight ranges"
    spans = [line for line in nees.lines if len(line.get_xdata()) == 2 and len(set(line.get_ydata())) == 1]
    assert [tuple(line.get_xdata()) for line in spans] == [(0.99, 1.01), (0.98, 1.3), (150.0, 1200.0)]
    points = [line for line in nees.lines if line.get_marker() == "o"]
    assert [float(line.get_xdata()[0]) for line in points] == [1.0, np.median(GOOD), np.median(FAR)]
    every, some, none = (line.get_markerfacecolor() for line in points)
    assert every == points[0].get_color()
    assert some not in {"white", points[1].get_color()}
    assert none == "white"
    assert len(look.draw(error_and_consistency(errors, None, HEADER)).axes) == 1


def unknowns(condition, names, prior, sigma, error):
    columns = {"unknown": names, "prior_sigma": prior, "sigma": sigma, "rms_error": error}
    return pd.DataFrame({"condition": condition, **columns})


def test_unknowns_are_by_their_prior_and_names_that_would_touch_stand_upright(look):
    many = [f"clock {what} {c}" for what in ("offset", "skew") for c in "ABCDE"]
    modes = unknowns("modes", ["mode 1", "mode 2"], 2.0, [0.2, 2.0], [0.1, 1.0])
    clocks = unknowns("clocks", many, 1e-3, np.linspace(1e-5, 1e-3, 10), np.linspace(2e-5, 1e-3, 10))
    few, lots = look.draw(unknowns_before_and_after(pd.concat([modes, clocks]), HEADER)).axes
    sigma, error = (line.get_ydata() for line in few.lines[1:3])
    np.testing.assert_allclose(sigma, [0.1, 1.0])
    np.testing.assert_allclose(error, [0.05, 0.5])
    np.testing.assert_allclose(lots.lines[1].get_ydata(), np.linspace(1e-2, 1.0, 10))
    assert [t.get_text() for t in few.get_xticklabels()] == ["mode 1", "mode 2"]
    assert few.get_ylim() == lots.get_ylim()
    for axes in (few, lots):
        boxes = [label.get_window_extent() for label in axes.get_xticklabels()]
        assert not any(a.overlaps(b) for a, b in pairwise(boxes))

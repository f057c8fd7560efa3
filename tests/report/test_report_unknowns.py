"""Figure of unknowns: every marker is what the table says, by the prior."""

from itertools import pairwise

import numpy as np
import pandas as pd

from pymantaray.report.figures_unknowns import unknowns_before_and_after
from pymantaray.report.style import save_figure


def rows(condition, names, prior, sigma, error):
    return [
        {"condition": condition, "unknown": n, "unit": "s", "realizations": 5, "prior_sigma": prior, "sigma": s,
         "resolution": 1 - (s / prior) ** 2, "rms_error": e, "error_ratio": (e / s) ** 2}
        for n, s, e in zip(names, sigma, error, strict=True)
    ]  # fmt: skip


def test_markers_are_by_the_prior_in_a_panel_for_each_condition(look, tmp_path):
    many = [f"clock offset {c}" for c in "ABCDEFGHIJKLMN"]
    table = pd.DataFrame(
        rows("modes", ["mode 1", "mode 2"], 2.0, [0.2, 2.0], [0.1, 1.0])
        + rows("clocks", many, 1e-3, np.linspace(1e-5, 1e-3, 14), np.linspace(2e-5, 1e-3, 14))
    )
    figure = unknowns_before_and_after(table, "Test Sea, synthetic ocean")
    look.draw(figure)
    few, lots = figure.axes
    sigma, error = (line.get_ydata() for line in few.lines[1:3])
    np.testing.assert_allclose(sigma, [0.1, 1.0])
    np.testing.assert_allclose(error, [0.05, 0.5])
    assert [t.get_text() for t in few.get_xticklabels()] == ["mode 1", "mode 2"]
    assert {t.get_rotation() for t in few.get_xticklabels()} == {0.0}
    assert {t.get_rotation() for t in lots.get_xticklabels()} == {90.0}
    np.testing.assert_allclose(lots.lines[1].get_ydata(), np.linspace(1e-2, 1.0, 14))
    assert few.get_ylim() == lots.get_ylim()
    assert all(path.is_file() for path in save_figure(figure, tmp_path, "unknowns"))


def test_names_that_would_touch_stand_upright(look):
    clocks = [f"clock {what} {c}" for what in ("offset", "skew") for c in "ABCDE"]
    table = pd.DataFrame(rows("clocks", clocks, 1e-3, np.full(10, 1e-4), np.full(10, 1e-4)))
    (axes,) = look.draw(unknowns_before_and_after(table, "")).axes
    boxes = [label.get_window_extent() for label in axes.get_xticklabels()]
    assert not any(a.overlaps(b) for a, b in pairwise(boxes))

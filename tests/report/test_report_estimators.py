"""Figure of estimators: a line for each condition, where the tables say, and its verdict in the marker."""

import numpy as np
import pandas as pd
import pytest

from pymantaray.report.figures_estimators import error_and_consistency
from pymantaray.report.style import save_figure

HEADER = "Test Sea, synthetic ocean"
ERRORS = pd.DataFrame(
    {"condition": ["straight", "refracted", "eigenray", "lost"], "rmse_m": [12.0, 30.0, 12.5, np.nan]}
)
RATIOS = {"straight": [1.0, 1.02, 0.98], "refracted": [100.0, 500.0, 900.0], "eigenray": [1.0, 1.3, 1.05]}


@pytest.fixture
def consistency():
    rows = [
        {
            "condition": name,
            "statistic": statistic,
            "ratio": r,
            "low": 0.9,
            "high": 1.1,
            "inside": 0.9 <= r <= 1.1,
        }
        for name, ratios in RATIOS.items()
        for statistic, factor in (("horizontal", 1.0), ("ranges", 7.0))
        for r in np.array(ratios) * factor
    ]
    return pd.DataFrame(rows)


def test_lines_are_where_the_tables_say(look, consistency, tmp_path):
    figure = error_and_consistency(ERRORS, consistency, HEADER)
    look.draw(figure)
    error, nees = figure.axes
    np.testing.assert_allclose(error.collections[0].get_offsets()[:3, 0], [12.0, 30.0, 12.5])
    assert [t.get_text() for t in error.texts] == ["12.00", "30.00", "12.50"]
    assert error.get_yticklabels()[1].get_text() == "Refracted ranges"
    dashed = [line for line in error.lines if line.get_linestyle() == "--"]
    assert dashed[0].get_xdata()[0] == 12.0
    assert figure.legends[0].get_texts()[0].get_text() == "error, straight ranges"
    spans = [
        line
        for line in nees.lines
        if len(line.get_xdata()) == 2 and line.get_ydata()[0] == line.get_ydata()[1]
    ]
    assert [tuple(line.get_xdata()) for line in spans] == [(0.98, 1.02), (100.0, 900.0), (1.0, 1.3)]
    points = [line for line in nees.lines if line.get_marker() == "o"]
    assert [float(line.get_xdata()[0]) for line in points] == [1.0, 500.0, 1.05]
    faces = [line.get_markerfacecolor() for line in points]
    assert faces[0] == points[0].get_color()  # inside at every epoch
    assert faces[1] == "white"
    assert faces[2] not in {"white", points[2].get_color()}
    assert all(path.is_file() for path in save_figure(figure, tmp_path, "estimators"))


def test_without_covariances_there_is_one_panel(look):
    figure = error_and_consistency(ERRORS, None, HEADER)
    look.draw(figure)
    assert len(figure.axes) == 1

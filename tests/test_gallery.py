"""Scripts of the gallery: short, and each draws its figure."""

import ast
import re
import runpy
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib import pyplot as plt
from pages import ROOT

SCRIPTS = sorted((ROOT / "examples" / "gallery").glob("plot_*.py"))
QUICK = ("plot_eddy", "plot_foreign_graph")


def has_own_scale(panel):
    """
    True if the vertical axis has numbers; a panel that shares the axis of its neighbour has none.
    """
    shown = panel.yaxis.get_tick_params()
    return shown.get("labelleft", True) or shown.get("labelright", False)


def marked(script: Path):
    return pytest.param(
        script, id=script.stem, marks=() if script.stem in QUICK else pytest.mark.slow
    )


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_a_script_has_a_title_and_less_than_thirty_lines(script):
    text = script.read_text(encoding="utf-8")
    words = ast.get_docstring(ast.parse(text))
    assert re.fullmatch(r"[^\n]+\n=+\n\n.+", words, re.DOTALL)
    code = text.split('"""', 2)[2]
    assert len([line for line in code.splitlines() if line.strip()]) < 30


@pytest.mark.parametrize("script", [marked(script) for script in SCRIPTS])
@pytest.mark.filterwarnings("default")
def test_a_script_draws_data_with_units(script, monkeypatch):
    before = sorted(script.parent.iterdir())
    monkeypatch.chdir(script.parent)
    mpl.use("agg")
    figure = runpy.run_path(str(script))["figure"]
    figure.canvas.draw()
    axes = figure.axes[0]
    drawn = [line.get_ydata() for line in axes.lines] + [
        mesh.get_array() for mesh in axes.collections
    ]
    assert any(
        np.isfinite(np.ma.filled(np.ma.asarray(values, dtype=float), np.nan)).any()
        for values in drawn
    )
    assert all(
        re.search(r"\[.+\]$", panel.get_ylabel()) for panel in figure.axes if has_own_scale(panel)
    )
    plt.close("all")
    assert [
        path for path in sorted(script.parent.iterdir()) if path.name != "__pycache__"
    ] == before

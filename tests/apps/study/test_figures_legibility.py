"""
Numbers, names and legends of figures can be read: no offsets, no missing or colliding ticks, a key
to every number.
"""

import hashlib
import re
from io import BytesIO

import numpy as np
import pytest
from matplotlib.ticker import ScalarFormatter
from PIL import Image

from pymantaray.apps.replay import page as replay_page
from pymantaray.apps.study.figures.fleet import factor_graph, fleet_layout
from pymantaray.apps.study.figures.register import RunResults, run_figure_specs
from pymantaray.apps.study.figures.trajectory import error_over_time
from pymantaray.apps.study.page import run_page
from pymantaray.plotting import drawing as write, style
from pymantaray.records import RayStatus
from pymantaray.records.glossary import GLOSSARY

LONG = ("surface-beacon", "remus-north", "hugin-south", "bluefin-east")


def drawn_ticks(axis):
    """Positions and words of the ticks that can be seen."""
    low, high = sorted(axis.get_view_interval())
    return [
        (tick, label.get_text())
        for tick, label in zip(axis.get_majorticklocs(), axis.get_majorticklabels(), strict=True)
        if low <= tick <= high and label.get_text()
    ]


def boxes(figure):
    """Extents of all tick labels that are drawn. [pixels]"""
    renderer = figure.canvas.get_renderer()
    found = []
    for axes in figure.axes:
        if not axes.get_visible():
            continue
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            ticks = [tick for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
            labels = [tick.label1 for tick in ticks if tick.label1.get_visible()]
            found += [label.get_window_extent(renderer) for label in labels if label.get_text()]
    return [box for box in found if box.width > 0]


@pytest.mark.parametrize("draw", [fleet_layout, factor_graph])
@pytest.mark.parametrize("landmarks", [0, 2])
def test_vehicles_that_a_figure_numbers_have_a_key(look, made_run, draw, landmarks):
    truth, measurements, *_ = made_run(names=LONG, landmarks=landmarks).records(1)
    figure = look.draw(draw(truth, measurements, "Test Sea"))
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert words == [f"{i}: {name}" for i, name in enumerate(LONG, 1)]
    legend = figure.legends[0].get_window_extent(figure.canvas.get_renderer())
    for axes in figure.axes:
        assert axes.get_tightbbox().y0 > legend.y1 - 1.0, "the key covers a panel"
    assert legend.x0 >= 0
    assert legend.x1 <= figure.bbox.x1


def test_vehicles_of_short_names_have_no_key(made_run):
    truth, measurements, *_ = made_run().records(1)
    assert fleet_layout(truth, measurements, "Test Sea").legends == []


@pytest.mark.parametrize(
    ("view", "expected"),
    [
        ((1e-2, 1e3), [0.01, 0.1, 1.0, 10.0, 100.0, 1000.0]),
        ((0.9, 11.0), [1.0, 10.0]),
        ((1.5, 8.0), [2.0, 5.0]),
        ((2.1, 4.9), [2.5, 3.0, 3.5, 4.0, 4.5]),
        ((51.0, 53.0), [51.0, 51.5, 52.0, 52.5, 53.0]),
    ],
)
def test_a_logarithmic_axis_has_two_numbers_at_least(view, expected):
    figure = style.new_figure(style.COLUMN, 2.0, "")
    axes = figure.subplots()
    axes.set_xscale("log")
    axes.set_xlim(*view)
    style.short_numbers(axes.xaxis)
    figure.canvas.draw()
    shown = [(tick, float(text)) for tick, text in drawn_ticks(axes.xaxis)]
    assert len(shown) >= 2
    np.testing.assert_allclose([text for _, text in shown], [tick for tick, _ in shown])
    if len(expected) == len(shown):
        np.testing.assert_allclose([tick for tick, _ in shown], expected)
    assert set(np.round([tick for tick, _ in shown], 6)) <= set(
        np.round([*expected, *np.arange(51, 53.1, 0.5)], 6)
    )


@style.styled
def _figure_of_near_values():
    figure = style.new_figure(style.COLUMN, 2.0, "")
    axes = figure.subplots()
    mesh = axes.pcolormesh(1514.0 + 1e-3 * np.arange(12.0).reshape(3, 4))
    return figure, figure.colorbar(mesh, ax=axes)


def test_a_colour_bar_has_whole_numbers_and_no_offset():
    figure, bar = _figure_of_near_values()
    figure.canvas.draw()
    assert isinstance(bar.ax.yaxis.get_major_formatter(), ScalarFormatter)
    assert bar.ax.yaxis.get_offset_text().get_text() == ""
    ticks = drawn_ticks(bar.ax.yaxis)
    assert [float(text) for _, text in ticks] == pytest.approx(
        [tick for tick, _ in ticks], rel=1e-9
    )


@pytest.mark.slow
@pytest.mark.parametrize("hours", [0.3, 2.0, 3.0, 8.0, 168.0])
@pytest.mark.parametrize("vehicles", [3, 5, 10])
def test_ticks_of_errors_over_time_do_not_touch(look, hours, vehicles):
    time = np.linspace(0.0, 3600.0 * hours, 50)
    errors = {"straight": 1.0 + np.random.default_rng(1).random((3, vehicles, 50))}
    figure = error_over_time(
        time, [f"v{i}" for i in range(vehicles)], errors, np.zeros((vehicles, 50), bool), "Sea"
    )
    look.draw(figure)
    found = boxes(figure)
    assert len(found) > 4
    for i, box in enumerate(found):
        for other in found[i + 1 :]:
            assert not box.padded(1.0).overlaps(other), "two tick labels touch"


@pytest.mark.slow
def test_a_replay_calls_the_share_of_predicted_events_by_its_name(
    made_replay, tmp_path, monkeypatch
):
    monkeypatch.setattr(write, "draw", lambda *_, **__: [])
    text = replay_page.write_replay(made_replay, tmp_path / "out").read_text(encoding="utf-8")
    heads = re.findall("<th[^>]*>(.*?)</th>", text)
    assert "predicted [%]" in heads
    assert not [head for head in heads if "dropout" in head]


def test_the_page_says_what_its_words_mean_and_how_to_cite_it(run):
    text = run_page(RunResults(run), "[]").html()
    digest = hashlib.sha256((run.path / "config.toml").read_bytes()).hexdigest()
    assert f"configuration {digest[:12]}" in text
    assert "@software{mantaray," in text
    lost = run.measurements.range_status
    for status in (RayStatus.SHADOW, RayStatus.WEAK, RayStatus.LEAKED):
        word = status.name.lower()
        assert (f"<p>{word}: {GLOSSARY[word]}</p>" in text) == bool((lost == status).any())
        assert f'title="{GLOSSARY[word]}"' in text or status == RayStatus.LEAKED


@pytest.mark.parametrize(
    ("width", "mm"),
    [(style.COLUMN, 84.0), pytest.param(style.DOUBLE, 174.0, marks=pytest.mark.slow)],
)
def test_figures_for_a_paper_have_the_width_of_a_journal_and_300_dpi(width, mm):
    figure = style.new_figure(width, 2.0, "Test Sea")
    figure.subplots().plot([0.0, 1.0])
    files = style.rendered(figure, ("png", "pdf", "svg"), dpi=300)
    assert files == style.rendered(figure, ("png", "pdf", "svg"), dpi=300), (
        "the same bytes each time"
    )
    with Image.open(BytesIO(files["png"])) as image:
        assert image.width == pytest.approx(mm / 25.4 * 300.0, abs=1.0)
    (box,) = re.findall(rb"/MediaBox \[ 0 0 ([\d.]+)", files["pdf"])
    assert float(box) == pytest.approx(mm / 25.4 * 72.0, abs=0.1)
    (points,) = re.findall(rb'<svg [^>]*?width="([\d.]+)pt"', files["svg"])
    assert float(points) == pytest.approx(mm / 25.4 * 72.0, abs=0.1)


def test_gnss_is_in_the_legend_exactly_where_there_is_a_fix(look, run, made_run, tmp_path):
    for fix in (False, True):
        fixes = np.zeros((2, 50), bool)
        fixes[0, 3] = fix
        errors = {"straight": np.ones((3, 2, 50))}
        figure = error_over_time(np.arange(50.0), ["A", "B"], errors, fixes, "Sea")
        assert ("GNSS fix" in look.texts(figure)) == fix
    results = RunResults(run)
    for fixed in (True, False):
        results.__dict__["fixes"] = np.full_like(results.fixes, fixed)
        caption = next(p.caption for p in run_figure_specs(results) if p.name == "error_over_time")
        assert ("GNSS" in caption) == fixed

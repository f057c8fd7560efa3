"""Saving: valid files, the same each time, whole or not at all; and the line that says synthetic."""

import re

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

from pymantaray.errors import WriteError
from pymantaray.report.style import new_figure, ocean_header, save_figure, styled


@styled
def small(header="Test Sea"):
    figure = new_figure(2.0, 1.5, header)
    figure.subplots().plot([0.0, 1.0], [0.0, 1.0])
    return figure


def test_figures_are_valid_not_blank_and_the_same_each_time(tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
    first, second = (save_figure(small(), tmp_path / name, "plot") for name in ("one", "two"))
    for a, b in zip(first, second, strict=True):
        assert a.read_bytes() == b.read_bytes()
    png, pdf = first
    pixels = mpl.image.imread(png)
    assert pixels.shape[:2] == (300, 400)
    assert 0.01 < np.mean(pixels[..., :3] < 0.99) < 0.5
    content = pdf.read_bytes()
    assert content.startswith(b"%PDF")
    assert content.rstrip().endswith(b"%%EOF")
    assert not re.search(rb"CreationDate|ModDate", content)
    assert sorted(p.name for p in (tmp_path / "one").iterdir()) == ["plot.pdf", "plot.png"]


def test_a_figure_that_cannot_be_drawn_leaves_no_file(tmp_path, monkeypatch):
    def fail(self, file, **_):
        file.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Figure, "savefig", fail)
    with pytest.raises(WriteError, match=r"plot\.png: cannot be written: No space left"):
        save_figure(small(), tmp_path, "plot")
    assert list(tmp_path.iterdir()) == []


def test_the_user_s_own_settings_neither_matter_nor_change(tmp_path):
    with mpl.rc_context({"axes.facecolor": "red", "font.size": 30.0}):
        before = dict(mpl.rcParams)
        mine = save_figure(small(), tmp_path, "mine")
        assert dict(mpl.rcParams) == before
    clean = save_figure(small(), tmp_path, "clean")
    assert mine[0].read_bytes() == clean[0].read_bytes()


@pytest.mark.parametrize(
    ("attrs", "expected"),
    [
        ({"title": "Fram Strait (synthetic)", "synthetic": 1}, "Fram Strait, synthetic ocean"),
        ({"title": "Fram Strait", "synthetic": np.int64(1)}, "Fram Strait, synthetic ocean"),
        ({"title": "HYCOM", "synthetic": 0, "time": "2014-07-15T12:00:00"}, "HYCOM, 2014-07-15 12:00 UTC"),
        ({}, "unnamed ocean"),
    ],
)
def test_header_says_synthetic_exactly_when_the_ocean_is(attrs, expected):
    assert ocean_header(attrs) == expected


def test_dollar_signs_in_names_are_no_mathematics(tmp_path):
    save_figure(small("a $ name with $x_{ broken"), tmp_path, "plot")

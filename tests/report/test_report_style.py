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


def test_figures_are_valid_not_blank_and_the_same_whatever_the_user_has_set(tmp_path):
    first = save_figure(small(), tmp_path, "first")
    with mpl.rc_context({"axes.facecolor": "red", "font.size": 30.0}):
        before = dict(mpl.rcParams)
        second = save_figure(small(), tmp_path, "second")
        assert dict(mpl.rcParams) == before
    for a, b in zip(first, second, strict=True):
        assert a.read_bytes() == b.read_bytes()
    pixels = mpl.image.imread(first[0])
    assert pixels.shape[:2] == (300, 400)
    assert 0.01 < np.mean(pixels[..., :3] < 0.99) < 0.5
    content = first[1].read_bytes()
    assert content.startswith(b"%PDF")
    assert content.rstrip().endswith(b"%%EOF")
    assert not re.search(rb"CreationDate|ModDate", content)
    save_figure(small("dollars: $ and $x_{ are no mathematics"), tmp_path, "third")
    assert len(list(tmp_path.iterdir())) == 6


def test_a_figure_that_cannot_be_drawn_leaves_no_file(tmp_path, monkeypatch):
    def fail(self, file, **_):
        file.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Figure, "savefig", fail)
    with pytest.raises(WriteError, match=r"plot\.png: cannot be written: No space left"):
        save_figure(small(), tmp_path, "plot")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("attrs", "expected"), [
    ({"title": "Fram Strait (synthetic)", "synthetic": 1}, "Fram Strait, synthetic ocean"),
    ({"title": "Fram Strait", "synthetic": np.int64(1)}, "Fram Strait, synthetic ocean"),
    ({"title": "HYCOM", "synthetic": 0, "time": "2014-07-15T12:00:00"}, "HYCOM, 2014-07-15 12:00 UTC"),
    ({}, "unnamed ocean"),
])  # fmt: skip
def test_header_says_synthetic_exactly_when_the_ocean_is(attrs, expected):
    assert ocean_header(attrs) == expected

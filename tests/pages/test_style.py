"""Valid files, the same each time; and the line that says synthetic."""

import re
from io import BytesIO

import matplotlib as mpl
import numpy as np
import pytest
from PIL import Image

from pymantaray.plotting.style import (
    condition_labels,
    new_figure,
    ocean_header,
    rendered,
    shortened,
    styled,
)


@styled
def small(header="Test Sea"):
    figure = new_figure(2.0, 1.5, header)
    figure.subplots().plot([0.0, 1.0], [0.0, 1.0])
    return figure


def mode_and_pixels(png):
    with Image.open(BytesIO(png)) as image:
        return image.mode, np.asarray(image.convert("RGB")).astype(float)


@pytest.mark.parametrize("colours", ["few", "many"])
def test_a_picture_of_few_colours_is_as_the_whole_one(colours):
    """It differs by less than one of 255 steps (RMS), and its white is white."""
    figure = small()
    if colours == "many":
        noise = np.random.default_rng(5).normal(size=(60, 60))
        figure.axes[0].pcolormesh(noise, cmap="turbo")
    whole, few = (rendered(figure, ("png",), few_colours=f)["png"] for f in (False, True))
    (_, expected), (mode, got) = mode_and_pixels(whole), mode_and_pixels(few)
    assert len(np.unique(expected.reshape(-1, 3), axis=0)) > 256
    assert mode == "P"
    assert len(np.unique(got.reshape(-1, 3), axis=0)) <= 256
    assert np.sqrt(np.mean((got - expected) ** 2)) < 1.0
    np.testing.assert_array_equal(got[(expected == 255.0).all(axis=-1)], 255.0)
    assert len(few) < 0.6 * len(whole)


@pytest.mark.slow
def test_figures_do_not_depend_on_the_settings_of_the_user():
    first = rendered(small(), ("png", "pdf"))
    with mpl.rc_context({"axes.facecolor": "red", "font.size": 30.0}):
        before = dict(mpl.rcParams)
        second = rendered(small(), ("png", "pdf"))
        assert dict(mpl.rcParams) == before
    assert first == second
    pixels = mpl.image.imread(BytesIO(first["png"]))
    assert pixels.shape[:2] == (300, 400)
    assert 0.01 < np.mean(pixels[..., :3] < 0.99) < 0.5
    assert first["pdf"].startswith(b"%PDF")
    assert first["pdf"].rstrip().endswith(b"%%EOF")
    assert not re.search(rb"CreationDate|ModDate", first["pdf"])
    assert rendered(small("dollars: $ and $x_{ are no mathematics"), ("png",)).keys() == {"png"}


@pytest.mark.parametrize(
    ("attrs", "expected"),
    [
        ({"title": "Fram Strait (synthetic)", "synthetic": 1}, "Fram Strait, synthetic ocean"),
        ({"title": "Fram Strait", "synthetic": np.int64(1)}, "Fram Strait, synthetic ocean"),
        (
            {"title": "HYCOM", "synthetic": 0, "time": "2014-07-15T12:00:00"},
            "HYCOM, 2014-07-15 12:00 UTC",
        ),
        ({}, "unnamed ocean"),
    ],
)
def test_header_says_synthetic_exactly_when_the_ocean_is(attrs, expected):
    assert ocean_header(attrs) == expected


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["a", "b"], ["a", "b"]),
        ([f"{'a' * 28}{end}" for end in "xy"], [f"{'a' * 13}…{'a' * 13}{end}" for end in "xy"]),
        (
            [f"{'a' * 28}{middle}{'a' * 14}" for middle in "xy"],
            [f"{i}: {'a' * 22}…" for i in (1, 2)],
        ),
    ],
)
def test_names_of_runs_stay_unlike_when_cut(names, expected):
    assert shortened(names) == expected


def test_labels_of_conditions_fit_on_a_figure_and_differ():
    names = ["straight", *("W" * 126 + c for c in "ab"), "cost $"]
    labels = condition_labels(names)
    assert labels["straight"] == "Straight ranges"
    assert labels["cost $"] == r"cost \$"
    assert len(set(labels.values())) == 4
    assert max(map(len, labels.values())) <= 29

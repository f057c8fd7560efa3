"""Plots of an atlas show it: artists are read back and compared with what they were given."""

import json

import numpy as np
import pytest
from made_up_atlas import made_atlas
from matplotlib.collections import QuadMesh
from PIL import Image
from refusals import refused

from pymantaray.apps.atlas import page as atlas_page, write_atlas_plots
from pymantaray.apps.atlas.figures import (
    error_maps,
    error_series,
    safety_maps,
    share_maps,
    worst_error,
)
from pymantaray.apps.atlas.page import write_atlas_page
from pymantaray.errors import ReportError
from pymantaray.pages.page import Page


def meshes(axes):
    return [c for c in axes.collections if isinstance(c, QuadMesh)]


def values(mesh):
    return np.ma.filled(mesh.get_array().astype(float), np.nan).reshape(4, 5)


def test_classes_are_those_of_the_largest_error_of_a_place(look, as_stored):
    atlas = made_atlas()
    figure = look.draw(safety_maps(atlas, [("here", 2, 1)]))
    as_stored(figure)
    classes, others = (values(mesh) for mesh in meshes(figure.axes[0]))
    worst = np.fmax.reduce(atlas["worst_range_error"].values[0, :, :, 2, :, 1], axis=-1)
    np.testing.assert_array_equal(worst, worst_error(atlas, 2, 1))
    expected = np.select(
        [worst <= 1.0, worst <= 5.0, worst <= 20.0, worst > 20.0], [0.0, 1.0, 2.0, 3.0], np.nan
    )
    np.testing.assert_array_equal(classes, expected)
    assert (others[0] == 1.0).all()
    assert (others[1, 0], others[2, 2]) == (0.0, 2.0)
    assert np.isnan(others[3]).all()  # no direct path: the grey beneath, and lines
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == [
        "≤ 1 m",
        "≤ 5 m",
        "≤ 20 m",
        "> 20 m",
        "no direct path",
        "none on most links",
        "land",
        "edge of the data",
        "too shallow",
    ]


def test_maps_show_whole_cells_and_hatch_whole_cells(look):
    atlas = made_atlas()
    atlas["no_direct_path"][:, 2, 3:, :, 1] = 0.9
    atlas["no_direct_path"][:, 3, 0, :, 1] = 0.9
    axes = look.draw(safety_maps(atlas, [("here", 2, 1)])).axes[0]
    assert (axes.get_xlim(), axes.get_ylim()) == ((-2.5, 2.5), (76.75, 78.75))
    (hatched,) = (patch.get_path() for patch in axes.patches if patch.get_hatch())
    lat, lon = np.meshgrid(atlas["lat"], atlas["lon"], indexing="ij")
    lost = atlas["no_direct_path"].values[0, ..., 1].mean(axis=-1) > 0.5
    for north in (-0.24, 0.0, 0.24):  # near all corners of a cell of 0.5 degrees by 1 degree
        for east in (-0.49, 0.0, 0.49):
            points = np.column_stack([(lon + east).ravel(), (lat + north).ravel()])
            np.testing.assert_array_equal(hatched.contains_points(points), lost.ravel())


def test_errors_and_lost_paths_are_shown_with_their_units(look, as_stored):
    atlas = made_atlas()
    figure = look.draw(error_maps(atlas, 0, 2))
    as_stored(figure)
    error, lost = (values(meshes(axes)[0]) for axes in figure.axes[:2])
    np.testing.assert_array_equal(error, worst_error(atlas, 0, 2))
    np.testing.assert_allclose(
        lost, 100.0 * atlas["no_direct_path"].values[0, :, :, :, 2].mean(axis=-1)
    )
    assert [axes.get_xlabel() for axes in figure.axes[2:]] == [
        "Largest range error [m]",
        "No direct path [%]",
    ]
    assert "Test Sea, synthetic ocean" in figure.get_suptitle()


def test_through_time_the_share_of_instants_and_the_series_of_a_place(look, as_stored):
    atlas = made_atlas(times=4)
    figure = look.draw(share_maps(atlas, 1, 0))
    as_stored(figure, name="share")
    as_stored(figure.get_size_inches(), name="size of share")
    worst = np.fmax.reduce(atlas["worst_range_error"].values[:, :, :, 1, :, 0], axis=-1)
    for axes, limit in zip(figure.axes, (1.0, 5.0, 20.0), strict=False):
        expected = np.where(
            np.isfinite(worst).any(axis=0), 100.0 * (worst <= limit).mean(axis=0), np.nan
        )
        np.testing.assert_allclose(values(meshes(axes)[0]), expected)
    figure = look.draw(
        error_series(atlas, 0, (78.4, 362.1))
    )  # nearest to 78.5 N 2 E, where there is no path
    assert figure.axes[0].get_title(loc="left") == "78.5° N, 2° E, 2 km"
    figure = look.draw(error_series(atlas, 0, (78.1, -1.9)))
    as_stored(figure, name="series")
    heights = figure.axes[0].get_gridspec().get_height_ratios()
    as_stored([figure.get_size_inches(), heights], name="size")
    lines = figure.axes[0].get_lines()
    for k in range(5):
        expected = atlas["worst_range_error"].values[:, 2, 0, k, :, 0].max(axis=-1)
        np.testing.assert_array_equal(lines[k].get_ydata(), expected)


def test_the_page_has_every_instant_or_every_second_column(tmp_path, monkeypatch, as_stored):
    monkeypatch.setattr(Page, "write", lambda page, _: page)
    atlas = made_atlas(times=3).assign_attrs(title="made")
    whole = write_atlas_page(atlas, [], tmp_path)
    monkeypatch.setattr(atlas_page, "_MAX_NUMBERS", 600)
    figures = [tmp_path / f"atlas_error.{kind}" for kind in ("png", "pdf", "84mm.png", "84mm.pdf")]
    for file in figures:
        Image.new("L", (80, 60)).save(file)
    half = write_atlas_page(atlas, figures, tmp_path)
    assert [(len(p.pictures), len(p.notes)) for p in (whole, half)] == [(0, 0), (1, 1)]
    (picture,) = half.pictures
    assert (*picture.files, picture.narrow.width) == ("84mm.pdf", "pdf", "png", 80)
    as_stored([[p.facts, p.notes, json.loads(p.explorer.data)] for p in (whole, half)])
    errors = np.array(json.loads(half.explorer.data)["error"], dtype=float)
    own = atlas["worst_range_error"].values[:, ::2, ::2].ravel()
    np.testing.assert_array_equal(errors, own.round(3))


def test_a_series_without_a_place_is_of_the_middle_column():
    atlas = made_atlas(times=2).assign_coords(lon=10.0 + np.arange(5))
    title = error_series(atlas, 0, None).axes[0].get_title(loc="left")
    assert title == "77.5° N, 12° E, 2 km"


def test_a_place_of_a_series_may_be_given_east_or_west_of_180():
    atlas = made_atlas(times=2).assign_coords(lon=178.0 + np.arange(5))
    for east in (181.0, -179.0):
        title = error_series(atlas, 0, (78.1, east)).axes[0].get_title(loc="left")
        assert title == "78° N, 179° W, 2 km"


@pytest.mark.slow
def test_figures_are_written_and_what_is_not_there_is_refused(tmp_path):
    paths = write_atlas_plots(made_atlas(times=2), tmp_path, pair=(20.0, 800.0), distance=1e4)
    assert {path.stem for path in paths} == {
        f"atlas_{name}" for name in ("safe", "error", "conventions", "share", "series")
    }
    atlas = made_atlas()
    refused(
        ReportError,
        "convention best: not in the atlas, which has transmitter",
        write_atlas_plots,
        atlas,
        tmp_path,
        convention="best",
    )
    refused(
        ReportError,
        "distance 3.0: not in the atlas",
        write_atlas_plots,
        atlas,
        tmp_path,
        distance=3.0,
    )
    refused(
        ReportError,
        "pair 1,2: not in the atlas, which has 20,20, 20,800",
        write_atlas_plots,
        atlas,
        tmp_path,
        pair=(1.0, 2.0),
    )
    refused(ReportError, "needs two latitudes", write_atlas_plots, atlas.isel(lat=[0]), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("synthetic", [0, 1])
def test_a_synthetic_ocean_is_called_that(look, synthetic):
    atlas = made_atlas().assign_attrs(synthetic=synthetic)
    assert ("synthetic" in look.draw(error_maps(atlas, 0, 0)).get_suptitle()) == bool(synthetic)

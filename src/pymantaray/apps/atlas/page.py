"""
Page of an atlas: an interactive map of range errors by convention, distance, depths and instant,
and the figures.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.colors import to_hex
from matplotlib.image import imread

from pymantaray.apps.atlas.dataset import notes_of
from pymantaray.apps.atlas.figures import CONVENTION_COLOURS, CONVENTION_WORDS
from pymantaray.pages.page import Explorer, Page, as_json
from pymantaray.plotting import style
from pymantaray.plotting.drawing import Image, Picture
from pymantaray.plotting.formats import ONE_COLUMN
from pymantaray.records.digits import counted

_MAX_NUMBERS = 500_000  # numbers on the page
_WIDTH = 952  # of a figure [px]
_COLUMN_WIDTH = 440  # of its layout for one column [px]
_COLOURS = 9  # of the colour map on the page
_CAPTIONS = {
    "atlas_safe": "Locations with safe ranges, by distance.",
    "atlas_error": "Largest range error, and the share of the links without a direct path.",
    "atlas_conventions": "Locations with safe ranges, by the sound speed that converts time to"
    " range.",
    "atlas_share": "Share of the instants at which ranges are safe.",
    "atlas_series": "Largest error and lost links at one place through time.",
}


def write_atlas_page(atlas: xr.Dataset, figures: Sequence[Path], folder: str | Path) -> Path:
    """
    Write the page of an atlas into the folder of its figures.

    Parameters
    ----------
    atlas : xarray.Dataset
        Atlas from `pymantaray.apps.atlas.open_atlas`. If it has more than half a million errors,
        the page contains every n-th column.
    figures : sequence of pathlib.Path
        Files from `write_atlas_plots`.
    folder : str or pathlib.Path
        Folder of these files.

    Returns
    -------
    pathlib.Path
        ``index.html``, one file with all its scripts and data.

    Raises
    ------
    WriteError
        If the page cannot be written.

    Examples
    --------
    Continues the example of `pymantaray.apps.atlas`:

    >>> from pymantaray.apps.atlas import write_atlas_page, write_atlas_plots
    >>> write_atlas_page(atlas, write_atlas_plots(atlas, "atlas"), "atlas").name
    'index.html'
    """
    # every n-th column of a large atlas
    errors = atlas["worst_range_error"]
    step = int(np.ceil(np.sqrt(errors.size / _MAX_NUMBERS))) if errors.size > _MAX_NUMBERS else 1
    part = atlas.isel(lat=slice(None, None, step), lon=slice(None, None, step))
    values = (
        part["worst_range_error"]
        .transpose("time", "lat", "lon", "convention", "pair", "distance")
        .values
    )
    # data of the interactive map
    content = {
        "time": [str(t)[:16].replace("T", " ") for t in part["time"].values],
        "lat": part["lat"].values.astype(float).round(4),
        "lon": part["lon"].values.astype(float).round(4),
        "conventions": [
            {"name": CONVENTION_WORDS[name], "colour": CONVENTION_COLOURS[name]}
            for name in map(str, part["convention"].values)
        ],
        "distances": part["distance"].values,
        "pairs": np.stack(
            [part["transmitter_depth"].values, part["receiver_depth"].values], axis=1
        ),
        "error": values.ravel().astype(float).round(3),
        "colours": [
            [x, to_hex(style.LEVELS.reversed()(x))]
            for x in np.linspace(0.0, 1.0, _COLOURS).tolist()
        ],
    }
    # the page with the map and all figures
    instants = counted(atlas.sizes["time"], "instant")
    thinned = [
        (
            f"The interactive map shows every {step}-th column in both directions; the figures and"
            " the"
            " file contain all columns."
        )
    ]
    page = Page(
        title=str(atlas.attrs["title"]),
        facts=[
            style.ocean_header(
                {"title": atlas.attrs["ocean"], "synthetic": atlas.attrs["synthetic"]}
            ),
            f"{atlas.sizes['lat']} x {atlas.sizes['lon']} columns, {instants}",
        ],
        notes=[*notes_of(atlas), *(thinned if step > 1 else [])],
        explorer=Explorer("pymantaray.apps.atlas/atlas", as_json(content)),
        pictures=[
            _picture(file, figures)
            for file in figures
            if file.suffix == ".png" and file.stem in _CAPTIONS
        ],
    )
    return page.write(folder)


def _picture(file: Path, figures: Sequence[Path]) -> Picture:
    """Figure with its other files and its layout for one column, if they are there."""
    name = file.stem
    others = [f"{ONE_COLUMN}.pdf", "pdf"]
    files = {kind: file.with_name(f"{name}.{kind}") for kind in others}
    files = {kind: path for kind, path in files.items() if path in figures} | {"png": file}
    column = file.with_name(f"{name}.{ONE_COLUMN}.png")
    return Picture(
        name,
        _CAPTIONS[name],
        *_size(file, _WIDTH),
        {kind: path.read_bytes() for kind, path in files.items()},
        folder="",
        narrow=Image(column.read_bytes(), *_size(column, _COLUMN_WIDTH))
        if column in figures
        else None,
    )


def _size(file: Path, widest: int) -> tuple[int, int]:
    """Width and height of a PNG on the page. [px]"""
    height, width = imread(file).shape[:2]
    return min(width, widest), round(height * min(width, widest) / width)

"""
Plots of an atlas: locations with safe straight-line ranges, range errors, shares of links without a
direct path, and time series.
"""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap, LogNorm, Normalize
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path as Outline
from matplotlib.ticker import LogLocator
from numpy.typing import NDArray

from pymantaray.apps.atlas.dataset import largest_over_pairs, mean_lost_over_pairs
from pymantaray.apps.ocean.figures import (
    CELLS,
    LAND,
    finish_bar,
    latitude_label,
    lay_out_map,
    longitude_label,
    map_shape,
)
from pymantaray.arrays import Array
from pymantaray.errors import ReportError
from pymantaray.geometry.longitude import wrap_longitude
from pymantaray.jobs.progress import Progress
from pymantaray.plotting import style

CONVENTION_WORDS = {
    "transmitter": "speed at the transmitter",
    "receiver": "speed at the receiver",
    "mean": "mean of both speeds",
    "chord": "mean slowness of the chord",
    "nominal": "one speed",
}
CONVENTION_COLOURS = dict(
    zip(
        CONVENTION_WORDS,
        (style.BLUE, style.SKY, style.GREEN, style.ORANGE, style.GREY),
        strict=True,
    )
)
_WATER = 0  # of column_status
_OTHERS = ((LAND, "land"), ("#f4f2ee", "edge of the data"), (style.BED, "too shallow"))
"""Colour and name of its values 1 and 2, and of water above the depths of all links."""
_LOST_SHARE = 0.5  # share of the links without a direct path above which a safe place is marked
_LOGARITHMIC = 10.0  # greatest by least error above which colours are by the logarithm
_LINES = "////"
_COLUMNS = 2  # of maps beside each other
_PAGE = 9.0  # greatest height of a figure [in]
_HIGHEST = 1.4  # height over width of a panel; a higher map does not fill its width
_FEW_TICKS = 2.0  # inches for a map, below which it has fewer ticks


def write_atlas_plots(
    atlas: xr.Dataset,
    folder: str | Path,
    *,
    convention: str = "transmitter",
    distance: float | None = None,
    pair: tuple[float, float] | None = None,
    place: tuple[float, float] | None = None,
    formats: Sequence[str] = (),
    progress: Progress | None = None,
) -> list[Path]:
    """
    Draw maps of an atlas: locations with safe ranges by distance and by convention, largest error,
    and links without a direct path.

    With several instants, the maps show the largest error of all instants. Two more figures show
    the share of the instants with safe ranges, and the errors at one place over time.

    Parameters
    ----------
    atlas : xarray.Dataset
        Atlas from `pymantaray.apps.atlas.open_atlas`.
    folder : str or pathlib.Path
        Folder, which is created if necessary. Existing figures with the same names are replaced.
    convention : str
        Convention of the atlas.
    distance : float, optional
        Distance of the atlas. Default: the middle one. [m]
    pair : tuple of float, optional
        Depths of transmitter and receiver, one pair of the atlas. Default: the largest error of all
        pairs. [m]
    place : tuple of float, optional
        Latitude and longitude of the time series, which shows the nearest column. Default: the
        middle of the map. [degrees]
    formats : sequence of str
        ``svg`` for SVG as well, ``png`` for PNG with 300 dpi, ``84mm`` for PNG and PDF in a layout
        for one column of a journal as well.
    progress : callable, optional
        Called with ``"figures"``, the number of finished figures and the total.

    Returns
    -------
    list of pathlib.Path
        PNG and PDF files of all figures.

    Raises
    ------
    ReportError
        If the atlas has no such convention, distance or pair, or has only one latitude or
        longitude, or if a format is unknown.
    WriteError
        If a file cannot be written.

    Examples
    --------
    Continues the example of `pymantaray.apps.atlas`:

    >>> from pymantaray.apps.atlas import write_atlas_plots
    >>> [file.name for file in write_atlas_plots(atlas, "atlas") if file.suffix == ".png"]
    ['atlas_safe.png', 'atlas_error.png', 'atlas_conventions.png']
    """
    if min(atlas.sizes["lat"], atlas.sizes["lon"]) < 2:
        raise ReportError("atlas: a map needs two latitudes and two longitudes at least")
    here = _one_of(atlas, "convention", convention)
    distances = atlas["distance"].values
    where = _one_of(
        atlas, "distance", distances[len(distances) // 2] if distance is None else distance
    )
    if pair is not None:
        pairs = list(
            zip(atlas["transmitter_depth"].values, atlas["receiver_depth"].values, strict=True)
        )
        if pair not in pairs:
            listed = ", ".join(f"{first:g},{second:g}" for first, second in pairs)
            raise ReportError(f"pair {pair[0]:g},{pair[1]:g}: not in the atlas, which has {listed}")
        atlas = atlas.isel(pair=[pairs.index(pair)])
    km = f"{float(atlas['distance'][where]) / 1e3:g} km"
    by_distance = [
        (f"{d / 1e3:g} km, {CONVENTION_WORDS[convention]}", here, k)
        for k, d in enumerate(distances)
    ]
    by_convention = [
        (f"{km}, {CONVENTION_WORDS[str(name)]}", k, where)
        for k, name in enumerate(atlas["convention"].values)
    ]
    draw: dict[str, Callable[[float], Figure]] = {
        "atlas_safe": partial(safety_maps, atlas, by_distance),
        "atlas_error": partial(error_maps, atlas, here, where),
        "atlas_conventions": partial(safety_maps, atlas, by_convention),
    }
    if atlas.sizes["time"] > 1:
        draw["atlas_share"] = partial(share_maps, atlas, here, where)
        draw["atlas_series"] = partial(error_series, atlas, where, place)
    return style.write_figures(draw, folder, formats=formats, progress=progress)


def _one_of(atlas: xr.Dataset, name: str, value: str | float) -> int:
    there = atlas[name].values.tolist()
    if value not in there:
        raise ReportError(
            f"{name} {value}: not in the atlas, which has {', '.join(map(str, there))}"
        )
    return int(there.index(value))


@style.styled
def safety_maps(
    atlas: xr.Dataset, panels: Sequence[tuple[str, int, int]], width: float = style.DOUBLE
) -> Figure:
    """
    Maps of error classes, one for each title, convention and distance: largest error of all pairs,
    bearings and instants.
    """
    safe = atlas["safe"].values
    colours = [style.LEVELS(x) for x in np.linspace(0.97, 0.1, safe.size + 1)]
    figure, axes = _maps(atlas, len(panels), width, below=0.45)
    for k, (title, convention, distance) in enumerate(panels):
        worst = worst_error(atlas, convention, distance)
        classes = np.where(np.isnan(worst), np.nan, np.searchsorted(safe, np.nan_to_num(worst)))
        norm = BoundaryNorm(np.arange(safe.size + 2) - 0.5, safe.size + 1)
        axes[k].pcolormesh(
            atlas["lon"], atlas["lat"], classes, cmap=ListedColormap(colours), norm=norm, **CELLS
        )
        # hatch the cells of some columns
        where = np.nan_to_num(_lost(atlas, distance)) > _LOST_SHARE
        if where.any():
            _hatch(axes[k], atlas, where)
        _finish(axes[k], atlas, (k, title), distance)
    names = [f"≤ {x:g} m" for x in safe] + [f"> {safe[-1]:g} m"]
    handles = [Patch(color=c, label=name) for c, name in zip(colours, names, strict=True)]
    handles += _other_patches(atlas)
    style.common_legend(figure, handles, loc="outside lower center")
    figure.draw_without_rendering()
    return figure


@style.styled
def error_maps(
    atlas: xr.Dataset, convention: int, distance: int, width: float = style.DOUBLE
) -> Figure:
    """
    Maps of the largest error of all pairs and bearings, and of the share of links without a direct
    path.
    """
    figure, axes = _maps(atlas, 2, width, below=0.7, bars=True)
    worst = worst_error(atlas, convention, distance)
    lost = _lost(atlas, distance)
    known = worst[np.isfinite(worst) & (worst > 0.0)]
    low, high = (known.min(), known.max()) if known.size else (0.1, 1.0)
    norm = LogNorm(low, high) if high > _LOGARITHMIC * low else Normalize(0.0, high)
    km = f"{float(atlas['distance'][distance]) / 1e3:g} km"
    words = CONVENTION_WORDS[str(atlas["convention"].values[convention])]
    looks: tuple[dict[str, Any], dict[str, Any]] = (
        {"cmap": style.LEVELS.reversed(), "norm": norm},
        {"cmap": style.FLOOR, "vmin": 0.0, "vmax": 100.0},
    )
    labels = ("Largest range error [m]", "No direct path [%]")
    for k, (values, title) in enumerate(
        ((worst, f"{km}, {words}"), (100.0 * lost, f"{km}, share of the links"))
    ):
        mesh = axes[k].pcolormesh(atlas["lon"], atlas["lat"], values, **looks[k], **CELLS)
        _finish(axes[k], atlas, (k, title), distance)
        bar = figure.colorbar(mesh, ax=axes[k], pad=0.02, aspect=20, location="bottom")
        if k == 0 and isinstance(norm, LogNorm):
            bar.set_label(labels[k])
            bar.outline.set_linewidth(0.4)
            style.short_numbers(bar.ax.xaxis)
            bar.ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        else:
            finish_bar(bar, labels[k])
    figure.draw_without_rendering()
    return figure


@style.styled
def share_maps(
    atlas: xr.Dataset, convention: int, distance: int, width: float = style.DOUBLE
) -> Figure:
    """
    Maps of the share of instants at which no direct range error is larger, one for each error
    threshold.
    """
    safe = atlas["safe"].values
    figure, axes = _maps(atlas, safe.size, width, below=0.7)
    worst = _over_pairs(atlas, convention, distance)
    direct = np.isfinite(worst).sum(axis=0)
    for k, limit in enumerate(safe):
        share = np.where(
            direct > 0, 100.0 * (worst <= limit).sum(axis=0) / np.maximum(direct, 1), np.nan
        )
        mesh = axes[k].pcolormesh(
            atlas["lon"], atlas["lat"], share, cmap=style.LEVELS, vmin=0.0, vmax=100.0, **CELLS
        )
        _finish(axes[k], atlas, (k, f"safe to {limit:g}\u00a0m"), distance)
    finish_bar(
        figure.colorbar(mesh, ax=list(axes), aspect=40, location="bottom"),
        "Share of the instants [%]",
    )
    figure.draw_without_rendering()
    return figure


@style.styled
def error_series(
    atlas: xr.Dataset,
    distance: int,
    place: tuple[float, float] | None,
    width: float = style.DOUBLE,
) -> Figure:
    """
    Time series of the largest error of each convention at one place, and of the share of its links
    without a direct path.
    """
    # the nearest column to the place; by default the middle
    lat = atlas["lat"].values
    lon = atlas["lon"].values
    middle = 0.5 * float(lon[0] + lon[-1])
    at = (0.5 * float(lat[0] + lat[-1]), middle) if place is None else place
    i, j = (
        int(np.argmin(np.abs(axis - x)))
        for axis, x in ((lat, at[0]), (lon, wrap_longitude(at[1], about=middle)))
    )
    # largest errors of all conventions
    figure = style.new_figure(width, 3.2, _header(atlas))
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(1.8, 1.0))
    time = atlas["time"].values
    for k, name in enumerate(map(str, atlas["convention"].values)):
        upper.semilogy(
            time,
            largest_over_pairs(atlas)[:, i, j, k, distance].values,
            "o-",
            markersize=2.5,
            color=CONVENTION_COLOURS[name],
            label=CONVENTION_WORDS[name],
        )
    for limit in atlas["safe"].values:
        upper.axhline(limit, color=style.INK, linestyle=":", linewidth=0.7)
    style.short_numbers(upper.yaxis)
    # share of links without a direct path
    lost = mean_lost_over_pairs(atlas)[:, i, j, distance].values
    lower.plot(time, lost, "o-", markersize=2.5, color=style.INK)
    lower.set_ylim(-3.0, 103.0)
    # labels, title and legend
    upper.set_ylabel("Largest range error [m]")
    lower.set_ylabel("No path [%]")
    locator: Any = AutoDateLocator()  # type: ignore[no-untyped-call]
    lower.xaxis.set_major_locator(locator)
    lower.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
    lower.set_xlabel("Time (UTC)")
    km = f"{float(atlas['distance'][distance]) / 1e3:g} km"
    there = (
        f"{latitude_label(float(lat[i]), digits=2, unit='° ')},"
        f" {longitude_label(float(lon[j]), digits=2, unit='° ')}"
    )
    upper.set_title(f"{there}, {km}", loc="left")
    handles = upper.get_legend_handles_labels()[0]
    style.common_legend(figure, handles, loc="outside lower center", ncols=5)
    return figure


def worst_error(atlas: xr.Dataset, convention: int, distance: int) -> Array:
    """
    Largest error (lat, lon) of all pairs, bearings and instants; NaN without any direct path. [m]
    """
    return np.asarray(np.fmax.reduce(_over_pairs(atlas, convention, distance), axis=0))


def _over_pairs(atlas: xr.Dataset, convention: int, distance: int) -> Array:
    errors = largest_over_pairs(atlas).isel(convention=convention, distance=distance)
    return np.asarray(errors.values)


def _lost(atlas: xr.Dataset, distance: int) -> Array:
    """
    Share (lat, lon) of the links of a distance without a direct path; NaN if no link is in the
    water.
    """
    return np.asarray(atlas["no_direct_path"].isel(distance=distance).mean(("time", "pair")).values)


def _maps(
    atlas: xr.Dataset, count: int, width: float, *, below: float, bars: bool = False
) -> tuple[Figure, list[Axes]]:
    """
    Figure with rows of maps, and room for a common header and what is below the maps. [in]

    In one column of a journal, the maps are below each other if they fit on its page. With
    ``bars``, each map has a colour bar below it.
    """
    shape = min(_shape(atlas), _HIGHEST)
    narrow = width == style.COLUMN
    # titles of narrow maps have more lines, and bars are below each row
    between = (0.6 if narrow else 0.45) + (0.55 if narrow and bars else 0.0)
    for columns in (1, _COLUMNS) if narrow else (_COLUMNS,):
        rows = -(-count // columns)
        side = (width - (0.5 if narrow else 0.45) * columns) / columns
        height = rows * (side * shape + between) + below
        if height <= _PAGE:
            break
    figure = style.new_figure(width, min(height, _PAGE), _header(atlas))
    panels = figure.subplots(rows, min(count, columns), squeeze=False).ravel()
    for axes in panels[count:]:
        axes.set_axis_off()
    return figure, list(panels[:count])


def _shape(atlas: xr.Dataset) -> float:
    """Ratio of height to width of a map of all cells."""
    return map_shape(cell_edges(atlas["lat"].values), cell_edges(atlas["lon"].values))


def cell_edges(centre: Array) -> Array:
    """Edges (n + 1) of the cells about points (n) of an axis, halfway between the points."""
    middle = 0.5 * (centre[1:] + centre[:-1])
    return np.concatenate([[2.0 * centre[0] - middle[0]], middle, [2.0 * centre[-1] - middle[-1]]])


def _hatch(axes: Axes, atlas: xr.Dataset, where: NDArray[np.bool_]) -> None:
    """Hatch whole cells (lat, lon); neighbours in a row are one rectangle."""
    lon, lat = (cell_edges(atlas[name].values) for name in ("lon", "lat"))
    corners = []
    for row, marked in enumerate(where):
        ends = np.flatnonzero(np.diff(np.concatenate([[False], marked, [False]]).astype(int)))
        for west, east in lon[ends].reshape(-1, 2):
            south, north = lat[row : row + 2]
            corners.append([(west, south), (east, south), (east, north), (west, north)])
    area = Outline.make_compound_path_from_polys(np.array(corners))
    look: dict[str, Any] = {"facecolor": "none", "edgecolor": style.INK, "linewidth": 0.0}
    axes.add_patch(PathPatch(area, hatch=_LINES, zorder=2, **look))


def _finish(axes: Axes, atlas: xr.Dataset, title: tuple[int, str], distance: int) -> None:
    """Draw land, axes and title of one map."""
    axes.set_facecolor(style.PALE)
    others = _others(atlas, distance)
    if np.isfinite(others).any():
        colours = ListedColormap([colour for colour, _ in _OTHERS])
        last = len(_OTHERS) - 1
        axes.pcolormesh(
            atlas["lon"], atlas["lat"], others, cmap=colours, vmin=0, vmax=last, **CELLS
        )
    lat, lon = (cell_edges(atlas[name].values) for name in ("lat", "lon"))
    figure, place = axes.get_figure(root=True), axes.get_subplotspec()
    assert figure is not None and place is not None  # noqa: PT018
    side = figure.get_figwidth() / place.get_gridspec().ncols
    lay_out_map(axes, lat, lon, ticks=4 if side > _FEW_TICKS else 2)
    axes.set_xlabel("Longitude [°]")
    if place.is_first_col():
        axes.set_ylabel("Latitude [°]")
    style.panel_title(
        axes, "abcdefghij"[title[0] % 10], title[1], share=min(_HIGHEST / _shape(atlas), 1.0)
    )


def _others(atlas: xr.Dataset, distance: int) -> Array:
    """
    Index into `_OTHERS` of each column; NaN for columns with links of a distance in the water.
    """
    status = atlas["column_status"].isel(time=0).values
    shallow = np.isnan(_lost(atlas, distance))
    return np.where(status != _WATER, status - 1.0, np.where(shallow, len(_OTHERS) - 1.0, np.nan))


def _other_patches(atlas: xr.Dataset) -> list[Patch]:
    there = [_others(atlas, k) for k in range(atlas.sizes["distance"])]
    return [
        Patch(color=style.PALE, label="no direct path"),
        Patch(
            facecolor="white",
            edgecolor=style.INK,
            linewidth=0.0,
            hatch=_LINES,
            label="none on most links",
        ),
        *(
            Patch(facecolor=colour, edgecolor=style.GREY, linewidth=0.4, label=label)
            for k, (colour, label) in enumerate(_OTHERS)
            if any((others == k).any() for others in there)
        ),
    ]


def _header(atlas: xr.Dataset) -> str:
    times = np.datetime_as_string(atlas["time"].values, unit="m")
    attrs = {"title": atlas.attrs["ocean"], "synthetic": atlas.attrs["synthetic"], "time": times[0]}
    several = f" and {times.size - 1} more" if times.size > 1 else ""
    depths = f"{atlas.sizes['pair']} pairs of depths"
    if atlas.sizes["pair"] == 1:
        depths = (
            f"{float(atlas['transmitter_depth'][0]):g} m to {float(atlas['receiver_depth'][0]):g} m"
        )
    return f"{style.ocean_header(attrs)}{several}; {depths}"

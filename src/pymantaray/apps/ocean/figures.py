"""
Plots of an ocean on the grid of its source: profiles, maps of sound speed, currents and sea floor,
vertical sections.
"""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colorbar import Colorbar
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from matplotlib.patheffects import AbstractPathEffect, withStroke
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.typing import NDArray

from pymantaray.arrays import Array
from pymantaray.errors import ReportError
from pymantaray.geometry.longitude import whole_turns, wrap_longitude
from pymantaray.jobs.progress import Progress
from pymantaray.ocean import sound_speed_profile_spread
from pymantaray.ocean.sea_floor import fill_below_sea_bed, sea_floor_depth
from pymantaray.ocean.seawater import ocean_sound_speed, sound_speed
from pymantaray.plotting import style
from pymantaray.plotting.water import UPPER_DEPTH, sound_speed_profiles

_LEVEL = 100.0  # m; of the map unless another is asked for
LAND = "#d9d2c7"
CELLS: dict[str, Any] = {"shading": "nearest", "rasterized": True}
_ARROWS = {style.DOUBLE: 32, style.COLUMN: 18}  # across the longer side of a map
_HIGH_MAP = 1.1  # height over width of a map that is always drawn in one column
_MARGIN = 0.07  # of the axes, within which contour lines get no labels
_APART = 0.11  # of the axes of a figure over both columns, between labels of contour lines
# white lines must read on yellow
_OUTLINE: list[AbstractPathEffect] = [withStroke(linewidth=1.3, foreground="#30303070")]


def write_ocean_plots(
    ocean: xr.Dataset,
    folder: str | Path,
    *,
    depth: float | None = None,
    place: tuple[float, float] | None = None,
    sea_floor: xr.DataArray | None = None,
    formats: Sequence[str] = (),
    progress: Progress | None = None,
) -> list[Path]:
    """
    Draw an ocean: range of its profiles, two sections, a map with currents, and the sea floor.

    Parameters
    ----------
    ocean : xarray.Dataset
        A valid ocean.
    folder : str or pathlib.Path
        Folder, which is created if necessary. Existing figures with the same names are replaced.
    depth : float, optional
        Depth of the map. Default: 100 m, or half the greatest depth if that is smaller. [m]
    place : tuple of float, optional
        Latitude and longitude at which the sections cross. Default: the middle of the window.
        [degrees]
    sea_floor : xarray.DataArray, optional
        Sea floor from `pymantaray.ocean.open_sea_floor`. [m]
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
        If the place is outside the window, the depth is below the deepest water, or a format is
        unknown.
    WriteError
        If a file cannot be written.

    Examples
    --------
    Continues the example of `pymantaray.ocean`:

    >>> from pymantaray.apps.ocean import write_ocean_plots
    >>> [file.name for file in write_ocean_plots(ocean, "figures") if file.suffix == ".png"]
    ['ocean_profiles.png', 'ocean_sections.png', 'ocean_map.png', 'ocean_sea_floor.png']
    """
    lat, lon = (np.asarray(ocean[name].values, dtype=float) for name in ("lat", "lon"))
    middle = (0.5 * float(lat[0] + lat[-1]), 0.5 * float(lon[0] + lon[-1]))
    where = middle if place is None else place
    turned = wrap_longitude(where[1], about=middle[1])
    if not (lat[0] <= where[0] <= lat[-1] and lon[0] <= turned <= lon[-1]):
        raise ReportError(
            f"place {where[0]:g}, {where[1]:g} is outside the ocean: latitude {lat[0]:g} to"
            f" {lat[-1]:g}, longitude {lon[0]:g} to {lon[-1]:g}"
        )
    wet = np.isfinite(ocean["water_temp"].values).any(axis=(1, 2))
    deepest = float(ocean["depth"].values[wet][-1])
    level = min(_LEVEL, 0.5 * deepest) if depth is None else float(depth)
    if not 0.0 <= level <= deepest:
        raise ReportError(f"depth {level:g} m is not in the water; allowed 0 to {deepest:g} m")
    time = (
        ""
        if np.isnat(ocean["time"].values)
        else str(np.datetime_as_string(ocean["time"].values, unit="s"))
    )
    header = style.ocean_header({**ocean.attrs, "time": time})
    draw: dict[str, Callable[[float], Figure]] = {
        # has one layout, which is that of one column
        "ocean_profiles": lambda _: sound_speed_profiles(
            [(style.ocean_name(ocean.attrs), sound_speed_profile_spread(ocean))], header
        ),
        "ocean_sections": partial(sound_speed_sections, ocean, where, header, sea_floor),
        "ocean_map": partial(sound_speed_map, ocean, level, header, sea_floor),
        "ocean_sea_floor": partial(sea_floor_map, ocean, header, sea_floor),
    }
    return style.write_figures(draw, folder, formats=formats, progress=progress)


@style.styled
def sound_speed_map(
    ocean: xr.Dataset,
    depth: float,
    header: str,
    sea_floor: xr.DataArray | None = None,
    width: float = style.DOUBLE,
) -> Figure:
    """Map of the sound speed at a level, with currents as arrows and the sea floor as contours."""
    k = _nearest(ocean["depth"].values, depth)
    level = float(ocean["depth"].values[k])
    speed = ocean_sound_speed(ocean.isel(depth=[k]))[0]

    def draw(axes: Axes, arrows: int) -> Any:
        axes.set_facecolor(style.BED if level > 0.0 else LAND)
        mesh = axes.pcolormesh(ocean["lon"], ocean["lat"], speed, cmap=style.SOUND_SPEED, **CELLS)
        _draw_floor_lines(axes, _floor_of(ocean, sea_floor))
        _draw_currents(axes, ocean.isel(depth=k), arrows)
        return mesh

    figure, bar = _map(ocean, draw, header, f"at {level:g} m depth", width)
    finish_bar(bar, "Sound speed [m/s]")
    return _laid_out(figure)


@style.styled
def sea_floor_map(
    ocean: xr.Dataset,
    header: str,
    sea_floor: xr.DataArray | None = None,
    width: float = style.DOUBLE,
) -> Figure:
    """Map of the depth of the sea floor."""
    floor = _floor_of(ocean, sea_floor)
    source = (
        "last level with water"
        if sea_floor is None
        else str(sea_floor.attrs.get("source", "from a file"))
    )

    def draw(axes: Axes, _arrows: int) -> Any:
        axes.set_facecolor(LAND)
        wet = np.where(floor.values > 0.0, floor.values, np.nan)
        mesh = axes.pcolormesh(floor["lon"], floor["lat"], wet, cmap=style.FLOOR, **CELLS)
        _draw_floor_lines(axes, floor)
        return mesh

    figure, bar = _map(ocean, draw, header, f"sea floor, {source}", width)
    finish_bar(bar, "Sea floor depth [m]")
    bar.ax.invert_yaxis()
    return _laid_out(figure)


def _map(
    ocean: xr.Dataset, draw: Callable[[Axes, int], Any], header: str, title: str, width: float
) -> tuple[Figure, Colorbar]:
    """
    Map of the ocean's window, with equal scales northward and eastward at its middle, and its
    colour bar.
    """
    lat, lon = (np.asarray(ocean[name].values, dtype=float) for name in ("lat", "lon"))
    shape = map_shape(lat, lon)
    width = width if shape < _HIGH_MAP else style.COLUMN
    wide = width > style.COLUMN
    height = min(max((width - 1.4) * shape + 0.75, 2.4), 7.0)
    figure = style.new_figure(width, height, header)
    axes = figure.subplots()
    mesh = draw(axes, _ARROWS[width])
    lay_out_map(axes, lat, lon, ticks=7 if wide else 4)
    axes.set(xlabel="Longitude [°]", ylabel="Latitude [°]")
    axes.set_title(style.fitting(axes, title), loc="left")
    return figure, figure.colorbar(mesh, ax=axes, pad=0.015, aspect=24)


def _laid_out(figure: Figure) -> Figure:
    """Figure after a first layout, which the fixed aspect of a map changes; the next one fits."""
    figure.draw_without_rendering()
    return figure


def map_shape(lat: Array, lon: Array) -> float:
    """Ratio of height to width of a map with equal scales northward and eastward at its middle."""
    return _stretch(lat) * float((lat[-1] - lat[0]) / (lon[-1] - lon[0]))


def lay_out_map(axes: Axes, lat: Array, lon: Array, *, ticks: int) -> None:
    """
    Limits, proportions, ticks and a frame of a map of these latitudes and longitudes. [degrees]
    """
    axes.grid(visible=False)
    axes.set(aspect=_stretch(lat), xlim=(lon[0], lon[-1]), ylim=(lat[0], lat[-1]))
    axes.xaxis.set_major_formatter(FuncFormatter(longitude_label))
    axes.yaxis.set_major_formatter(FuncFormatter(latitude_label))
    axes.xaxis.set_major_locator(MaxNLocator(ticks, steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    for spine in axes.spines.values():
        spine.set_visible(True)


def _stretch(lat: Array) -> float:
    """Number of degrees of longitude with the length of one degree of latitude, at the middle."""
    return 1.0 / max(float(np.cos(np.radians(0.5 * (lat[0] + lat[-1])))), 0.02)


def _draw_floor_lines(axes: Axes, floor: xr.DataArray) -> None:
    deepest = float(floor.max())
    steps = [
        step for step in (200.0, 500.0, *np.arange(1_000.0, 7_000.0, 1_000.0)) if step < deepest
    ]
    if deepest - float(floor.min()) > 50.0 and steps:
        look: dict[str, Any] = {"colors": "white", "linewidths": 0.6}
        lines = axes.contour(floor["lon"], floor["lat"], floor.values, levels=steps, **look)
        _label_contours(axes, lines, "%g m")


def _draw_currents(axes: Axes, level: xr.Dataset, count: int) -> None:
    u = level["water_u"].values
    v = level["water_v"].values
    size = np.hypot(u, v)
    if not np.nanmax(np.where(np.isfinite(size), size, 0.0)) > 0.0:
        return
    lat = level["lat"].values
    lon = level["lon"].values
    squeeze = float(np.cos(np.radians(0.5 * (lat[0] + lat[-1]))))
    gap = max(float(lat[-1] - lat[0]), squeeze * float(lon[-1] - lon[0])) / count
    step = [max(1, round(gap / d)) for d in (lat[1] - lat[0], squeeze * (lon[1] - lon[0]))]
    rows, columns = (slice(s // 2, None, s) for s in step)
    scale = float(np.nanpercentile(size, 99.0)) or 1.0
    look: dict[str, Any] = {"color": style.INK, "width": 0.0018, "headwidth": 4.0, "zorder": 4}
    size_on_page: dict[str, Any] = {
        "angles": "uv",
        "scale_units": "width",
        "scale": scale * count * 0.8,
    }
    thinned = (lon[columns], lat[rows], u[rows, columns], v[rows, columns])
    arrows = axes.quiver(*thinned, **size_on_page, **look)
    key = float(f"{scale:.1g}")
    place: dict[str, Any] = {"labelpos": "W", "labelsep": 0.05, "fontproperties": {"size": 6.5}}
    axes.quiverkey(arrows, 0.94, 1.035, key, f"{key:g} m/s", **place)


class _Cut(NamedTuple):
    """One vertical section."""

    along: Array
    """Latitude or longitude. [degrees]"""
    speed: Array
    """Shape (depth, along), NaN below the sea bed. [m/s]"""
    filled: Array
    """Sound speed extended below the sea bed as in `to_local`. [m/s]"""
    bed_along: Array
    bed: Array
    """Axis and depth of the sea floor. [degrees, m]"""
    crossing: float
    """Position of the other section. [degrees]"""
    title: str


@style.styled
def sound_speed_sections(
    ocean: xr.Dataset,
    place: tuple[float, float],
    header: str,
    sea_floor: xr.DataArray | None = None,
    width: float = style.DOUBLE,
) -> Figure:
    """
    Sections of the sound speed along a parallel and a meridian through a place: upper part and all
    depths.
    """
    depth = np.asarray(ocean["depth"].values, dtype=float)
    cuts = _cuts(ocean, place, _floor_of(ocean, sea_floor))
    known = np.any([np.isfinite(cut.speed).any(axis=1) for cut in cuts], axis=0)
    lowest = float(depth[known][-1])
    deepest = max(min(max(float(cut.bed.max()) for cut in cuts), 1.02 * lowest), lowest)
    figure, panels = _section_panels(ocean, header, width)
    narrow = width == style.COLUMN
    for i, limit in enumerate((min(UPPER_DEPTH, deepest), deepest)):
        shown = np.concatenate([cut.speed[depth <= limit].ravel() for cut in cuts])
        low = np.nanmin(shown)
        high = np.nanmax(shown)
        for j, cut in enumerate(cuts):
            axes = panels[i, j]
            mesh = _draw_section(axes, depth, cut, (low, high), limit)
            axes.axvline(cut.crossing, color=style.INK, linestyle=":", linewidth=0.7, zorder=1.5)
            if i == 0 or narrow:
                style.panel_title(axes, "abcd"[2 * i + j], cut.title)
            axes.xaxis.set_major_formatter(
                FuncFormatter(longitude_label if j == 0 else latitude_label)
            )
            axes.xaxis.set_major_locator(MaxNLocator(5 if j == 0 else 4, steps=[1, 2, 5, 10]))
        for axes in panels[i, :] if narrow else panels[i, :1]:
            axes.set_ylabel("Depth [m]")
        bar = figure.colorbar(mesh, ax=panels[i, :], pad=0.012, aspect=30 if narrow else 16)
        finish_bar(bar, "Sound speed [m/s]")
    for row in panels if narrow else panels[1:]:
        row[0].set_xlabel("Longitude [°]")
        row[1].set_xlabel("Latitude [°]")
    return figure


def _section_panels(
    ocean: xr.Dataset, header: str, width: float
) -> tuple[Figure, NDArray[np.object_]]:
    """
    Panels by part of the depths and by section: both sections beside each other, or all panels
    below each other in one column of a journal.
    """
    if width == style.COLUMN:
        figure = style.new_figure(width, 7.6, header)
        return figure, figure.subplots(4, 1).reshape(2, 2)
    figure = style.new_figure(width, 4.4, header)
    # ratio of the lengths of both sections in kilometres, with limits
    lat = ocean["lat"].values
    lon = ocean["lon"].values
    east = (lon[-1] - lon[0]) * float(np.cos(np.radians(0.5 * (lat[0] + lat[-1]))))
    widths = [float(np.clip(east / (lat[-1] - lat[0]), 0.7, 1.5)), 1.0]
    return figure, figure.subplots(2, 2, sharex="col", sharey="row", width_ratios=widths)


def _cuts(ocean: xr.Dataset, place: tuple[float, float], floor: xr.DataArray) -> tuple[_Cut, _Cut]:
    """Section along the parallel and along the meridian nearest to a place."""
    lat, lon, depth = (
        np.asarray(ocean[name].values, dtype=float) for name in ("lat", "lon", "depth")
    )
    row = _nearest(lat, place[0])
    column = _nearest(lon, wrap_longitude(place[1], about=0.5 * (lon[0] + lon[-1])))
    temperature, salinity = (
        fill_below_sea_bed(ocean[v].values, lat) for v in ("water_temp", "salinity")
    )
    filled = sound_speed(temperature, salinity, depth[:, None, None], lat[:, None], lon)
    speed = np.where(np.isfinite(ocean["water_temp"].values), filled, np.nan)
    parallel = latitude_label(lat[row], digits=2, unit="° ")
    meridian = longitude_label(lon[column], digits=2, unit="° ")
    along_lat = _along(floor, "lat", lon[column])
    along_lon = _along(floor, "lon", lat[row])
    return (
        _Cut(
            lon,
            speed[:, row],
            filled[:, row],
            *along_lon,
            lon[column],
            f"west to east along {parallel}",
        ),
        _Cut(
            lat,
            speed[:, :, column],
            filled[:, :, column],
            *along_lat,
            lat[row],
            f"south to north along {meridian}",
        ),
    )


def _draw_section(
    axes: Axes, depth: Array, cut: _Cut, span: tuple[float, float], limit: float
) -> Any:
    """
    Draw sound speed as filled contours, extended below the sea bed so that the bed covers their
    edge, then the bed.
    """
    axes.grid(visible=False)
    along = cut.along
    bed = cut.bed
    levels = (
        np.linspace(*span, 41) if span[1] > span[0] else np.array([span[0] - 0.5, span[0] + 0.5])
    )
    mesh = axes.contourf(
        along, depth, np.clip(cut.filled, *span), levels=levels, cmap=style.SOUND_SPEED
    )
    mesh.set_edgecolor("face")
    mesh.set_linewidth(0.2)
    mesh.set_rasterized(True)
    axes.set(xlim=(along[0], along[-1]), ylim=(limit, 0.0))
    shown = np.arange(depth.size) <= np.searchsorted(depth, limit)
    ticks = MaxNLocator(7, steps=[1, 2, 2.5, 5, 10]).tick_values(*span)
    look: dict[str, Any] = {"colors": style.INK, "linewidths": 0.4}
    lines = axes.contour(along, depth[shown], cut.speed[shown], levels=ticks, **look)
    _label_contours(axes, lines, "%g")
    axes.fill_between(
        cut.bed_along, bed, 2.0 * max(limit, bed.max()), color=style.BED, linewidth=0.0, zorder=3
    )
    axes.plot(cut.bed_along, bed, color=style.SHORE, linewidth=0.8, zorder=3)
    return mesh


def _along(floor: xr.DataArray, axis: str, at: float) -> tuple[Array, Array]:
    """Axis and depth of the sea floor along a grid line."""
    other = "lat" if axis == "lon" else "lon"
    line = floor.interp({other: at}, kwargs={"fill_value": "extrapolate"})
    return np.asarray(line[axis].values, dtype=float), np.maximum(line.values, 0.0)


def _floor_of(ocean: xr.Dataset, sea_floor: xr.DataArray | None) -> xr.DataArray:
    """Sea floor for the drawing, in the ocean's window of longitudes."""
    if sea_floor is None:
        return sea_floor_depth(ocean)
    middle = 0.5 * float(ocean["lon"][0] + ocean["lon"][-1])
    lon = sea_floor["lon"]
    return sea_floor.assign_coords(
        lon=lon - whole_turns(0.5 * float(lon[0] + lon[-1]), about=middle)
    )


def _nearest(axis: Array, value: float) -> int:
    """Index of the point of an axis that is nearest to a value."""
    return int(np.argmin(np.abs(np.asarray(axis, dtype=float) - value)))


def _label_contours(axes: Axes, lines: ContourSet, form: str) -> None:
    """
    Write values on contour lines, readable on light and dark colours, away from the frame and each
    other.
    """
    to_axes = axes.transData + axes.transAxes.inverted()
    figure = axes.get_figure(root=True)
    assert figure is not None
    apart = _APART * style.DOUBLE / figure.get_figwidth()
    places: list[Array] = []
    for path in lines.get_paths():
        for line in path.to_polygons(closed_only=False):
            corners = to_axes.transform(line)
            length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
            along = np.linspace(0.0, length[-1], 201)
            inside = np.stack([np.interp(along, length, corners[:, k]) for k in (0, 1)], axis=1)
            inside = inside[np.all((inside > _MARGIN) & (inside < 1.0 - _MARGIN), axis=1)]
            if len(inside) < 2 or np.ptp(inside, axis=0).max() < 2.0 * _MARGIN:
                continue
            middle = inside[np.argsort(np.abs(np.arange(len(inside)) - 0.5 * len(inside)))]
            free = (p for p in middle if all(np.hypot(*(p - q)) > apart for q in places))
            place = next(free, None)
            if place is not None:
                places.append(place)
    lines.set_path_effects(_OUTLINE)
    if not places:
        return
    at = to_axes.inverted().transform(places)
    for text in axes.clabel(
        lines, fontsize=6.0, fmt=form, colors="white", zorder=2, manual=at.tolist()
    ):
        text.set_path_effects(_OUTLINE)


def finish_bar(bar: Colorbar, label: str) -> None:
    """Give a colour bar its label, round ticks and a thin frame."""
    bar.set_label(label)
    bar.locator = MaxNLocator(6, steps=[1, 2, 5, 10])
    bar.update_ticks()
    bar.outline.set_linewidth(0.4)


def longitude_label(
    value: float, _position: int | None = None, *, digits: int = 4, unit: str = "°"
) -> str:
    """Label such as ``140°W``, from degrees of any window."""
    turned = round(wrap_longitude(value), digits)
    side = "" if turned in (0.0, -180.0, 180.0) else "W" if turned < 0.0 else "E"
    return f"{abs(turned):g}{unit}{side}".rstrip()


def latitude_label(
    value: float, _position: int | None = None, *, digits: int = 4, unit: str = "°"
) -> str:
    """As ``74.5°N``."""
    rounded = round(value, digits)
    side = "" if rounded == 0.0 else "S" if rounded < 0.0 else "N"
    return f"{abs(rounded):g}{unit}{side}".rstrip()

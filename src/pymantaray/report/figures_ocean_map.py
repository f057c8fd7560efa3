"""Maps of an ocean as its source has it: sound speed, currents and the sea floor."""

from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.typing import NDArray

from pymantaray.ocean.seawater import sound_speed
from pymantaray.report.colormaps import FLOOR, WATER
from pymantaray.report.ocean_axes import (
    BED,
    finish_bar,
    floor_of,
    label_contours,
    latitude_tick,
    longitude_tick,
    nearest,
)
from pymantaray.report.style import COLUMN, DOUBLE, INK, new_figure, styled

Array = NDArray[np.float64]
_LAND = "#d9d2c7"
_ARROWS = {DOUBLE: 32, COLUMN: 18}  # across the longer side of a map


@styled
def sound_speed_map(
    ocean: xr.Dataset, depth: float, header: str, sea_floor: xr.DataArray | None = None
) -> Figure:
    """
    Sound speed at a level in plan, currents as arrows, the sea floor as contours.

    Parameters
    ----------
    ocean : xarray.Dataset
        A valid ocean.
    depth : float
        The nearest level is shown. [m]
    header : str
        From `ocean_header`.
    sea_floor : xarray.DataArray, optional
        From `pymantaray.ocean.topography.open_sea_floor`; by default where the ocean's levels end. [m]

    Returns
    -------
    matplotlib.figure.Figure
    """
    k = nearest(ocean["depth"].values, depth)
    level = float(ocean["depth"].values[k])
    speed = _speed(ocean.isel(depth=[k]))[0]

    def draw(axes: Axes, arrows: int) -> Any:
        axes.set_facecolor(BED if level > 0.0 else _LAND)
        mesh = axes.pcolormesh(
            ocean["lon"], ocean["lat"], speed, cmap=WATER, shading="nearest", rasterized=True
        )
        _draw_floor_lines(axes, floor_of(ocean, sea_floor))
        _draw_currents(axes, ocean.isel(depth=k), arrows)
        return mesh

    return _map(ocean, draw, "Sound speed [m/s]", header, f"at {level:g} m depth")


@styled
def sea_floor_map(ocean: xr.Dataset, header: str, sea_floor: xr.DataArray | None = None) -> Figure:
    """
    Depth of the sea floor in plan.

    Parameters
    ----------
    ocean : xarray.Dataset
        A valid ocean.
    header : str
        From `ocean_header`.
    sea_floor : xarray.DataArray, optional
        From `pymantaray.ocean.topography.open_sea_floor`; by default where the ocean's levels end. [m]

    Returns
    -------
    matplotlib.figure.Figure
        Land is grey.
    """
    floor = floor_of(ocean, sea_floor)
    source = (
        "where the levels end" if sea_floor is None else str(sea_floor.attrs.get("source", "from a file"))
    )

    def draw(axes: Axes, _arrows: int) -> Any:
        axes.set_facecolor(_LAND)
        wet = np.where(floor.values > 0.0, floor.values, np.nan)
        mesh = axes.pcolormesh(
            floor["lon"], floor["lat"], wet, cmap=FLOOR, shading="nearest", rasterized=True
        )
        _draw_floor_lines(axes, floor)
        return mesh

    return _map(ocean, draw, "Sea floor depth [m]", header, f"sea floor, {source}", invert=True)


def _map(
    ocean: xr.Dataset,
    draw: Callable[[Axes, int], Any],
    label: str,
    header: str,
    title: str,
    *,
    invert: bool = False,
) -> Figure:
    """Map of the ocean's window, in which a kilometre is as long northward as eastward at the middle."""
    lat, lon = (np.asarray(ocean[name].values, dtype=float) for name in ("lat", "lon"))
    aspect = 1.0 / max(float(np.cos(np.radians(0.5 * (lat[0] + lat[-1])))), 0.02)
    shape = aspect * (lat[-1] - lat[0]) / (lon[-1] - lon[0])
    wide = shape < 1.1
    width = DOUBLE if wide else COLUMN
    height = min(max((width - 1.4) * shape + 0.75, 2.4), 7.0)
    figure = new_figure(width, height, header)
    axes = figure.subplots()
    axes.grid(visible=False)
    mesh = draw(axes, _ARROWS[width])
    axes.set_aspect(aspect)
    axes.set_xlim(lon[0], lon[-1])
    axes.set_ylim(lat[0], lat[-1])
    for name, axis in (("Longitude [°]", axes.xaxis), ("Latitude [°]", axes.yaxis)):
        axis.set_label_text(name)
    axes.xaxis.set_major_formatter(FuncFormatter(longitude_tick))
    axes.yaxis.set_major_formatter(FuncFormatter(latitude_tick))
    axes.xaxis.set_major_locator(MaxNLocator(7 if wide else 4, steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    for spine in axes.spines.values():
        spine.set_visible(True)
    axes.set_title(title, loc="left")
    bar = figure.colorbar(mesh, ax=axes, pad=0.015, aspect=24)
    finish_bar(bar, label)
    if invert:
        bar.ax.invert_yaxis()
    return figure


def _draw_floor_lines(axes: Axes, floor: xr.DataArray) -> None:
    deepest = float(floor.max())
    steps = [s for s in (200.0, 500.0, 1_000.0, 2_000.0, 3_000.0, 4_000.0, 5_000.0, 6_000.0) if s < deepest]
    if deepest - float(floor.min()) > 50.0 and steps:
        lines = axes.contour(
            floor["lon"], floor["lat"], floor.values, levels=steps, colors="white", linewidths=0.6
        )
        label_contours(axes, lines, "%g m")


def _draw_currents(axes: Axes, level: xr.Dataset, count: int) -> None:
    u, v = level["water_u"].values, level["water_v"].values
    size = np.hypot(u, v)
    if not np.nanmax(np.where(np.isfinite(size), size, 0.0)) > 0.0:
        return
    lat, lon = level["lat"].values, level["lon"].values
    squeeze = float(np.cos(np.radians(0.5 * (lat[0] + lat[-1]))))
    gap = max(float(lat[-1] - lat[0]), squeeze * float(lon[-1] - lon[0])) / count
    step = [max(1, round(gap / d)) for d in (lat[1] - lat[0], squeeze * (lon[1] - lon[0]))]
    rows, columns = (slice(s // 2, None, s) for s in step)
    scale = float(np.nanpercentile(size, 99.0)) or 1.0
    arrows = axes.quiver(
        lon[columns],
        lat[rows],
        u[rows, columns],
        v[rows, columns],
        color=INK,
        angles="uv",
        scale_units="width",
        scale=scale * count * 0.8,
        width=0.0018,
        headwidth=4.0,
        zorder=4,
    )
    key = float(f"{scale:.1g}")
    axes.quiverkey(
        arrows, 0.94, 1.035, key, f"{key:g} m/s", labelpos="W", labelsep=0.05, fontproperties={"size": 6.5}
    )


def _speed(ocean: xr.Dataset) -> Array:
    depth, lat, lon = (np.asarray(ocean[name].values, dtype=float) for name in ("depth", "lat", "lon"))
    return sound_speed(
        ocean["water_temp"].values, ocean["salinity"].values, depth[:, None, None], lat[:, None], lon
    )

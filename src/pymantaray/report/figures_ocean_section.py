"""Vertical sections through an ocean as its source has it."""

from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.typing import NDArray

from pymantaray.geometry.longitude import wrapped
from pymantaray.ocean.sea_floor import fill_below_sea_bed
from pymantaray.ocean.seawater import sound_speed
from pymantaray.report.colormaps import WATER
from pymantaray.report.ocean_axes import (
    BED,
    finish_bar,
    floor_of,
    label_contours,
    latitude_tick,
    longitude_near,
    longitude_tick,
    nearest,
)
from pymantaray.report.style import DOUBLE, INK, new_figure, panel_title, styled

Array = NDArray[np.float64]
UPPER = 500.0
"""Depth to which the upper panels of the sections go. [m]"""
_SHORE = "#4a4038"


class _Cut(NamedTuple):
    """One vertical section."""

    along: Array
    """Latitude or longitude. [degrees]"""
    speed: Array
    """Shape (depth, along), NaN below the sea bed. [m/s]"""
    filled: Array
    """The same, carried on beneath it as `to_local` does. [m/s]"""
    bed_along: Array
    bed: Array
    """Sea floor, on an axis of its own. [m]"""
    crossing: float
    """Where the other section crosses. [degrees]"""
    title: str


@styled
def sound_speed_sections(
    ocean: xr.Dataset, place: tuple[float, float], header: str, sea_floor: xr.DataArray | None = None
) -> Figure:
    """
    Sound speed along a parallel and a meridian through a place, upper part and all depths.

    Parameters
    ----------
    ocean : xarray.Dataset
        A valid ocean.
    place : tuple of float
        Latitude and longitude; the nearest grid lines are shown. [degrees]
    header : str
        From `ocean_header`.
    sea_floor : xarray.DataArray, optional
        From `pymantaray.ocean.topography.open_sea_floor`; by default where the ocean's levels end. [m]

    Returns
    -------
    matplotlib.figure.Figure
        Left west to east, right south to north; dotted lines mark where the sections cross.
    """
    depth = np.asarray(ocean["depth"].values, dtype=float)
    cuts = _cuts(ocean, place, floor_of(ocean, sea_floor))
    known = np.any([np.isfinite(cut.speed).any(axis=1) for cut in cuts], axis=0)
    lowest = float(depth[known][-1])
    deepest = max(min(max(float(cut.bed.max()) for cut in cuts), 1.02 * lowest), lowest)
    figure = new_figure(DOUBLE, 4.4, header)
    widths = _widths(ocean["lat"].values, ocean["lon"].values)
    panels = figure.subplots(2, 2, sharex="col", sharey="row", width_ratios=widths)
    for i, limit in enumerate((min(UPPER, deepest), deepest)):
        shown = np.concatenate([cut.speed[depth <= limit].ravel() for cut in cuts])
        low, high = np.nanmin(shown), np.nanmax(shown)
        for j, cut in enumerate(cuts):
            axes = panels[i, j]
            mesh = _draw_section(axes, depth, cut, (low, high), limit)
            axes.axvline(cut.crossing, color=INK, linestyle=":", linewidth=0.7, zorder=1.5)
            if i == 0:
                panel_title(axes, "ab"[j], cut.title)
            axes.xaxis.set_major_formatter(FuncFormatter(longitude_tick if j == 0 else latitude_tick))
            axes.xaxis.set_major_locator(MaxNLocator(5 if j == 0 else 4, steps=[1, 2, 5, 10]))
        panels[i, 0].set_ylabel("Depth [m]")
        finish_bar(figure.colorbar(mesh, ax=panels[i, :], pad=0.012, aspect=16), "Sound speed [m/s]")
    panels[1, 0].set_xlabel("Longitude [°]")
    panels[1, 1].set_xlabel("Latitude [°]")
    return figure


def _cuts(ocean: xr.Dataset, place: tuple[float, float], floor: xr.DataArray) -> tuple[_Cut, _Cut]:
    """Section along the parallel and along the meridian nearest to a place."""
    lat, lon, depth = (np.asarray(ocean[name].values, dtype=float) for name in ("lat", "lon", "depth"))
    row, column = nearest(lat, place[0]), nearest(lon, longitude_near(ocean, place[1]))
    temperature, salinity = (fill_below_sea_bed(ocean[v].values, lat) for v in ("water_temp", "salinity"))
    filled = sound_speed(temperature, salinity, depth[:, None, None], lat[:, None], lon)
    speed = np.where(np.isfinite(ocean["water_temp"].values), filled, np.nan)
    west_east = f"west to east along {_north(lat[row])}"
    south_north = f"south to north along {_east(lon[column])}"
    return (
        _Cut(lon, speed[:, row], filled[:, row], *_along(floor, "lon", lat[row]), lon[column], west_east),
        _Cut(
            lat,
            speed[:, :, column],
            filled[:, :, column],
            *_along(floor, "lat", lon[column]),
            lat[row],
            south_north,
        ),
    )


def _draw_section(axes: Axes, depth: Array, cut: _Cut, span: tuple[float, float], limit: float) -> Any:
    """Sound speed as filled contours, which go on under the bed so that their edge is the bed's; then the bed."""
    axes.grid(visible=False)
    along, bed = cut.along, cut.bed
    levels = np.linspace(*span, 41) if span[1] > span[0] else np.array([span[0] - 0.5, span[0] + 0.5])
    mesh = axes.contourf(along, depth, np.clip(cut.filled, *span), levels=levels, cmap=WATER)
    mesh.set_edgecolor("face")
    mesh.set_linewidth(0.2)
    mesh.set_rasterized(True)
    axes.set_xlim(along[0], along[-1])
    axes.set_ylim(limit, 0.0)
    shown = np.arange(depth.size) <= np.searchsorted(depth, limit)
    ticks = MaxNLocator(7, steps=[1, 2, 2.5, 5, 10]).tick_values(*span)
    label_contours(
        axes,
        axes.contour(along, depth[shown], cut.speed[shown], levels=ticks, colors="white", linewidths=0.5),
        "%g",
    )
    axes.fill_between(cut.bed_along, bed, 2.0 * max(limit, bed.max()), color=BED, linewidth=0.0, zorder=3)
    axes.plot(cut.bed_along, bed, color=_SHORE, linewidth=0.8, zorder=3)
    return mesh


def _along(floor: xr.DataArray, axis: str, at: float) -> tuple[Array, Array]:
    """Axis and depth of the sea floor along a grid line."""
    other = "lat" if axis == "lon" else "lon"
    line = floor.interp({other: at}, kwargs={"fill_value": "extrapolate"})
    return np.asarray(line[axis].values, dtype=float), np.maximum(line.values, 0.0)


def _widths(lat: Array, lon: Array) -> list[float]:
    """Ratio of the panels' widths: by length in kilometres, within reason."""
    east = (lon[-1] - lon[0]) * float(np.cos(np.radians(0.5 * (lat[0] + lat[-1]))))
    return [float(np.clip(east / (lat[-1] - lat[0]), 0.7, 1.5)), 1.0]


def _north(value: float) -> str:
    return f"{abs(round(value, 2)):g}° {'S' if value < 0.0 else 'N'}"


def _east(value: float) -> str:
    turned = wrapped(value)
    side = "" if round(turned, 2) in (0.0, -180.0) else " W" if turned < 0.0 else " E"
    return f"{abs(round(turned, 2)):g}°{side}"

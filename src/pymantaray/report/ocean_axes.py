"""What maps and sections of an ocean share: ticks in degrees, labelled contour lines, colour bars."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colorbar import Colorbar
from matplotlib.contour import ContourSet
from matplotlib.patheffects import AbstractPathEffect, withStroke
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from pymantaray.geometry.longitude import whole_turns, wrapped
from pymantaray.ocean.sea_floor import sea_floor_depth

Array = NDArray[np.float64]
BED = "#8d7f70"
"""Colour of what lies beneath the sea bed."""
_MARGIN = 0.07  # of the axes, within which contour lines get no labels
# white lines must read on yellow
_OUTLINE: list[AbstractPathEffect] = [withStroke(linewidth=1.3, foreground="#30303070")]


def floor_of(ocean: xr.Dataset, sea_floor: xr.DataArray | None) -> xr.DataArray:
    """
    Sea floor to draw, longitudes as the ocean counts them.

    Parameters
    ----------
    ocean : xarray.Dataset
        A valid ocean.
    sea_floor : xarray.DataArray or None
        From `pymantaray.ocean.topography.open_sea_floor`; None for where the ocean's levels end.

    Returns
    -------
    xarray.DataArray, shape (lat, lon)
        [m]
    """
    if sea_floor is None:
        return sea_floor_depth(ocean)
    middle = 0.5 * float(ocean["lon"][0] + ocean["lon"][-1])
    lon = sea_floor["lon"]
    return sea_floor.assign_coords(lon=lon - whole_turns(0.5 * float(lon[0] + lon[-1]), about=middle))


def nearest(axis: Array, value: float) -> int:
    """
    Index of the point of an axis that is nearest to a value.

    Parameters
    ----------
    axis : ndarray, shape (n,)
    value : float

    Returns
    -------
    int
    """
    return int(np.argmin(np.abs(np.asarray(axis, dtype=float) - value)))


def longitude_near(ocean: xr.Dataset, lon: float) -> float:
    """
    Longitude as the ocean counts it.

    Parameters
    ----------
    ocean : xarray.Dataset
        A valid ocean.
    lon : float
        In any 360 degree window. [degrees]

    Returns
    -------
    float
        Within 180 degrees of the middle of the ocean's window. [degrees]
    """
    middle = 0.5 * float(ocean["lon"][0] + ocean["lon"][-1])
    return wrapped(lon, about=middle)


def label_contours(axes: Axes, lines: ContourSet, form: str) -> None:
    """
    Write values on contour lines, readable on light and on dark, away from the frame and each other.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        With its final limits.
    lines : matplotlib.contour.ContourSet
    form : str
        Format of a value, such as ``"%g m"``.
    """
    to_axes = axes.transData + axes.transAxes.inverted()
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
            free = (p for p in middle if all(np.hypot(*(p - q)) > 1.6 * _MARGIN for q in places))
            place = next(free, None)
            if place is not None:
                places.append(place)
    lines.set_path_effects(_OUTLINE)
    if not places:
        return
    at = to_axes.inverted().transform(places)
    for text in axes.clabel(lines, fontsize=5.5, fmt=form, colors="white", zorder=2, manual=at.tolist()):
        text.set_path_effects(_OUTLINE)


def finish_bar(bar: Colorbar, label: str) -> None:
    """
    Give a colour bar its label, round ticks and a thin frame.

    Parameters
    ----------
    bar : matplotlib.colorbar.Colorbar
    label : str
        With its unit.
    """
    bar.set_label(label)
    bar.locator = MaxNLocator(6, steps=[1, 2, 5, 10])
    bar.update_ticks()
    bar.outline.set_linewidth(0.4)


def longitude_tick(value: float, _position: int | None = None) -> str:
    """
    Text of a tick of longitude.

    Parameters
    ----------
    value : float
        In any 360 degree window. [degrees]

    Returns
    -------
    str
        As ``140W``.
    """
    turned = wrapped(value)
    side = "" if abs(turned) < 1e-9 or abs(abs(turned) - 180.0) < 1e-9 else "W" if turned < 0.0 else "E"
    return f"{abs(round(turned, 4)):g}{side}"


def latitude_tick(value: float, _position: int | None = None) -> str:
    """
    Text of a tick of latitude.

    Parameters
    ----------
    value : float
        [degrees]

    Returns
    -------
    str
        As ``74.5N``.
    """
    side = "" if abs(value) < 1e-9 else "S" if value < 0.0 else "N"
    return f"{abs(round(value, 4)):g}{side}"

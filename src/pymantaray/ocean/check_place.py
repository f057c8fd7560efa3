"""Does it hold the domain and the fleet: coverage, spacing and the projection's error."""

from collections.abc import Mapping

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from pymantaray.errors import GeometryError, OceanError
from pymantaray.geometry import LocalFrame
from pymantaray.ocean.findings import Finding, doubtful, wrong
from pymantaray.ocean.sea_floor import is_finer, local_floor, sea_floor_depth
from pymantaray.ocean.window import Window

Array = NDArray[np.float64]
COARSE = 12e3
"""Spacing beyond which eddies and fronts are not resolved; HYCOM's and GLORYS's are 9 km at most. [m]"""
MIN_NODES = 10
"""Grid points across the domain."""
SCALE_ERROR = 1e-3
"""Distortion of lengths by the projection: 1 m in 1 km. [-]"""


def check_place(
    ocean: xr.Dataset,
    *,
    centre: tuple[float, float] | None,
    half_extent: tuple[float, float] | None,
    fleet: Mapping[str, Array],
    sea_floor: xr.DataArray | None,
) -> list[Finding]:
    """
    List what is wrong or doubtful about an ocean's place and size.

    Parameters
    ----------
    ocean : xarray.Dataset
        A valid ocean.
    centre, half_extent : tuple of float or None
        Domain, see `pymantaray.ocean.to_local`.
    fleet : mapping of str to ndarray, shape (n, 3)
        Points that each vehicle plans to reach, the first one its start. [m]
    sea_floor : xarray.DataArray or None
        Sea floor of a file.

    Returns
    -------
    list of Finding
    """
    lat, lon = (np.asarray(ocean[name].values, dtype=float) for name in ("lat", "lon"))
    if centre is None:
        centre = (0.5 * float(lat[0] + lat[-1]), 0.5 * float(lon[0] + lon[-1]))
    try:
        window = Window(lat, lon, LocalFrame(*centre))
        largest = window.largest_rectangle()
    except (OceanError, GeometryError) as error:
        return [wrong("coverage", str(error), "centre inside the data", "fetch the window around the centre")]
    found = []
    half = largest if half_extent is None else half_extent
    if not window.holds(*half):
        found.append(
            wrong(
                "coverage",
                f"domain of +-{half[0] / 1e3:g} km north, +-{half[1] / 1e3:g} km east",
                f"+-{largest[0] / 1e3:.1f} km by +-{largest[1] / 1e3:.1f} km fits",
                "fetch a larger window or shrink the domain",
                where=f"{centre[0]:g} N {centre[1]:g} E",
            )
        )
        return found
    found.extend(_fleet(ocean, window, half, fleet, sea_floor))
    found.extend(_grid(window, half))
    return found


def _grid(window: Window, half: tuple[float, float]) -> list[Finding]:
    found = []
    spacing = window.native_spacing()
    nodes = [2.0 * h / s for h, s in zip(half, spacing, strict=True)]
    if max(spacing) > COARSE or min(nodes) < MIN_NODES:
        found.append(
            doubtful(
                "coarse grid",
                f"{spacing[0] / 1e3:.1f} km by {spacing[1] / 1e3:.1f} km, {nodes[0]:.0f} by {nodes[1]:.0f} cells"
                " across the domain",
                f"{COARSE / 1e3:g} km and {MIN_NODES} cells",
                "fronts and eddies are lost; take a finer source or a larger domain",
            )
        )
    side = np.linspace(-1.0, 1.0, 21)
    north, east = half[0] * side[:, None], half[1] * side[None, :]
    error = float(np.max(np.abs(window.frame.scale_factor(north, east) - 1.0)))
    if error > SCALE_ERROR:
        found.append(
            doubtful(
                "projection error",
                f"lengths up to {1e3 * error:.2g} m in 1 km too long at the domain's edge",
                f"{1e3 * SCALE_ERROR:g} m in 1 km",
                "set half_extent to what the fleet needs",
            )
        )
    return found


def _fleet(
    ocean: xr.Dataset,
    window: Window,
    half: tuple[float, float],
    fleet: Mapping[str, Array],
    sea_floor: xr.DataArray | None,
) -> list[Finding]:
    found: list[Finding] = []
    finer = sea_floor is not None and is_finer(sea_floor, window)
    if sea_floor is not None and finer:
        try:
            local = local_floor(sea_floor, window, half)
        except OceanError as error:
            return [wrong("sea floor", str(error), "the whole domain", "fetch a larger window of it")]
        bed = RegularGridInterpolator((local.north, local.east), local.depth)
    else:
        floor = RegularGridInterpolator((window.lat, window.lon), sea_floor_depth(ocean).values)
    for name, plan in fleet.items():
        points = np.atleast_2d(np.asarray(plan, dtype=float))
        outside = np.any(np.abs(points[:, :2]) > np.asarray(half) + 1e-6, axis=1)
        if outside.any():
            north, east = points[int(np.argmax(outside)), :2] / 1e3
            found.append(
                wrong(
                    "coverage",
                    f"{int(outside.sum())} of {len(points)} planned points outside the domain, the first"
                    f" {north:g} km north, {east:g} km east",
                    f"+-{half[0] / 1e3:.1f} km by +-{half[1] / 1e3:.1f} km",
                    "fetch a larger window or move the vehicle",
                    where=f"vehicle {name}",
                )
            )
            continue
        if finer:
            beds = bed(points[:, :2])
        else:
            beds = floor(np.stack(window.geographic(points[:, 0], points[:, 1]), axis=-1))
        short = points[:, 2] - beds
        if np.any(short > 0.0):
            worst = 0 if short[0] > 0.0 else int(np.argmax(short))
            report = wrong if worst == 0 else doubtful
            found.append(
                report(
                    "sea bed above the vehicle",
                    f"sea bed at {beds[worst]:.0f} m, {'start' if worst == 0 else 'plan'} at {points[worst, 2]:g} m",
                    f"above {beds[worst]:.0f} m",
                    "it stops at the bed; move it to deeper water or plan shallower",
                    where=f"vehicle {name}",
                )
            )
    return found

"""Figures of an ocean written into a folder."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pymantaray.errors import ReportError
from pymantaray.geometry.longitude import wrapped
from pymantaray.ocean import sound_speed_profile_spread
from pymantaray.report.figures_ocean import sound_speed_profiles
from pymantaray.report.figures_ocean_map import sea_floor_map, sound_speed_map
from pymantaray.report.figures_ocean_section import sound_speed_sections
from pymantaray.report.labels import ocean_header, ocean_name
from pymantaray.report.style import save_figure

DEPTH = 100.0
"""Level of the map unless another is asked for. [m]"""


def write_ocean_plots(
    ocean: xr.Dataset,
    folder: str | Path,
    *,
    depth: float | None = None,
    place: tuple[float, float] | None = None,
    sea_floor: xr.DataArray | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> list[Path]:
    """
    Draw an ocean: spread of its profiles, two sections, a map with currents, and the sea floor.

    Parameters
    ----------
    ocean : xarray.Dataset
        A valid ocean.
    folder : str or pathlib.Path
        Made if it is not there; figures of the same names in it are replaced.
    depth : float, optional
        Of the map; by default 100 m, or half-way down where it is shallower. [m]
    place : tuple of float, optional
        Latitude and longitude where the sections cross, by default the middle of the window. [degrees]
    sea_floor : xarray.DataArray, optional
        From `pymantaray.ocean.topography.open_sea_floor`. [m]
    progress : callable, optional
        Told ``"figures"``, how many are done and how many there are.

    Returns
    -------
    list of pathlib.Path
        PNG and PDF of each.

    Raises
    ------
    ReportError
        If the place lies outside the window, the depth beneath the water, or nothing can be written.
    """
    lat, lon = (np.asarray(ocean[name].values, dtype=float) for name in ("lat", "lon"))
    middle = (0.5 * float(lat[0] + lat[-1]), 0.5 * float(lon[0] + lon[-1]))
    where = middle if place is None else place
    turned = wrapped(where[1], about=middle[1])
    if not (lat[0] <= where[0] <= lat[-1] and lon[0] <= turned <= lon[-1]):
        raise ReportError(
            f"place {where[0]:g}, {where[1]:g} is outside the ocean: latitude {lat[0]:g} to {lat[-1]:g}, longitude"
            f" {lon[0]:g} to {lon[-1]:g}"
        )
    wet = np.isfinite(ocean["water_temp"].values).any(axis=(1, 2))
    deepest = float(ocean["depth"].values[wet][-1])
    level = min(DEPTH, 0.5 * deepest) if depth is None else float(depth)
    if not 0.0 <= level <= deepest:
        raise ReportError(f"depth {level:g} m is not in the water; allowed 0 to {deepest:g} m")
    time = str(np.datetime_as_string(ocean["time"].values, unit="s"))
    header = ocean_header({**ocean.attrs, "time": time})
    draw: dict[str, Callable[[], Figure]] = {
        "ocean_profiles": lambda: sound_speed_profiles(
            [(ocean_name(ocean.attrs), sound_speed_profile_spread(ocean))], header
        ),
        "ocean_sections": lambda: sound_speed_sections(ocean, where, header, sea_floor),
        "ocean_map": lambda: sound_speed_map(ocean, level, header, sea_floor),
        "ocean_sea_floor": lambda: sea_floor_map(ocean, header, sea_floor),
    }
    written = []
    for i, (name, figure) in enumerate(draw.items()):
        written.extend(save_figure(figure(), Path(folder), name))
        if progress is not None:
            progress("figures", i + 1, len(draw))
    return written

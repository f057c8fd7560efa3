"""Synthetic oceans of the paper's two regions, with HYCOM's grid, levels and names."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import xarray as xr

from pymantaray.arrays import Array
from pymantaray.errors import OceanError
from pymantaray.geometry import LocalFrame
from pymantaray.ocean.convert import parse_instant
from pymantaray.ocean.schema import assemble_ocean
from pymantaray.ocean.seawater import density, in_situ_temperature
from pymantaray.ocean.synthetic import beaufort, fram
from pymantaray.ocean.synthetic.geostrophy import Grid, geostrophic_currents
from pymantaray.records.dates import seconds_since

HYCOM_DEPTHS = (
    *(
        0.0,
        2.0,
        4.0,
        6.0,
        8.0,
        10.0,
        12.0,
        15.0,
        20.0,
        25.0,
        30.0,
        35.0,
        40.0,
        45.0,
        50.0,
        60.0,
        70.0,
        80.0,
    ),
    *(
        90.0,
        100.0,
        125.0,
        150.0,
        200.0,
        250.0,
        300.0,
        350.0,
        400.0,
        500.0,
        600.0,
        700.0,
        800.0,
        900.0,
    ),
    *(1000.0, 1250.0, 1500.0, 2000.0, 2500.0, 3000.0, 4000.0, 5000.0),
)
"""The 40 levels of HYCOM's public data sets. [m]"""
_LON_STEP = 0.08  # degrees, as in HYCOM
_LAT_STEP = 0.04
EPOCH = "2014-07-15T00:00"
"""The paper's snapshot (UTC); tables of eddies and fronts give positions at this instant."""


@dataclass(frozen=True)
class SyntheticRegion:
    """Grid of a region, and functions for its water, sea bed and reference height."""

    title: str
    latitude_deg: float
    longitude_deg: float
    n_lat: int
    n_lon: int
    water: Callable[[Grid, float], Array]
    floor: Callable[[Grid], Array]
    reference_height: Callable[[Grid], Array]

    def axes(self) -> tuple[Array, Array]:
        """Latitudes and longitudes of the grid. [degrees]"""
        return (
            _centred(self.latitude_deg, _LAT_STEP, self.n_lat),
            _centred(self.longitude_deg, _LON_STEP, self.n_lon),
        )

    def grid(self) -> Grid:
        """HYCOM's grid around the region's centre."""
        lat, lon = self.axes()
        frame = LocalFrame(self.latitude_deg, self.longitude_deg)
        north, east = frame.to_local(lat[:, None], lon[None, :])
        return Grid(np.array(HYCOM_DEPTHS), lat, lon, north, east)


REGIONS = {
    "beaufort": SyntheticRegion(
        "Beaufort Sea",
        74.5,
        -140.0,
        76,
        251,
        beaufort.water,
        beaufort.floor,
        beaufort.reference_height,
    ),
    "fram": SyntheticRegion(
        "Fram Strait", 78.0, 0.0, 75, 237, fram.water, fram.floor, fram.reference_height
    ),
}


def synthetic_ocean(region: str, time: str | np.datetime64 = EPOCH) -> xr.Dataset:
    """
    Make a synthetic ocean of one of the paper's regions.

    Parameters
    ----------
    region : {"beaufort", "fram"}
        Beaufort Sea or Fram Strait.
    time : str or numpy.datetime64
        Instant (UTC). Default: the instant of the paper.

    Returns
    -------
    xarray.Dataset
        A valid ocean.

    Notes
    -----
    The grid is HYCOM's: 40 levels, steps of 0.08 degrees in longitude and 0.04 in latitude, 251 x
    76 points around 74.5 N 140 W (Beaufort Sea) and 237 x 75 points around 78 N 0 E (Fram Strait).
    The widths in the paper's Table I, 650 and 490 km, are those of the south edges. The widths at
    the centres are 595 and 437 km (597 and 438 km on the ellipsoid). Temperature and salinity are
    sums of smooth functions of place and time, based on published water masses (see `beaufort` and
    `fram`). Eddies drift and fronts meander; nothing is random. Currents are in geostrophic balance
    with the density, plus a weak current that is constant over depth.

    Examples
    --------
    >>> from pymantaray.ocean import synthetic_ocean
    >>> dict(synthetic_ocean("fram").sizes)
    {'depth': 40, 'lat': 75, 'lon': 237}
    """
    return _kept_ocean(region, parse_instant(time)).copy(deep=True)


@lru_cache(maxsize=2)  # studies and sweeps of one process open one ocean many times
def _kept_ocean(region: str, instant: np.datetime64) -> xr.Dataset:
    """Synthetic ocean of a region at an instant."""
    definition = _region(region)
    elapsed = float(seconds_since(instant, np.datetime64(EPOCH)))
    grid = definition.grid()
    potential_temperature, salinity = np.moveaxis(definition.water(grid, elapsed), -1, 0)
    place = (grid.depth[:, None, None], grid.lat[:, None], grid.lon)
    temperature = in_situ_temperature(potential_temperature, salinity, *place)
    # one composition of sea water for the whole region: TEOS-10's atlas has kinks at its nodes,
    # every 4 degrees, which would cause currents
    composition = (definition.latitude_deg, definition.longitude_deg)
    u, v = geostrophic_currents(
        density(temperature, salinity, grid.depth[:, None, None], *composition),
        grid.depth,
        grid.lat,
        grid.lon,
        definition.reference_height(grid),
    )
    dry = grid.depth[:, None, None] > definition.floor(grid)
    fields = {"water_temp": temperature, "salinity": salinity, "water_u": u, "water_v": v}
    return assemble_ocean(
        {"depth": grid.depth, "lat": grid.lat, "lon": grid.lon},
        instant,
        {name: np.where(dry, np.nan, field) for name, field in fields.items()},
        title=f"{definition.title} (synthetic)",
        source="pymantaray.ocean.synthetic: water masses from the literature, geostrophic currents",
        synthetic=True,
    )


def synthetic_axes(region: str) -> tuple[Array, Array]:
    """Latitudes and longitudes of a region's grid. [degrees]"""
    return _region(region).axes()


def _region(name: str) -> SyntheticRegion:
    if name not in REGIONS:
        raise OceanError(
            f"synthetic ocean {name!r} is unknown; available: {', '.join(sorted(REGIONS))}"
        )
    return REGIONS[name]


def _centred(middle: float, step: float, count: int) -> Array:
    # rounded to HYCOM's multiples of the step, so -150 does not become -149.99999999999997
    return np.asarray(
        np.round(middle + step * (np.arange(count) - 0.5 * (count - 1)), 6), dtype=float
    )

"""From latitude and longitude to the local frame: every node is looked up where it truly lies."""

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.errors import OceanError
from pymantaray.geometry import LocalFrame
from pymantaray.ocean.bathymetry import fill_below_sea_bed, sea_floor_depth
from pymantaray.ocean.schema import VARIABLES, validate_ocean
from pymantaray.ocean.seawater import sound_speed
from pymantaray.ocean.spline import TensorSpline
from pymantaray.ocean.window import Window

Array = NDArray[np.float64]
_MIN_CELLS = 2  # on either side of the centre: five nodes, enough for a cubic spline


def to_local(
    ocean: xr.Dataset,
    centre: tuple[float, float] | None = None,
    half_extent: tuple[float, float] | None = None,
) -> xr.Dataset:
    """
    Sound speed, currents and sea floor of an ocean on a regular grid in the local NED frame.

    Each node of the local grid is projected back to its latitude and longitude and interpolated there:
    a cubic tensor spline for sound speed and currents, bilinear for the sea floor. One row's metres per
    degree for all rows would be 12 % wrong across the paper's Fram Strait.

    Parameters
    ----------
    ocean : xarray.Dataset
        A valid ocean, see `validate_ocean`.
    centre : tuple of float, optional
        Latitude and longitude of the frame's centre, by default the window's middle. [degrees]
    half_extent : tuple of float, optional
        Half sides (north, east) of the domain about the centre, by default of the rectangle of largest
        area that the window holds. [m]

    Returns
    -------
    xarray.Dataset
        Dimensions ``(north, east, depth)`` [m], depth being the ocean's own levels. Variables
        ``sound_speed``, ``current_north``, ``current_east`` (components along the frame's axes) [m/s] and
        ``sea_floor_depth`` (north, east) [m]. Attributes ``centre_latitude_deg``,
        ``centre_longitude_deg``, ``proj_string``, ``scale_error_max`` (largest distortion of lengths in
        the domain), ``time``, ``title``, ``source``, ``synthetic``.

    Raises
    ------
    OceanError
        If the ocean is not valid, or the domain does not fit into its window.

    Notes
    -----
    Sound speed is computed from temperature and salinity at the ocean's own grid points. Beneath the sea
    bed both are carried downward first, so that sound speed goes on rising with pressure there and the
    spline meets no step where the coarse floor lies between two levels.
    """
    validate_ocean(ocean)
    lat, lon, depth = (np.asarray(ocean[name].values, dtype=float) for name in ("lat", "lon", "depth"))
    middle = (0.5 * (lat[0] + lat[-1]), 0.5 * (lon[0] + lon[-1]))
    window = Window(lat, lon, LocalFrame(*(middle if centre is None else centre)))
    half = window.largest_rectangle() if half_extent is None else _checked(half_extent, window)
    north, east = (_axis(h, step) for h, step in zip(half, window.native_spacing(), strict=True))

    fields = {v.name: fill_below_sea_bed(ocean[v.name].values, lat) for v in VARIABLES}
    speed = sound_speed(fields["water_temp"], fields["salinity"], depth[:, None, None], lat[:, None], lon)
    at_lat, at_lon = window.geographic(north[:, None], east[None, :])
    smooth = TensorSpline(lat, lon, at_lat, at_lon)
    floor = sea_floor_depth(ocean).values
    flat = TensorSpline(lat, lon, at_lat, at_lon, degree=1)(floor[None])[..., 0]
    u, v = smooth(fields["water_u"]), smooth(fields["water_v"])
    bearing = window.frame.convergence(at_lat, at_lon)[..., None]
    cos, sin = np.cos(bearing), np.sin(bearing)
    scale = window.frame.scale_factor(north[:, None], east[None, :])
    grid, plane = ("north", "east", "depth"), ("north", "east")
    return xr.Dataset(
        {
            "sound_speed": (grid, smooth(speed), _attrs("speed_of_sound_in_sea_water", "m s-1")),
            "current_north": (grid, v * cos - u * sin, _attrs("sea_water_y_velocity", "m s-1")),
            "current_east": (grid, v * sin + u * cos, _attrs("sea_water_x_velocity", "m s-1")),
            "sea_floor_depth": (
                plane,
                np.clip(flat, floor.min(), floor.max()),  # not even by rounding below the deepest level
                _attrs("sea_floor_depth_below_sea_surface", "m"),
            ),
        },
        coords={
            "north": ("north", north, _attrs("projection_y_coordinate", "m")),
            "east": ("east", east, _attrs("projection_x_coordinate", "m")),
            "depth": ("depth", depth, {**_attrs("depth", "m"), "positive": "down"}),
        },
        attrs={
            "Conventions": "CF-1.8",
            "centre_latitude_deg": window.frame.latitude_deg,
            "centre_longitude_deg": window.frame.longitude_deg,
            "proj_string": window.frame.proj_string,
            "scale_error_max": float(np.max(np.abs(scale - 1.0))),
            "time": str(np.datetime_as_string(ocean["time"].values, unit="s")),
            **{name: ocean.attrs[name] for name in ("title", "source", "synthetic")},
        },
    )


def _attrs(standard_name: str, units: str) -> dict[str, str]:
    return {"standard_name": standard_name, "units": units}


def _checked(half_extent: tuple[float, float], window: Window) -> tuple[float, float]:
    north, east = (float(h) for h in half_extent)
    if not (north > 0.0 and east > 0.0):
        raise OceanError(f"half_extent is {half_extent} m; both half sides must be positive")
    if not window.holds(north, east):
        largest = window.largest_rectangle()
        raise OceanError(
            f"domain of +-{north / 1e3:g} km north, +-{east / 1e3:g} km east about"
            f" {window.frame.latitude_deg:g} N {window.frame.longitude_deg:g} E does not fit into the data;"
            f" the largest that fits is +-{largest[0] / 1e3:.1f} km by +-{largest[1] / 1e3:.1f} km"
        )
    return north, east


def _axis(half: float, spacing: float) -> Array:
    """Nodes from -half to half with one on the centre, as near to the native spacing as that allows."""
    cells = max(_MIN_CELLS, round(half / spacing))
    return np.linspace(-half, half, 2 * cells + 1)

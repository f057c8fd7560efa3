"""Internal tide in a local ocean: the first mode over a flat bottom, which travels east."""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import xarray as xr

from pymantaray.errors import OceanError

# vertical gradient of sound speed at constant temperature and salinity [s-1]
PRESSURE_GRADIENT = 0.0163
_AMPLITUDE, _PERIOD, _WAVELENGTH = (
    f"internal_tide_{what}" for what in ("amplitude_m", "period_s", "wavelength_m")
)


def with_internal_tide(
    local: xr.Dataset, *, amplitude: float, period: float, wavelength: float
) -> xr.Dataset:
    """
    Add the parameters of an internal tide [m, s, m] to a local ocean, which is the undisturbed
    state.
    """
    if not all(value > 0.0 for value in (amplitude, period, wavelength)):
        raise OceanError(
            f"internal tide: amplitude {amplitude:g} m, period {period:g} s, wavelength"
            f" {wavelength:g} m; all must be positive"
        )
    return local.assign_attrs({_AMPLITUDE: amplitude, _PERIOD: period, _WAVELENGTH: wavelength})


def has_internal_tide(local: xr.Dataset) -> bool:
    """Return True if a local ocean has an internal tide."""
    return _AMPLITUDE in local.attrs


def displaced(
    local: xr.Dataset, time: float, columns: Mapping[str, slice] = MappingProxyType({})
) -> xr.Dataset:
    r"""
    Local ocean, or some of its columns north and east, at a time [s], displaced downward by
    :math:`A \sin(\pi z / H) \cos(k x - \omega t)`, x east.

    H is the greatest depth of the sea floor. Displaced water keeps its temperature and salinity, so
    its sound speed changes only with pressure. At a fixed depth, the change is :math:`-\zeta (dc/dz
    - \gamma)`.
    """
    bottom = float(local["sea_floor_depth"].max())
    local = local.isel(columns)
    attrs = local.attrs
    z = local["depth"].values
    x = local["east"].values
    phase = 2.0 * np.pi * (x / attrs[_WAVELENGTH] - time / attrs[_PERIOD])
    shape = np.sin(np.pi * np.clip(z / bottom, 0.0, 1.0))
    lowered = attrs[_AMPLITUDE] * np.cos(phase)[:, None] * shape
    origin = np.clip(z - lowered, z[0], z[-1])
    above = np.clip(np.searchsorted(z, origin) - 1, 0, z.size - 2)
    share = (origin - z[above]) / (z[above + 1] - z[above])
    speed = local["sound_speed"].transpose("north", "east", "depth").values
    upper, lower = (np.take_along_axis(speed, (above + k)[None], axis=2) for k in (0, 1))
    moved = upper + share * (lower - upper) + PRESSURE_GRADIENT * lowered
    return local.assign(sound_speed=(("north", "east", "depth"), moved, local["sound_speed"].attrs))

"""Water that an internal tide lifts and lowers: the first mode of a flat bottom, running east through a local ocean."""

import numpy as np
import xarray as xr

from pymantaray.errors import OceanError

PRESSURE_GRADIENT = 0.0163  # of sound speed in water of one temperature and salinity [s-1]
_AMPLITUDE, _PERIOD, _WAVELENGTH = (
    f"internal_tide_{what}" for what in ("amplitude_m", "period_s", "wavelength_m")
)


def with_internal_tide(
    local: xr.Dataset, *, amplitude: float, period: float, wavelength: float
) -> xr.Dataset:
    """Local ocean that is as it is between the wave's crests, and says which wave runs through it [m, s, m]."""
    if not all(value > 0.0 for value in (amplitude, period, wavelength)):
        raise OceanError(
            f"internal tide of {amplitude:g} m, {period:g} s and {wavelength:g} m; needs positive numbers"
        )
    return local.assign_attrs({_AMPLITUDE: amplitude, _PERIOD: period, _WAVELENGTH: wavelength})


def has_internal_tide(local: xr.Dataset) -> bool:
    """Whether an internal tide runs through it."""
    return _AMPLITUDE in local.attrs


def displaced(local: xr.Dataset, time: float) -> xr.Dataset:
    r"""
    Local ocean at a time [s]: water is lowered by :math:`A \sin(\pi z / H) \cos(k x - \omega t)`, x east.

    H is the greatest depth of the sea floor. Water takes its temperature and salinity along, so that its sound speed changes by
    the pressure alone: at a fixed depth by :math:`-\zeta (dc/dz - \gamma)`.
    """
    attrs, z, x = local.attrs, local["depth"].values, local["east"].values
    bottom = float(local["sea_floor_depth"].max())
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

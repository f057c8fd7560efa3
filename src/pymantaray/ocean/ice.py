"""Ice cover on a local ocean: its draft as one value or as a field from a file."""

from pathlib import Path

import numpy as np
import xarray as xr

from pymantaray.errors import OceanError
from pymantaray.geometry import LocalFrame
from pymantaray.geometry.grid import linear_interpolator
from pymantaray.geometry.longitude import wrap_longitude
from pymantaray.geometry.roughness import Roughness
from pymantaray.ocean.convert import is_our_unit
from pymantaray.ocean.files import file_name, open_file, text
from pymantaray.ocean.sea_floor import HorizontalField, horizontal_axes

# densities of ice and of sea water [kg/m3]; Archimedes, without snow
_DRAFT_PER_THICKNESS = 917.0 / 1026.0
_SHARE = {"sea_ice_draft": 1.0, "sea_ice_thickness": _DRAFT_PER_THICKNESS}
_ROUGHNESS = ("slope", "length", "seed", "draw")
_MAX_DRAFT = 100.0  # m; a larger value means a wrong fill value or unit


def with_ice(local: xr.Dataset, ice: float | str | Path) -> xr.Dataset:
    """
    Add an ice cover to a local ocean.

    Parameters
    ----------
    local : xarray.Dataset
        Ocean from `to_local`.
    ice : float or str or Path
        Uniform draft [m], or a NetCDF file with one variable of CF standard name ``sea_ice_draft``
        or ``sea_ice_thickness`` on latitude and longitude or a map projection. The draft is
        917/1026 of the thickness.

    Returns
    -------
    xarray.Dataset
        The ocean with ``sea_ice_draft``, a scalar or on (north, east), 0 where the file has no
        value. [m]

    Raises
    ------
    OceanError
        If the draft is negative, or the file is unreadable, has no such variable or several, or
        does not cover the ocean.

    Examples
    --------
    Continues the example of `pymantaray.ocean`:

    >>> from pymantaray.ocean import to_local, with_ice
    >>> float(with_ice(to_local(ocean), 1.5)["sea_ice_draft"])
    1.5
    """
    attrs = {"standard_name": "sea_ice_draft", "units": "m"}
    if isinstance(ice, (int, float)):
        if not 0.0 <= ice <= _MAX_DRAFT:
            raise OceanError(f"ice: the draft is {ice:g} m; it must be 0 to {_MAX_DRAFT:g} m")
        return local.assign(sea_ice_draft=((), float(ice), {**attrs, "source": "one value"}))
    frame = LocalFrame(local.attrs["centre_latitude_deg"], local.attrs["centre_longitude_deg"])
    lat, lon = frame.to_geodetic(local["north"].values[:, None], local["east"].values[None, :])
    lon = wrap_longitude(lon, about=frame.longitude_deg)
    window = (float(lat.min()), float(lat.max()), float(lon.min()), float(lon.max()))
    with open_file(ice) as data:
        field, share = _ice_of(data)
        at_lat, at_lon, values = field.on_geographic(window, None)
        source = f"{file_name(data)}: {field.name}"
    draft = share * np.nan_to_num(values, nan=0.0)
    if draft.min() < 0.0 or draft.max() > _MAX_DRAFT:
        raise OceanError(
            f"{source}: drafts are {draft.min():g} to {draft.max():g} m; allowed: 0 to"
            f" {_MAX_DRAFT:g} m; check the units"
        )
    at_lon = wrap_longitude(at_lon, about=frame.longitude_deg)
    places = np.stack([lat.ravel(), lon.ravel()], axis=-1)
    on_nodes = linear_interpolator((at_lat, at_lon), draft)(places).reshape(lat.shape)
    return local.assign(sea_ice_draft=(("north", "east"), on_nodes, {**attrs, "source": source}))


def with_roughness(local: xr.Dataset, roughness: Roughness) -> xr.Dataset:
    """
    Make the underside of the ice of a local ocean rough.

    Parameters
    ----------
    local : xarray.Dataset
        Ocean from `with_ice`.
    roughness : Roughness

    Returns
    -------
    xarray.Dataset
        The ocean with the roughness in attributes of ``sea_ice_draft``. Rays see it; vehicles do
        not.

    Examples
    --------
    Continues the example of `pymantaray.ocean`:

    >>> from pymantaray.geometry.roughness import Roughness
    >>> from pymantaray.ocean import to_local, with_ice, with_roughness
    >>> local = with_roughness(with_ice(to_local(ocean), 1.5), Roughness(slope=0.1, length=20.0))
    >>> local["sea_ice_draft"].attrs["roughness_slope"]
    0.1
    """
    attrs = {f"roughness_{name}": getattr(roughness, name) for name in _ROUGHNESS}
    return local.assign(sea_ice_draft=local["sea_ice_draft"].assign_attrs(attrs))


def roughness_of(local: xr.Dataset) -> Roughness | None:
    """Return the roughness of the ice of a local ocean; None if it is smooth."""
    attrs = local["sea_ice_draft"].attrs if "sea_ice_draft" in local else {}
    if "roughness_slope" not in attrs:
        return None
    slope, length, seed, draw = (attrs[f"roughness_{name}"] for name in _ROUGHNESS)
    return Roughness(float(slope), float(length), int(seed), int(draw))


def with_ice_draw(local: xr.Dataset, draw: int) -> xr.Dataset:
    """Return a local ocean with rough ice with another draw of it."""
    rough = roughness_of(local)
    assert rough is not None
    return with_roughness(local, rough.with_draw(draw))


def _ice_of(data: xr.Dataset) -> tuple[HorizontalField, float]:
    """Variable with the ice, and the fraction of its values that is under water."""
    named = {
        text(variable, "standard_name"): (str(name), axes)
        for name, variable in data.variables.items()
        if text(variable, "standard_name") in _SHARE
        and (axes := horizontal_axes(data, variable)) is not None
    }
    for standard_name, share in _SHARE.items():
        if standard_name in named:
            name, axes = named[standard_name]
            unit = text(data.variables[name], "units")
            if unit and not is_our_unit("length", unit):
                raise OceanError(f"{file_name(data)}: {name} is in {unit!r}; it must be in metres")
            return HorizontalField(data, name, *axes, "down"), share
    raise OceanError(
        f"{file_name(data)}: no ice; it needs a variable with CF standard name"
        f" {' or '.join(_SHARE)} at one instant on two horizontal axes"
    )

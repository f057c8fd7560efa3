"""
Water in metres: data sets on north, east and depth, from memory, a NetCDF file or an
``environment.json``.
"""

import numpy as np
import xarray as xr

from pymantaray.acoustics.medium import Interpolation
from pymantaray.config.common import utc_instant
from pymantaray.config.sections import OceanSection
from pymantaray.errors import OceanError
from pymantaray.geometry import LocalFrame
from pymantaray.ocean.metres import (
    cropped,
    file_in_metres,
    is_in_metres,
    ocean_in_metres,
    read_file_in_metres,
    with_flat_floor,
)
from pymantaray.ocean.range_section import along_axis, is_section_data, turned

_WITHOUT_MEANING = (
    "names",
    "thin",
    "smooth",
    "time_varying",
    "bathymetry_crs",
    "equation",
    "repair_freezing",
)


def section_in_metres(section: OceanSection) -> bool:
    """True if the source of a section is water in metres."""
    return len(section.source) == 1 and file_in_metres(section.source[0])


def metres_of(section: OceanSection, data: xr.Dataset | None) -> xr.Dataset | None:
    """Data set in metres of a section, or in memory; None if the water is not in metres."""
    if data is None and section_in_metres(section):
        data = read_file_in_metres(section.source[0])
    if data is not None and is_section_data(data):
        return along_axis(data, section.bearing or 0.0)
    if section.bearing is not None:
        raise OceanError(
            "`bearing` applies to a section of sound speed by range and depth; remove it"
        )
    return data if data is not None and is_in_metres(data) else None


def local_of(section: OceanSection, data: xr.Dataset, interpolation: Interpolation) -> xr.Dataset:
    """Local ocean of a section from a data set in metres, without ice."""
    name = str(data.attrs.get("title", section.source[0]))
    for key in _WITHOUT_MEANING:
        if getattr(section, key) != OceanSection.model_fields[key].default:
            raise OceanError(f"{name}: ocean.{key} does not apply to water in metres; remove it")
    if isinstance(section.bathymetry, str):
        raise OceanError(
            f"{name}: ocean.bathymetry is a file, which water in metres cannot place; give one"
            " depth in metres, or sea_floor_depth in the data set"
        )
    local = ocean_in_metres(data, name, at_rest=section.currents == "rest")
    if section.bearing is not None:
        smooth = interpolation == "smooth"
        local = turned(local, section.bearing, smooth=smooth, half_extent=section.half_extent)
    if section.bathymetry is not None:
        local = with_flat_floor(local, section.bathymetry)
    if section.half_extent is not None:
        local = cropped(local, section.half_extent)
    if section.time is not None:
        local.attrs["time"] = str(np.datetime_as_string(utc_instant(section.time), unit="s"))
    if section.centre is not None:
        centre = section.centre
        own = local.attrs.get("centre_latitude_deg"), local.attrs.get("centre_longitude_deg")
        if own not in ((None, None), centre):
            raise OceanError(
                f"{name}: its centre is {own[0]:g}, {own[1]:g} degrees, and {centre[0]:g},"
                f" {centre[1]:g} is given; remove the centre"
            )
        local.attrs |= {
            "centre_latitude_deg": centre[0],
            "centre_longitude_deg": centre[1],
            "proj_string": LocalFrame(*centre).proj_string,
        }
    if isinstance(section.ice, str) and "centre_latitude_deg" not in local.attrs:
        raise OceanError(
            f"{name}: ocean.ice is a map, which needs the centre of the frame; give it, or a draft"
        )
    return local

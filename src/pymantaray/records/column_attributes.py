"""CF attributes of a table's columns from their names, which end in units."""

from typing import TYPE_CHECKING

from pymantaray.records.glossary import meaning

if TYPE_CHECKING:
    import xarray as xr

UNIT_ENDINGS = {
    "_m_s": ("m/s", "m s-1"),
    "_m": ("m", "m"),
    "_km": ("km", "km"),
    "_s": ("s", "s"),
    "_us": ("µs", "microsecond"),
    "_h": ("h", "h"),
    "_deg": ("deg", "degree"),
    "_percent": ("%", "percent"),
}
"""Unit on pages and in CF by the ending of a column's name, longer endings first."""
_MORE_ENDINGS = {"_seconds": "s", "_ms": "millisecond", "_db": "dB"}  # that pages write in full
_PLACES = {
    "lat": {"standard_name": "latitude", "long_name": "latitude", "units": "degrees_north"},
    "lon": {"standard_name": "longitude", "long_name": "longitude", "units": "degrees_east"},
    "depth": {"standard_name": "depth", "long_name": "depth", "units": "m", "positive": "down"},
    "north": {"long_name": "north", "units": "m"},
    "east": {"long_name": "east", "units": "m"},
}


def column_attributes(name: str) -> dict[str, str]:
    """
    CF attributes of a numeric column.

    Parameters
    ----------
    name : str
        Name that ends in its unit, or the name of a coordinate.

    Returns
    -------
    dict of str to str
        ``long_name`` and ``units``; ``comment`` if the glossary has the column.
    """
    if name in _PLACES:
        return dict(_PLACES[name])
    units = _MORE_ENDINGS | {ending: unit for ending, (_, unit) in UNIT_ENDINGS.items()}
    ending = next((ending for ending in units if name.endswith(ending)), "")
    words = name.removesuffix(ending).replace("_", " ")
    attributes = {"long_name": words or name, "units": units.get(ending, "1")}
    if name.removeprefix("prior_") in _PLACES:
        attributes["units"] = "m"
    if meaning(name):
        attributes["comment"] = meaning(name)
    return attributes


def with_column_attributes(data: "xr.Dataset") -> "xr.Dataset":
    """
    Add attributes to all variables and coordinates of a data set.

    Parameters
    ----------
    data : xarray.Dataset
        Its own attributes take precedence.

    Returns
    -------
    xarray.Dataset
        Text has no units.
    """
    data = data.copy()
    for name, variable in data.variables.items():
        attributes = column_attributes(str(name))
        if variable.dtype.kind in "OUST":
            attributes = {"long_name": attributes["long_name"]}
        data[name].attrs = attributes | variable.attrs
    return data

"""
Nested results, such as a solved realization, as groups of one NetCDF file.

Each record is a group of its own, as in its own file. All other arrays are in one group, whose
attribute has the rest as JSON; numbers keep all digits.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Any

import numpy as np

from pymantaray.arrays import AnyArray
from pymantaray.errors import RecordError
from pymantaray.records.base import Record
from pymantaray.records.writing import netcdf_content, netcdf_groups

if TYPE_CHECKING:
    import xarray as xr

_VALUES = "values"
_Variable = tuple[list[str], AnyArray]  # dimensions, values


def to_groups(value: Any) -> dict[str, xr.Dataset]:
    """Groups of a value of records, data classes, named tuples, mappings, arrays and scalars."""
    import xarray as xr

    groups: dict[str, xr.Dataset] = {}
    arrays: dict[str, _Variable] = {}
    tree = _node(value, groups, arrays)
    groups[_VALUES] = xr.Dataset(arrays, attrs={"tree": json.dumps(tree)})
    return groups


def from_groups(groups: Mapping[str, xr.Dataset], *types: type) -> Any:
    """
    Value from the groups of `to_groups`, made of records, data classes, named tuples and
    enumerations of these types; raises `RecordError` if something else is in them.
    """
    known = {one.__name__: one for one in types}
    try:
        values = groups[_VALUES]
        return _value(json.loads(values.attrs["tree"]), groups, values, known)
    except (KeyError, TypeError, ValueError) as error:
        raise RecordError(f"not a result: {type(error).__name__} {error}") from None


def to_bytes(value: Any) -> bytes:
    """Content of a NetCDF file with the groups of `to_groups`."""
    return netcdf_content(to_groups(value))


def from_bytes(content: bytes, *types: type) -> Any:
    """Value from the content of `to_bytes`, as `from_groups`."""
    return from_groups(netcdf_groups(content), *types)


def _node(value: Any, groups: dict[str, xr.Dataset], arrays: dict[str, _Variable]) -> Any:
    """JSON of a value, whose records and arrays are added to those found before."""

    def nodes(items: Mapping[str, Any]) -> dict[str, Any]:
        return {name: _node(item, groups, arrays) for name, item in items.items()}

    name = type(value).__name__
    if isinstance(value, np.ndarray):
        array = f"array_{len(arrays)}"
        arrays[array] = [f"{array}_{i}" for i in range(value.ndim)], value
        return {"array": array}
    if isinstance(value, Record):
        record = f"record_{len(groups)}"
        groups[record] = value.to_dataset()
        return {"record": record, "type": name}
    if isinstance(value, IntEnum):
        return {"enum": int(value), "type": name}
    if is_dataclass(value):
        parts = {f.name: getattr(value, f.name) for f in fields(value)}
        return {"fields": nodes(parts), "type": name}
    if hasattr(value, "_asdict"):
        return {"fields": nodes(value._asdict()), "type": name}
    if isinstance(value, Mapping):
        return {"mapping": nodes(value)}
    if isinstance(value, tuple):
        return [_node(item, groups, arrays) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def _value(
    node: Any, groups: Mapping[str, xr.Dataset], values: xr.Dataset, known: Mapping[str, type]
) -> Any:
    """Value of a node."""
    if isinstance(node, list):
        return tuple(_value(item, groups, values, known) for item in node)
    if not isinstance(node, dict):
        return node
    kind, content = next(iter(node.items()))
    if kind == "array":
        return values[content].values
    if kind in ("fields", "mapping"):
        parts = {name: _value(item, groups, values, known) for name, item in content.items()}
        return parts if kind == "mapping" else known[node["type"]](**parts)
    if kind == "record":
        record: Any = known[node["type"]]
        return record.from_dataset(groups[content])
    return known[node["type"]](content)

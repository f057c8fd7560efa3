"""
Conversion of latitudes and longitudes of vehicles, landmarks and casts to north and east, before
all checks.
"""

from typing import Any

from pymantaray.geometry import LocalFrame
from pymantaray.quantities.units import quantity_of

_CENTRE = ("centre_lat", "centre_lon")


def with_local_places(tree: Any) -> Any:
    """
    Convert nested dictionaries of a study such that vehicles, waypoints, landmarks and casts are in
    the frame of its ocean.

    ``north`` and ``east`` replace ``lat`` and ``lon``; the ``points`` of such a vehicle are
    latitude, longitude and depth. Trees that are not studies are returned unchanged for later
    checks.
    """
    try:
        fleet = tree.get("fleet", {})
        keys = ("landmarks", "conditions")
        lists = {key: tree[key] for key in keys if isinstance(tree.get(key), list | tuple)}
        vehicles = fleet.get("vehicles", ())
        entries = [*vehicles, *(entry for entries in lists.values() for entry in entries)]
        if not any(
            "lat" in place or "lon" in place
            for entry in entries
            for place in (entry, _belief(entry))
        ):
            return tree
    except (AttributeError, TypeError):
        return tree
    centre = [_degrees(tree.get("ocean", {}).get(name)) for name in _CENTRE]
    if not all(isinstance(value, int | float) for value in centre):
        raise ValueError(
            "vehicles, landmarks or casts have lat and lon, which need the frame's centre: give"
            f" ocean.{_CENTRE[0]} and {_CENTRE[1]}"
        )
    frame = LocalFrame(*map(float, centre))
    placed = (
        {"fleet": {**fleet, "vehicles": [_local(vehicle, frame) for vehicle in vehicles]}}
        if vehicles
        else {}
    )
    return {**tree, **placed} | {
        key: [_local(entry, frame) for entry in entries] for key, entries in lists.items()
    }


def _belief(entry: Any) -> dict[str, Any]:
    """Belief of a condition, which may be a cast with a position; empty without a belief."""
    model = entry.get("range_model") if isinstance(entry, dict) else None
    belief = model.get("belief") if isinstance(model, dict) else None
    return belief if isinstance(belief, dict) else {}


def _local(entry: dict[str, Any], frame: LocalFrame) -> dict[str, Any]:
    if belief := _belief(entry):
        name = f"the belief of {entry.get('name', 'a condition')}"
        inner = _local({"name": name, **belief}, frame)
        inner = {key: value for key, value in inner.items() if key != "name"}
        return {**entry, "range_model": {**entry["range_model"], "belief": inner}}
    if "lat" not in entry and "lon" not in entry:
        return entry
    who = f"{entry.get('name', 'a vehicle')}"
    out = dict(entry)
    if "lat" not in entry or "lon" not in entry or "north" in entry or "east" in entry:
        keys = [key for key in ("lat", "lon", "north", "east") if key in entry]
        raise ValueError(
            f"{who}: found {', '.join(keys)}; give either lat and lon, or north and east"
        )
    out["north"], out["east"] = _north_east(who, out.pop("lat"), out.pop("lon"), frame)
    if "points" in entry:
        out["points"] = [
            [*_north_east(who, point[0], point[1], frame), point[2]]
            if isinstance(point, list | tuple) and len(point) == 3
            else point
            for point in entry["points"]
        ]
    return out


def _degrees(value: Any) -> Any:
    """Convert text with a unit to degrees; other values are returned unchanged."""
    if not isinstance(value, str):
        return value
    try:
        return quantity_of(value, "deg")
    except ValueError:
        return value


def _north_east(who: str, lat: Any, lon: Any, frame: LocalFrame) -> tuple[float, float]:
    lat = _degrees(lat)
    lon = _degrees(lon)
    if not all(isinstance(value, int | float) for value in (lat, lon)) or abs(lat) > 90.0:
        raise ValueError(
            f"{who}: found lat {lat!r}, lon {lon!r}; allowed: numbers, lat from -90 to 90 degrees"
        )
    north, east = frame.to_local(lat, lon)
    return float(north), float(east)

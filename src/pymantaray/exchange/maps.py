"""
Writers of maps for geographic information systems: GeoJSON (RFC 7946) and KML 2.2 (OGC 07-147r2).

Both have longitude, latitude and height, in this order. A height is minus the depth. Geometries
that cross the antimeridian are cut there.
"""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import groupby, pairwise
from typing import Any, Literal
from xml.etree import ElementTree as ET

import numpy as np

from pymantaray.arrays import Array
from pymantaray.messages import printable

_DECIMALS = (9, 9, 4, 6)  # 0.1 mm; degrees, degrees, metres, seconds
_HALF_TURN = 180.0
_OPACITY = {"line": "ff", "area": "80"}  # hexadecimal


@dataclass(frozen=True, eq=False)
class Feature:
    """One point, line or convex area of a map."""

    kind: Literal["Point", "LineString", "Polygon"]
    coordinates: Array
    """
    Longitude, latitude [degrees], height [m] and time [s] (n, 2 to 4); of an area, the corners, of
    which none is repeated.
    """
    properties: dict[str, Any] = field(default_factory=dict)
    """Values with ``name``; units in the names."""
    folder: str = ""
    colour: str = ""
    """As ``#rrggbb``."""
    span: tuple[str, str] | None = None
    """First and last date, as in ISO 8601."""

    @property
    def parts(self) -> list[Array]:
        """Coordinates on either side of the antimeridian; rings are closed and counterclockwise."""
        points = np.array(self.coordinates, dtype=float)
        points[:, 0] = np.unwrap(points[:, 0], period=360.0)
        return [
            np.column_stack([column.round(d) for column, d in zip(part.T, _DECIMALS, strict=False)])
            for part in (_cut_area(points) if self.kind == "Polygon" else _cut_line(points))
        ]


def geojson(features: Iterable[Feature]) -> str:
    """Collection of features as GeoJSON; NaN is null."""
    collection = {"type": "FeatureCollection", "features": [_json_feature(f) for f in features]}
    return json.dumps(collection, indent=1, allow_nan=False) + "\n"


def kml(features: Sequence[Feature], name: str) -> str:
    """Document with a folder for each run of features with the same folder."""
    root = ET.Element("kml", xmlns="http://www.opengis.net/kml/2.2")
    document = ET.SubElement(root, "Document")
    _text(document, "name", name)
    for colour in dict.fromkeys(feature.colour for feature in features if feature.colour):
        style = ET.SubElement(document, "Style", id=f"colour{colour[1:]}")
        for kind, what in (("IconStyle", "line"), ("LineStyle", "line"), ("PolyStyle", "area")):
            blue_green_red = colour[5:7] + colour[3:5] + colour[1:3]
            _text(ET.SubElement(style, kind), "color", _OPACITY[what] + blue_green_red)
    for title, members in groupby(features, key=lambda feature: feature.folder):
        folder = ET.SubElement(document, "Folder")
        _text(folder, "name", title)
        for feature in members:
            _placemark(folder, feature)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _json_feature(feature: Feature) -> dict[str, Any]:
    parts = feature.parts
    properties = {name: _json_value(value) for name, value in feature.properties.items()}
    if feature.colour:
        key = "marker-color" if feature.kind == "Point" else "stroke"
        properties[key] = feature.colour
        if feature.kind == "Polygon":
            properties["fill"] = feature.colour
    times = [part[:, 3].tolist() for part in parts if part.shape[1] > 3]
    if times and feature.kind == "LineString":
        properties["time_s"] = times[0] if len(times) == 1 else times
    places = [part[:, :3].tolist() for part in parts]
    if feature.kind == "Point":
        kind, coordinates = "Point", places[0][0]
    else:
        shapes: list[Any] = [[place] for place in places] if feature.kind == "Polygon" else places
        kind = feature.kind if len(shapes) == 1 else f"Multi{feature.kind}"
        coordinates = shapes[0] if len(shapes) == 1 else shapes
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _json_value(value: Any) -> Any:
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _placemark(folder: ET.Element, feature: Feature) -> None:
    """Add a placemark, with its elements in the order of the schema."""
    mark = ET.SubElement(folder, "Placemark")
    _text(mark, "name", str(feature.properties.get("name", "")))
    if feature.span is not None:
        span = ET.SubElement(mark, "TimeSpan")
        for key, date in zip(("begin", "end"), feature.span, strict=True):
            _text(span, key, date)
    if feature.colour:
        _text(mark, "styleUrl", f"#colour{feature.colour[1:]}")
    data = ET.SubElement(mark, "ExtendedData")
    for name, value in feature.properties.items():
        if name != "name" and _json_value(value) is not None:
            item = ET.SubElement(data, "Data", name=printable(name))
            _text(item, "value", str(_json_value(value)))
    parts = feature.parts
    parent = mark if len(parts) == 1 else ET.SubElement(mark, "MultiGeometry")
    for part in parts:
        shape = ET.SubElement(parent, feature.kind)
        part = part[:1] if feature.kind == "Point" else part
        with_height = part.shape[1] > 2
        _text(shape, "altitudeMode", "absolute" if with_height else "clampToGround")
        if feature.kind == "Polygon":
            shape = ET.SubElement(ET.SubElement(shape, "outerBoundaryIs"), "LinearRing")
        rows = part[:, :3].tolist()
        _text(shape, "coordinates", " ".join(",".join(map(repr, row)) for row in rows))


def _text(parent: ET.Element, tag: str, text: str) -> None:
    ET.SubElement(parent, tag).text = printable(text)


def _cut_line(points: Array) -> list[Array]:
    """Parts of a line between antimeridians, with the crossings as ends of both parts."""
    turn = np.floor((points[:, 0] + _HALF_TURN) / 360.0)
    if (turn == turn[0]).all():
        return [points - [360.0 * turn[0], *np.zeros(points.shape[1] - 1)]]
    rows = [points[:1]]
    for before, after in pairwise(points):
        low, high = sorted((before[0], after[0]))
        first, last = (np.floor((lon + _HALF_TURN) / 360.0) for lon in (low, high))
        at = 360.0 * np.arange(first + 1.0, last + 1.0) - _HALF_TURN
        share = (at[(at > low) & (at < high)] - before[0]) / (after[0] - before[0] or 1.0)
        rows += [before + np.sort(share)[:, None] * (after - before), after[None]]
    line = np.concatenate(rows)
    middle = np.floor((0.5 * (line[1:, 0] + line[:-1, 0]) + _HALF_TURN) / 360.0)
    parts = []
    for start, stop in _runs(middle):
        part = line[start : stop + 1].copy()
        part[:, 0] -= 360.0 * middle[start]
        parts.append(part)
    return parts


def _runs(values: Array) -> list[tuple[int, int]]:
    """Starts and ends of runs of equal values."""
    edges = np.flatnonzero(np.diff(values)) + 1
    return list(zip([0, *edges.tolist()], [*edges.tolist(), len(values)], strict=True))


def _cut_area(corners: Array) -> list[Array]:
    """Closed, counterclockwise parts of a convex area between antimeridians."""
    x, y = corners[:, 0], corners[:, 1]
    if np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) < 0.0:
        corners = corners[::-1]
    turns = np.floor((np.array([x.min(), x.max()]) + _HALF_TURN) / 360.0)
    parts = []
    for turn in np.arange(turns[0], turns[1] + 1.0):
        west = 360.0 * turn - _HALF_TURN
        part = _clipped(_clipped(corners, west, 1.0), west + 360.0, -1.0)
        if len(part) > 2 and np.ptp(part[:, 0]) > 0.0:
            part[:, 0] -= 360.0 * turn
            parts.append(np.concatenate([part, part[:1]]))
    return parts


def _clipped(corners: Array, meridian: float, side: float) -> Array:
    """Corners of the part of an area east (side 1) or west (side -1) of a meridian."""
    out = [corners[:0]]
    for before, after in zip(np.roll(corners, 1, axis=0), corners, strict=True):
        inside = side * (after[0] - meridian) >= 0.0
        if inside != (side * (before[0] - meridian) >= 0.0):
            share = (meridian - before[0]) / (after[0] - before[0])
            crossing = before + share * (after - before)
            crossing[0] = meridian
            out.append(crossing[None])
        if inside:
            out.append(after[None])
    return np.concatenate(out)

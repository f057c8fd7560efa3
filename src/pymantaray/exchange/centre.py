"""
Centre of the local frame of exported positions, so that a reader can restore their geographic
position.

Text files with comments contain it in comment lines, such as ``# centre_latitude_deg = 74.5``. For
all other formats, a file ``frame.json`` in the same folder contains it.
"""

import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from pymantaray.errors import ExchangeError
from pymantaray.records import whole_file
from pymantaray.user_files import exists, read_text

Centre = tuple[float, float]
"""Latitude and longitude. [degrees]"""
SIDECAR = "frame.json"
NED = "north, east, down [m]"
ENU = "east, north, up [m]"
_KEYS = ("centre_latitude_deg", "centre_longitude_deg")
_COMMENT = re.compile(rf"^\s*#\s*({'|'.join(_KEYS)})\s*[=:]\s*(\S+)\s*$")


def centre_attributes(centre: Centre | None) -> dict[str, float]:
    """Latitude and longitude of a centre by key; empty for None."""
    return {} if centre is None else dict(zip(_KEYS, map(float, centre), strict=True))


def centre_of_names(named: Mapping[Any, Any], path: Path) -> Centre | None:
    """Centre from keys of a file, or None if there are none; both must be valid numbers."""
    if not named.keys() & set(_KEYS):
        return None
    try:
        lat, lon = (float(str(named[key])) for key in _KEYS)
    except (KeyError, ValueError):
        lat = lon = float("nan")
    if not (-90.0 <= lat <= 90.0 and -180.0 <= lon <= 360.0):
        values = ", ".join(f"{key} {named[key]!r}" for key in _KEYS if key in named)
        raise ExchangeError(
            f"{path}: the centre is {values}; {_KEYS[0]} must be -90 to 90 and {_KEYS[1]} -180 to"
            " 360 degrees"
        )
    return lat, lon


def centre_comments(centre: Centre | None) -> list[str]:
    """Comment lines with a centre, without ``#``; empty for None."""
    return [f"{key} = {value!r}" for key, value in centre_attributes(centre).items()]


def centre_in_comments(lines: Iterable[str], path: Path) -> Centre | None:
    """Centre from comment lines, or None."""
    matches = (_COMMENT.match(line) for line in lines)
    return centre_of_names({match[1]: match[2] for match in matches if match}, path)


def write_sidecar(folder: Path, centre: Centre | None, axes: str = NED) -> None:
    """Write ``frame.json`` into a folder of exported files; do nothing without a centre."""
    if centre is None:
        return
    tree = {"axes": axes, **centre_attributes(centre)}
    with whole_file(folder / SIDECAR) as file:
        file.write_text(json.dumps(tree, indent=2) + "\n", encoding="utf-8")


def centre_beside(path: Path) -> Centre | None:
    """Centre from ``frame.json`` in the folder of a file, or None without this file."""
    sidecar = path.parent / SIDECAR
    if not exists(sidecar):
        return None
    try:
        tree = json.loads(read_text(sidecar, ExchangeError))
    except (ValueError, RecursionError) as error:
        raise ExchangeError(
            f"{sidecar}: cannot be read ({' '.join(str(error).split())[:80]}); correct or remove it"
        ) from None
    # other content: not from this package
    return centre_of_names(tree, sidecar) if isinstance(tree, dict) else None

"""
Positions in the text of headers and comments: hemispheres on either side of the number, and values
that mean no fix.
"""

import math
import re

from pymantaray.records.position_rows import Position, is_no_fix, is_position

__all__ = ["Position", "is_position"]

_SIDES = {"n": 1.0, "s": -1.0, "e": 1.0, "w": -1.0}
_SIDES_OF = {"latitude": "ns", "longitude": "ew"}
_WORDS = {
    **dict.fromkeys(("n", "north", "nord", "norte"), "n"),
    **dict.fromkeys(("s", "south", "sud", "süd", "sur", "sul"), "s"),
    **dict.fromkeys(("e", "east", "est", "este", "leste", "ost"), "e"),
    **dict.fromkeys(("w", "west", "ouest", "oeste"), "w"),
}
"""Hemispheres in the languages of instruments; the letter O alone is east or west."""
_ANY_WORD = "|".join(sorted(_WORDS, key=len, reverse=True))
_SIDE = rf"(?<![^\W\d_])(?:{_ANY_WORD})(?![^\W\d_])"
_MARK = {"degrees": r"(?:degrees?|deg\.?|[d°º*:-])", "minutes": r"(?:minutes?|min\.?|[m'′’:])"}
_BEHIND = {unit: rf"(?:\s*{mark}\s*|\s+)" for unit, mark in _MARK.items()}
_ANGLE = re.compile(
    rf"(?P<before>{_ANY_WORD})?\.?\s*(?P<sign>[-+])?\s*"
    r"(?P<degrees>\d+(?:\.\d*)?|\.\d+)"
    rf"(?:{_BEHIND['degrees']}(?P<minutes>\d+(?:\.\d*)?)"
    rf"(?:{_BEHIND['minutes']}(?P<seconds>\d+(?:\.\d*)?)(?:\s*(?:seconds?|sec\.?|[\"″”]|''|s(?=\s*[nsew])))?"
    rf"|\s*{_MARK['minutes']})?|\s*{_MARK['degrees']})?"
    rf"[\s(\[]*(?P<after>{_SIDE})?(?![\d.])(?P<rest>.*)",
    re.IGNORECASE,
)
_KEY = r"\b{}\b\s*[:=]?(?=\s*(?:" + _ANY_WORD + r")?\s*[-+]?[.\d])"
_LAT, _LON = (
    re.compile(_KEY.format(name), re.IGNORECASE) for name in ("lat(?:itude)?", "lon(?:gitude)?")
)


def angle(words: str, axis: str) -> float:
    """
    Convert a latitude or longitude in text to degrees; NaN if it cannot be read with certainty.

    The text may have decimal degrees, or degrees, minutes and seconds, with a sign or a hemisphere
    before or after the number, and a comment behind: ``-12.51``, ``S12 30.60``, ``12°30'36" S``,
    ``045 15.5 W (bridge)``.
    """
    match = _ANGLE.fullmatch(words.strip())
    if match is None:
        return math.nan
    sides = {_WORDS[side.lower()] for side in (match["before"], match["after"]) if side}
    rest = match["rest"]
    minutes = match["minutes"]
    # what follows is a comment
    complete = match["after"] and "." in match["degrees"] + str(minutes)
    unclear = (
        len(sides) > 1
        or not sides <= set(_SIDES_OF[axis])
        or (not sides and re.search(_SIDE, rest, re.IGNORECASE))
        or ("." in match["degrees"] and minutes is not None)
        or ("." in str(minutes) and match["seconds"] is not None)
        or (not complete and re.match(r"[,.]?\s*[-+]?\d|\s*[a-z](?![a-z])", rest, re.IGNORECASE))
    )
    parts = [float(part or 0.0) for part in (match["degrees"], minutes, match["seconds"])]
    if unclear or max(parts[1:]) >= 60.0:
        return math.nan
    size = parts[0] + parts[1] / 60.0 + parts[2] / 3600.0
    side = _SIDES[sides.pop()] if sides else 0.0
    if match["sign"] and side and (side > 0.0) == (match["sign"] == "-"):
        return math.nan
    return -size if side < 0.0 or match["sign"] == "-" else size


def position_in_text(latitude: str, longitude: str) -> tuple[Position | None, tuple[str, ...]]:
    """
    Position from two texts of a header, and notes: None if a text is empty or unreadable, or if the
    values mean no fix.
    """
    if not (latitude.strip() or longitude.strip()):
        return None, ()
    place = angle(latitude, "latitude"), angle(longitude, "longitude")
    if math.isnan(sum(place)):
        unread = [
            f"{axis} {words.strip()[:40]!r}"
            for axis, words, value in zip(_SIDES_OF, (latitude, longitude), place, strict=True)
            if math.isnan(value)
        ]
        return None, (f"position not read: {' and '.join(unread)}",)
    assumed = [
        f"{axis} {words.strip()[:40]!r} has no hemisphere: {positive} assumed"
        for axis, words, positive in (
            ("latitude", latitude, "north"),
            ("longitude", longitude, "east"),
        )
        if re.match(r"\d+[^\d.]+\d", words.strip()) and not re.search(_SIDE, words, re.IGNORECASE)
    ]
    known, notes = known_position(*place)
    return known, notes or tuple(assumed)


def known_position(latitude: float, longitude: float) -> tuple[Position | None, tuple[str, ...]]:
    """
    Position of an instrument and notes: None for 0, 0 and for values outside the globe, which mean
    no fix.
    """
    if not (math.isfinite(latitude) and math.isfinite(longitude)):
        return None, ()
    if is_no_fix(latitude, longitude):
        return None, (unused_position(latitude, longitude),)
    return (latitude, longitude), ()


def unused_position(latitude: float, longitude: float) -> str:
    """Note about a position that a reader does not use."""
    return f"position {latitude:g}, {longitude:g} not used: no fix, or not a place"


def position_in_comment(line: str) -> Position | None:
    """
    Position in a comment such as ``lat 74.0, lon -140.0``; None if it has none that can be read.
    """
    north = _LAT.search(line)
    east = _LON.search(line)
    if north is None or east is None:
        return None
    ends = {north: len(line), east: len(line)}
    first, second = sorted((north, east), key=lambda match: match.start())
    ends[first] = second.start()
    words = (
        re.split(r"[,;](?!\d)|\d{4}-\d\d", line[match.end() : ends[match]])[0]
        for match in (north, east)
    )
    lat, lon = (angle(text, axis) for text, axis in zip(words, _SIDES_OF, strict=True))
    return None if math.isnan(lat + lon) else (lat, lon)

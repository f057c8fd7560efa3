"""
Rows of casts: the one rule by which all readers select rows, with limits, fill values and rows in
air.
"""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from pymantaray.arrays import Array, Indices, Mask
from pymantaray.errors import OceanError
from pymantaray.ocean.convert import DEEPEST, parse_instant
from pymantaray.ocean.schema import VARIABLES

_SPAN = {v.name: (v.lowest, v.highest) for v in VARIABLES}
LIMITS = {
    "temperature": _SPAN["water_temp"],
    "salinity": _SPAN["salinity"],
    "sound_speed": (1300.0, 1800.0),
}
"""Possible values in all seas and lakes. [degC], practical, [m/s]"""
_UNITS = {"temperature": " degC", "salinity": "", "sound_speed": " m/s"}
_REMEDIES = {
    "temperature": "name the unit, as in temperature_degF or temperature_K, or correct the column",
    "salinity": "practical salinity is needed; name another kind, as in absolute_salinity",
    "sound_speed": "name the unit, as in sound_speed_km/s or sound_speed_ft/s",
}
_NINES = [9.99, 9.999, 99.0, 99.9, 99.99, 99.999]
_MANY_NINES = [999.0, 999.9, 999.99, 999.999, 9999.0, 9999.9, 9999.99, 99999.0, 999999.0]
_FILLS = [*_MANY_NINES, *(-x for x in (*_NINES, *_MANY_NINES)), -32768.0, -32767.0]
_BAD_FLAG = -9.99e-29  # of Sea-Bird
_BEYOND_ALL = 1e9  # larger than any value in any unit, also a pressure in pascals
_POSSIBLE = {
    **LIMITS,
    **dict.fromkeys(("potential_temperature", "conservative_temperature"), LIMITS["temperature"]),
    "absolute_salinity": LIMITS["salinity"],
    "measured_conductivity": (0.0, 98.0),
    # a smaller positive depth of nines may be a level
    **dict.fromkeys(("depth", "pressure"), (0.0, 9998.0)),
}
_FASTEST_IN_AIR = 400.0  # m/s; instruments in air give 0 or about 340 m/s
_WARMEST_MEDIAN = 36.0  # degC; no sea is warmer
_WARM_BELOW, _WARMEST_BELOW = 300.0, 25.0  # m, degC; the Red Sea has 22 degC there
_SALTY = 5.0
_IN_AIR = 0.1  # practical salinity of a cell without water
_FRESH, _AT_SURFACE = 2.0, 0.5  # practical salinity, m; several such rows are on deck
_KG_PER_KG = (0.02, 0.045)
_SPIKE = 3.0  # times the largest other step between rows
# between rows of one cast at most; a cast to the deepest bed takes about 5 hours
_LONGEST, _FARTHEST = np.timedelta64(12, "h"), 0.05  # degrees


class LevelsError(OceanError):
    """A cast has less than two usable levels."""


def without_fills(raw: Array, values: Array, quantity: str) -> Array:
    """
    Values in our unit, NaN where the number in the file is not finite or is a usual fill value.

    A number of nines is a fill value only if it is no possible value of the quantity.
    """
    low, high = _POSSIBLE.get(quantity, (-np.inf, np.inf))
    with np.errstate(invalid="ignore"):
        missing = np.isin(raw, _FILLS) & ((values < low) | (values > high))
        missing |= ~(np.abs(raw) < _BEYOND_ALL) | (raw == _BAD_FLAG)
    return np.where(missing, np.nan, values)


def usable_rows(
    depth: Array,
    quantities: Mapping[str, Array],
    *,
    beside: Mapping[str, Array] | None = None,
    titles: Mapping[str, tuple[str, str]] | None = None,
    notes: Sequence[str] = (),
    where: str,
) -> tuple[Indices, list[str], int]:
    """
    Select the rows of a raw cast that are complete, possible, in water and deeper than all rows
    before.

    ``quantities`` are columns by name in `LIMITS`, ``beside`` further ones that are not needed in
    each row, and ``titles`` their names and stated units in the file. Returns the rows, the notes
    with one more line for each reason of dropped rows, and the number of dropped rows. A column
    that is impossible in half of the rows raises an error.
    """
    notes = list(notes)
    counts: dict[str, int] = {}
    water = {**(beside or {}), **quantities}
    whole = np.isfinite(depth)
    for values in quantities.values():
        whole &= np.isfinite(values)
    whole &= ~_zeros(water)
    counts["with a missing value"] = int(np.count_nonzero(~whole))
    # an axis that is positive up, by its extremes: a logger is on deck for many rows
    low, high = (float(end(depth[whole], initial=0.0)) for end in (np.min, np.max))
    if -low > high:
        raise OceanError(
            f"{where}: depth is {low:g} to {depth[whole].max():g} m; it must be positive down;"
            " change its sign"
        )
    wet = whole & (depth >= 0.0)
    counts["above the surface"] = int(np.count_nonzero(whole & ~wet))
    air = wet & _in_air(depth, water)
    counts["in air or on deck, by salinity or sound speed"] = int(np.count_nonzero(air))
    wet &= ~air
    possible = wet & (depth <= DEEPEST)
    if 2 * int(np.count_nonzero(wet & ~possible)) >= max(int(np.count_nonzero(wet)), 1):
        raise OceanError(
            f"{where}: depth is up to {depth[wet].max():g} m; allowed: at most {DEEPEST:g} m; check"
            " its unit"
        )
    for quantity, values in quantities.items():
        title = (titles or {}).get(quantity, (quantity, "stated"))
        _check_most(depth[wet], values[wet], quantity, title, where)
        possible &= _inside(values, quantity)
    counts["with an impossible value"] = int(np.count_nonzero(wet & ~possible))
    rows = np.flatnonzero(possible)
    spikes = _spikes(depth[rows])
    counts["with a depth far beyond the rows before and after"] = int(np.count_nonzero(spikes))
    rows = rows[~spikes]
    steps = np.diff(depth[rows])
    # false for a downcast with an upcast
    early = rows.size > 0 and 3 * int(np.argmax(depth[rows])) < rows.size
    if early and np.count_nonzero(steps < 0.0) > np.count_nonzero(steps >= 0.0):
        rows = rows[::-1]
        notes.append("rows reversed: the file lists them upward")
    deepest = np.maximum.accumulate(np.concatenate([[-1.0], depth[rows]]))[:-1]
    deeper = rows[depth[rows] > deepest]
    counts["not deeper than an earlier row"] = int(rows.size - deeper.size)
    notes += [
        f"{count} of {depth.size} rows dropped: {why}" for why, count in counts.items() if count
    ]
    if deeper.size < 2:
        reasons = f" ({'; '.join(notes)})" if notes else ""
        raise LevelsError(f"{where}: {deeper.size} usable levels; a cast needs at least 2{reasons}")
    notes += _unit_doubts({name: values[deeper] for name, values in quantities.items()})
    return deeper, notes, sum(counts.values())


def visits(names: Sequence[str], times: Sequence[str], places: Array, *, exact: bool) -> list[str]:
    """
    Name of the cast of each row: that of its station, with the time of the cast if the station has
    several, and its place if several have the same time.

    ``places`` are latitudes and longitudes (n, 2), NaN if unknown [degrees]. A cast ends where time
    or place change by more than one cast can take or, if ``exact``, at all.
    """
    instants = {time: _instant_or_nat(time) for time in dict.fromkeys(times)}
    rows = pd.DataFrame({"lat": places[:, 0], "lon": places[:, 1]})
    rows["instant"] = [instants[time] for time in times]
    station = np.array(names, dtype=object)
    steps = rows.groupby(station).ffill().groupby(station).diff()
    steps["lon"] = (steps["lon"] + 180.0) % 360.0 - 180.0
    longest, farthest = (np.timedelta64(0), 0.0) if exact else (_LONGEST, _FARTHEST)
    ends = (steps["instant"].abs() > longest) | (steps[["lat", "lon"]].abs() > farthest).any(axis=1)
    if not ends.any():
        return list(names)
    casts = list(zip(names, ends.groupby(station).cumsum(), strict=True))
    labels = zip(times, places.tolist(), strict=True)
    first = dict(reversed(list(zip(casts, labels, strict=True))))  # of each cast
    visited = Counter(name for name, _ in first)
    together = Counter((name, time) for (name, _), (time, _) in first.items())
    full = {}
    for (name, visit), (time, place) in first.items():
        beside = "" if time and together[name, time] == 1 else "{:g} {:g}".format(*place)
        words = (name, time, beside) if visited[name] > 1 else (name,)
        full[name, visit] = " ".join(filter(None, words))
    return [full[cast] for cast in casts]


def _instant_or_nat(time: str) -> np.datetime64:
    """Instant of a cell, NaT if it is empty or has another layout."""
    try:
        return parse_instant(time)
    except OceanError:
        return np.datetime64("NaT", "ns")


def water_beside(columns: Mapping[str, Array]) -> tuple[tuple[Array, Array] | None, list[str]]:
    """
    Temperature and salinity beside a sound speed, None unless both are complete and possible, and
    a note about impossible ones.
    """
    notes = [
        f"{quantity} is {np.nanmin(values):g} to {np.nanmax(values):g}, which is impossible; not"
        " used beside the sound speed"
        for quantity, values in columns.items()
        if not _inside(values[np.isfinite(values)], quantity).all()
    ]
    complete = len(columns) == 2 and all(np.isfinite(v).all() for v in columns.values())
    if notes or not complete:
        return None, notes
    return (columns["temperature"], columns["salinity"]), notes


def _inside(values: Array, quantity: str) -> Mask:
    low, high = LIMITS[quantity]
    return np.asarray((values >= low) & (values <= high))


def _zeros(water: Mapping[str, Array]) -> Mask | np.bool_:
    """Rows whose temperature and salinity are both exactly 0, which means that they are missing."""
    if not {"temperature", "salinity"} <= water.keys():
        return np.bool_(False)
    return np.asarray((water["temperature"] == 0.0) & (water["salinity"] == 0.0))


def _in_air(depth: Array, water: Mapping[str, Array]) -> Mask:
    """
    Rows whose sound speed is that of air or 0, and rows of a cast in salty water whose salinity is
    that of an empty cell, or is fresh in several rows at the surface.
    """
    air = np.zeros(depth.shape, dtype=bool)
    with np.errstate(invalid="ignore"):
        if "sound_speed" in water:
            speed = water["sound_speed"]
            air |= (speed == 0.0) | ((speed > 200.0) & (speed < _FASTEST_IN_AIR))
        if "salinity" in water:
            salinity = water["salinity"]
            low = np.isfinite(salinity) & np.isfinite(depth)
            low &= depth >= 0.5 * float(np.max(depth, where=low, initial=0.0))
            if low.any() and np.median(salinity[low]) > _SALTY:
                deck = (salinity < _FRESH) & (depth < _AT_SURFACE)
                air |= (salinity >= 0.0) & (salinity < _IN_AIR)
                if np.count_nonzero(deck) > 1:
                    air |= deck
    return air


def _check_most(
    depth: Array, values: Array, quantity: str, title: tuple[str, str], where: str
) -> None:
    """
    Refuse a column if half of its values are impossible, or if temperatures without a unit are
    those of no sea although some of them are possible.
    """
    name, unit = title
    outside = ~_inside(values, quantity)
    wrong = values.size > 0 and 2 * int(np.count_nonzero(outside)) >= values.size
    warm = ""
    if quantity == "temperature" and values.size and not unit:
        deep = values[depth > _WARM_BELOW]
        if np.median(values) > _WARMEST_MEDIAN or (deep.size and np.median(deep) > _WARMEST_BELOW):
            wrong = True
            warm = f", in most rows to {_WARMEST_MEDIAN:g}, below {_WARM_BELOW:g} m to"
            warm += f" {_WARMEST_BELOW:g}"
    if wrong:
        low, high = LIMITS[quantity]
        raise OceanError(
            f"{where}: {name} is {values.min():g} to {values.max():g}; allowed:"
            f" {low:g} to {high:g}{_UNITS[quantity]}{warm}; {_REMEDIES[quantity]}"
        )


def _spikes(depth: Array) -> Mask:
    """Single rows whose depth is far beyond that of both neighbours, or of the last row before."""
    spikes = np.zeros(depth.shape, dtype=bool)
    if depth.size < 4:
        return spikes
    steps = np.abs(np.diff(depth))
    worst = int(np.argmax(depth))
    others = np.delete(steps, [k for k in (worst - 1, worst) if 0 <= k < steps.size])
    beside = [depth[k] for k in (worst - 1, worst + 1) if 0 <= k < depth.size]
    inner = len(beside) == 2
    spikes[worst] = inner and depth[worst] - max(beside) > _SPIKE * others.max(initial=0.0)
    return spikes


def _unit_doubts(water: Mapping[str, Array]) -> list[str]:
    """Note about a salinity that may be in kg/kg."""
    salinity = water.get("salinity", np.zeros(1))
    low, high = _KG_PER_KG
    if not (low <= salinity.min() and salinity.max() <= high):
        return []
    note = (
        f"salinity is {salinity.min():g} to {salinity.max():g}: read as fresh water; if it is in"
        " kg/kg, write absolute_salinity_kg/kg"
    )
    return [note]

"""
Conversion of data sets to the ocean schema: units, instants, levels and TEOS-10 kinds of
temperature and salinity.
"""

import math
import re
import warnings
from collections.abc import Sequence

import gsw
import numpy as np
import pandas as pd
import xarray as xr

from pymantaray.arrays import Array, Instants
from pymantaray.errors import OceanError
from pymantaray.messages import one_line
from pymantaray.ocean.files import file_name, numbers, text

IN_SITU = "in situ"
POTENTIAL = "potential"
CONSERVATIVE = "conservative"
PRACTICAL = "practical"
ABSOLUTE = "absolute"
PREFORMED = "preformed"
REFERENCE = "reference"
HYCOM_NAMES = ("water_temp", "salinity", "water_u", "water_v")
"""Names of in-situ temperature, practical salinity, and eastward and northward currents."""
# HYCOM's fill value if a server scaled it like data: -30000 x 0.001, plus 20 for tracers
_SCALED_FILL = dict(zip(HYCOM_NAMES, (-10.0, -10.0, -30.0, -30.0), strict=True))
DEEPEST = 12_000.0
"""Upper limit of ocean depth. [m]"""
_AT_SURFACE = 1e-3  # m; a first level this close to 0 m counts as the surface
_DEEPEST_FIRST_LEVEL = 30.0  # m; values of a deeper first level are not extended to the surface
_MIN_MAX_SALINITY = 0.06  # a lower maximum means kg/kg with a wrong unit
_CALENDARS = ("", "standard", "gregorian", "proleptic_gregorian", "none")
_MAX_MONTHS = 12_000.0
_MAX_YEARS = 250  # from an origin after 1900: the years that 64-bit nanoseconds can represent
_FIRST_YEAR, _LAST_YEAR = 1678, 2261
_UTC = ("z", "t", "utc", "gmt")
_TIME_TOLERANCE = np.timedelta64(1, "m")  # between the requested and an available instant

_METRES = "m meter meters metre metres"
_RADIANS = {180.0 / math.pi: "radians radian rad"}
_THOUSANDTHS = "1e-3 0.001 10^-3 10-3 ppt ‰ g/kg gkg-1 gkg^-1"
# by quantity: the unit of this package; then factor and spellings of each unit, without case,
# spaces and underscores (MPa and mPa are therefore equal)
_UNITS: dict[str, tuple[str, dict[float, str]]] = {
    "temperature": (
        "degC",
        {
            1.0: "degc celsius degreec degreesc degreecelsius degreescelsius degcelsius c °c ºc"
            " its90 its-90"
        },
    ),
    "practical salinity": (
        "1",
        {
            1.0: "1 psu pss-78 pss78 pss practical parts/1000 dimensionless unitless none"
            f" {_THOUSANDTHS} practicalsalinityunit practicalsalinityunits"
        },
    ),
    "mass salinity": ("g kg-1", {1.0: _THOUSANDTHS, 1000.0: "kg/kg kgkg-1 kgkg^-1"}),
    "velocity": (
        "m s-1",
        {
            1.0: "m/s ms-1 ms^-1 m.s-1 m*s-1 m/sec ms**-1 meterspersecond metrespersecond "
            + " ".join(
                f"{m}/{s} {m}second-1" for m in _METRES.split() for s in ("s", "second", "seconds")
            ),
            0.01: "cm/s cms-1 cms^-1 cm.s-1 centimeter/s centimetre/s cm/sec",
            0.001: "mm/s mms-1 mms^-1",
            1000.0 / 3600.0: "km/h kmh-1 kmhour-1 km/hour",
            0.3048: "ft/s fts-1 ft/sec feet/s",
            1000.0: "km/s kms-1",
        },
    ),
    "conductivity": (
        "mS cm-1",
        {
            1.0: "ms/cm mscm-1",
            10.0: "s/m sm-1",
            1e-3: "us/cm µs/cm uscm-1 microsiemenspercentimeter",
        },
    ),
    "length": (
        "m",
        {
            1.0: _METRES,
            1000.0: "km kilometer kilometre kilometers kilometres",
            0.01: "cm centimeter centimetre centimeters centimetres",
            0.3048: "ft feet foot",
        },
    ),
    "pressure": (
        "dbar",
        {
            1.0: "dbar db decibar decibars dbars decibar=10000pascals",
            10.0: "bar bars",
            1e-4: "pa pascal pascals",
            1e-2: "hpa mbar millibar",
            0.1: "kpa",
            100.0: "mpa",
            0.6894757293168: "psi psia",
        },
    ),
    "latitude": (
        "degrees_north",
        {1.0: "degreesnorth degreenorth degreesn degreen degrees degree degn deg", **_RADIANS},
    ),
    "longitude": (
        "degrees_east",
        {1.0: "degreeseast degreeeast degreese degreee degrees degree dege deg", **_RADIANS},
    ),
}
_FACTORS = {
    quantity: {word: factor for factor, words in units.items() for word in words.split()}
    for quantity, (_, units) in _UNITS.items()
}
_FAHRENHEIT = [
    "f",
    "degf",
    "°f",
    "ºf",
    "fahrenheit",
    "degreef",
    "degreesf",
    "degreefahrenheit",
    "degreesfahrenheit",
]
_KELVIN = ["k", "kelvin", "kelvins", "degk", "degreek", "degreesk", "degreekelvin", "degreeskelvin"]


def is_unit_of(quantity: str, unit: str) -> bool:
    """Return True if a unit is a known unit of a quantity, with any factor."""
    word = _plain(unit)
    return word in _FACTORS[quantity] or (
        quantity == "temperature" and word in (*_KELVIN, *_FAHRENHEIT)
    )


def vertical_of(unit: str, otherwise: str) -> str:
    """Depth or pressure by the unit of a vertical axis; without such a unit, as its name says."""
    for quantity, kind in (("depth", "length"), ("pressure", "pressure")):
        if is_unit_of(kind, unit):
            return quantity
    return otherwise


def is_our_unit(quantity: str, unit: str) -> bool:
    """Return True if values in a unit need no conversion."""
    return _FACTORS[quantity].get(_plain(unit)) == 1.0


def our_unit(quantity: str) -> str:
    """Unit of a quantity in this package, in CF notation."""
    return _UNITS[quantity][0]


def to_our_unit(values: Array, quantity: str, unit: str, *, where: str) -> Array:
    """
    Convert values to degC, practical salinity or g/kg, m/s, m, dbar or degrees; the same array if
    no change is needed.
    """
    if not unit:
        raise OceanError(
            f"{where} has no units; set its attribute units according to CF, or give `names` with"
            " standard name and unit, as in temp=sea_water_temperature[degC]"
        )
    if not is_unit_of(quantity, unit):
        raise OceanError(
            f"{where} has units {unit[:40]!r}, which is not a unit of {quantity}; write"
            f" {our_unit(quantity)}"
        )
    if quantity == "temperature" and _plain(unit) in _KELVIN:
        return values - 273.15
    if quantity == "temperature" and _plain(unit) in _FAHRENHEIT:
        return (values - 32.0) / 1.8
    factor = _FACTORS[quantity][_plain(unit)]
    return values if factor == 1.0 else values * factor


def _plain(unit: str) -> str:
    return re.sub(r"[\s_]+", "", unit.strip().lower())


def without_scaled_fill(name: str, values: Array) -> Array:
    """Mask HYCOM's fill value if a server scaled it like data; other variables are unchanged."""
    if name not in _SCALED_FILL:
        return values
    return np.where(np.abs(values - _SCALED_FILL[name]) < 1e-3, np.nan, values)


def parse_instant(time: str | np.datetime64) -> np.datetime64:
    """Instant in UTC from text or numpy.datetime64; text without a zone is UTC."""
    try:  # pandas also reads "now", and numbers as nanoseconds
        is_date = not isinstance(time, str) or (
            time.isprintable() and re.match(r"\s*-?\d{4}", time)
        )
        stamp = pd.Timestamp(time) if is_date else pd.NaT
    except (TypeError, ValueError):
        stamp = pd.Timestamp("NaT")
    if pd.isna(stamp):
        raise OceanError(f"time {time!r} is not an instant; write it as 2014-07-15T12:00 (UTC)")
    if stamp.tz is not None:
        stamp = stamp.tz_convert("UTC").tz_localize(None)
    if not pd.Timestamp.min <= stamp <= pd.Timestamp.max:
        raise OceanError(
            f"time {time!r} is out of range; allowed: {_FIRST_YEAR} to {_LAST_YEAR} (64-bit"
            " nanoseconds)"
        )
    return stamp.to_datetime64()


def has_time(data: xr.Dataset, name: str) -> bool:
    """
    Return True unless a time coordinate has no name, or consists of one missing instant; xarray
    writes NaT as -2**63.
    """
    return bool(name) and not (
        data.variables[name].size == 1
        and bool(np.all(np.isnan(values := numbers(data, name)) | (values <= -(2.0**63))))
    )


def instants(data: xr.Dataset, name: str) -> tuple[Instants, bool]:
    """
    Instants of a time coordinate in UTC and the standard calendar, and True for a climatology; one
    element for a scalar.
    """
    axis = data.variables[name]
    where = f"{file_name(data)}: {name}"
    unit = text(axis, "units")
    calendar = text(axis, "calendar").lower()
    if calendar not in _CALENDARS:
        raise OceanError(
            f"{where} uses the calendar {calendar!r}, which is not a real calendar; convert it"
            " first, data.convert_calendar('standard', align_on='date')"
        )
    if " since " not in unit:
        raise OceanError(
            f"{where} has units {unit[:40]!r}; a time coordinate needs units such as 'hours since"
            " ...'"
        )
    values = np.atleast_1d(numbers(data, name))
    months = unit.lower().startswith("month")
    climatology = months or "climatology" in axis.attrs
    if climatology:  # of no year
        unit = re.sub(r"(?<= since )0*[01]-", "2000-", unit)
    times = (
        _months_since(values, unit, where)
        if months
        else decoded_times(values, unit, calendar, where=where)
    )
    different, counts = np.unique(times, return_counts=True)
    if different.size < times.size:
        again = minute(different[np.argmax(counts)])
        raise OceanError(f"{where} has the instant {again} {counts.max()} times; keep one of them")
    return times, climatology


def _months_since(values: Array, unit: str, where: str) -> Instants:
    """
    Instants of a count of calendar months, as in the World Ocean Atlas; fractions are of the length
    of the month.
    """
    start = parse_instant(unit.split(" since ", 1)[1])
    origin = start.astype("datetime64[M]")
    if not np.all(np.isfinite(values)) or np.abs(values).max(initial=0.0) > _MAX_MONTHS:
        raise OceanError(
            f"{where} has months from {values.min():g} to {values.max():g}; correct the axis"
        )
    years = np.floor(values / 12.0)
    # times of no year, as in files of the World Ocean Atlas 2023
    if np.abs(years).max(initial=0.0) > _MAX_YEARS:
        values = values - 12.0 * years.min()
    whole = np.floor(values).astype(int)
    first, after = (origin + (whole + k).astype("timedelta64[M]") for k in (0, 1))
    length = (after.astype("datetime64[ns]") - first.astype("datetime64[ns]")).astype(float)
    part = np.round((values - whole) * length).astype("timedelta64[ns]")
    return np.asarray(first.astype("datetime64[ns]") + part + (start - origin))


def decoded_times(values: Array, unit: str, calendar: str = "", *, where: str) -> Instants:
    """
    Instants from numbers with units 'UNIT since ORIGIN', exact to the nanosecond for integers.
    """
    zone = re.search(r"\d\s*([a-z]+)\s*$", unit.lower().partition(" since ")[2])
    if (zone and zone[1] not in _UTC) or re.search(r" since \d\d?/", unit):
        raise OceanError(
            f"{where} has units {unit[:60]!r}, whose date cannot be read with certainty; write it"
            " as 2014-07-15 12:00:00 (UTC)"
        )
    if np.any(np.isinf(values)):
        raise OceanError(f"{where} has infinite values; correct the axis")
    whole = np.all(values == np.round(values)) and np.all(np.abs(values) < 2**53)
    attrs = {"units": unit, "calendar": calendar or "standard"}
    raw = xr.Variable(("time",), values.astype(np.int64) if whole else values, attrs)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            coarse = xr.decode_cf(xr.Dataset({"when": raw}))["when"].values
            years = coarse.astype("datetime64[Y]").astype(int) + 1970
            times = coarse.astype("datetime64[ns]")
    except Exception as error:  # noqa: BLE001  cftime and pandas raise many types
        raise OceanError(
            f"{where} cannot be read as {unit[:40]!r} ({one_line(error, 80)})"
        ) from None
    if times.size == 0 or np.any(np.isnat(times)):
        raise OceanError(f"{where} is empty or has missing instants; correct the axis")
    beyond = (years < _FIRST_YEAR) | (years > _LAST_YEAR)
    if np.any(beyond):
        raise OceanError(
            f"{where} has the year {years[beyond][0]}; allowed: {_FIRST_YEAR} to {_LAST_YEAR}"
            " (64-bit nanoseconds)"
        )
    return np.asarray(times)


def pick(times: Instants, time: str | np.datetime64 | None, names: str) -> np.datetime64:
    """
    Instant of increasing times that is within a minute of the requested time; without a request,
    the only instant.
    """
    if time is None:
        if len(times) > 1:
            raise OceanError(
                f"{names}: {len(times)} times ({listing(times)}); select one with"
                f" `time={minute(times[0])}`"
            )
        return np.datetime64(times[0])
    instant = parse_instant(time)
    nearest = times[np.argmin(np.abs(times - instant))]
    if abs(nearest - instant) > _TIME_TOLERANCE:
        raise OceanError(f"{names}: no time {time}; available: {listing(times)}")
    return np.datetime64(nearest)


def listing(times: Sequence[np.datetime64] | Instants) -> str:
    """First four instants and the last, for messages."""
    words = ", ".join(minute(t) for t in times[:4])
    return words + (f", ... {minute(times[-1])}" if len(times) > 4 else "")


def minute(time: np.datetime64) -> str:
    """Instant as text, to the minute."""
    return str(np.datetime_as_string(time, unit="m"))


def degrees(data: xr.Dataset, name: str, quantity: str) -> Array:
    """Latitudes or longitudes of a variable in degrees, from degrees or radians."""
    values = numbers(data, name)
    unit = text(data.variables[name], "units")
    if unit:
        return to_our_unit(values, quantity, unit, where=f"{file_name(data)}: {name}")
    if (
        quantity == "latitude"
        and values.size > 1
        and np.nanmax(np.abs(values), initial=0.0) <= 0.5 * math.pi
    ):
        raise OceanError(
            f"{file_name(data)}: {name} has no units and may be in degrees or radians; set its"
            " units to degrees_north or radians"
        )
    return values


def time_text(ocean: xr.Dataset) -> str:
    """Instant of an ocean as text, to the minute, or ``unknown``."""
    time = ocean["time"].values
    return "unknown" if np.isnat(time) else str(np.datetime_as_string(time, unit="m"))


def levels(data: xr.Dataset, name: str) -> tuple[Array, bool]:
    """
    Vertical axis, positive down, in the order of the file, and True if it is an axis of pressure.
    [m] or [dbar]
    """
    axis = data.variables[name]
    where = f"{file_name(data)}: {name}"
    unit = text(axis, "units")
    standard_name = text(axis, "standard_name")
    if is_unit_of("pressure", unit) or standard_name.startswith("sea_water_pressure"):
        return _from_surface(
            to_our_unit(numbers(data, name), "pressure", unit, where=where), where
        ), True
    values = to_our_unit(numbers(data, name), "length", unit, where=where)
    positive = (text(axis, "positive") or text(axis, "_CoordinateZisPositive")).lower()
    if standard_name in ("height", "altitude", "height_above_mean_sea_level"):
        positive = positive or "up"
    negative = bool(values.size) and bool(np.all(values <= 0.0)) and bool(np.any(values < 0.0))
    if positive == "down" and negative:
        raise OceanError(
            f"{where} has negative values although its attribute positive is 'down'; correct the"
            " sign or the attribute"
        )
    upward = positive == "up" or (negative and not positive)
    return _from_surface(-values if upward else values, where), False


def _from_surface(values: Array, where: str) -> Array:
    if values.size == 0 or not np.all(np.isfinite(values)):
        raise OceanError(f"{where} is empty or has missing or infinite values; correct the axis")
    if values.min() < -_AT_SURFACE:
        raise OceanError(
            f"{where} has a level {-values.min():g} above the surface; check its attribute positive"
        )
    if values.max() > DEEPEST:
        raise OceanError(
            f"{where} has a level at {values.max():g}; allowed: at most {DEEPEST:g} m or dbar"
        )
    return np.asarray(np.where(np.abs(values) <= _AT_SURFACE, 0.0, values), dtype=float)


def to_in_situ_and_practical(
    temperature: tuple[Array, str],
    salinity: tuple[Array, str],
    pressure: Array,
    lat: Array,
    lon: Array,
) -> tuple[Array, Array]:
    """
    Convert fields over (depth, lat, lon) of any TEOS-10 kind to in-situ temperature and practical
    salinity.

    Potential temperature refers to 0 dbar. Absolute, reference and preformed salinity are in g/kg.
    Pressure [dbar] broadcasts. See McDougall, T. J. and Barker, P. M. (2011), Getting started with
    TEOS-10 and the Gibbs Seawater (GSW) Oceanographic Toolbox, SCOR/IAPSO WG127.
    """
    (t, t_kind), (s, s_kind) = temperature, salinity
    place = (pressure, lon, lat[:, None])
    with np.errstate(all="ignore"):
        if s_kind == PRACTICAL:
            practical = s
        elif s_kind == ABSOLUTE:
            practical = gsw.SP_from_SA(s, *place)
        elif s_kind == REFERENCE:
            practical = gsw.SP_from_SR(s)
        else:
            practical = gsw.SP_from_Sstar(s, *place)
        if t_kind == IN_SITU:
            return t, practical
        absolute = s if s_kind == ABSOLUTE else gsw.SA_from_SP(practical, *place)
        if t_kind == CONSERVATIVE:
            return np.asarray(gsw.t_from_CT(absolute, t, pressure), dtype=float), practical
        return np.asarray(gsw.pt_from_t(absolute, t, 0.0, pressure), dtype=float), practical


def check_salinity_unit(salinity: Array, where: str) -> None:
    """Raise an error if salinity is in kg/kg although its unit says practical salinity."""
    highest = np.max(salinity, initial=0.0, where=np.isfinite(salinity))
    if 0.0 < highest < _MIN_MAX_SALINITY:
        raise OceanError(
            f"{where} is at most {highest:.3g}, which suggests kg/kg; set units to 'kg kg-1' and"
            " the standard_name to sea_water_absolute_salinity, or multiply by 1000"
        )


def to_fixed_depths(
    fields: dict[str, Array], pressure: Array, lat: Array
) -> tuple[Array, dict[str, Array], float]:
    """
    Interpolate fields from pressure levels [dbar] to the depths of these levels at the middle
    latitude.

    Returns the depths [m], the linearly interpolated fields and the largest displacement [m]. A
    value with a missing neighbour is unchanged.
    """
    depth = -np.asarray(gsw.z_from_p(pressure, 0.5 * (lat[0] + lat[-1])), dtype=float)
    depth[pressure == 0.0] = 0.0
    actual = -np.asarray(gsw.z_from_p(pressure[:, None], lat), dtype=float)
    shift = (depth[:, None] - actual)[..., None]
    moved = {}
    for name, field in fields.items():
        slope = np.diff(field, axis=0) / np.diff(actual, axis=0)[..., None]
        below = np.concatenate([slope, np.zeros_like(field[:1])])
        above = np.concatenate([np.zeros_like(field[:1]), slope])
        step = np.where(shift > 0.0, below, above) * shift
        moved[name] = field + np.where(np.isfinite(step), step, 0.0)
    return depth, moved, float(np.max(np.abs(shift)))


def up_to_surface(
    depth: Array, fields: dict[str, Array], where: str
) -> tuple[Array, dict[str, Array]]:
    """
    Add a level at 0 m with the values of the first level if that is deeper than 0 m, but not too
    deep. [m]
    """
    if depth[0] == 0.0:
        return depth, fields
    if depth[0] > _DEEPEST_FIRST_LEVEL:
        raise OceanError(
            f"{where}: the first level is at {depth[0]:g} m; its values are extended to the surface"
            f" only if it is at most {_DEEPEST_FIRST_LEVEL:g} m deep; add levels above it to the"
            " file"
        )
    return np.concatenate([[0.0], depth]), {
        n: np.concatenate([f[:1], f]) for n, f in fields.items()
    }

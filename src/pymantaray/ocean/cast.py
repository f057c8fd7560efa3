"""
One cast: a measured profile at a place and time, and its CSV table.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from pymantaray.arrays import Array
from pymantaray.errors import OceanError, RecordError, errors_as
from pymantaray.ocean.archives import ArchiveTable, archive_table
from pymantaray.ocean.cast_rows import LIMITS, usable_rows, visits, without_fills
from pymantaray.ocean.convert import is_unit_of, minute, our_unit, to_our_unit, vertical_of
from pymantaray.ocean.instrument_table import InstrumentTable
from pymantaray.ocean.instruments import instrument_table
from pymantaray.ocean.names import Equation
from pymantaray.ocean.positions import is_position, position_in_text
from pymantaray.ocean.schema import latitude, layer_edges, longitude
from pymantaray.ocean.seawater import TOO_COLD, freezing_notes, repair_salinity, sound_speed
from pymantaray.quantities.checks import checked_array
from pymantaray.records.invalid_lines import InvalidLines
from pymantaray.records.text_table import read_text, read_text_table

_MISSING = ("", "nan", "na", "n/a", "null", "none", "-", "--")
# quantity: kind of its unit, and column names in lower case, first those of `mantaray rays`, then
# those of cruise and model files
_COLUMNS = {
    "depth": ("length", "depth vertcoord depsm z"),
    "pressure": ("pressure", "pressure pres press ctdprs prdm p"),
    "temperature": (
        "temperature",
        "temperature temp water_temp sea_water_temperature in_situ_temperature ctdtmp t090c t",
    ),
    "potential_temperature": (
        "temperature",
        "potential_temperature sea_water_potential_temperature theta thetao potemp",
    ),
    "conservative_temperature": (
        "temperature",
        "conservative_temperature sea_water_conservative_temperature",
    ),
    "salinity": (
        "practical salinity",
        "salinity practical_salinity sea_water_practical_salinity sal psal ctdsal salnty sal00 s",
    ),
    "absolute_salinity": ("mass salinity", "absolute_salinity sea_water_absolute_salinity"),
    "measured_conductivity": ("conductivity", "measured_conductivity"),
    "sound_speed": ("velocity", "sound_speed soundspeed sound_velocity svel svcm"),
    "lat": ("latitude", "latitude lat"),
    "lon": ("longitude", "longitude lon long"),
}
# names in the vocabulary P01 of SeaDataNet (https://vocab.nerc.ac.uk), for the temperature scale of
# 1990 only, and in GEOTRACES
_CODES = {
    "depth": "dephpr01 adepzz01",
    "pressure": "prespr01 ctdprs_t_value_sensor",
    "temperature": "temppr01 tempst01 tempcc01 tempcu01 temps901 tempp901 ctdtmp_t_value_sensor",
    "potential_temperature": "potmcv01",
    "salinity": "psltzz01 psalpr01 psalst01 psalcc01 psalcu01 ctdsal_d_conc_sensor",
}
_NAMES = {
    quantity: [*names.split(), *_CODES.get(quantity, "").split()]
    for quantity, (_, names) in _COLUMNS.items()
}
_TEXTS = {
    "time": ("time", "datetime", "date_time", "time_utc", "timestamp", "date"),
    "station": ("station", "stnnbr", "station_id"),
    "cast": ("cast", "castno", "profile", "cast_id", "profile_id"),
}
_HEADER = re.compile(
    r"^(?P<name>[^\[(]*?)\s*(?:[\[(]\s*(?:units?\s*=\s*)?\"?(?P<unit>[^\"\])]*)\"?\s*[\])])?$"
)


@dataclass(frozen=True, eq=False)
class Cast:
    """
    Temperature and salinity measured downward at one place.

    Attributes
    ----------
    name : str
    lat, lon : float
        Place. [degrees]
    time : numpy.datetime64
        Instant (UTC); NaT if it is unknown.
    depth : ndarray, shape (n_levels,)
        Depth of the samples, strictly increasing, positive down. [m]
    temperature : ndarray, shape (n_levels,)
        In-situ temperature. [degC]
    salinity : ndarray, shape (n_levels,)
        Practical salinity. [-]
    bottom_depth : float
        Depth of the sea bed if the file gives it, else NaN. [m]
    dropped : int
        Number of unused rows of the file.
    notes : tuple of str
        Conversions and dropped rows.
    """

    name: str
    lat: float
    lon: float
    time: np.datetime64
    depth: Array
    temperature: Array
    salinity: Array
    bottom_depth: float = float("nan")
    dropped: int = 0
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Convert, check and freeze the arrays."""
        object.__setattr__(self, "name", " ".join(self.name.split()))  # part of one-line messages
        for field in ("depth", "temperature", "salinity"):
            where = f"cast {self.name}: {field}"
            array = checked_array(OceanError, where, getattr(self, field), (np.size(self.depth),))
            object.__setattr__(self, field, array)
        object.__setattr__(self, "time", self.time.astype("datetime64[ns]"))
        if self.depth.size < 2 or self.depth[0] < 0.0 or np.any(np.diff(self.depth) <= 0.0):
            raise OceanError(
                f"cast {self.name}: depths must strictly increase, be 0 m or more (positive down)"
                " and have at least 2 levels"
            )
        for field in ("temperature", "salinity"):
            low, high = LIMITS[field]
            values = getattr(self, field)
            if values.min() < low or values.max() > high:
                raise OceanError(
                    f"cast {self.name}: {field} is {values.min():g} to {values.max():g}; allowed:"
                    f" {low:g} to {high:g}"
                )
        if not is_position(self.lat, self.lon):
            raise OceanError(
                f"cast {self.name}: latitude {self.lat:g} and longitude {self.lon:g} are not a"
                " place; latitude must be in -90 to 90 degrees, longitude"
                " in -360 to 360"
            )

    def __repr__(self) -> str:
        """Name, place, time and depth range."""
        time = "time unknown" if np.isnat(self.time) else minute(self.time)
        return (
            f"Cast({self.name!r}, {latitude(self.lat)}, {longitude(self.lon)}, {time},"
            f" {self.depth.size} levels from {self.depth[0]:g} to {self.depth[-1]:g} m)"
        )

    def sound_speed(self, equation: Equation = "teos-10") -> Array:
        """
        Sound speed at the samples.

        Parameters
        ----------
        equation : str
            As in `pymantaray.ocean.sound_speed`.

        Returns
        -------
        ndarray, shape (n_levels,)
            [m/s]
        """
        return sound_speed(
            self.temperature, self.salinity, self.depth, self.lat, self.lon, equation=equation
        )

    def with_repaired_salinity(self) -> Cast:
        """
        Cast with the salinity of the freezing line at levels below the freezing point; a note gives
        their number.
        """
        salinity, repairs = repair_salinity(
            self.temperature, self.salinity, self.depth, self.lat, self.lon
        )
        if not repairs:
            return self
        kept = [note for note in self.notes if TOO_COLD not in note]
        return replace(self, salinity=salinity, notes=(*kept, *repairs))

    def cell_means(self, levels: ArrayLike) -> tuple[Array, Array]:
        """
        Average temperature and salinity over the cells around levels.

        A cell extends half-way to the next level on both sides. The cell of the first level begins
        at that level, the cell of the last level ends at that level. The profile is linear between
        samples and constant beyond the first and last sample; the average of this profile is exact.

        Parameters
        ----------
        levels : array_like, shape (n,)
            Depths, strictly increasing. [m]

        Returns
        -------
        temperature : ndarray, shape (n,)
            [degC]
        salinity : ndarray, shape (n,)
            Practical salinity. [-]
        """
        edges = layer_edges(np.asarray(levels, dtype=float))
        return self._means(edges, self.temperature), self._means(edges, self.salinity)

    def _means(self, edges: Array, values: Array) -> Array:
        nodes = np.union1d(edges, self.depth)
        at = np.interp(nodes, self.depth, values)
        integral = np.concatenate([[0.0], np.cumsum(0.5 * (at[1:] + at[:-1]) * np.diff(nodes))])
        return np.asarray(np.diff(np.interp(edges, nodes, integral)) / np.diff(edges))


def notes_of_casts(casts: Iterable[Cast]) -> tuple[str, ...]:
    """Notes of the reader of casts, each with the name of its cast."""
    return tuple(f"{cast.name}: {note}" for cast in casts for note in cast.notes)


def clean_cast(
    name: str,
    place: tuple[float, float],
    time: np.datetime64,
    profile: Sequence[Array],
    *,
    bottom_depth: float = float("nan"),
    dropped: int = 0,
    notes: Sequence[str] = (),
    titles: Mapping[str, tuple[str, str]] | None = None,
    where: str,
) -> Cast:
    """
    Make a cast from raw rows of depth [m], in-situ temperature [degC] and practical salinity; NaN
    if missing.

    Unusable rows are dropped and counted. A profile in upward order is reversed. ``dropped`` and
    ``notes`` describe earlier steps, ``titles`` are as in `usable_rows` and ``where`` is file and
    station for messages.
    """
    depth, temperature, salinity = (np.asarray(column, dtype=float) for column in profile)
    quantities = {"temperature": temperature, "salinity": salinity}
    deeper, cast_notes, lost = usable_rows(
        depth, quantities, titles=titles, notes=notes, where=where
    )
    used = temperature[deeper], salinity[deeper], depth[deeper]
    if is_position(*place):  # `Cast` rejects other places
        cast_notes += freezing_notes(*used, *place)
    return Cast(
        name,
        float(place[0]),
        float(place[1]),
        time,
        depth[deeper],
        temperature[deeper],
        salinity[deeper],
        bottom_depth,
        dropped + lost,
        tuple(cast_notes),
    )


@dataclass(frozen=True, eq=False)
class CastTable:
    """Rows of a CSV file as text, with the meaning of its columns."""

    path: Path
    header: tuple[str, ...]
    """Titles as in the file."""
    rows: pd.DataFrame
    """Cells, empty if missing; columns by position; the index is the line of the file."""
    comments: list[str]
    """Lines that begin with ``#``."""
    columns: dict[str, tuple[int, str]]
    """Position and unit of each known quantity."""
    texts: dict[str, int]
    """Positions of ``time``, ``station`` and ``cast``, if present."""
    bracketed: bool
    """True if units are in brackets, as in tables of the NetCDF Subset Service."""
    instrument: str = ""
    """Instrument that wrote the file with raw rows; empty for other tables."""
    place: tuple[float, float] | None = None
    """Latitude and longitude in an instrument's file. [degrees]"""
    time: str = ""
    """Time (UTC) in an instrument's file."""
    labelled: bool = False
    """True if each row has the time and the place of its cast, as in files of archives."""
    notes: tuple[str, ...] = ()
    """Changes made by the reader."""
    unread: tuple[str, ...] = ()
    """Names of columns in an instrument's file or a data set that the reader does not use."""

    @property
    def lines(self) -> list[int]:
        """Line in the file of each row."""
        return self.rows.index.to_list()

    def has(self, *quantities: str) -> bool:
        """Return True if all of these quantities have a column."""
        return all(q in self.columns for q in quantities)

    def name(self, quantity: str) -> str:
        """Title of a quantity's column in the file."""
        return self.header[self.columns[quantity][0]]

    def title(self, quantity: str) -> tuple[str, str]:
        """Title of a quantity's column, and its unit if the file states it."""
        return self.name(quantity), self.columns[quantity][1]

    @property
    def listing(self) -> str:
        """Names of the used and the other columns, for messages."""
        unread = f"; not read: {', '.join(self.unread[:12])}" if self.unread else ""
        return f"the columns are {', '.join(self.header)}{unread}"

    def values(self, quantity: str) -> Array:
        """Column in m, dbar, degC, practical salinity, g/kg, m/s or degrees; NaN if missing."""
        position, unit = self.columns[quantity]
        raw = self._numbers(quantity, self.rows[position])
        kind = _COLUMNS[quantity][0]
        values = to_our_unit(
            raw, kind, unit or our_unit(kind), where=f"{self.path}: {self.name(quantity)}"
        )
        # integers of the NetCDF Subset Service may be packed, so any of them may be a value
        return without_fills(raw, values, "packed" if self.bracketed else quantity)

    def _numbers(self, quantity: str, cells: pd.Series[Any]) -> Array:
        """
        Convert cells of text to numbers, NaN if empty; cells of a data set are numbers already.
        """
        if cells.dtype.kind == "f":
            return np.array(cells, dtype=float)
        cells = cells.mask(cells.str.lower().isin(_MISSING), "nan")
        try:
            return cells.to_numpy(dtype=object).astype(float)
        except ValueError:
            wrong = pd.to_numeric(cells.replace("nan", "0"), errors="coerce").isna()
            row = int(np.argmax(wrong))
            raise OceanError(
                f"{self.path}, line {self.lines[row]}: {self._fault(quantity, row)}"
            ) from None

    def readable(self, invalid: InvalidLines) -> CastTable:
        """Table without the lines that have text where a number is needed; a note lists them."""
        keep = np.ones(len(self.rows), dtype=bool)
        for quantity, (position, _) in self.columns.items():
            cells = self.rows[position]
            text = pd.to_numeric(cells, errors="coerce").isna() & ~cells.str.lower().isin(_MISSING)
            for row in np.flatnonzero(text & keep).tolist():
                invalid.add(self.path, self.lines[row], self._fault(quantity, row))
            keep &= ~text.to_numpy()
        invalid.refuse_most(int(keep.sum()), OceanError)
        return replace(self, rows=self.rows[keep], notes=(*self.notes, *invalid.notes))

    def text(self, kind: str) -> list[str] | None:
        """Cells of the time, station or cast column; None without such a column."""
        return self.rows[self.texts[kind]].to_list() if kind in self.texts else None

    def casts(self) -> dict[str, CastTable]:
        """Rows of each cast by its name, in the order of the file; a single cast has no name."""
        labels = [texts for kind in ("station", "cast") if (texts := self.text(kind)) is not None]
        keys = ["/".join(filter(None, row)) for row in zip(*labels, strict=True)]
        times = self.text("time") or [""] * len(self.rows)
        places = np.full((len(self.rows), 2), np.nan)
        if self.has("lat", "lon"):
            places = np.column_stack([self.values("lat"), self.values("lon")])
        if self.bracketed and self.has("lat", "lon"):
            keys = [
                f"{t} {lat:g} {lon:g}".strip()
                for t, (lat, lon) in zip(times, places.tolist(), strict=True)
            ]
        else:
            keys = visits(keys or [""] * len(self.rows), times, places, exact=self.labelled)
        if not labels and len(set(keys)) < 2:
            return {"": self}
        groups = self.rows.groupby(np.array(keys, dtype=object), sort=False)
        of_all = tuple(f"whole file: {note}" for note in self.notes)
        notes = iter([self.notes if len(groups) == 1 else of_all])  # once, with the first cast
        return {str(key): replace(self, rows=rows, notes=next(notes, ())) for key, rows in groups}

    def _fault(self, quantity: str, row: int) -> str:
        cell = self.rows[self.columns[quantity][0]].iloc[row]
        return f"{self.name(quantity)} is {cell!r}; it must be a number"


@errors_as(OceanError, RecordError)
def read_cast_table(path: str | Path) -> CastTable:
    """
    Read a CSV file with one or several casts, or an instrument's file with one cast.

    The separator is a comma, semicolon, tab or space, as in the header. Column names are
    case-insensitive and may include a unit, as in ``depth_m``, ``depth [m]`` or
    ``latitude[unit="degrees_north"]``.
    """
    text = read_text(Path(path))
    lines = text.splitlines()
    instrument = instrument_table(Path(path), lines)
    if instrument is not None:
        return _of_instrument(Path(path), instrument)
    invalid = InvalidLines()
    archive = archive_table(Path(path), text, lines) or ArchiveTable("", text, (), labelled=False)
    table = read_text_table(path, archive.text, invalid=invalid)
    header = tuple(table.frame.columns)
    columns, texts = _columns(table.path, header)
    whole = CastTable(
        table.path,
        header,
        table.frame.set_axis(range(len(header)), axis=1),
        table.comments,
        columns,
        texts,
        bracketed=any("[unit=" in title for title in header),
        instrument=archive.name,
        labelled=archive.labelled,
        notes=archive.notes,
    )
    return whole.readable(invalid)


def _of_instrument(path: Path, instrument: InstrumentTable) -> CastTable:
    """Convert an instrument's columns to a table; short rows are filled with empty cells."""
    width = len(instrument.titles)
    cells = {i: (row + [""] * width)[:width] for i, row in instrument.rows.items()}
    known = [k for k, title in enumerate(instrument.titles) if title]
    header = tuple(instrument.titles[k] for k in known)
    rows = pd.DataFrame.from_dict(cells, orient="index", dtype=str)[known].set_axis(
        range(len(known)), axis=1
    )
    columns, texts = _columns(path, header)
    place, notes = position_in_text(*instrument.position)
    return CastTable(
        path,
        header,
        rows,
        [f"bottom {instrument.bottom_depth:g} m"] if instrument.bottom_depth > 0.0 else [],
        columns,
        texts,
        bracketed=False,
        instrument=instrument.instrument,
        place=place,
        time=instrument.time,
        notes=(*instrument.notes, *notes),
        unread=instrument.unread,
    )


def _columns(
    path: Path, header: tuple[str, ...]
) -> tuple[dict[str, tuple[int, str]], dict[str, int]]:
    columns: dict[str, tuple[int, str]] = {}
    texts: dict[str, int] = {}
    for i, title in enumerate(header):
        match = _HEADER.match(title.lower())
        name = re.sub(r"[\s.]+", "_", match["name"].strip()) if match else title.lower()
        unit = (match["unit"] or "").strip() if match else ""
        kind = next((kind for kind, names in _TEXTS.items() if name in names), None)
        if kind is not None:
            texts.setdefault(kind, i)
            continue
        quantity, suffix = _meaning(name)
        if quantity is None:
            continue
        if quantity in ("depth", "pressure"):
            quantity = vertical_of(unit or suffix, quantity)
        of = _COLUMNS[quantity][0]
        if unit and not is_unit_of(of, unit):
            raise OceanError(
                f"{path}: the unit of column {title!r} is unknown; write {quantity} in"
                f" {our_unit(of)}"
            )
        if quantity not in columns:
            columns[quantity] = (i, unit or suffix)
        elif name in _NAMES[quantity]:
            raise OceanError(
                f"{path}: columns {header[columns[quantity][0]]!r} and {title!r} are both"
                f" {quantity}; remove one"
            )
    return columns, texts


def _meaning(name: str) -> tuple[str | None, str]:
    """Quantity of a column, and the unit at the end of its name."""
    for quantity, names in _NAMES.items():
        kind = _COLUMNS[quantity][0]
        if name in names:
            return quantity, ""
        kinds = ("length", "pressure") if quantity in ("depth", "pressure") else (kind,)
        for alias in names:
            unit = name.removeprefix(alias + "_")
            # units of names of files, such as sound_speed_m_s
            for spelling in (unit, re.sub(r"_(?:per_)?(?=[a-z]+$)", "/", unit)):
                if unit != name and any(is_unit_of(kind, spelling) for kind in kinds):
                    return quantity, spelling
    return None, ""

"""CSV tables of casts: which column is what, in which unit, and which cells are missing."""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import OceanError

Array = NDArray[np.float64]
Factor = tuple[float, float]  # value = cell * factor + offset

_LARGEST = 200_000_000  # bytes; a cast of a million rows is a third of that
_MISSING = frozenset({"", "nan", "na", "n/a", "null", "none", "-", "--"})
_FILLS = (-9.99e-29, -99.0, -99.9, -99.99, -999.0, -999.9, -999.99, -9999.0, -99999.0, 99999.0, -1e34, 1e35)
_DEGREES: dict[str, Factor] = {
    **dict.fromkeys(("", "degc", "c", "°c", "ºc", "deg_c", "celsius", "its90", "its-90"), (1.0, 0.0)),
    **dict.fromkeys(("k", "kelvin"), (1.0, -273.15)),
}
_METRES: dict[str, Factor] = {
    **dict.fromkeys(("", "m", "metres", "meters"), (1.0, 0.0)),
    "km": (1e3, 0.0),
    "ft": (0.3048, 0.0),
}
_DBAR: dict[str, Factor] = {
    **dict.fromkeys(("", "dbar", "db", "decibar"), (1.0, 0.0)),
    "bar": (10.0, 0.0),
    "kpa": (0.1, 0.0),
    "mpa": (100.0, 0.0),
    "pa": (1e-4, 0.0),
}
_PRACTICAL: dict[str, Factor] = dict.fromkeys(
    ("", "1", "psu", "pss", "pss78", "pss-78", "ppt", "practical"), (1.0, 0.0)
)
_GRAMS: dict[str, Factor] = dict.fromkeys(("", "g/kg", "g_kg"), (1.0, 0.0))
_SPEED: dict[str, Factor] = dict.fromkeys(("", "m/s", "m_s", "m s-1", "m_s-1"), (1.0, 0.0))
_ANGLE: dict[str, Factor] = dict.fromkeys(
    ("", "deg", "degrees", "degrees_north", "degrees_east", "deg_n", "deg_e", "degn", "dege"), (1.0, 0.0)
)
# first the names of `mantaray rays`, then those of cruises' and models' files; lower case
QUANTITIES: dict[str, tuple[tuple[str, ...], dict[str, Factor]]] = {
    "depth": (("depth", "vertcoord", "depsm", "z"), _METRES),
    "pressure": (("pressure", "pres", "press", "ctdprs", "prdm", "p"), _DBAR),
    "temperature": (
        (
            *("temperature", "temp", "water_temp", "sea_water_temperature", "in_situ_temperature"),
            *("ctdtmp", "t090c", "t"),
        ),
        _DEGREES,
    ),
    "potential_temperature": (
        ("potential_temperature", "sea_water_potential_temperature", "theta", "thetao", "potemp"),
        _DEGREES,
    ),
    "conservative_temperature": (
        ("conservative_temperature", "sea_water_conservative_temperature"),
        _DEGREES,
    ),
    "salinity": (
        (
            *("salinity", "practical_salinity", "sea_water_practical_salinity", "sal", "psal", "ctdsal"),
            *("salnty", "sal00", "s"),
        ),
        _PRACTICAL,
    ),
    "absolute_salinity": (("absolute_salinity", "sea_water_absolute_salinity"), _GRAMS),
    "sound_speed": (("sound_speed", "soundspeed", "sound_velocity", "svel", "svcm"), _SPEED),
    "lat": (("latitude", "lat"), _ANGLE),
    "lon": (("longitude", "lon", "long"), _ANGLE),
}
_TEXT = {
    "time": ("time", "datetime", "date_time", "time_utc", "timestamp", "date"),
    "station": ("station", "stnnbr", "cast", "castno", "profile", "station_id", "cast_id", "profile_id"),
}
_HEADER = re.compile(
    r"^(?P<name>[^\[(]*?)\s*(?:[\[(]\s*(?:units?\s*=\s*)?\"?(?P<unit>[^\"\])]*)\"?\s*[\])])?$"
)


@dataclass(frozen=True, eq=False)
class CastTable:
    """
    Rows of a CSV file as text, with what its columns mean.

    Attributes
    ----------
    path : pathlib.Path
    header : tuple of str
        As the file writes it.
    rows : list of list of str
    lines : list of int
        Line of the file that each row stands in.
    comments : list of str
        Lines that begin with ``#``.
    columns : dict
        Position of each known quantity, and factor and offset to m, dbar, degC, practical salinity, g/kg,
        m/s or degrees.
    texts : dict
        Positions of ``time`` and ``station``, if they are there.
    bracketed : bool
        Whether units stand in brackets, as in the NetCDF Subset Service's tables.
    """

    path: Path
    header: tuple[str, ...]
    rows: list[list[str]]
    lines: list[int]
    comments: list[str]
    columns: dict[str, tuple[int, Factor]]
    texts: dict[str, int]
    bracketed: bool

    def has(self, *quantities: str) -> bool:
        """Whether all of these quantities have a column."""
        return all(q in self.columns for q in quantities)

    def name(self, quantity: str) -> str:
        """Column of a quantity as the file calls it."""
        return self.header[self.columns[quantity][0]]

    def values(self, quantity: str, *, complete: bool = False) -> Array:
        """
        A column as numbers in the unit of the package.

        Parameters
        ----------
        quantity : str
            One of `QUANTITIES` that the table has.
        complete : bool
            Refuse missing cells too.

        Returns
        -------
        ndarray, shape (n_rows,)
            NaN where a cell is empty, says so, or holds a usual fill value.

        Raises
        ------
        OceanError
            If a cell is no number; the message names its line.
        """
        position, (factor, offset) = self.columns[quantity]
        found = np.empty(len(self.rows))
        for i, row in enumerate(self.rows):
            cell = row[position].strip()
            try:
                found[i] = np.nan if cell.lower() in _MISSING else float(cell)
            except ValueError:
                raise self._no_number(i, quantity) from None
        missing = ~np.isfinite(found) | (np.abs(found) > 1e30)
        if quantity not in ("lat", "lon"):  # -99 is a longitude
            missing |= np.isin(found, _FILLS)
        found[missing] = np.nan
        if complete and np.any(np.isnan(found)):
            raise self._no_number(int(np.flatnonzero(np.isnan(found))[0]), quantity)
        return found * factor + offset

    def text(self, kind: str) -> list[str] | None:
        """Cells of the time or station column, None if there is none."""
        if kind not in self.texts:
            return None
        return [row[self.texts[kind]].strip() for row in self.rows]

    def select(self, rows: Sequence[int]) -> "CastTable":
        """Table of some of the rows."""
        return CastTable(
            self.path,
            self.header,
            [self.rows[i] for i in rows],
            [self.lines[i] for i in rows],
            self.comments,
            self.columns,
            self.texts,
            self.bracketed,
        )

    def _no_number(self, row: int, quantity: str) -> OceanError:
        found = self.rows[row][self.columns[quantity][0]]
        return OceanError(
            f"{self.path}, line {self.lines[row]}: {self.name(quantity)} needs a number; it is {found!r}"
        )


def read_cast_table(path: str | Path) -> CastTable:
    """
    Read a CSV file of one or several casts.

    Cells are separated by commas, semicolons, tabs or blanks, whichever the header has. Names of columns
    are found in `QUANTITIES` whatever their case, alone or with their unit, as in ``depth_m``,
    ``depth [m]`` or ``latitude[unit="degrees_north"]``.

    Parameters
    ----------
    path : str or pathlib.Path

    Returns
    -------
    CastTable

    Raises
    ------
    OceanError
        If the file is unreadable, has no rows, a row has more cells than the header, a unit is unknown, or two
        columns are the same quantity.
    """
    path = Path(path)
    lines = [(i, line) for i, line in enumerate(_text(path).splitlines(), 1) if line.strip(" \t,;")]
    comments = [line for _, line in lines if line.lstrip().startswith("#")]
    rows = [(i, line) for i, line in lines if not line.lstrip().startswith("#")]
    if len(rows) < 2:
        raise OceanError(f"{path}: not a cast: needs a header with names of columns, and rows")
    separator = next((s for s in ",;\t" if s in rows[0][1]), None)
    cells = [_split(line, separator) for _, line in rows]
    header = tuple(cells[0])
    numbers = [i for i, _ in rows[1:]]
    for i, row in zip(numbers, cells[1:], strict=True):
        if len(row) > len(header) and any(row[len(header) :]):
            raise OceanError(
                f"{path}, line {i}: {len(row)} cells under a header of {len(header)}; is a separator missing?"
            )
        row.extend([""] * (len(header) - len(row)))
    columns, texts = _columns(path, header)
    return CastTable(path, header, cells[1:], numbers, comments, columns, texts, "[unit=" in rows[0][1])


def _text(path: Path) -> str:
    try:
        size = path.stat().st_size
        if size > _LARGEST:
            raise OceanError(
                f"{path}: {size / 1e6:.0f} MB; a table of a cast has at most {_LARGEST / 1e6:.0f} MB"
            )
        raw = path.read_bytes()
    except OSError as error:
        raise OceanError(f"{path}: cannot be read: {error.strerror}; name an existing file") from None
    if b"\0" in raw[:4096]:
        raise OceanError(f"{path}: neither a CSV table nor NetCDF; a cast is one of the two")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")  # degree signs of older programs


def _split(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]
    except (csv.Error, StopIteration):
        return [cell.strip() for cell in line.split(separator)]


def _columns(path: Path, header: tuple[str, ...]) -> tuple[dict[str, tuple[int, Factor]], dict[str, int]]:
    columns: dict[str, tuple[int, Factor]] = {}
    texts: dict[str, int] = {}
    for i, title in enumerate(header):
        match = _HEADER.match(title.strip().lower())
        name = re.sub(r"[\s.]+", "_", match["name"].strip()) if match else title.strip().lower()
        unit = (match["unit"] or "").strip() if match else ""
        kind = next((k for k, names in _TEXT.items() if name in names), None)
        if kind is not None:
            texts.setdefault(kind, i)
            continue
        meaning = _meaning(name)
        if meaning is None:
            continue
        quantity, suffix = meaning
        factor = QUANTITIES[quantity][1].get(unit or suffix)
        if factor is None:
            known = ", ".join(u for u in QUANTITIES[quantity][1] if u)
            raise OceanError(
                f"{path}: unit of column {title!r} is unknown; allowed for {quantity} are {known}"
            )
        if quantity not in columns:
            columns[quantity] = (i, factor)
        elif name in QUANTITIES[quantity][0]:
            raise OceanError(
                f"{path}: columns {header[columns[quantity][0]]!r} and {title!r} are both {quantity}; keep one"
            )
    return columns, texts


def _meaning(name: str) -> tuple[str, str] | None:
    """Quantity of a column, and the unit at the end of its name."""
    for quantity, (names, units) in QUANTITIES.items():
        if name in names:
            return quantity, ""
        for alias in names:
            if name.startswith(alias + "_") and name[len(alias) + 1 :] in units:
                return quantity, name[len(alias) + 1 :]
    return None

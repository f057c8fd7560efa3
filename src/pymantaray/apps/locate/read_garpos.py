"""
Reader of GARPOS surveys from their ini file.

Columns, signs and units follow the documentation of https://github.com/s-watanabe-jhod/garpos:
east, north and up from the site's origin; ``ATDoffset`` forward, rightward and downward; attitudes
in degrees; ``flag`` is true for unused pings. ``TT`` is the travel time without the transponder's
delay. Depths are below the origin's ``Height0``.
"""

import configparser
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pymantaray.apps.locate.read_options import ReadOptions
from pymantaray.apps.locate.survey import LeverArm, Node, Survey
from pymantaray.arrays import Array
from pymantaray.errors import LocateError, OceanError
from pymantaray.geometry import LocalFrame
from pymantaray.ocean.convert import parse_instant
from pymantaray.quantities.checks import parsed_number
from pymantaray.records.invalid_lines import InvalidLines
from pymantaray.records.position_rows import FASTEST_PLATFORM, PositionRows, order_of_times
from pymantaray.records.text_table import TextTable, check_seconds, read_text_table
from pymantaray.user_files import exists, read_text

_DAY = 86400.0  # s
_MAX_TIME_OF_DAY = 40.0 * 86400.0  # s; larger times are since 1970, or modified Julian dates
_LATEST = 9e9  # s since 1970; 64-bit nanoseconds end in 2262
_MJD_1970 = 40587 * 86400.0
_REQUIRED = ["TT", "ST", "ant_e0", "ant_n0", "ant_u0"]
_NUMBERS = [
    *("RT", "ant_e1", "ant_n1", "ant_u1"),
    *(f"{angle}{end}" for end in "01" for angle in ("head", "pitch", "roll")),
]
_TRUE = ("true", "t", "1", "1.0", "yes")


class _Vector(NamedTuple):
    """Three components in the order of the file, and their standard deviations."""

    value: tuple[float, float, float]
    sigma: tuple[float, float, float]


class _Settings:
    """Entries of an ini file by case-insensitive section and key."""

    def __init__(self, path: Path) -> None:
        self.path = path
        parser = configparser.ConfigParser(interpolation=None, strict=False, allow_no_value=True)
        try:
            parser.read_string(
                read_text(path, LocateError, what="an ini file", errors="replace"), str(path)
            )
        # AttributeError: a line continues a key without value
        except (configparser.Error, AttributeError) as error:
            raise LocateError(
                f"{path}: not a readable ini file: {' '.join(str(error).split())[:100]}"
            ) from None
        self._sections = {
            name.strip().lower(): {key.lower(): value or "" for key, value in parser.items(name)}
            for name in parser.sections()
        }

    def text(self, section: str, key: str, default: str | None = None) -> str:
        """Text of an entry, or its default; a missing entry without default raises an error."""
        value = self._sections.get(section.lower(), {}).get(key.lower(), default)
        if value is None:
            raise LocateError(f"{self.path}: [{section}] has no {key}; add it")
        return value.split("#")[0].strip()

    def numbers(
        self, section: str, key: str, least: int, default: str | None = None
    ) -> list[float]:
        """Numbers of an entry, with a minimum count."""
        text = self.text(section, key, default)
        try:
            values = [parsed_number(word) for word in text.replace(",", " ").split()]
        except ValueError:
            values = []
        if len(values) < least or not np.isfinite(values).all():
            raise LocateError(
                f"{self.path}: [{section}] {key} is {text!r}; it must be {least} finite numbers"
            )
        return values

    def vector(self, section: str, key: str, default: str | None = None) -> _Vector:
        """Vector of an entry, with standard deviations of 0 if it has none."""
        x, y, z, *rest = self.numbers(section, key, 3, default)
        sigma_x, sigma_y, sigma_z, *_ = [*rest, 0.0, 0.0, 0.0]
        return _Vector((x, y, z), (sigma_x, sigma_y, sigma_z))


def read_garpos(path: Path, options: ReadOptions) -> Survey:
    """Read the survey of an array."""
    settings = _Settings(path)
    latitude, longitude = (
        settings.numbers("Site-parameter", key, 1)[0] for key in ("Latitude0", "Longitude0")
    )
    if not (abs(latitude) <= 90.0 and abs(longitude) <= 360.0):
        raise LocateError(
            f"{path}: site at {latitude:g}, {longitude:g}; degrees within 90 and 360 are needed"
        )
    names = settings.text("Site-parameter", "Stations").split()
    nodes, rigid = _nodes(settings, names)
    pings = _find(settings, settings.text("Data-file", "datacsv"))
    invalid = InvalidLines()
    table = read_text_table(pings, invalid=invalid)
    columns = set(table.frame.columns)
    table = table.readable(
        invalid, words=["MT"], numbers=[*_REQUIRED, *(n for n in _NUMBERS if n in columns)]
    )
    invalid.refuse_most(len(table.frame), LocateError)
    positions = PositionRows(pings, LocateError, fastest=FASTEST_PLATFORM)
    table = _possible(table, positions)
    survey = _survey(settings, table, nodes, names)
    profile = settings.text("Obs-parameter", "SoundSpeed", "")
    lever = settings.vector("Model-parameter", "ATDoffset", "0 0 0")
    height = settings.numbers("Site-parameter", "Height0", 1, "0")[0]
    return options.apply(
        survey.assign(
            lever=LeverArm(lever.value, lever.sigma),
            rigid=rigid,
            profile=None if not profile else _profile(_find(settings, profile)),
            frame=LocalFrame(latitude, longitude),
            depth_reference="plane",
            notes=(
                (
                    f"{path}: depths are relative to the site's origin, {height:g} m above the"
                    " ellipsoid"
                ),
                *survey.notes,
                *invalid.notes,
                *positions.notes,
            ),
        )
    )


def _possible(table: TextTable, positions: PositionRows) -> TextTable:
    """Rows whose positions of the antenna are possible, at transmission and at reception."""
    keep = np.ones(len(table.frame), dtype=bool)
    for time, north, east in (("ST", "ant_n0", "ant_e0"), ("RT", "ant_n1", "ant_e1")):
        if {time, north, east} <= set(table.frame.columns):
            instant, *position = table.numbers([time, north, east])[keep].T
            possible = positions.possible(
                instant,
                np.column_stack(position),
                table.lines[keep],
                geographic=False,
            )
            keep[np.flatnonzero(keep)[~possible]] = False
    positions.refuse_most(int(keep.sum()))
    return replace(table, frame=table.frame[keep])


def _nodes(
    settings: _Settings, names: list[str]
) -> tuple[tuple[Node, ...], tuple[float, float, float, float] | None]:
    """Nodes, and priors of a rigid array if the stations are fixed and the centre is not."""
    centre = settings.vector("Model-parameter", "dCentPos", "0 0 0")
    centre_east, centre_north, centre_up = centre.value
    nodes = []
    for name in names:
        station = settings.vector("Model-parameter", f"{name}_dPos")
        east, north, up = station.value
        sigma_east, sigma_north, sigma_up = station.sigma
        position = (north + centre_north, east + centre_east, -(up + centre_up))
        nodes.append(Node(name, position, (sigma_north, sigma_east, sigma_up)))
    if not any(any(node.sigma) for node in nodes):
        if not any(centre.sigma):
            raise LocateError(
                f"{settings.path}: all sigmas of stations and of dCentPos are 0; at least one must"
                " be positive"
            )
        sigma_east, sigma_north, sigma_up = centre.sigma
        return tuple(nodes), (sigma_north, sigma_east, sigma_up, 0.0)
    return tuple(nodes), None


def _survey(
    settings: _Settings, table: TextTable, nodes: tuple[Node, ...], names: list[str]
) -> Survey:
    columns = set(table.frame.columns)
    travel_time, transmit_time, e0, n0, u0 = table.numbers(_REQUIRED).T
    check_seconds(transmit_time, f"{table.path}: ST", LocateError)
    transmit_position = np.column_stack([n0, e0, -u0])
    receive_time = table.numbers(["RT"])[:, 0] if "RT" in columns else transmit_time + travel_time
    if (receive_time <= transmit_time).any():
        row = int(np.argmax(receive_time <= transmit_time))
        raise LocateError(
            f"{table.where(row)}: RT {receive_time[row]:.6f} is not after ST"
            f" {transmit_time[row]:.6f}; both must be in seconds"
        )
    receive_position = transmit_position
    if {"ant_e1", "ant_n1", "ant_u1"} <= columns:
        e1, n1, u1 = table.numbers(["ant_e1", "ant_n1", "ant_u1"]).T
        receive_position = np.column_stack([n1, e1, -u1])
    transponders = table.frame["MT"].tolist()
    for row, transponder in enumerate(transponders):
        if transponder not in names:
            raise LocateError(
                f"{table.where(row)}: transponder {transponder!r} is not a station of the site;"
                f" allowed: {', '.join(names)}"
            )
    flags = np.zeros(travel_time.size, bool)
    if "flag" in columns:
        flags = table.frame["flag"].str.lower().isin(_TRUE).to_numpy()
    order, note = order_of_times(
        transmit_time, table.where, LocateError, dated=bool(transmit_time.max() > _DAY)
    )
    order = np.arange(transmit_time.size) if order is None else order
    epoch, origin = _epoch(settings, float(transmit_time.min()))
    return Survey(
        nodes=nodes,
        node=np.array([names.index(transponder) for transponder in transponders])[order],
        time=(transmit_time - origin)[order],
        travel_time=travel_time[order],
        transmit_position=transmit_position[order],
        receive_position=receive_position[order],
        transmit_attitude=_attitude(table, "0")[order],
        receive_attitude=_attitude(table, "1" if "head1" in columns else "0")[order],
        flagged=flags[order],
        line=table.lines[order],
        epoch=epoch,
        source=str(table.path),
        notes=(note,) if note else (),
    )


def _attitude(table: TextTable, end: str) -> Array:
    """Heading, pitch, roll [rad]; 0 if a column is missing."""
    out = np.zeros((len(table.frame), 3))
    for k, name in enumerate(("head", "pitch", "roll")):
        if f"{name}{end}" in table.frame.columns:
            out[:, k] = np.radians(table.numbers([f"{name}{end}"])[:, 0])
    return out


def _epoch(settings: _Settings, first: float) -> tuple[np.datetime64, float]:
    """UTC of time 0, and an origin to subtract from the file's times to keep their digits. [s]"""
    origin = float(np.floor(first / 86400.0) * 86400.0) if first > _MAX_TIME_OF_DAY else 0.0
    since_1970 = origin - _MJD_1970 if first > _MJD_1970 else origin
    if since_1970 > _LATEST:
        raise LocateError(
            f"{settings.path}: ST is {first:.17g} s, which is no time of day and no date; correct"
            " it"
        )
    if first > _MAX_TIME_OF_DAY:
        return np.datetime64(round(since_1970), "s").astype("datetime64[ns]"), origin
    date = settings.text("Obs-parameter", "Date(UTC)", "")
    if not date:
        return np.datetime64("NaT", "ns"), origin
    try:
        return parse_instant(date), origin
    except OceanError:
        raise LocateError(
            f"{settings.path}: [Obs-parameter] Date(UTC) is {date[:40]!r}; it must be a date such"
            " as 2018-04-24"
        ) from None


def _profile(path: Path) -> tuple[Array, Array]:
    """Depth and sound speed of a profile with columns ``depth`` and ``speed``."""
    table = read_text_table(path)
    depth, speed = table.numbers(["depth", "speed"]).T
    if (np.diff(depth) <= 0.0).any():
        row = int(np.argmax(np.diff(depth) <= 0.0)) + 1
        raise LocateError(
            f"{table.where(row)}: depth {depth[row]:g} m does not increase; sort the rows"
        )
    return depth, speed


def _find(settings: _Settings, name: str) -> Path:
    """File named in an ini file, relative to the working folder, the ini file or a parent."""
    relative_path = Path(name.replace("\\", "/"))
    here = settings.path.resolve().parent
    folders = [Path(), here, *here.parents]
    for candidate in [*(folder / relative_path for folder in folders), here / relative_path.name]:
        if exists(candidate) and not candidate.is_dir():
            return candidate
    raise LocateError(
        f"{settings.path}: {name} is neither in the working folder nor in a folder above the ini"
        " file; correct its path"
    )

"""
Reader of GARPOS surveys from their ini file.

Columns, signs and units follow the documentation of https://github.com/s-watanabe-jhod/garpos:
east, north and up from the site's origin; ``ATDoffset`` forward, rightward and downward; attitudes
in degrees; ``flag`` is true for unused pings. ``TT`` is the travel time without the transponder's
delay. Depths are below the origin's ``Height0``.
"""

import configparser
from pathlib import Path

import numpy as np

from pymantaray.apps.locate.read_options import ReadOptions
from pymantaray.apps.locate.read_rows import attitudes, possible_rows
from pymantaray.apps.locate.survey import LeverArm, Node, Survey
from pymantaray.arrays import Array
from pymantaray.errors import LocateError, OceanError
from pymantaray.geometry import LocalFrame
from pymantaray.ocean.convert import parse_instant
from pymantaray.quantities.checks import parsed_number
from pymantaray.records.invalid_lines import InvalidLines
from pymantaray.records.position_rows import (
    FASTEST_PLATFORM,
    PositionRows,
    is_position,
    order_of_times,
)
from pymantaray.records.text_table import TextTable, check_seconds, read_text_table
from pymantaray.user_files import exists, read_text

_DAY = 86400.0  # s
_MAX_TIME_OF_DAY = 40.0 * 86400.0  # s; larger times are since 1970, or modified Julian dates
_LATEST = 9e9  # s since 1970; 64-bit nanoseconds end in 2262
_MJD_1970 = 40587 * 86400.0
_REQUIRED = ["TT", "ST", "ant_n0", "ant_e0", "ant_u0"]
_SECOND = ["ant_n1", "ant_e1", "ant_u1"]
_ANGLES = [[f"{angle}{end}" for angle in ("head", "pitch", "roll")] for end in "01"]
_TRUE = ("true", "t", "1", "1.0", "yes")


class _Settings:
    """Entries of an ini file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._parser = configparser.ConfigParser(
            interpolation=None, strict=False, allow_no_value=True
        )
        text = read_text(path, LocateError, what="an ini file", errors="replace")
        try:
            self._parser.read_string(text, str(path))
        # AttributeError: a line continues a key without value
        except (configparser.Error, AttributeError) as error:
            raise LocateError(
                f"{path}: not a readable ini file: {' '.join(str(error).split())[:100]}"
            ) from None

    def text(self, section: str, key: str, default: str | None = None) -> str:
        """Text of an entry, or its default; a missing entry without default raises an error."""
        value = self._parser.get(section, key, fallback=default)
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

    def vector(self, key: str, default: str | None = None) -> tuple[list[float], list[float]]:
        """Three components of an entry of the model, and their standard deviations, else 0."""
        values = [*self.numbers("Model-parameter", key, 3, default), 0.0, 0.0, 0.0]
        return values[:3], values[3:6]

    def file(self, name: str) -> Path:
        """File of a name, relative to the working folder, the ini file or a parent."""
        relative_path = Path(name.replace("\\", "/"))
        here = self.path.resolve().parent
        files = [folder / relative_path for folder in (Path(), here, *here.parents)]
        for candidate in [*files, here / relative_path.name]:
            if exists(candidate) and not candidate.is_dir():
                return candidate
        raise LocateError(
            f"{self.path}: {name} is neither in the working folder nor in a folder above the ini"
            " file; correct its path"
        )


def read_garpos(path: Path, options: ReadOptions) -> Survey:
    """Read the survey of an array."""
    # site and nodes
    settings = _Settings(path)
    latitude, longitude = (
        settings.numbers("Site-parameter", key, 1)[0] for key in ("Latitude0", "Longitude0")
    )
    if not is_position(latitude, longitude):
        raise LocateError(
            f"{path}: site at {latitude:g}, {longitude:g}; degrees within 90 and 360 are needed"
        )
    names = settings.text("Site-parameter", "Stations").split()
    nodes, rigid = _nodes(settings, names)
    # rows that can be read, at possible positions
    invalid = InvalidLines()
    table = read_text_table(settings.file(settings.text("Data-file", "datacsv")), invalid=invalid)
    columns = set(table.frame.columns)
    others = {"RT", *_SECOND, *_ANGLES[0], *_ANGLES[1]} & columns
    table = table.readable(invalid, words=["MT"], numbers=[*_REQUIRED, *sorted(others)])
    invalid.refuse_most(len(table.frame), LocateError)
    positions = PositionRows(table.path, LocateError, fastest=FASTEST_PLATFORM)
    ends = [(table.optional("ST"), "ant_n0", "ant_e0")]
    if "RT" in columns:
        ends.append((table.optional("RT"), "ant_n1", "ant_e1"))
    everywhere = np.ones(len(table.frame), dtype=bool)
    table = possible_rows(table, positions, everywhere, ends, geographic=False)
    # survey in order of time
    survey = _survey(settings, table, nodes, names)
    profile = settings.text("Obs-parameter", "SoundSpeed", "")
    offset, sigma = settings.vector("ATDoffset", "0 0 0")
    height = settings.numbers("Site-parameter", "Height0", 1, "0")[0]
    origin = f"{path}: depths are relative to the site's origin, {height:g} m above the ellipsoid"
    survey = survey.assign(
        lever=LeverArm((offset[0], offset[1], offset[2]), (sigma[0], sigma[1], sigma[2])),
        rigid=rigid,
        profile=_profile(settings.file(profile)) if profile else None,
        frame=LocalFrame(latitude, longitude),
        depth_reference="plane",
        notes=(origin, *survey.notes, *invalid.notes, *positions.notes),
    )
    return options.apply(survey)


def _nodes(
    settings: _Settings, names: list[str]
) -> tuple[tuple[Node, ...], tuple[float, float, float, float] | None]:
    """Nodes, and priors of a rigid array if the stations are fixed and the centre is not."""
    centre, sigma_centre = settings.vector("dCentPos", "0 0 0")
    nodes = []
    for name in names:
        station, sigma = settings.vector(f"{name}_dPos")
        east, north, up = np.add(station, centre).tolist()
        nodes.append(Node(name, (north, east, -up), (sigma[1], sigma[0], sigma[2])))
    if any(any(node.sigma) for node in nodes):
        return tuple(nodes), None
    if not any(sigma_centre):
        raise LocateError(
            f"{settings.path}: all sigmas of stations and of dCentPos are 0; at least one must"
            " be positive"
        )
    return tuple(nodes), (sigma_centre[1], sigma_centre[0], sigma_centre[2], 0.0)


def _survey(
    settings: _Settings, table: TextTable, nodes: tuple[Node, ...], names: list[str]
) -> Survey:
    """Survey of a table in order of time."""
    # times of transmission and reception
    columns = set(table.frame.columns)
    travel_time, transmit_time, *position = table.numbers(_REQUIRED).T
    check_seconds(transmit_time, f"{table.path}: ST", LocateError)
    receive_time = table.numbers(["RT"])[:, 0] if "RT" in columns else transmit_time + travel_time
    is_before = receive_time <= transmit_time
    if is_before.any():
        row = int(np.argmax(is_before))
        raise LocateError(
            f"{table.where(row)}: RT {receive_time[row]:.6f} is not after ST"
            f" {transmit_time[row]:.6f}; both must be in seconds"
        )
    # positions at both times, with depths instead of heights
    down = np.array([1.0, 1.0, -1.0])
    transmit_position = receive_position = np.column_stack(position) * down
    if set(_SECOND) <= columns:
        receive_position = table.numbers(_SECOND) * down
    # each ping names a station
    transponders = table.frame["MT"].tolist()
    for row, transponder in enumerate(transponders):
        if transponder not in names:
            raise LocateError(
                f"{table.where(row)}: transponder {transponder!r} is not a station of the site;"
                f" allowed: {', '.join(names)}"
            )
    # the survey, in order of time
    epoch, origin = _epoch(settings, float(transmit_time.min()))
    transmit_attitude, receive_attitude = attitudes(table, _ANGLES)
    survey = Survey(
        nodes=nodes,
        node=np.array([names.index(transponder) for transponder in transponders]),
        time=transmit_time - origin,
        travel_time=travel_time,
        transmit_position=transmit_position,
        receive_position=receive_position,
        transmit_attitude=transmit_attitude,
        receive_attitude=receive_attitude,
        flagged=np.array([word.lower() in _TRUE for word in table.words("flag")]),
        line=table.lines,
        epoch=epoch,
        source=str(table.path),
    )
    order, note = order_of_times(
        transmit_time, table.where, LocateError, dated=bool(transmit_time.max() > _DAY)
    )
    if order is None or note is None:
        return survey
    return survey.rows(order).assign(notes=(note,))


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

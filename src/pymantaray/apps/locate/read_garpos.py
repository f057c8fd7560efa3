"""
Reader of GARPOS surveys from their ini file: site, stations with priors, antenna to transducer,
pings and profile.

Columns, signs and units follow the documentation of https://github.com/s-watanabe-jhod/garpos:
east, north and up from the site's origin; ``ATDoffset`` forward, rightward and downward; attitudes
in degrees; ``flag`` is true for unused pings. ``TT`` is the travel time without the transponder's
delay. Depths are below the origin's ``Height0``.
"""

import configparser
from pathlib import Path

import numpy as np

from pymantaray.apps.locate.read_options import ReadOptions
from pymantaray.apps.locate.survey import LeverArm, Node, Survey
from pymantaray.arrays import Array
from pymantaray.errors import LocateError, OceanError
from pymantaray.geometry import LocalFrame
from pymantaray.ocean.convert import parse_instant
from pymantaray.records.invalid_lines import InvalidLines
from pymantaray.records.text_table import TextTable, check_seconds, read_text_table
from pymantaray.user_files import exists, read_text

_MAX_TIME_OF_DAY = 40.0 * 86400.0  # s; larger times are since 1970, or modified Julian dates
_LATEST = 9e9  # s since 1970; 64-bit nanoseconds end in 2262
_MJD_1970 = 40587 * 86400.0
_REQUIRED = ["TT", "ST", "ant_e0", "ant_n0", "ant_u0"]
_NUMBERS = [
    *("RT", "ant_e1", "ant_n1", "ant_u1"),
    *(f"{angle}{end}" for end in "01" for angle in ("head", "pitch", "roll")),
]
_TRUE = ("true", "t", "1", "1.0", "yes")


class _Settings:
    """Entries of an ini file by case-insensitive section and key."""

    def __init__(self, path: Path) -> None:
        self.path = path
        parser = configparser.ConfigParser(interpolation=None, strict=False, allow_no_value=True)
        try:
            parser.read_string(
                read_text(path, LocateError, what="an ini file", errors="replace"), str(path)
            )
        except (
            configparser.Error,
            AttributeError,
        ) as error:  # AttributeError: a line continues a key without value
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
            values = [float(word) for word in text.replace(",", " ").split()]
        except ValueError:
            values = []
        if len(values) < least or not np.isfinite(values).all():
            raise LocateError(
                f"{self.path}: [{section}] {key} is {text!r}; it must be {least} finite numbers"
            )
        return values


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
    there = set(table.frame.columns)
    table = table.readable(
        invalid, words=["MT"], numbers=[*_REQUIRED, *(n for n in _NUMBERS if n in there)]
    )
    invalid.refuse_most(len(table.frame), LocateError)
    survey = _survey(settings, table, nodes, names)
    profile = settings.text("Obs-parameter", "SoundSpeed", "")
    lever = settings.numbers("Model-parameter", "ATDoffset", 3, "0 0 0")
    sigma = (lever + [0.0] * 3)[3:6]
    height = settings.numbers("Site-parameter", "Height0", 1, "0")[0]
    return options.applied(
        survey.changed(
            lever=LeverArm((lever[0], lever[1], lever[2]), (sigma[0], sigma[1], sigma[2])),
            rigid=rigid,
            profile=None if not profile else _profile(_find(settings, profile)),
            frame=LocalFrame(latitude, longitude),
            notes=(
                (
                    f"{path}: depths are relative to the site's origin, {height:g} m above the"
                    " ellipsoid"
                ),
                *invalid.notes,
            ),
        )
    )


def _nodes(
    settings: _Settings, names: list[str]
) -> tuple[tuple[Node, ...], tuple[float, float, float, float] | None]:
    """
    Nodes with priors, and priors of a rigid array if the stations are fixed and the centre is not.
    """
    centre = settings.numbers("Model-parameter", "dCentPos", 3, "0 0 0")
    centre_sigma = (centre + [0.0] * 3)[3:6]
    nodes = []
    for name in names:
        east, north, up, *rest = settings.numbers("Model-parameter", f"{name}_dPos", 3)
        sigma = (rest + [0.0] * 3)[:3]
        position = (north + centre[1], east + centre[0], -(up + centre[2]))
        nodes.append(Node(name, position, (sigma[1], sigma[0], sigma[2])))
    if not any(any(node.sigma) for node in nodes):
        if not any(centre_sigma):
            raise LocateError(
                f"{settings.path}: all sigmas of stations and of dCentPos are 0; at least one must"
                " be positive"
            )
        return tuple(nodes), (centre_sigma[1], centre_sigma[0], centre_sigma[2], 0.0)
    return tuple(nodes), None


def _survey(
    settings: _Settings, table: TextTable, nodes: tuple[Node, ...], names: list[str]
) -> Survey:
    columns = set(table.frame.columns)
    time, sent, e0, n0, u0 = table.numbers(_REQUIRED).T
    check_seconds(sent, f"{table.path}: ST", LocateError)
    near = np.column_stack([n0, e0, -u0])
    received = table.numbers(["RT"])[:, 0] if "RT" in columns else sent + time
    if (received <= sent).any():
        row = int(np.argmax(received <= sent))
        raise LocateError(
            f"{table.where(row)}: RT {received[row]:.6f} is not after ST {sent[row]:.6f}; both must"
            " be in seconds"
        )
    away = near
    if {"ant_e1", "ant_n1", "ant_u1"} <= columns:
        e1, n1, u1 = table.numbers(["ant_e1", "ant_n1", "ant_u1"]).T
        away = np.column_stack([n1, e1, -u1])
    unknown = [mt for mt in table.frame["MT"] if mt not in names]
    if unknown:
        raise LocateError(
            f"{table.where(table.frame['MT'].tolist().index(unknown[0]))}: transponder"
            f" {unknown[0]!r} is not a station of the site; allowed: {', '.join(names)}"
        )
    number = {name: k for k, name in enumerate(names)}
    flags = (
        table.frame["flag"].str.lower().isin(_TRUE).to_numpy()
        if "flag" in columns
        else np.zeros(time.size, bool)
    )
    order = np.argsort(sent, kind="stable")
    epoch, shift = _epoch(settings, float(sent.min()))
    return Survey(
        nodes=nodes,
        node=np.array([number[mt] for mt in table.frame["MT"]])[order],
        time=(sent - shift)[order],
        travel_time=time[order],
        transmit_position=near[order],
        receive_position=away[order],
        transmit_attitude=_attitude(table, "0")[order],
        receive_attitude=_attitude(table, "1" if "head1" in columns else "0")[order],
        flagged=flags[order],
        line=table.frame.index.to_numpy(dtype=np.int64)[order],
        epoch=epoch,
        source=str(table.path),
    )


def _attitude(table: TextTable, end: str) -> Array:
    """Heading, pitch, roll [rad]; 0 if a column is missing."""
    out = np.zeros((len(table.frame), 3))
    for k, name in enumerate(("head", "pitch", "roll")):
        if f"{name}{end}" in table.frame.columns:
            out[:, k] = np.radians(table.numbers([f"{name}{end}"])[:, 0])
    return out


def _epoch(settings: _Settings, first: float) -> tuple[np.datetime64, float]:
    """
    UTC of time 0, and an offset to subtract from the file's times to preserve their digits. [s]
    """
    shift = float(np.floor(first / 86400.0) * 86400.0) if first > _MAX_TIME_OF_DAY else 0.0
    since_1970 = shift - _MJD_1970 if first > _MJD_1970 else shift
    if since_1970 > _LATEST:
        raise LocateError(
            f"{settings.path}: ST is {first:.17g} s, which is no time of day and no date; correct"
            " it"
        )
    if first > _MAX_TIME_OF_DAY:
        return np.datetime64(round(since_1970), "s").astype("datetime64[ns]"), shift
    date = settings.text("Obs-parameter", "Date(UTC)", "")
    if not date:
        return np.datetime64("NaT", "ns"), shift
    try:
        return parse_instant(date), shift
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
    """
    File named in an ini file, relative to the working folder, to the ini file, or to a folder above
    it.
    """
    wanted = Path(name.replace("\\", "/"))
    here = settings.path.resolve().parent
    folders = [Path(), here, *here.parents]
    for candidate in [*(folder / wanted for folder in folders), here / wanted.name]:
        if exists(candidate) and not candidate.is_dir():
            return candidate
    raise LocateError(
        f"{settings.path}: {name} is neither in the working folder nor in a folder above the ini"
        " file; correct its path"
    )

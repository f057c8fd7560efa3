"""Events: measured one-way travel times with the names and positions of source and receiver."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pymantaray.arrays import Array
from pymantaray.errors import RecordError, ReplayError
from pymantaray.quantities.checks import checked_array
from pymantaray.records.invalid_lines import InvalidLines
from pymantaray.records.position_rows import (
    FASTEST_PLATFORM,
    PositionRows,
    distances,
    order_of_times,
    repeated_note,
    repeated_rows,
)
from pymantaray.records.text_table import TextTable, read_text_table

Names = NDArray[np.str_]
ENDS = ("source", "receiver")
_AXES = {True: ("lat", "lon", "depth"), False: ("north", "east", "depth")}
"""Axes of positions by `Events.geographic`."""
_MILLISECONDS = (300.0, 3000.0)  # ratio of times with a wrong unit
_AS_RADIANS = (2.0, 200.0)  # the same of positions in radians, about 57
_RADIANS = (0.5 * np.pi, np.pi)  # largest latitude and longitude
_SOUND_SPEED = 1500.0  # m/s
_ECHO_METRES = 1.0  # between the ends of an echo
_ECHO_DEGREES = 1e-5
_MAX_TIME = 3600.0  # s; a longer travel time is in another unit


@dataclass(frozen=True, eq=False)
class Events:
    r"""
    Receptions whose one-way travel time was measured.

    Parameters
    ----------
    time : array_like, shape (n,)
        Time of emission, since any instant. [s]
    source, receiver : array_like of str, shape (n,)
        Names of the nodes at both ends. If they are the same, the time is that of an echo at the
        surface or the sea bed, as from an inverted echo sounder.
    source_position, receiver_position : array_like, shape (n, 3)
        Latitude, longitude [degrees] and depth [m] if ``geographic``, else north, east and depth in
        a local frame [m].
    travel_time : array_like, shape (n,)
        Receiver's clock at the reception minus the source's clock at the emission. [s]
    geographic : bool
    sigma : array_like, shape (n,), optional
        Standard deviation of the travel times, NaN if unknown, as by default. [s]
    cast : array_like of str, shape (n,), optional
        Name of the cast of the event, empty for the nearest in time, as by default.
    level_db : array_like, shape (n,), optional
        Received level in any unit of dB, NaN if unknown, as by default.
    epoch : numpy.datetime64
        UTC of time 0; NaT, the default, if only differences of time are known.
    notes : sequence of str
        Lines that the reader left out.

    Examples
    --------
    Continues the example of `pymantaray.apps.replay`:

    >>> events.receiver.tolist(), events.geographic
    (['B', 'A', 'B', 'A', 'B', 'A'], False)
    """

    time: Array
    source: Names
    receiver: Names
    source_position: Array
    receiver_position: Array
    travel_time: Array
    geographic: bool
    sigma: Array = field(default_factory=lambda: np.empty(0))
    cast: Names = field(default_factory=lambda: np.empty(0, dtype=str))
    epoch: np.datetime64 = field(default_factory=lambda: np.datetime64("NaT", "ns"))
    notes: tuple[str, ...] = ()
    level_db: Array = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        """Check shapes and values."""
        # numbers that every event has
        n = np.size(self.travel_time)
        for name, shape in (
            ("travel_time", (None,)),
            ("time", (n,)),
            ("source_position", (n, 3)),
            ("receiver_position", (n, 3)),
        ):
            values = checked_array(ReplayError, f"events: {name}", getattr(self, name), shape)
            object.__setattr__(self, name, values)
        # names and optional columns
        for name, kind, default in (
            ("source", str, None),
            ("receiver", str, None),
            ("cast", str, ""),
            ("sigma", float, np.nan),
            ("level_db", float, np.nan),
        ):
            values = np.array(getattr(self, name), dtype=kind)
            if default is not None and not values.size:
                values = np.full(n, default)
            if values.shape != (n,):
                raise ReplayError(f"events: {name} has shape {values.shape}; it needs ({n},)")
            object.__setattr__(self, name, values)
        # values that no event can have
        self._refuse(
            "travel_time",
            ~((self.travel_time > 0.0) & (self.travel_time < _MAX_TIME)),
            f"seconds above 0, below {_MAX_TIME:g}",
        )
        self._refuse("sigma", self.sigma <= 0.0, "seconds above 0, or empty")
        differs = np.abs(self.source_position - self.receiver_position)
        tolerance = _ECHO_DEGREES if self.geographic else _ECHO_METRES
        has_moved = (differs > [tolerance, tolerance, _ECHO_METRES]).any(axis=1)
        self._refuse(
            "source and receiver",
            self.is_echo & has_moved,
            "two nodes, or one node at one position, for an echo",
        )
        if self.geographic:
            for name in ("source_position", "receiver_position"):
                lat, lon = getattr(self, name)[:, :2].T
                wrong = (np.abs(lat) > 90.0) | (np.abs(lon) > 360.0)
                self._refuse(name, wrong, "latitude in -90 to 90, longitude in -360 to 360 degrees")

    def _refuse(self, name: str, wrong: NDArray[np.bool_], requirement: str) -> None:
        if wrong.any():
            row = int(np.argmax(wrong))
            values = " and ".join(str(getattr(self, part)[row]) for part in name.split(" and "))
            raise ReplayError(
                f"events: {name} of event {row + 1} is {values}; allowed: {requirement}"
            )

    @property
    def pair(self) -> Names:
        """Unordered pair of each event, its names in alphabetical order."""
        ends = np.sort(np.stack([self.source, self.receiver]), axis=0)
        return np.char.add(np.char.add(ends[0], " and "), ends[1])

    @property
    def is_echo(self) -> NDArray[np.bool_]:
        """True for times from an instrument to itself, by a reflection."""
        return np.asarray(self.source == self.receiver)

    @property
    def instant(self) -> NDArray[np.datetime64]:
        """UTC of each emission; NaT if only differences are known."""
        return self.epoch + np.round(1e9 * self.time).astype("timedelta64[ns]")


def read_events(path: str | Path, nodes: str | Path | None = None) -> Events:
    r"""
    Read measured travel times from a table.

    Parameters
    ----------
    path : str or pathlib.Path
        Columns ``time`` (UTC as ``2020-03-10T12:00:00``, or seconds), ``source`` and ``receiver``
        (names), ``source_lat``, ``source_lon``, ``source_depth`` and the same of the receiver
        [degrees, m], or ``_north`` and ``_east`` for ``_lat`` and ``_lon`` [m], and ``travel_time``
        [s]; optionally ``sigma`` [s], ``cast`` (a name) and ``level_db`` (received
        level). Other columns are ignored.
    nodes : str or pathlib.Path, optional
        Table of fixed nodes with ``name``, ``lat``, ``lon`` and ``depth`` (or ``north`` and
        ``east``), as `mantaray locate` writes it. Its positions replace those of the events, whose
        cells for these nodes, or whole columns, may be empty.

    Returns
    -------
    Events

    Raises
    ------
    ReplayError
        If a column is missing, or a value is impossible. Lines that cannot be parsed are left out
        with a note, and an error if they are half of the file or more.

    Examples
    --------
    >>> from pathlib import Path
    >>> from pymantaray.apps.replay import read_events
    >>> axes = ("north", "east", "depth")
    >>> ends = [f"{end}_{axis}" for end in ("source", "receiver") for axis in axes]
    >>> head = ",".join(["time", "source", "receiver", *ends, "travel_time"])
    >>> _ = Path("events.csv").write_text(head + "\n0,A,B,0,0,30,1500,0,150,1.03\n")
    >>> read_events("events.csv").travel_time
    array([1.03])
    """
    invalid = InvalidLines()
    try:
        table = read_text_table(path, invalid=invalid)
        return _events(
            table if nodes is None else _with_positions(table, read_text_table(nodes)), invalid
        )
    except RecordError as error:
        raise ReplayError(str(error)) from None


def _events(table: TextTable, invalid: InvalidLines) -> Events:
    path = table.path
    columns = set(table.frame.columns)
    geographic = {f"{end}_lat" for end in ENDS} <= columns
    if geographic and "source_north" in columns:
        raise ReplayError(
            f"{path}: has positions in lat, lon and in north, east; keep one of the two"
        )
    source_columns, receiver_columns = (
        [f"{end}_{axis}" for axis in _AXES[geographic]] for end in ENDS
    )
    numbers = [*source_columns, *receiver_columns, "travel_time"]
    table.require(["time", *ENDS, *numbers, *sorted({"sigma", "cast", "level_db"} & columns)])
    table = table.readable(
        invalid, times=["time"], numbers=numbers, words=ENDS, optional=["sigma", "level_db"]
    )
    invalid.refuse_most(len(table.frame), ReplayError)
    table, notes = _possible(table, geographic=geographic)
    names = {end: table.words(end) for end in ENDS}
    time, epoch = table.seconds("time")
    events = Events(
        time=time,
        source=np.array(names["source"]),
        receiver=np.array(names["receiver"]),
        source_position=table.numbers(source_columns),
        receiver_position=table.numbers(receiver_columns),
        travel_time=table.numbers(["travel_time"])[:, 0],
        geographic=geographic,
        sigma=table.optional("sigma"),
        cast=np.array(table.words("cast")),
        epoch=epoch,
        notes=(*invalid.notes, *notes),
        level_db=table.optional("level_db"),
    )
    _check_unit(path, events)
    return events


def _possible(table: TextTable, *, geographic: bool) -> tuple[TextTable, tuple[str, ...]]:
    """
    Events with possible positions, each once, and notes about the others.

    The positions of a node are those of both ends of its events.
    """
    line = table.lines
    time, epoch = table.seconds("time")
    keys = [table.frame[end].to_numpy() for end in ENDS]
    repeated = repeated_rows([time, *keys, table.numbers(["travel_time"])[:, 0]])
    notes = [repeated_note(table.path, line[repeated].tolist())] if repeated.any() else []
    keep = ~repeated
    positions = PositionRows(table.path, ReplayError, fastest=FASTEST_PLATFORM)
    places = np.stack([table.numbers([f"{end}_{a}" for a in _AXES[geographic]]) for end in ENDS])
    names = np.stack([table.words(end) for end in ENDS])
    rows = np.broadcast_to(np.arange(time.size), names.shape)
    for name in np.unique(names).tolist():
        of_node = (names == name) & keep
        possible = positions.possible(
            time[rows[of_node]],
            places[of_node],
            line[rows[of_node]],
            geographic=geographic,
            who=name,
            stated_degrees=True,
        )
        keep[rows[of_node][~possible]] = False
    positions.refuse_most(int(keep.sum()))
    # events may have any order, but times of day must not pass midnight
    order_of_times(time, table.where, ReplayError, dated=not np.isnat(epoch))
    return replace(table, frame=table.frame[keep]), (*notes, *positions.notes)


def _check_unit(path: Path, events: Events) -> None:
    """Raise an error if travel times are thousands of times too long or too short."""
    first, second = events.source_position, events.receiver_position
    horizontal = distances(first, second, geographic=events.geographic)
    straight_time = np.hypot(horizontal, first[:, 2] - second[:, 2]) / _SOUND_SPEED
    apart = ~events.is_echo & (straight_time > 0.0)
    if not apart.any():
        return
    ratio = float(np.median(events.travel_time[apart] / straight_time[apart]))
    places = np.concatenate([first, second])[:, :2]
    low, high = _AS_RADIANS
    if events.geographic and low < ratio < high and (np.abs(places) <= _RADIANS).all():
        raise ReplayError(
            f"{path}: travel_time is {ratio:.3g} times the distance over {_SOUND_SPEED:g} m/s, and"
            f" positions such as {places[0, 0]:g}, {places[0, 1]:g} look like radians; convert them"
            " to degrees"
        )
    low, high = _MILLISECONDS
    if low < ratio < high or low * ratio < 1.0 < high * ratio:
        raise ReplayError(
            f"{path}: travel_time is {ratio:.3g} times the distance over {_SOUND_SPEED:g} m/s"
            f" (median {np.median(events.travel_time):g} s); it must be in seconds"
        )


def _with_positions(table: TextTable, nodes: TextTable) -> TextTable:
    """Table with the positions of nodes from another table, in its coordinates."""
    geographic = "source_lat" in table.frame.columns or "receiver_lat" in table.frame.columns
    axes = _AXES[geographic]
    nodes.require(["name", *axes])
    names = nodes.words("name")
    table.require(list(ENDS))
    frame = table.frame.copy()
    for end in ENDS:
        node = frame[end].str.strip()
        has_position = node.isin(names).to_numpy()
        for axis in axes:
            coordinates = dict(zip(names, nodes.frame[axis].tolist(), strict=True))
            column = f"{end}_{axis}"
            cells = frame[column] if column in frame.columns else frame[end].map(lambda _: "")
            frame[column] = cells.where(~has_position, node.map(coordinates).fillna(""))
    return replace(table, frame=frame)

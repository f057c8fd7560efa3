"""
Reader of Bellhop's output as records in SI units: arrivals (`.arr`, text or binary) and rays
(`.ray`).
"""

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from pymantaray.arrays import Array
from pymantaray.errors import AcousticsError
from pymantaray.records.base import Column, Record, column
from pymantaray.user_files import read_bytes

MAX_OUTPUT_BYTES = 2_000_000_000
_GRID = "source_depth source_north source_east receiver_bearing receiver_depth receiver_range"
_DECLINATION = "angle from the horizontal, positive down,"
# length of the first record of a binary file, which has four letters with its kind
_RECORD_MARK = bytes([4, 0, 0, 0])
_RAYS = re.compile(r"\s*'[^']*'([^']*)'(\w+)\s*'(.*)", re.DOTALL)  # title, head, coordinates, rays
_COORDINATES = {"xyz": 3, "rz": 2}


@dataclass(frozen=True, eq=False)
class BellhopArrivals(Record):
    """
    Arrivals and the grid of sources and receivers; Bellhop's x is north and y is east. Azimuths are
    NaN in a 2-D file.
    """

    kind: ClassVar[str] = "bellhop_arrivals"

    frequency: Column = column("", "Hz", "frequency")
    source_depth: Column = column("source_depth", "m", "depth of the sources")
    source_north: Column = column("source_north", "m", "north of the sources, Bellhop's x")
    source_east: Column = column("source_east", "m", "east of the sources, Bellhop's y")
    receiver_bearing: Column = column(
        "receiver_bearing", "rad", "bearing of the receivers from the source"
    )
    receiver_depth: Column = column("receiver_depth", "m", "depth of the receivers")
    receiver_range: Column = column("receiver_range", "m", "horizontal range of the receivers")
    count: Column = column(_GRID, "1", "number of arrivals", "i8")
    pair: Column = column("arrival", "1", "index into the flat count, last dimension fastest", "i8")
    travel_time: Column = column("arrival", "s", "travel time")
    travel_time_imaginary: Column = column("arrival", "s", "imaginary part, from absorption")
    amplitude: Column = column("arrival", "1", "pressure amplitude relative to 1 m")
    phase: Column = column("arrival", "rad", "phase change by reflections and caustics")
    launch_declination: Column = column("arrival", "rad", f"{_DECLINATION} at the source")
    launch_azimuth: Column = column("arrival", "rad", "azimuth at the source")
    arrival_declination: Column = column("arrival", "rad", f"{_DECLINATION} at the receiver")
    arrival_azimuth: Column = column("arrival", "rad", "azimuth at the receiver")
    surface_bounces: Column = column("arrival", "1", "reflections at the surface", "i4")
    bottom_bounces: Column = column("arrival", "1", "reflections at the sea bed", "i4")

    def first_direct(self) -> Array:
        """
        Travel time of the earliest arrival without a bounce for every source and receiver; NaN if
        none exists. [s]
        """
        first = np.full(self.count.size, np.inf)
        direct = (self.surface_bounces == 0) & (self.bottom_bounces == 0)
        np.minimum.at(first, self.pair[direct], self.travel_time[direct])
        return np.where(np.isfinite(first), first, np.nan).reshape(self.count.shape)


@dataclass(frozen=True, eq=False)
class BellhopRays(Record):
    """
    Nodes of all rays in succession, and one row per ray; in a 2-D file, north is the range and east
    is 0.
    """

    kind: ClassVar[str] = "bellhop_rays"

    frequency: Column = column("", "Hz", "frequency")
    ray: Column = column("node", "1", "ray of the node", "i8")
    position: Column = column("node axis", "m", "north, east, down")
    launch_declination: Column = column("n_rays", "rad", f"{_DECLINATION} at the source")
    launch_azimuth: Column = column("n_rays", "rad", "azimuth at the source, of the first step")
    surface_bounces: Column = column("n_rays", "1", "reflections at the surface", "i4")
    bottom_bounces: Column = column("n_rays", "1", "reflections at the sea bed", "i4")


def read_bellhop_arrivals(path: str | Path) -> BellhopArrivals:
    r"""
    Read an `.arr` file of BELLHOP or BELLHOP3D, text or binary; arrivals have the order of the
    file, not that of time.

    Bellhop stores travel times in single precision: the resolution is 0.24 us from 2 to 4 s and
    0.48 us from 4 to 8 s.

    Parameters
    ----------
    path : str or pathlib.Path
        File with the mark 2D or 3D in its first line, as Bellhop has written it since 2018, and a
        rectilinear grid of receivers.

    Returns
    -------
    BellhopArrivals
        Arrivals in SI units.

    Raises
    ------
    AcousticsError
        If the file is unreadable, damaged, older, or has an irregular grid of receivers.

    Examples
    --------
    >>> from pathlib import Path
    >>> from pymantaray.apps.bellhop import read_bellhop_arrivals
    >>> numbers = "10000 1 500 1 400 1 1000 1 1 9.5e-5 0 0.6692 0 -3 -3 0 0"
    >>> _ = Path("link.arr").write_text(f"'2D'\n{numbers}")
    >>> print(read_bellhop_arrivals("link.arr").travel_time)
    [0.6692]
    """
    file = Path(path)
    content = _content(file)
    stream: _Text | _Binary
    if content.startswith(_RECORD_MARK):
        stream = _Binary(file, content)
        mark = stream.record(4).decode("ascii", "replace")
    else:
        mark, _, text = content.decode("utf-8", "replace").lstrip().partition("\n")
        stream = _Text(file, text)
    mark = mark.strip().strip("' ")
    if mark not in ("2D", "3D"):
        raise AcousticsError(
            f"{file}: starts with {mark!r}; it must start with '2D' or '3D', as Bellhop has"
            " written it since 2018"
        )
    arrivals = _arrivals(stream, three_d=mark == "3D")
    if stream.left():
        raise AcousticsError(f"{file}: {stream.left()} numbers follow the last arrival")
    return arrivals


def read_bellhop_rays(path: str | Path) -> BellhopRays:
    """
    Read a `.ray` file of BELLHOP or BELLHOP3D; rays have the order of the file.

    Some programs write the launch angle of a ray in degrees, others in radians. The function
    chooses the unit that agrees better with the direction of the first step.

    Parameters
    ----------
    path : str or pathlib.Path
        File with rays.

    Returns
    -------
    BellhopRays
        Nodes and rays in SI units.

    Raises
    ------
    AcousticsError
        If the file is unreadable or damaged.

    Examples
    --------
    >>> from pathlib import Path
    >>> from pymantaray.apps.bellhop import read_bellhop_rays
    >>> head = "'one ray' 10000 1 1 1 1 1 0 2000 'rz'"
    >>> _ = Path("link.ray").write_text(f"{head} -30 2 0 0 0 500 346.41 300")
    >>> print(read_bellhop_rays("link.ray").position)
    [[  0.     0.   500.  ]
     [346.41   0.   300.  ]]
    """
    file = Path(path)
    parts = _RAYS.match(_content(file).decode("utf-8", "replace"))
    if parts is None or parts[2] not in _COORDINATES:
        raise AcousticsError(f"{file}: the kind of coordinates is neither 'xyz' nor 'rz'")
    columns = _COORDINATES[parts[2]]
    frequency = _Text(file, parts[1]).take(1)[0]
    stream = _Text(file, parts[3])
    heads = []
    nodes = []
    while stream.left():
        written = stream.take(1)[0]
        size = stream.whole()
        surface = stream.whole()
        bottom = stream.whole()
        points = stream.take(size * columns).reshape(size, columns)
        if columns == 2:
            points = np.insert(points, 1, 0.0, axis=1)
        heads.append((*_launch(written, points), surface, bottom))
        nodes.append(points)
    table = np.array(heads, dtype=float).reshape(-1, 4)
    return BellhopRays(
        frequency=frequency,
        ray=np.repeat(np.arange(len(nodes)), [len(points) for points in nodes]),
        position=np.concatenate([np.empty((0, 3)), *nodes]),
        launch_declination=table[:, 0],
        launch_azimuth=table[:, 1],
        surface_bounces=table[:, 2],
        bottom_bounces=table[:, 3],
    )


class _Text:
    """Numbers of a text with any line breaks; a vector is a count followed by this many numbers."""

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self._at = 0
        words = text.replace("D", "E").split()
        # repeated values as written by some compilers, for example 3*0.0
        for i in [i for i, word in enumerate(words) if "*" in word][::-1]:
            times, _, value = words[i].partition("*")
            words[i : i + 1] = [value] * (int(times) if times.isdigit() else 1)
        try:
            self._values = np.array(words, dtype=float)
        except ValueError as error:
            raise AcousticsError(f"{path}: {error}") from None

    def left(self) -> int:
        return int(self._values.size - self._at)

    def take(self, n: int) -> Array:
        if n > self.left():
            raise AcousticsError(
                f"{self.path}: the file ends early; wait for the end of the run, and use a"
                " rectilinear grid of receivers"
            )
        self._at += n
        return self._values[self._at - n : self._at]

    def whole(self) -> int:
        value = float(self.take(1)[0])
        if not (value.is_integer() and value >= 0.0):
            raise AcousticsError(f"{self.path}: found {value:g}; a count must be here")
        return int(value)

    def vector(self) -> Array:
        return self.take(self.whole())


class _Binary:
    """
    Numbers of four bytes in the records of an unformatted Fortran file, each between two markers of
    its length.
    """

    def __init__(self, path: Path, content: bytes) -> None:
        self.path = path
        self._rest = content

    def left(self) -> int:
        return 0  # other writers may pad

    def record(self, size: int | None = None) -> bytes:
        length = int.from_bytes(self._rest[:4], "little")
        whole = self._rest[4 : 4 + length]
        mark = self._rest[4 + length : 8 + length]
        if len(mark) < 4 or mark != self._rest[:4]:
            raise AcousticsError(f"{self.path}: the file ends early or is damaged")
        if size is not None and length != size:
            raise AcousticsError(f"{self.path}: a record has {length} bytes; it must have {size}")
        self._rest = self._rest[8 + length :]
        return whole

    def take(self, n: int) -> Array:
        return np.frombuffer(self.record(4 * n), dtype="<f4").astype(float)

    def whole(self) -> int:
        return int.from_bytes(self.record(4), "little", signed=True)

    def vector(self) -> Array:
        record = self.record()
        n = int.from_bytes(record[:4], "little")
        if len(record) != 4 * (n + 1) or n == 0:
            raise AcousticsError(f"{self.path}: a list of positions is damaged")
        return np.frombuffer(record[4:], dtype="<f4").astype(float)


def _content(path: Path) -> bytes:
    return read_bytes(path, AcousticsError, what="an output of Bellhop", limit=MAX_OUTPUT_BYTES)


def _arrivals(stream: _Text | _Binary, *, three_d: bool) -> BellhopArrivals:
    # header: frequency, sources and receivers
    frequency = stream.take(1)[0]
    none = np.zeros(1)
    x, y = (stream.vector(), stream.vector()) if three_d else (none, none)
    z = stream.vector()
    receiver_z = stream.vector()
    ranges = stream.vector()
    bearings = np.radians(stream.vector()) if three_d else none
    shape = (z.size, x.size, y.size, bearings.size, receiver_z.size, ranges.size)
    # number of arrivals and their rows, by source and receiver
    counts = np.zeros(math.prod(shape), dtype=np.int64)
    tables = []
    columns = 10 if three_d else 8
    per_source = bearings.size * receiver_z.size * ranges.size
    for pair in range(counts.size):
        if pair % per_source == 0:
            most = stream.whole()
        counts[pair] = n = stream.whole()
        if n > most:
            raise AcousticsError(
                f"{stream.path}: {n} arrivals, but the header announces at most {most}"
            )
        tables += [stream.take(columns) for _ in range(n)]
    # columns of all arrivals
    rows = np.array(tables).reshape(-1, columns)
    if not three_d:  # a 2-D file has no azimuths
        rows = np.insert(rows, [5, 6], np.nan, axis=1)
    return BellhopArrivals(
        frequency=frequency,
        source_depth=z,
        source_north=x,
        source_east=y,
        receiver_bearing=bearings,
        receiver_depth=receiver_z,
        receiver_range=ranges,
        count=counts.reshape(shape),
        pair=np.repeat(np.arange(counts.size), counts),
        amplitude=rows[:, 0],
        phase=np.radians(rows[:, 1]),
        travel_time=rows[:, 2],
        travel_time_imaginary=rows[:, 3],
        launch_declination=np.radians(rows[:, 4]),
        launch_azimuth=np.radians(rows[:, 5]),
        arrival_declination=np.radians(rows[:, 6]),
        arrival_azimuth=np.radians(rows[:, 7]),
        surface_bounces=rows[:, 8],
        bottom_bounces=rows[:, 9],
    )


def _launch(written: float, points: Array) -> tuple[float, float]:
    """Declination and azimuth at the source; NaN for a ray without a step."""
    if len(points) < 2:
        return math.nan, math.nan
    north, east, down = points[1] - points[0]
    seen = math.atan2(down, math.hypot(north, east))
    declination = min(written, math.radians(written), key=lambda angle: abs(angle - seen))
    return declination, math.atan2(east, north)

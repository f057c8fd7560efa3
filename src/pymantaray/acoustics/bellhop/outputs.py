"""The arrivals that Bellhop writes (`.arr`, text or binary) as a record in SI units."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.io import FortranFile

from pymantaray.acoustics.bellhop.listing import ListReader
from pymantaray.acoustics.bellhop.streams import RecordStream, Stream, TextStream
from pymantaray.errors import AcousticsError
from pymantaray.records.base import Column, Record, column

Array = NDArray[np.float64]
_GRID = "source_depth source_north source_east receiver_bearing receiver_depth receiver_range"
_RECORD_MARK = bytes([4, 0, 0, 0])  # length of a binary file's first record: the four letters of its kind


@dataclass(frozen=True, eq=False)
class BellhopArrivals(Record):
    """
    Arrivals as Bellhop wrote them: one row per arrival, and the grid of sources and receivers.

    Bellhop's x is taken for north and y for east. Angles are from the horizontal, positive down, and from
    north towards east; azimuths are NaN in a 2-D file.
    """

    kind: ClassVar[str] = "bellhop_arrivals"

    frequency: Column = column("", "Hz", "frequency")
    source_depth: Column = column("source_depth", "m", "depth of the sources")
    source_north: Column = column("source_north", "m", "north of the sources, Bellhop's x")
    source_east: Column = column("source_east", "m", "east of the sources, Bellhop's y")
    receiver_bearing: Column = column("receiver_bearing", "rad", "bearing of the receivers from the source")
    receiver_depth: Column = column("receiver_depth", "m", "depth of the receivers")
    receiver_range: Column = column("receiver_range", "m", "horizontal range of the receivers")
    count: Column = column(_GRID, "1", "number of arrivals", "i8")
    pair: Column = column("arrival", "1", "index into the flat count, last dimension fastest", "i8")
    travel_time: Column = column("arrival", "s", "travel time")
    travel_time_imaginary: Column = column("arrival", "s", "imaginary part, from absorption")
    amplitude: Column = column("arrival", "1", "pressure amplitude relative to 1 m")
    phase: Column = column("arrival", "rad", "phase change by reflections and caustics")
    launch_declination: Column = column(
        "arrival", "rad", "angle from the horizontal at the source, positive down"
    )
    launch_azimuth: Column = column("arrival", "rad", "azimuth at the source")
    arrival_declination: Column = column(
        "arrival", "rad", "angle from the horizontal at the receiver, positive down"
    )
    arrival_azimuth: Column = column("arrival", "rad", "azimuth at the receiver")
    surface_bounces: Column = column("arrival", "1", "reflections at the surface", "i4")
    bottom_bounces: Column = column("arrival", "1", "reflections at the sea bed", "i4")

    def first_direct(self) -> Array:
        """
        Earliest arrival without a bounce of every source and receiver.

        Returns
        -------
        ndarray, shape of ``count``
            Travel time, NaN where there is none. [s]
        """
        first = np.full(self.count.size, np.inf)
        direct = (self.surface_bounces == 0) & (self.bottom_bounces == 0)
        np.minimum.at(first, self.pair[direct], self.travel_time[direct])
        return np.where(np.isfinite(first), first, np.nan).reshape(self.count.shape)


def read_bellhop_arrivals(path: str | Path) -> BellhopArrivals:
    """
    Read a `.arr` file of BELLHOP or BELLHOP3D, text or binary.

    Parameters
    ----------
    path : str or pathlib.Path

    Returns
    -------
    BellhopArrivals
        Arrivals in the file's order, which is not that of time.

    Raises
    ------
    AcousticsError
        If the file is missing, damaged, without the mark 2D or 3D on top (as before 2018), or of an
        irregular grid of receivers.

    Notes
    -----
    Bellhop keeps travel times in single precision: 0.24 us from 2 to 4 s, 0.48 us from 4 to 8 s.
    """
    file = Path(path)
    try:
        with file.open("rb") as stream:
            binary = stream.read(4) == _RECORD_MARK
        if binary:
            with FortranFile(file, "r") as records:
                stream_of_records = RecordStream(file, records)
                mark = bytes(stream_of_records.record(4)).decode("ascii", "replace")
                return _arrivals(stream_of_records, mark)
    except OSError as error:
        raise AcousticsError(f"{file}: cannot be read: {error.strerror}") from None
    reader = ListReader(file)
    mark = reader.word("the mark 2D or 3D")
    text = TextStream(file, reader.remaining())
    found = _arrivals(text, mark)
    if text.left():
        raise AcousticsError(f"{file}: {text.left()} numbers follow the last arrival")
    return found


def _arrivals(stream: Stream, mark: str) -> BellhopArrivals:
    kind = mark.strip("' ")
    if kind not in ("2D", "3D"):
        raise AcousticsError(
            f"{stream.path}: starts with {mark!r}; '2D' or '3D' is expected, as written since 2018"
        )
    three_d = kind == "3D"
    frequency = stream.take(1)[0]
    none = np.zeros(1)
    x, y = (stream.vector(), stream.vector()) if three_d else (none, none)
    z, receiver_z, ranges = stream.vector(), stream.vector(), stream.vector()
    bearings = np.radians(stream.vector()) if three_d else none
    shape = (z.size, x.size, y.size, bearings.size, receiver_z.size, ranges.size)
    count = np.zeros(shape, dtype=np.int64)
    flat, tables, columns = count.reshape(-1), [], 10 if three_d else 8
    per_source = bearings.size * receiver_z.size * ranges.size
    for source in range(z.size * x.size * y.size):
        most = stream.whole()
        for pair in range(source * per_source, (source + 1) * per_source):
            n = flat[pair] = stream.whole()
            if n > most:
                raise AcousticsError(f"{stream.path}: {n} arrivals where at most {most} are announced")
            tables += [stream.take(columns) for _ in range(n)]
    rows = np.array(tables).reshape(-1, columns)
    if not three_d:  # the azimuths that a 2-D file lacks
        rows = np.insert(rows, [5, 6], np.nan, axis=1)
    return BellhopArrivals(
        frequency=frequency,
        source_depth=z,
        source_north=x,
        source_east=y,
        receiver_bearing=bearings,
        receiver_depth=receiver_z,
        receiver_range=ranges,
        count=count,
        pair=np.repeat(np.arange(flat.size), flat),
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

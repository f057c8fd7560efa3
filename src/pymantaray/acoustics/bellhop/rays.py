"""The rays that Bellhop writes (`.ray`) as a record in SI units."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics.bellhop.listing import ListReader
from pymantaray.acoustics.bellhop.streams import TextStream
from pymantaray.records.base import Column, Record, column

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BellhopRays(Record):
    """
    Rays as Bellhop wrote them: nodes of all rays one after the other, and one row per ray.

    In a 2-D file north is the range and east is 0.
    """

    kind: ClassVar[str] = "bellhop_rays"

    frequency: Column = column("", "Hz", "frequency")
    ray: Column = column("node", "1", "ray that the node belongs to", "i8")
    position: Column = column("node axis", "m", "north, east, down")
    launch_declination: Column = column(
        "n_rays", "rad", "angle from the horizontal at the source, positive down"
    )
    launch_azimuth: Column = column("n_rays", "rad", "azimuth at the source, of the first step")
    surface_bounces: Column = column("n_rays", "1", "reflections at the surface", "i4")
    bottom_bounces: Column = column("n_rays", "1", "reflections at the sea bed", "i4")


def read_bellhop_rays(path: str | Path) -> BellhopRays:
    """
    Read a `.ray` file of BELLHOP or BELLHOP3D.

    Parameters
    ----------
    path : str or pathlib.Path

    Returns
    -------
    BellhopRays
        Rays in the file's order.

    Raises
    ------
    AcousticsError
        If the file is missing or damaged.

    Notes
    -----
    The launch angle on a ray's first line is in degrees from some programs and in radians from others: the
    one nearer to the direction of the first step is taken.
    """
    file = Path(path)
    reader = ListReader(file)
    reader.word("the title")
    frequency = reader.numbers(1, "frequency [Hz]")[0]
    reader.numbers(3, "numbers of sources")
    reader.numbers(2, "numbers of launch angles", least=1)
    reader.numbers(1, "depth of the surface")
    reader.numbers(1, "depth of the sea bed")
    columns = {"xyz": 3, "rz": 2}.get(reader.word("the kind of coordinates"))
    if columns is None:
        raise reader.fail("the kind of coordinates is neither 'xyz' nor 'rz'")
    numbers = TextStream(file, reader.remaining())
    heads, nodes = [], []
    while numbers.left():
        written = numbers.take(1)[0]
        size, surface, bottom = numbers.whole(), numbers.whole(), numbers.whole()
        points = numbers.take(size * columns).reshape(size, columns)
        if columns == 2:
            points = np.stack([points[:, 0], np.zeros(size), points[:, 1]], axis=1)
        heads.append((*_launch(written, points), surface, bottom))
        nodes.append(points)
    table = np.array(heads, dtype=float).reshape(-1, 4)
    return BellhopRays(
        frequency=frequency,
        ray=np.repeat(np.arange(len(nodes)), [len(points) for points in nodes]),
        position=np.concatenate(nodes) if nodes else np.empty((0, 3)),
        launch_declination=table[:, 0],
        launch_azimuth=table[:, 1],
        surface_bounces=table[:, 2],
        bottom_bounces=table[:, 3],
    )


def _launch(written: float, points: Array) -> tuple[float, float]:
    """Declination and azimuth at the source; NaN for a ray that takes no step."""
    if len(points) < 2:
        return math.nan, math.nan
    step = points[1] - points[0]
    across = math.hypot(step[0], step[1])
    seen = math.atan2(step[2], across)
    return min(written, math.radians(written), key=lambda angle: abs(angle - seen)), math.atan2(
        step[1], step[0]
    )

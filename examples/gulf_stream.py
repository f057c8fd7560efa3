"""
Make up a Gulf Stream off Cape Hatteras, for those who have no HYCOM file at hand: the ocean of
gulf_stream.toml.

Warm water in the south-east, cold water in the north-west, a front between them with the stream
along it, over a continental slope. The numbers are of the size of those in HYCOM's field of 7 March
2019, nothing is fitted, and the stream is not in balance with the density.

    python examples/gulf_stream.py [FILE]      gulf_stream.nc beside the script by default
    mantaray study run examples/gulf_stream.toml
"""

import sys
from pathlib import Path

import numpy as np

from pymantaray.ocean import assemble_ocean

DEPTH = np.array(
    [*range(0, 100, 10), *range(100, 400, 50), *range(400, 1000, 100), *range(1000, 4500, 500)],
    float,
)
LAT, LON = np.linspace(34.0, 35.28, 33), np.linspace(-75.68, -73.84, 24)
FRONT = (34.9, -75.1)  # a point of it
ALONG = np.radians(45.0)  # its direction, clockwise from north
WIDTH = 25e3  # m
M_PER_DEGREE = 111.2e3


def main(file: Path) -> None:
    """Write the ocean."""
    north = (LAT - FRONT[0])[:, None] * M_PER_DEGREE + 0.0 * LON
    east = (LON - FRONT[1]) * M_PER_DEGREE * np.cos(np.radians(FRONT[0])) + 0.0 * LAT[:, None]
    seaward = east * np.cos(ALONG) - north * np.sin(
        ALONG
    )  # m from the front, towards the south-east
    z = DEPTH[:, None, None]
    warm, cold = 4.0 + 20.0 * np.exp(-z / 600.0), 4.0 + 11.0 * np.exp(-z / 250.0)  # degC
    share = 0.5 * (1.0 + np.tanh(seaward / WIDTH))
    temperature = cold + (warm - cold) * share
    salinity = 34.9 + 0.08 * (temperature - 4.0)
    speed = 1.5 * np.exp(-z / 500.0) / np.cosh(seaward / WIDTH) ** 2  # m/s
    bed = np.clip(200.0 + 0.03 * (seaward + 40e3), 100.0, 3200.0)  # m
    fields = {
        "water_temp": temperature,
        "salinity": salinity,
        "water_u": speed * np.sin(ALONG),
        "water_v": speed * np.cos(ALONG),
    }
    ocean = assemble_ocean(
        {"depth": DEPTH, "lat": LAT, "lon": LON},
        np.datetime64("2019-03-07T15:00"),
        {name: np.where(z <= bed, field, np.nan) for name, field in fields.items()},
        title="Gulf Stream (made up)",
        source="examples/gulf_stream.py",
        synthetic=True,
    )
    ocean.to_netcdf(file)
    print(f"{file}: written")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_suffix(".nc"))

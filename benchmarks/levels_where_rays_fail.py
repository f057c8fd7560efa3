"""
Compare levels in shadows, beside caustics and near the surface with a parabolic equation, one line
per link.

Run with ``python benchmarks/levels_where_rays_fail.py``: the parabolic equation is the one in
`tests/oracles.py`, and shares no code with the package. All levels are those of a tone at the
centre of the band, relative to spherical spreading. The water has no absorption, and the sea bed
reflects nothing. The settings of the package were chosen with the fixed places; ``--places random``
compares at other places, drawn once, in the ducts and in a duct of another shape.
"""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from pymantaray.acoustics import (
    Leakage,
    Medium,
    find_eigenrays,
    find_leaks,
    find_tails,
    received_loss_db,
    transmission_loss,
)

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from oracles import ParabolicEquation

Speed = Callable[[np.ndarray], np.ndarray]
BOUNCES = (15, 0)
WITHIN = 3.0  # dB
FLOOR = -60.0  # dB; weaker sound is not compared


class Water(NamedTuple):
    """Water column, the source in it, and receivers: n random places, or those given."""

    speed: Speed
    source_depth: float
    deepest: float
    """Depth below which the parabolic equation absorbs. [m]"""
    spacing: float
    """Ranges are multiples of it. [m]"""
    places: tuple[tuple[float, float], ...]
    """Range and depth of the receivers. [m]"""


def random_places(
    seed: int, n: int, spacing: float, ranges: tuple[float, float], depths: tuple[float, float]
):
    """Ranges that are multiples of a spacing, and depths in whole metres."""
    rng = np.random.default_rng(seed)
    steps = rng.integers(round(ranges[0] / spacing), round(ranges[1] / spacing) + 1, n)
    return tuple(
        zip(
            (spacing * steps).tolist(), rng.integers(*depths, n).astype(float).tolist(), strict=True
        )
    )


def grid(ranges: tuple[float, ...], depths: tuple[float, ...]):
    return tuple((distance, depth) for depth in depths for distance in ranges)


WATERS = {
    "shadow below a warm layer": Water(
        lambda z: 1500.0 - 12.0 * (1.0 - np.exp(-z / 60.0)) + 0.012 * z, 40.0, 200.0, 100.0,
        ((1300.0, 10.0), (1400.0, 10.0), (1500.0, 10.0), (1600.0, 30.0), (1700.0, 30.0),
         (1900.0, 30.0),
         (1800.0, 40.0), (2000.0, 60.0), (2200.0, 60.0), (2400.0, 100.0)),
    ),
    "shadow in one gradient": Water(
        lambda z: 1460.0 - 0.15 * z, 40.0, 220.0, 100.0,
        grid((1400.0, 1500.0, 1600.0), (10.0,)) + grid((1700.0, 1800.0, 1900.0, 2000.0), (30.0,))
        + grid((1800.0, 1900.0, 2000.0, 2100.0), (40.0,)) + grid((2000.0, 2100.0, 2200.0, 2300.0),
            (60.0,))
        + grid((2200.0, 2300.0), (80.0,)) + grid((2300.0, 2400.0, 2500.0), (100.0,)),
    ),
    "duct at 100 m": Water(
        lambda z: 1480.0 + 10.0 * (1.0 - np.exp(-(((z - 100.0) / 80.0) ** 2))), 90.0, 320.0, 500.0,
        random_places(1, 13, 500.0, (2000.0, 6000.0), (40, 200)),
    ),
    "duct below the surface": Water(
        lambda z: 1440.0 + 12.0 * (1.0 - np.exp(-z / 80.0)) + 0.016 * z, 30.0, 320.0, 500.0,
        random_places(2, 13, 500.0, (2000.0, 6000.0), (10, 120)),
    ),
    "source near the surface": Water(
        lambda z: np.full(z.shape, 1450.0), 4.0, 150.0, 500.0,
        random_places(4, 10, 500.0, (1000.0, 3000.0), (3, 60))
    ),
}  # fmt: skip

RANDOM_SEED = 28
OTHER_DUCTS = {  # sound speed, depths of the source and of the receivers [m]
    "duct at 100 m": (WATERS["duct at 100 m"].speed, (60, 140), (40, 200)),
    "duct below the surface": (WATERS["duct below the surface"].speed, (10, 90), (10, 120)),
    "duct at 60 m, Munk": (
        lambda z: 1480.0 + 1.48 * (np.exp(-(z - 60.0) / 30.0) - 1.0 + (z - 60.0) / 30.0),
        (30, 90),
        (20, 150),
    ),
}


def random_waters() -> dict[str, Water]:
    """
    Ducts with a random source and 13 random receivers each, which the settings of the package were
    not chosen for.
    """
    waters = {}
    for number, (name, (speed, sources, depths)) in enumerate(OTHER_DUCTS.items()):
        seed = RANDOM_SEED + number
        source = float(np.random.default_rng([seed, 1]).integers(*sources))
        waters[name] = Water(
            speed, source, 320.0, 400.0, random_places(seed, 13, 400.0, (1200.0, 4400.0), depths)
        )
    return waters


PLACES = {"fixed": WATERS, "random": random_waters()}


def medium_of(water: Water) -> Medium:
    """Medium of a water column, to 1 km."""
    depth = np.arange(0.0, 1001.0, 1.0)
    return Medium.from_profile(depth, water.speed(depth), bottom_depth=1000.0)


def ends_of(water: Water) -> tuple[np.ndarray, np.ndarray]:
    """Source and receiver of each link."""
    distance, depth = np.array(water.places).T
    source = np.tile([0.0, 0.0, water.source_depth], (distance.size, 1))
    return source, np.column_stack([distance, np.zeros(distance.size), depth])


def wave_db(water: Water, hz: float) -> np.ndarray:
    """Transmission loss of the parabolic equation for each receiver. [dB]"""
    distance, depth = np.array(water.places).T
    rows = np.round(distance / water.spacing).astype(int)
    solver = ParabolicEquation(water.speed, hz, water.source_depth, water.deepest, water.spacing)
    pressure = solver.pressure(rows.max(), depth)
    return -20.0 * np.log10(np.abs(pressure[rows - 1, np.arange(depth.size)]))


def predicted_db(water: Water, hz: float) -> pd.DataFrame:
    """
    Transmission loss of each link: the strongest ray alone, the sum of all rays, and the package's.
    [dB]
    """
    medium, (source, receiver), n = medium_of(water), ends_of(water), len(water.places)
    arrivals = find_eigenrays(medium, source, receiver, *BOUNCES, None)
    loss = transmission_loss(medium, source, receiver, arrivals, hz)
    table = pd.DataFrame({name: np.full(n, np.nan) for name in ("strongest", "rays", "predicted")})
    table["n_rays"] = np.bincount(arrivals.link, minlength=n)
    tails = find_tails(medium, source, receiver, arrivals, hz, bounces=BOUNCES)
    received = received_loss_db(arrivals, loss, hz, 0.1 * hz, coherent=True, tails=tails)
    phase = (
        2.0 * np.pi * hz * arrivals.travel_time
        + loss.boundary_phase
        - 0.5 * np.pi * arrivals.caustics
    )
    pressure = 10.0 ** (-loss.total_db / 20.0) * np.exp(1j * phase)
    for link in np.unique(arrivals.link):
        rows = np.flatnonzero(arrivals.link == link)
        total = np.abs(pressure[rows].sum())
        table.loc[link, ["strongest", "rays"]] = loss.total_db[rows].min(), -20.0 * np.log10(total)
        table.loc[link, "predicted"] = received[rows[0]]
    dark = np.flatnonzero(table["n_rays"] == 0)
    leaks = find_leaks(medium, source[dark], receiver[dark], Leakage(), hz, bounces=BOUNCES)
    chord = np.linalg.norm(receiver - source, axis=1)[dark][leaks.link]
    table.loc[dark[leaks.link], "predicted"] = 20.0 * np.log10(chord) + leaks.arrivals.spreading_db
    return table


def compare(name: str, hz: float, places: str = "fixed") -> pd.DataFrame:
    """One row per link of a water column: level of the waves and errors of the predictions. [dB]"""
    water = PLACES[places][name]
    source, receiver = ends_of(water)
    table, wave = predicted_db(water, hz), wave_db(water, hz)
    spherical = 20.0 * np.log10(np.linalg.norm(receiver - source, axis=1))
    rows = pd.DataFrame(
        {
            "water": name,
            "frequency_hz": hz,
            "range_m": receiver[:, 0],
            "depth_m": receiver[:, 2],
            "n_rays": table["n_rays"],
            "wave_db": spherical - wave,
        }
    )
    for column in ("strongest", "rays", "predicted"):
        rows[f"{column}_minus_wave_db"] = wave - table[column]
    return rows[rows["wave_db"] > FLOOR]


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """
    Links within 3 dB of the waves, by water and frequency; a link without a prediction is not
    within.
    """
    errors = rows.columns[rows.columns.str.endswith("_minus_wave_db")]
    groups = rows.groupby(["water", "frequency_hz"], sort=False)
    table = pd.DataFrame({"links": groups.size()})
    for error in errors:
        within = (rows[error].abs() < WITHIN).groupby(
            [rows["water"], rows["frequency_hz"]], sort=False
        )
        table[error.removesuffix("_minus_wave_db")] = within.sum()
    table["median_db"] = groups["predicted_minus_wave_db"].agg(lambda e: e.abs().median())
    table["largest_db"] = groups["predicted_minus_wave_db"].agg(lambda e: e.abs().max())
    return table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--frequencies", type=float, nargs="+", default=[3000.0, 8000.0, 12000.0], help="[Hz]"
    )
    parser.add_argument(
        "--places", choices=list(PLACES), default="fixed", help="receivers to compare at"
    )
    parser.add_argument("--waters", nargs="+", default=[""], help="parts of names of water columns")
    parser.add_argument("--out", type=Path, help="file for the table of links (CSV)")
    options = parser.parse_args()
    names = [
        name for name in PLACES[options.places] if any(part in name for part in options.waters)
    ]
    tables = [compare(name, hz, options.places) for name in names for hz in options.frequencies]
    rows = pd.concat(tables, ignore_index=True)
    print(rows.to_string(index=False, float_format="{:.2f}".format))
    print(f"\nlinks within {WITHIN:g} dB of the waves")
    print(summary(rows).to_string(float_format="{:.2f}".format))
    if options.out is not None:
        rows.round(3).to_csv(options.out, index=False)


if __name__ == "__main__":
    main()

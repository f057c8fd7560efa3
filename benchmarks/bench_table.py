"""Size, building time and error of travel-time tables, by medium, and the time of a look-up.

Run with ``python benchmarks/bench_table.py [MEDIUM ...]``. The media are ``a`` to ``f`` of the reference travel times, and ``hycom``, the file
in ../shared/data beside the repository. Each table has source depths of 5 to 200 m, receiver depths of 5 to 1,000 m and ranges of 10 to
6,000 m, to the north of the middle of the medium. The error is that of the range at the solver's travel time on ``--links`` random links, times ten cosines of the ray's angle if it is
steeper than 84 degrees. ``wrong`` counts links with a range in the table and no ray, or with the status SHADOW and a ray.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from pymantaray.acoustics import Medium
from pymantaray.errors import OnlineError
from pymantaray.online import CellStatus, TravelTimeTable, build_table
from pymantaray.online.samples import Radial
from pymantaray.water import Water, open_water

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
LIMITS = ((5.0, 200.0, 5.0), (5.0, 1000.0, 25.0), (10.0, 6000.0))


def waters() -> dict[str, Water]:
    """Open all media."""
    found = {}
    for path in sorted((DATA / "reference").glob("medium_*.npz")):
        grid = dict(np.load(path))
        north, east, depth, speed, bed = (
            grid[key] for key in ("north", "east", "depth", "sound_speed", "bathymetry")
        )
        found[path.stem.split("_")[1]] = Water(Medium.from_grid(north, east, depth, speed, bathymetry=bed))
    file = DATA / "hycom" / "hycom_glby_930_2019030712_t003_ts3z.nc"
    found["hycom"] = open_water(str(file), bathymetry=3000.0, half_extent=10e3)
    return found


def print_medium(name: str, water: Water, tolerance: float, links: int) -> None:
    """Print the row of a medium."""
    build_table(
        water, (5.0, 10.0), (5.0, 10.0), (10.0, 20.0), tolerance=10.0, node=node_of(water)
    )  # compiles
    start = time.process_time()
    try:
        table = build_table(water, *LIMITS, tolerance=tolerance, node=node_of(water))
    except OnlineError as error:
        print(f"{name:6} {error}", flush=True)
        return
    seconds = time.process_time() - start
    low, high = np.array([limits[:2] for limits in LIMITS]).T
    places = np.random.default_rng(0).uniform(low, high, (links, 3))
    error, wrong, border = errors(table, water, places)
    start = time.process_time()
    table.horizontal_range(*places.T)
    look_up = (time.process_time() - start) / links
    print(
        f"{name:6} {table.tree.nbytes / 1e3:5.0f} kB {len(table.tree.corner):6d} cells {seconds:6.1f} s of CPU;"
        f" error median {np.median(error):.4f}, 99.9 % {np.percentile(error, 99.9):.4f}, largest {error.max():.4f} m;"
        f" wrong {wrong}, border {100.0 * border:.1f} %; {1e6 * look_up:.1f} us a look-up in NumPy",
        flush=True,
    )


def node_of(water: Water) -> tuple[float, float]:
    """Position of the source: the middle of the medium."""
    medium, _ = water.at_start
    return float(medium.north.mean()), float(medium.east.mean())


def errors(table: TravelTimeTable, water: Water, places: np.ndarray) -> tuple[np.ndarray, int, float]:
    """Errors of the range, number of wrong outcomes and share of borders."""
    medium, _ = water.at_start
    north, east = node_of(water)
    solved = Radial(medium, north=north, east=east)(places)
    time_s = (1.0 + solved.value) / 1500.0 * solved.straight
    at_place = table.travel_time(*places.T)
    has_range = at_place.status <= CellStatus.AMBIGUOUS
    wrong = has_range & np.isnan(time_s) | (at_place.status == CellStatus.SHADOW) & np.isfinite(time_s)
    ok = has_range & np.isfinite(time_s)
    found = table.horizontal_range(places[ok, 0], places[ok, 1], time_s[ok])
    error = np.abs(found.horizontal_range - places[ok, 2]) * np.minimum(
        solved.slowness[ok] * 1500.0 / 0.1, 1.0
    )
    missing = np.isnan(error)
    return (
        error[~missing],
        int(wrong.sum() + missing.sum()),
        float((at_place.status == CellStatus.BORDER).mean()),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("media", nargs="*")
    parser.add_argument("--tolerance", type=float, default=0.05, help="bound of the error in metres")
    parser.add_argument("--links", type=int, default=100_000)
    options = parser.parse_args()
    for name, water in waters().items():
        if name in (options.media or [name]):
            print_medium(name, water, options.tolerance, options.links)


if __name__ == "__main__":
    main()

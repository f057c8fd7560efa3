"""
Size, building time and error of travel-time tables, by medium, and the time of a look-up.

Run with ``python benchmarks/bench_table.py [MEDIUM ...]``. The media are ``a`` to ``f`` of the
reference travel times, and ``hycom``, the file in ../shared/data beside the repository. Each table
has source depths of 5 to 200 m, receiver depths of 5 to 1,000 m and ranges of 10 to 6,000 m, to the
north of the middle of the medium. The error is that of the range at the solver's travel time on
``--links`` random links, times ten cosines of the ray's angle if it is steeper than 84 degrees.
``beyond`` counts links whose error exceeds the bound, ``wrong`` links with a range in the table and
no ray, or with the status SHADOW and a ray, and ``refused`` is the share of the links with a ray
that have the status BORDER.

``reader`` instead of a medium builds the table of the page docs/how-to/on-board.md, and
times 10,000,000 look-ups of random ranges with the C reader.
"""

import argparse
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pymantaray import Water, open_water
from pymantaray.acoustics import Medium
from pymantaray.apps.table import CellStatus, TravelTimeTable, build_table, save_table
from pymantaray.apps.table.cells import HAS_RANGE
from pymantaray.apps.table.file import c_header
from pymantaray.apps.table.samples import Radial
from pymantaray.errors import OnlineError

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT.parent / "shared" / "data"
LIMITS = ((5.0, 200.0, 5.0), (5.0, 1000.0, 25.0), (10.0, 6000.0))


def waters(chosen: list[str]) -> Iterator[tuple[str, Water]]:
    """Open the chosen media, or all if none is chosen."""
    for path in sorted((DATA / "reference").glob("medium_*.npz")):
        name = path.stem.split("_")[1]
        if name in (chosen or [name]):
            grid = dict(np.load(path))
            axes = (grid[key] for key in ("north", "east", "depth", "sound_speed"))
            yield name, Water(Medium.from_grid(*axes, bathymetry=grid["bathymetry"]))
    if "hycom" in (chosen or ["hycom"]):
        file = DATA / "hycom" / "hycom_glby_930_2019030712_t003_ts3z.nc"
        yield "hycom", open_water(str(file), bathymetry=3000.0, half_extent=10e3)


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
    found = errors(table, water, places)
    error, status = found.error, found.status
    start = time.process_time()
    table.horizontal_range(*places.T)
    look_up = (time.process_time() - start) / links
    by_status = ", ".join(
        f"{one.name.lower()} {error[status == one].max():.4f} m of"
        f" {np.count_nonzero(status == one)}"
        for one in HAS_RANGE
        if np.any(status == one)
    )
    print(
        f"{name:6} {table.tree.nbytes / 1e3:5.0f} kB {len(table.tree.corner):6d} cells"
        f" {seconds:6.1f} s of CPU; error median {np.median(error):.4f}, 99.9 %"
        f" {np.percentile(error, 99.9):.4f} m; largest: {by_status}; beyond"
        f" {np.count_nonzero(error > tolerance)}, wrong {found.wrong}, refused {found.refused} of"
        f" {found.with_ray} ({100.0 * found.refused / found.with_ray:.1f} %); {1e6 * look_up:.1f}"
        " us a look-up in NumPy",
        flush=True,
    )


def node_of(water: Water) -> tuple[float, float]:
    """Position of the source: the middle of the medium."""
    medium, _ = water.at_start
    return float(medium.north.mean()), float(medium.east.mean())


class Errors(NamedTuple):
    """
    Errors of the ranges [m] and status of their links, and numbers of wrong outcomes, of refused
    links and of links with a ray.
    """

    error: np.ndarray
    status: np.ndarray
    wrong: int
    refused: int
    with_ray: int


def errors(table: TravelTimeTable, water: Water, places: np.ndarray) -> Errors:
    """Compare a table with the solver."""
    medium, _ = water.at_start
    north, east = node_of(water)
    solved = Radial(medium, north=north, east=east)(places)
    time_s = (1.0 + solved.value) / 1500.0 * solved.straight
    ray = np.isfinite(time_s)
    at_place = table.travel_time(*places.T)
    has_range = np.isin(at_place.status, HAS_RANGE)
    wrong = has_range & ~ray | (at_place.status == CellStatus.SHADOW) & ray
    ok = has_range & ray
    found = table.horizontal_range(places[ok, 0], places[ok, 1], time_s[ok])
    error = np.abs(found.horizontal_range - places[ok, 2]) * np.minimum(
        solved.slowness[ok] * 1500.0 / 0.1, 1.0
    )
    missing = np.isnan(error)
    return Errors(
        error[~missing],
        at_place.status[ok][~missing],
        int(wrong.sum() + missing.sum()),
        int(np.count_nonzero((at_place.status == CellStatus.BORDER) & ray)),
        int(np.count_nonzero(ray)),
    )


def print_c_reader(number: int = 10_000_000) -> None:
    """Print the time of look-ups of random ranges with the C reader, from the table of the page."""
    page = (ROOT / "docs" / "how-to" / "on-board.md").read_text()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "profile.csv").write_text(page.split("```csv\n")[1].split("```")[0])
        limits = (0.0, 200.0, 5.0), (0.0, 1500.0, 25.0), (10.0, 6000.0)
        table = build_table(open_water(str(folder / "profile.csv"), bathymetry=1500.0), *limits)
        save_table(table, folder / "table.mtt")
        (folder / "mantaray_table.h").write_text(c_header())
        reader = str(ROOT / "tests" / "apps" / "table" / "read_table.c")
        subprocess.run(
            ["cc", "-std=c99", "-O2", f"-I{folder}", reader, "-o", str(folder / "reader"), "-lm"],
            check=True,
        )
        low, high = np.array([limit[:2] for limit in limits]).T
        places = np.random.default_rng(0).uniform(low, high, (200_000, 3))
        text = "\n".join(" ".join(map(str, [*place, 0.0])) for place in places.tolist())
        command = [str(folder / "reader"), str(folder / "table.mtt"), str(number)]
        answer = subprocess.run(command, input=text, capture_output=True, text=True, check=True)
        found = table.horizontal_range(places[:, 0], places[:, 1], places[:, 2] / 1500.0)
        share = np.isin(found.status, HAS_RANGE).mean()
        print(
            f"reader {(folder / 'table.mtt').stat().st_size / 1e3:.0f} kB; {number:,} look-ups of a"
            f" range, {100.0 * share:.1f} % with a range:"
            f" {1e9 * float(answer.stdout.split()[0]):.0f} ns of CPU each"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("media", nargs="*", help="a to f, hycom or reader")
    parser.add_argument(
        "--tolerance", type=float, default=0.05, help="bound of the error in metres"
    )
    parser.add_argument("--links", type=int, default=100_000)
    options = parser.parse_args()
    for name, water in waters(options.media):
        print_medium(name, water, options.tolerance, options.links)
    if "reader" in options.media or not options.media:
        print_c_reader()


if __name__ == "__main__":
    main()

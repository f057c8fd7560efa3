"""
Set the solver beside the reference tables and Bellhop: errors and CPU time by medium, as Markdown
tables.

Run with ``python benchmarks/compare_reference.py [FOLDER]``; the folder with the reference tables
is by default ../shared/data/reference beside the repository, and without it nothing is done. Errors
are of the earliest direct arrival of each link in `linear` media, which is what the tables mean,
without an amplitude cut-off. Times are CPU time of the process on one thread after compilation, so
that other work on the machine counts little: each link is solved alone, the call's overhead
included, several times, of which the median is taken; then all in one call. `smooth` media through
the same grid values are another ocean, so only their time is shown. ``--multipath`` adds every
arrival with up to three reflections, ``--tolerances`` how the error falls with the tolerance in the
`smooth` media, ``--bellhop`` the two-dimensional Bellhop of ``pelagic`` (GPL; used here only, never
by the package) on the links of the four media that are profiles.
"""

import argparse
import math
import time
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymantaray.acoustics import Medium, find_eigenrays

REFERENCE = Path(__file__).parents[2] / "shared" / "data" / "reference"
MEDIA = ("a_iso", "b_lingrad", "c_munk", "d_beaufort", "e_front_eddy", "f_fram")
SIDES = ("source", "receiver")
PROFILES = MEDIA[:4]
MOST = 3  # reflections in the multipath table, surface and bottom together
Array = NDArray[np.float64]


def load_medium(folder: Path, name: str, interpolation: str) -> Medium:
    with np.load(folder / f"medium_{name}.npz") as m:
        axes = (m["north"], m["east"], m["depth"], m["sound_speed"])
        return Medium.from_grid(*axes, bathymetry=m["bathymetry"], interpolation=interpolation)


def load_links(folder: Path, name: str) -> tuple[pd.DataFrame, Array, Array]:
    table = pd.read_csv(folder / "direct.csv")
    rows = table[table.medium == name].reset_index(drop=True)
    source, receiver = (
        rows[[f"{s}_{axis}" for axis in ("north", "east", "depth")]].to_numpy() for s in SIDES
    )
    return rows, source, receiver


def cpu_ms(
    medium: Medium, source: Array, receiver: Array, runs: int, cutoff: float | None
) -> tuple[Array, float]:
    """
    CPU time of each link alone, the median of several runs, and of a link when all are solved at
    once. [ms]
    """
    find_eigenrays(medium, source[:1], receiver[:1], spreading_cutoff_db=cutoff, threads=1)
    spent = np.empty((runs, len(source)))
    together = np.empty(runs)
    for run in range(runs):
        for i in range(len(source)):
            start = time.process_time()
            find_eigenrays(medium, source[i], receiver[i], spreading_cutoff_db=cutoff, threads=1)
            spent[run, i] = time.process_time() - start
        start = time.process_time()
        find_eigenrays(medium, source, receiver, spreading_cutoff_db=cutoff, threads=1)
        together[run] = (time.process_time() - start) / len(source)
    return 1e3 * np.median(spent, axis=0), 1e3 * float(np.median(together))


def errors_of(error: Array, digits: int) -> str:
    """Median, root mean square and largest of errors in seconds, as microseconds."""
    e = 1e6 * error
    return (
        f"{np.median(e):.{digits}f}, {math.sqrt(np.mean(e * e)):.{digits}f},"
        f" {np.abs(e).max():.{digits}f}"
    )


def compare_direct(folder: Path, runs: int) -> None:
    print(
        "| medium | direct arrivals | found by Bellhop | found by MantaRay | error of Bellhop:"
        " median, rms, max [us] | error of MantaRay [us] |"
    )
    print("|---|---|---|---|---|---|")
    cost, errors = [], []
    for name in MEDIA:
        rows, source, receiver = load_links(folder, name)
        linear, smooth = (load_medium(folder, name, kind) for kind in ("linear", "smooth"))
        first = find_eigenrays(linear, source, receiver, spreading_cutoff_db=None).first()
        exact = rows.travel_time_s.to_numpy()
        exists = np.isfinite(exact)
        found, error = [], []
        for travel_time in (rows.bellhop_direct_s.to_numpy(), first.travel_time):
            hit = np.isfinite(travel_time)
            ghosts = np.count_nonzero(hit & ~exists)
            found.append(
                f"{np.count_nonzero(hit & exists)}" + (f" and {ghosts} false" if ghosts else "")
            )
            error.append((travel_time - exact)[hit & exists])
        errors.append(error)
        print(
            f"| {name} | {np.count_nonzero(exists)} | {found[0]} | {found[1]} |"
            f" {errors_of(error[0], 0)} | {errors_of(error[1], 6)} |",
            flush=True,
        )
        spent = [
            cpu_ms(medium, source, receiver, runs, cutoff)
            for medium, cutoff in ((linear, None), (linear, 15.0), (smooth, 15.0))
        ]
        cost.append((name, rows.bellhop_cpu_ms_1thread.to_numpy(), spent))
    print()
    print(
        "CPU time per link [ms], median / 90th percentile of links solved alone (mean of all in"
        " one call):\n"
    )
    print(
        "| medium | Bellhop | linear, no cut-off | linear | smooth | ratio of Bellhop's median to"
        " linear | to smooth |"
    )
    print("|---|---|---|---|---|---|---|")
    for name, bellhop, spent in cost:
        cells = [f"{np.median(bellhop):.0f} / {np.percentile(bellhop, 90):,.0f}"]
        cells += [
            f"{np.median(s):.2f} / {np.percentile(s, 90):.2f} ({all_of:.2f})" for s, all_of in spent
        ]
        cells += [f"{np.median(bellhop) / np.median(s):,.0f}" for s, _ in spent[1:]]
        print(f"| {name} | {' | '.join(cells)} |")
    bellhop = np.concatenate([b for _, b, _ in cost])
    names = ("linear without cut-off", "linear", "smooth")
    print(
        f"\nAll {bellhop.size} links, Bellhop: median {np.median(bellhop):.0f} ms, sum"
        f" {bellhop.sum() / 1e3:.1f} s"
    )
    for k, label in enumerate(names):
        alone = np.concatenate([spent[k][0] for _, _, spent in cost])
        print(
            f"{label}: median {np.median(alone):.3f} ms, sum {alone.sum():.0f} ms;"
            f" Bellhop takes {np.median(bellhop) / np.median(alone):,.0f} times the median,"
            f" {bellhop.sum() / alone.sum():,.0f} times the sum"
        )
    for k, label in enumerate(("Bellhop", "MantaRay")):
        e = 1e6 * np.abs(np.concatenate([error[k] for error in errors]))
        print(
            f"{label}: absolute error, median {np.median(e):.3g} us, rms"
            f" {math.sqrt(np.mean(e**2)):.3g} us"
        )


def image_times(
    source: Array, receiver: Array, speed: float, depth: float, n_s: int, n_b: int
) -> list[float]:
    """
    Travel times in an isovelocity wave guide after 1 or 2 reflections, by the image method.
    """
    across = np.hypot(*(receiver - source)[:2])
    zs, zr = source[2], receiver[2]
    downs = []
    if n_s >= n_b:  # first up; every reflection at the surface or the bottom turns the image over
        downs.append(zs + zr + 2 * n_b * depth if n_s > n_b else 2 * n_b * depth + zs - zr)
    if n_b >= n_s:
        downs.append(2 * n_b * depth - zs - zr if n_b > n_s else 2 * n_b * depth - zs + zr)
    return sorted(float(np.hypot(across, down)) / speed for down in downs)


def compare_multipath(folder: Path) -> None:
    table = pd.read_csv(folder / "multipath.csv")
    print(
        "\n| medium | rows of the table | found | not in the table | largest error [ns] | CPU ms"
        " per link |"
    )
    print("|---|---|---|---|---|---|")
    for name in MEDIA[:4]:
        rows, source, receiver = load_links(folder, name)
        medium = load_medium(folder, name, "linear")
        find_eigenrays(
            medium, source[:1], receiver[:1], MOST, MOST, spreading_cutoff_db=None, threads=1
        )
        start = time.process_time()
        got = find_eigenrays(
            medium, source, receiver, MOST, MOST, spreading_cutoff_db=None, threads=1
        )
        spent = time.process_time() - start
        expected = table[table.medium == name]
        worst, found, images, extra = 0.0, 0, 0, 0
        for link, label in enumerate(rows.link):
            for n_s in range(MOST + 1):
                for n_b in range(MOST + 1 - n_s):
                    same = (expected.surface_bounces == n_s) & (expected.bottom_bounces == n_b)
                    want = expected.travel_time_s[same & (expected.link == label)].to_numpy()
                    pick = (
                        (got.link == link)
                        & (got.surface_bounces == n_s)
                        & (got.bottom_bounces == n_b)
                    )
                    mine = got.travel_time[pick]
                    for travel_time in want:
                        gap = np.abs(mine - travel_time)
                        if gap.size and gap.min() < 1e-6:
                            worst, found = max(worst, gap.min()), found + 1
                            mine = np.delete(mine, gap.argmin())
                    if name == "a_iso" and mine.size:
                        bed = float(medium.bed.depth[0, 0])
                        image = image_times(source[link], receiver[link], 1500.0, bed, n_s, n_b)
                        if len(image) == mine.size:
                            worst = max(worst, float(np.abs(np.sort(mine) - image).max()))
                            images += mine.size
                            continue
                    extra += mine.size
        beyond = f"{extra}" + (f", and {images} by the image method" if images else "")
        print(
            f"| {name} | {len(expected)} | {found} | {beyond} | {worst * 1e9:.3f} |"
            f" {1e3 * spent / len(rows):.1f} |",
            flush=True,
        )


def compare_tolerances(folder: Path) -> None:
    tolerances = (1e-1, 1e-2, 1e-3, 1e-4)
    print(f"\n| medium, smooth | {' | '.join(f'{x:g} m' for x in tolerances)} |")
    print(f"|---|{'---|' * len(tolerances)}")
    for name in MEDIA:
        _, source, receiver = load_links(folder, name)
        medium = load_medium(folder, name, "smooth")
        exact = find_eigenrays(medium, source, receiver, tolerance=1e-7).first().travel_time
        cells = []
        for tolerance in tolerances:
            start = time.process_time()
            got = find_eigenrays(medium, source, receiver, tolerance=tolerance, threads=1).first()
            spent = 1e6 * (time.process_time() - start) / len(source)
            gap = 1e6 * np.abs(got.travel_time - exact)
            cells.append(
                f"{np.nanmedian(gap):.2g}, {np.nanmax(gap):.2g} us ({spent:.0f} us of CPU)"
            )
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


class Beams(NamedTuple):
    """
    Settings of Bellhop: kind of beams, how many, how far about the chord [deg], and the step along
    them (0: a tenth of the depth) [m].
    """

    label: str
    kind: str
    count: int
    reach: float
    step: float


STEEPEST = 89.0  # deg
BEAMS = (
    Beams("hat, 1,000 beams in all, its own step", "geometric_hat_cartesian", 1000, 180.0, 0.0),
    Beams(
        "Gaussian, 1,000 beams in all, its own step",
        "geometric_gaussian_cartesian",
        1000,
        180.0,
        0.0,
    ),
    Beams("hat, 1,000 beams in 30 degrees, 10 m", "geometric_hat_cartesian", 1000, 15.0, 10.0),
    Beams("hat, 4,000 beams in 30 degrees, 10 m", "geometric_hat_cartesian", 4000, 15.0, 10.0),
)
FREQUENCY = 10_000.0  # Hz; sets the width of Gaussian beams


def direct_arrivals(
    medium: Medium, source: Array, receiver: Array, beams: Beams
) -> tuple[Array, float]:
    """
    Travel times of Bellhop's arrivals without a reflection [s], and the CPU time of its run. [ms]
    """
    from pelagic import bellhop

    bed = float(medium.bed.depth.max())
    depth = np.append(medium.depth[medium.depth < bed], bed)
    speed = np.interp(depth, medium.depth, medium.sound_speed[0, 0])
    across = float(np.hypot(*(receiver - source)[:2]))
    chord = math.degrees(math.atan2(receiver[2] - source[2], across))
    case = bellhop.Case.from_dict(
        {
            "pelagic": 2,
            "model": "bellhop",
            "title": beams.label,
            "frequency": FREQUENCY,
            "interpolation": "c_linear",
            "media": [{"to": bed, "ssp": np.column_stack([depth, speed])}],
            "surface": "vacuum",
            "bottom": {"type": "vacuum"},
            "source": {"depth": [source[2]]},
            "receivers": {"depth": [receiver[2]], "range": [across]},
            "bellhop": {
                "run": "arrivals",
                "beam": beams.kind,
                "angles": {
                    "from": max(chord - beams.reach, -STEEPEST),
                    "to": min(chord + beams.reach, STEEPEST),
                    "count": beams.count,
                },
                "step": beams.step,
                "box": {"depth": bed + 1.0, "range": 1.01 * across},
            },
        }
    )
    start = time.process_time()
    arrivals = case.run().arrivals
    spent = 1e3 * (time.process_time() - start)
    direct = (arrivals.top_bounces == 0) & (arrivals.bottom_bounces == 0)
    return arrivals.travel_time_s[direct].astype(float), spent


def compare_bellhop(folder: Path) -> None:
    """
    Earliest direct arrival of the two-dimensional Bellhop, its arrival nearest to the truth, and
    MantaRay's.
    """
    print(
        "\n| medium | settings | direct arrivals | found | earliest: median, rms, max [us] |"
        " nearest [us] | CPU ms per link |"
    )
    print("|---|---|---|---|---|---|---|")
    for name in PROFILES:
        rows, source, receiver = load_links(folder, name)
        medium = load_medium(folder, name, "linear")
        exact = rows.travel_time_s.to_numpy()
        for beams in BEAMS:
            solved = [
                direct_arrivals(medium, a, b, beams) for a, b in zip(source, receiver, strict=True)
            ]
            pairs = [
                (times, truth)
                for (times, _), truth in zip(solved, exact, strict=True)
                if times.size
            ]
            hits = [(times, truth) for times, truth in pairs if np.isfinite(truth)]
            earliest = np.array([times.min() - truth for times, truth in hits])
            nearest = np.array(
                [(times - truth)[np.abs(times - truth).argmin()] for times, truth in hits]
            )
            ghosts = f" and {len(pairs) - len(hits)} false" if len(pairs) > len(hits) else ""
            print(
                f"| {name} | {beams.label} | {np.count_nonzero(np.isfinite(exact))} |"
                f" {len(hits)}{ghosts} | {errors_of(earliest, 0)} | {errors_of(nearest, 0)} |"
                f" {np.median([ms for _, ms in solved]):.0f} |",
                flush=True,
            )
        spent, _ = cpu_ms(medium, source, receiver, 3, None)
        first = (
            find_eigenrays(medium, source, receiver, spreading_cutoff_db=None).first().travel_time
        )
        error = (first - exact)[np.isfinite(exact) & np.isfinite(first)]
        print(
            f"| {name} | MantaRay | {np.count_nonzero(np.isfinite(exact))} | {error.size} |"
            f" {errors_of(error, 6)} | the same | {np.median(spent):.2f} |",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path, default=REFERENCE)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument(
        "--multipath", action="store_true", help="also every arrival with up to three reflections"
    )
    parser.add_argument(
        "--tolerances", action="store_true", help="also how errors fall with the tolerance"
    )
    parser.add_argument(
        "--bellhop",
        action="store_true",
        help="only the two-dimensional Bellhop of pelagic, on profiles",
    )
    options = parser.parse_args()
    if not (options.folder / "direct.csv").is_file():
        print(f"no reference tables in {options.folder}; nothing to compare")
        return
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", RuntimeWarning
        )  # more eigenrays than are kept, on axes of linear ducts
        if options.bellhop:
            compare_bellhop(options.folder)
            return
        compare_direct(options.folder, options.runs)
        if options.multipath:
            compare_multipath(options.folder)
        if options.tolerances:
            compare_tolerances(options.folder)


if __name__ == "__main__":
    main()

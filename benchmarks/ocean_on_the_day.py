"""
Print what differs between runs of one study in several oceans, as a Markdown table: water, fleet,
ranges, estimates.

Run with ``python benchmarks/ocean_on_the_day.py RUN...``.
"""

import argparse
from collections.abc import Iterator

import numpy as np

from pymantaray.apps.study import Run, open_run
from pymantaray.apps.study.figures.register import RunResults

LEVELS = (0.0, 100.0, 400.0, 1000.0)  # m


def water(run: Run) -> Iterator[tuple[str, str]]:
    """
    Spread of the sound speed over the study's domain and over the fleet's part of it, and its
    change with depth.
    """
    ocean, places = run.ocean, run.truth.position[..., :2]
    low, high = places.min(axis=(0, 1)), places.max(axis=(0, 1))
    sides = [2e-3 * float(ocean[axis].values[-1]) for axis in ("north", "east")]
    yield "domain, north and east [km]", " x ".join(f"{side:.0f}" for side in sides)
    yield (
        "fleet, all the time, north and east [km]",
        " x ".join(f"{1e-3 * side:.1f}" for side in high - low),
    )
    path = ocean["sound_speed"].interp(
        north=("place", places[..., 0].ravel()[::20]), east=("place", places[..., 1].ravel()[::20])
    )
    for label, speed, over in (
        ("domain", ocean["sound_speed"], ("north", "east")),
        ("at the fleet", path, ("place",)),
    ):
        spread = speed.std(over).interp(depth=list(LEVELS))
        yield (
            f"sd of sound speed, {label}, at {', '.join(f'{z:.0f}' for z in LEVELS)} m [m/s]",
            ", ".join(f"{value:.2f}" for value in spread.values),
        )
    mean = path.mean("place").interp(depth=list(LEVELS)).values
    yield "mean sound speed at these [m/s]", ", ".join(f"{value:.0f}" for value in mean)


def fleet(run: Run) -> Iterator[tuple[str, str]]:
    """How far vehicles drift, and how long the links are."""
    place = run.truth.position[..., :2]
    drift = 1e-3 * np.linalg.norm(place[:, -1] - place[:, 0], axis=-1)[1:]
    yield "drift of the floats [km]", f"{drift.min():.1f} to {drift.max():.1f}"
    distance = 1e-3 * run.ranges()["distance"]
    yield "links: mean, longest [km]", f"{distance.mean():.1f}, {distance.max():.1f}"


def ranges(results: RunResults) -> Iterator[tuple[str, str]]:
    """Dropouts, and the range error with its parts, over all links."""
    lost = results.tables["dropouts"].frame.query("category == 'all links'").iloc[0]
    yield (
        "dropouts [%]",
        f"{lost['percent']:.1f} ({lost['shadow']} in a shadow, {lost['weak']} weak)",
    )
    for row in (
        results.tables["range_error_split"]
        .frame.query("category == 'all links'")
        .to_dict("records")
    ):
        yield (
            f"range error, {row['part']}: mean, sd [m]",
            f"{row['mean_m']:+.1f}, {row['sd_m']:.1f}",
        )


def estimates(results: RunResults) -> Iterator[tuple[str, str]]:
    """Errors under water at the pings, NEES beside them."""
    nees = {}
    if "consistency" in results.tables:
        table = results.tables["consistency"].frame.query("statistic == 'horizontal'")
        nees = dict(zip(table["condition"], table["median_ratio"], strict=True))
    at_pings = results.tables["ping_error"].frame
    yield "lower bound [m]", f"{at_pings['bound_rmse_m'].min():.2f}"
    for row in at_pings.to_dict("records"):
        yield (
            f"`{row['condition']}` at pings, RMSE; from `straight` [m]; NEES",
            (
                f"{row['rmse_m']:.2f}; {row['from_straight_rmse_m']:.2f};"
                f" {nees.get(row['condition'], np.nan):.3g}"
            ),
        )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("runs", nargs="+", metavar="RUN")
    folders = parser.parse_args().runs
    columns = []
    for folder in folders:
        results = RunResults(open_run(folder))
        run = results.run
        columns.append(dict([*water(run), *fleet(run), *ranges(results), *estimates(results)]))
    print(f"| | {' | '.join(folders)} |")
    print(f"|---|{'---|' * len(folders)}")
    for key in columns[0]:
        print(f"| {key} | {' | '.join(column.get(key, '-') for column in columns)} |")


if __name__ == "__main__":
    main()

"""Print the table of `docs/how-to/estimators.md` from runs of the estimators' presets: what each row is worth in each region.

Run with ``python benchmarks/estimator_table.py RUN...``; all runs need the same rows.
"""

import argparse
from pathlib import Path

import pandas as pd

_DIGITS = 3  # of NEES


def column(run: Path) -> pd.DataFrame:
    """What is shown of a run, by condition."""
    tables = {
        name: pd.read_csv(run / "tables" / f"{name}.csv")
        for name in ("ate_pooled", "ping_error", "consistency", "costs")
    }
    nees = tables["consistency"].query("statistic == 'horizontal'").set_index("condition")
    at_pings, costs = (tables[name].set_index("condition") for name in ("ping_error", "costs"))
    every = tables["ate_pooled"].set_index("condition")
    return pd.DataFrame(
        {
            "all poses": every["rmse_m"].map("{:.2f}".format),
            "at pings": at_pings["rmse_m"].map("{:.2f}".format),
            "median": at_pings["median_m"].map("{:.2f}".format),
            "from `straight`": at_pings["from_straight_rmse_m"].map("{:.2f}".format),
            "NEES": [
                f"{row.median_ratio:,.0f}" if row.median_ratio >= 1e3 else f"{row.median_ratio:.{_DIGITS}g}"
                for row in nees.loc[every.index].itertuples()
            ],
            "inside": nees["inside"].map(str) + " of " + nees["tests"].map(str),
            "CPU [s]": costs["cpu_median_s"].map("{:.2f}".format),
        }
    ).loc[every.index]


def main() -> None:
    """Print the table, and the realizations and the bound of each run."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN")
    runs = parser.parse_args().runs
    columns = [column(run) for run in runs]
    heads = [
        f"{run.name}: {name}" if i == 0 else name
        for run, c in zip(runs, columns, strict=True)
        for i, name in enumerate(c)
    ]
    print(f"| | {' | '.join(heads)} |")
    print(f"|---|{'---|' * len(heads)}")
    for name in columns[0].index:
        cells = [cell for c in columns for cell in c.loc[name]]
        print(f"| `{name}` | {' | '.join(cells)} |")
    for run in runs:
        bound = (
            pd.read_csv(run / "tables" / "ping_error.csv")
            .set_index("condition")
            .loc["straight", "bound_rmse_m"]
        )
        costs = pd.read_csv(run / "tables" / "costs.csv").iloc[0]
        print(
            f"{run.name}: {costs['realizations']} realizations, seed {costs['seed']}, least that is possible {bound:.2f} m"
        )


if __name__ == "__main__":
    main()

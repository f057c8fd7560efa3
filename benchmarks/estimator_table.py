"""
Print the table of `docs/theory/consistency.md` from runs of the estimators' presets: what each row
is worth in each region.

Run with ``python benchmarks/estimator_table.py RUN...``; all runs need the same rows.
"""

import argparse
from pathlib import Path

import pandas as pd


def column(run: Path) -> pd.DataFrame:
    """What is shown of a run, by condition."""
    names = ("ate_pooled", "ping_error", "consistency", "costs")
    tables = {name: pd.read_csv(run / "tables" / f"{name}.csv") for name in names}
    tables["consistency"] = tables["consistency"].query("statistic == 'horizontal'")
    rows = tables["ate_pooled"][["condition"]]
    for table in tables.values():
        rows = rows.merge(table, on="condition", suffixes=(None, "_at_pings"))
    cells = [
        {
            "all poses": f"{row['rmse_m']:.2f}",
            "at pings (median)": f"{row['rmse_m_at_pings']:.2f} ±"
            f" {row['rmse_standard_error_m_at_pings']:.2f} ({row['median_m_at_pings']:.2f})",
            "from `straight`": f"{row['from_straight_rmse_m']:.2f}",
            "NEES (inside)": f"{nees(row['median_ratio'])} ({row['inside']})",
            "CPU [s]": f"{row['cpu_median_s']:.2f}",
        }
        for row in rows.to_dict("records")
    ]
    return pd.DataFrame(cells, index=rows["condition"])


def nees(ratio: float) -> str:
    """Three digits, or all before the point."""
    return f"{ratio:,.0f}" if ratio >= 100.0 else f"{ratio:.3g}"


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
            f"{run.name}: {costs['realizations']} realizations, seed {costs['seed']}, bound"
            f" {bound:.2f} m"
        )


if __name__ == "__main__":
    main()

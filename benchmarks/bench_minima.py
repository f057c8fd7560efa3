"""
Search generated graphs for their lowest minimum, and certify it.

Run with ``python benchmarks/bench_minima.py``. The first table has 23 generated files
(`tests/two_minima.py`), solved with ``--start best --random-starts 24``: costs from the file, the
lowest cost, the cost of a search with other random starts, the share of starts that end at the
lowest cost, and the certificate. The second table has survey lines and cooperative vehicles whose
odometry has 1, 10 and 100 times the noise, started without the truth, with several seeds each.
"""

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import numpy as np
import two_minima

from pymantaray.apps.graphs import certify, open_graph, solve_graph
from pymantaray.apps.graphs.external import GraphResult

SAME = 1e-4  # relative; smaller differences of the cost are of one minimum


def solved(text: str, name: str, random_starts: int, seed: int) -> GraphResult:
    """Solve a file from all starts."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_text(text)
        return solve_graph(
            open_graph(path), start="best", random_starts=random_starts, seed=seed, truth=False
        )


def costs(result: GraphResult) -> dict[str, float]:
    """Final cost of each start; infinite unless it is usable."""
    return {o.name: o.cost for o in result.outcomes}


def reached(cost: float, best: float) -> bool:
    """True if a cost is the lowest one."""
    return bool(np.isfinite(cost) and cost <= best + SAME * (1.0 + best))


def print_files(random_starts: int) -> None:
    """Print the table of generated files."""
    print(
        "| file | from file | lowest | other search | starts at the lowest | status | certificate"
        " | CPU [s] |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for name, text in two_minima.FILES.items():
        begin = time.process_time()
        result = solved(text(), name, random_starts, 0)
        seconds = time.process_time() - begin
        own = costs(result)
        best = min(own.values())
        again = min(costs(solved(text(), name, random_starts, 1)).values())
        proof = certify(result.graph, result.solution.values)
        what = "certified" if proof.certified else proof.reason or f"{proof.least_eigenvalue:.2g}"
        share = np.mean([reached(c, best) for c in own.values()])
        print(
            f"| `{name}` | {own['file']:.4g} | {best:.4g} | {again:.4g} | {100 * share:.0f} % |"
            f" {result.solution.status.name} | {what} | {seconds:.1f} |",
            flush=True,
        )


def print_noise(random_starts: int, seeds: int) -> None:
    """Print the table of odometry noise."""
    print(
        "| graph | noise | certified | dead reckoning | chordal | relaxation | random | `--start"
        " best` |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for kind, make in (("survey", two_minima.survey), ("cooperative", two_minima.cooperative)):
        for factor in (1.0, 10.0, 100.0):
            rows = []
            for seed in range(seeds):
                name = "g.g2o" if kind == "survey" else "g.pyfg"
                text = make(100 + seed, factor)
                result, plain = (solved(text, name, count, 0) for count in (random_starts, 0))
                own = costs(result)
                best = min(own.values())
                random = [
                    reached(c, best) for start, c in own.items() if start.startswith("random")
                ]
                fine = result.solution.usable
                rows.append(
                    [
                        fine and certify(result.graph, result.solution.values).certified,
                        reached(own["dead-reckoning"], best),
                        reached(own["chordal"], best),
                        # without such a start, the lowest solution is certified
                        reached(own.get("relaxation", best), best),
                        np.mean(random),
                        reached(min(costs(plain).values()), best),
                    ]
                )
            share = 100.0 * np.mean(np.array(rows, dtype=float), axis=0)
            print(
                f"| {kind} | {factor:g} | {' | '.join(f'{value:.0f} %' for value in share)} |",
                flush=True,
            )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--random-starts", type=int, default=24)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument(
        "--tables", nargs="*", default=["files", "noise"], choices=("files", "noise")
    )
    arguments = parser.parse_args()
    if "files" in arguments.tables:
        print_files(arguments.random_starts)
        print()
    if "noise" in arguments.tables:
        print_noise(arguments.random_starts, arguments.seeds)


if __name__ == "__main__":
    main()

"""
Print the numbers of docs/paper.md that are in no table: python examples/paper_numbers.py RUN [RUN
...].
"""

import sys

import numpy as np

from pymantaray.apps.study import open_run
from pymantaray.records import RayStatus


def main() -> None:
    """
    Mean range error of what the station keeper sends and hears, largest distance, cost against
    expectation.
    """
    if len(sys.argv) == 1:
        sys.exit("name folders of runs: python examples/paper_numbers.py RUN [RUN ...]")
    for folder in sys.argv[1:]:
        run = open_run(folder)
        o, e = run.measurements, run.estimates
        heard = o.range_status == RayStatus.OK
        error = o.refracted_range - o.straight_range
        station = int(np.argmax(run.truth.role == "station"))
        sent, got = (
            error[heard & (end == station)].mean()
            for end in (o.range_transmitter, o.range_receiver)
        )
        print(f"{folder}: {o.name[station]} sends {sent:+.1f} m, hears {got:+.1f} m")
        print(f"  largest distance {o.straight_range.max() / 1e3:.1f} km")
        for c, condition in enumerate(e.condition):
            if condition != "odometry":
                ratio = np.median(e.final_cost[c] / e.expected_cost[c])
                print(f"  {condition}: cost {ratio:.4g} times its expectation")


if __name__ == "__main__":
    main()

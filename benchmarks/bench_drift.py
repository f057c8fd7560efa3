"""
Coverage of `mantaray.locate` in water that drifts, which was made without the solver's model.

Run with ``python benchmarks/bench_drift.py [--surveys N] [--constant]``. The surveys are those of
``tests/drifting.py``: 500 to 3,000 pings in 3 to 48 h at 2,000 to 5,000 m, one node or four. Rows:
share of surveys whose true mean position is in the 95 % region, mean chi-square of its error and of
the difference between both halves in time (3 is right), share of halves above the 99 % limit,
median standard deviation of the depth, CPU per survey.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from pymantaray.apps.locate import locate

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from drifting import constant_water, deep_water, drifting_survey, water_series


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--surveys", type=int, default=20)
    parser.add_argument("--constant", action="store_true", help="water that does not drift")
    chosen = parser.parse_args()
    medium = deep_water()
    water = constant_water if chosen.constant else water_series
    errors, halves, sigmas, spent = [], [], [], 0.0
    for seed in range(chosen.surveys):
        made = drifting_survey(seed, water=water)
        start = time.process_time()
        found = locate(made.survey, medium)
        spent += time.process_time() - start
        count = len(made.truth)
        mean = np.tile(np.eye(3) / count, count)
        covariance = mean @ found.covariance @ mean.T
        error = (found.positions - made.truth).mean(axis=0)
        errors.append(error @ np.linalg.solve(covariance, error))
        sigmas.append(np.sqrt(covariance[2, 2]))
        halves += [test.chi_square for test in found.tests if test.name == "halves in time"]
    print("surveys  inside 95 %  error  halves  > 99 %  sigma depth [m]  CPU [s]")
    print(
        f"{chosen.surveys:7d} {np.mean(np.array(errors) < chi2.ppf(0.95, 3)):12.3f}"
        f" {np.mean(errors):6.2f} {np.mean(halves):7.2f}"
        f" {np.mean(np.array(halves) > chi2.ppf(0.99, 3)):7.3f} {np.median(sigmas):16.4f}"
        f" {spent / chosen.surveys:8.2f}"
    )


if __name__ == "__main__":
    main()

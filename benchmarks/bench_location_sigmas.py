"""
Coverage and size of the standard deviations of `mantaray.locate` by class of survey.

Run with ``python benchmarks/bench_location_sigmas.py [--surveys N] [--shapes ...]``. A class is a
pattern of pings (circle, cross, line), the noise of two-way times, and water that drifts or not: an
Ornstein-Uhlenbeck process of 1e-4 of the sound speed with a memory of an hour, beside a constant
error of 1e-3. One node at 2,000 m answers 200 pings. Rows: class, share of surveys whose true
position is in the 95 % region (on a line: of depth and the coordinate along it), mean standard
deviation over the one with the true model known (of the worst axis), that of the
median survey, and models chosen.
"""

import argparse
import sys
from collections import Counter
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from pymantaray.acoustics import Medium
from pymantaray.apps.locate import LocateOptions, Node, Pattern, Survey, locate
from pymantaray.apps.locate.linear import Linearization
from pymantaray.apps.locate.sound_speed import SpeedPrior, sound_speed_terms
from pymantaray.apps.locate.travel_times import predict
from pymantaray.apps.locate.unknowns import SurveyUnknowns

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from campaigns import direct_time
from drifting import STEP, deep_water, ornstein_uhlenbeck

DEPTH, RADIUS, PINGS, SPEED = 2000.0, 1500.0, 200, 2.0
DRIFT, MEMORY, CONSTANT = 1e-4, 3600.0, 1e-3
PRIOR = np.array([100.0, 100.0, 50.0])  # m


def made(seed: int, shape: str, noise: float, *, drifts: bool) -> tuple[Survey, np.ndarray]:
    """Survey of a ship on a pattern, and the true position of its node."""
    rng = np.random.default_rng([seed, 7])
    points = Pattern(shape, RADIUS, PINGS).points()
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    time = length / SPEED * np.arange(PINGS) / PINGS
    place = np.column_stack([points, np.full(PINGS, 5.0)])
    truth = np.array([200.0, 300.0, DEPTH]) + PRIOR * rng.normal(size=3)
    grid = np.arange(0.0, time[-1] + 60.0, STEP)
    series = ornstein_uhlenbeck(rng, grid.size, MEMORY)
    fraction = CONSTANT * rng.normal() + DRIFT * drifts * np.interp(time, grid, series)
    two_way = 2.0 * direct_time(place, truth) * np.exp(-fraction) + rng.normal(0.0, noise, PINGS)
    node = Node("A", (200.0, 300.0, DEPTH), tuple(PRIOR))
    return Survey((node,), np.zeros(PINGS, int), time, two_way, place, place), truth


def known_covariance(
    survey: Survey, medium: Medium, noise: float, truth: np.ndarray, *, drifts: bool
) -> np.ndarray:
    """Covariance of the position for the noise and the drift that made the survey."""
    speed = sound_speed_terms(survey, truth[None], "known", SpeedPrior())
    unknowns = SurveyUnknowns(survey, speed)
    values = unknowns.prior_mean
    values[:3] = truth
    legs = predict(survey, medium, truth[None], np.zeros(3))
    rows = Linearization(unknowns, values, legs, np.ones(PINGS)).rows(slice(0, PINGS))[:, :3]
    apart = np.abs(survey.time[:, None] - survey.time)
    water = CONSTANT**2 + drifts * DRIFT**2 * np.exp(-apart / MEMORY)
    whole = noise**2 * np.eye(PINGS) + water * np.outer(legs.travel_time, legs.travel_time)
    return np.linalg.inv(rows.T @ np.linalg.solve(whole, rows) + np.diag(PRIOR**-2.0))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--surveys", type=int, default=20)
    parser.add_argument("--shapes", nargs="+", default=["circle", "cross", "line"])
    parser.add_argument("--noises", nargs="+", type=float, default=[5e-5, 6e-4, 5e-3])
    chosen = parser.parse_args()
    medium = deep_water()
    options = LocateOptions(speed_prior=SpeedPrior(scale=CONSTANT))
    print("pattern  noise [ms]  drift  inside 95 %  sigma  median  models")
    for shape in chosen.shapes:
        axes = [0, 2] if shape == "line" else [0, 1, 2]  # a line has a mirror image
        for noise in chosen.noises:
            for drifts in (False, True):
                squares, ratios, kinds = [], [], Counter()
                for seed in range(chosen.surveys):
                    survey, truth = made(seed, shape, noise, drifts=drifts)
                    found = locate(survey, medium, options)
                    error = (found.positions[0] - truth)[axes]
                    stated = found.covariance[np.ix_(axes, axes)]
                    squares.append(error @ np.linalg.solve(stated, error))
                    right = known_covariance(survey, medium, noise, truth, drifts=drifts)
                    ratio = np.diag(stated) / np.diag(right)[axes]
                    ratios.append(np.sqrt(ratio.max()))
                    kinds[found.hyperparameters["sound_speed"]] += 1
                inside = np.mean(np.array(squares) < chi2.ppf(0.95, len(axes)))
                models = ", ".join(f"{kind} {count}" for kind, count in kinds.most_common())
                print(
                    f"{shape:8s} {1e3 * noise:10g} {drifts!s:>6s} {inside:12.2f}"
                    f" {np.mean(ratios):6.2f} {np.median(ratios):7.2f}  {models}",
                    flush=True,
                )


if __name__ == "__main__":
    main()

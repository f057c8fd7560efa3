"""
Coverage and size of the standard deviations of `mantaray.locate` by class of survey.

Run with ``python benchmarks/bench_location_sigmas.py [--surveys N] [--shapes ...]``. A class is a
pattern of pings (circle, cross, line), the noise of two-way times, and water that drifts or not: an
Ornstein-Uhlenbeck process of 1e-4 of the sound speed with a memory of an hour, beside a constant
error of 1e-3. One node at 2,000 m answers 200 pings. Half of the surveys are on a plane, half on a
sphere, with travel times in closed form that do not use the package. Rows: class, share of surveys
whose true position is in the 95 % region (on a line: of depth and the coordinate along it) with its
95 % interval, mean standard deviation over the one with the true model known (of the worst axis),
that of the median survey, both for an ideal rule, and models chosen. The ideal rule knows the noise
and size and memory of the drift, and that half of all surveys have one: what it cannot tell, no
rule can. A survey takes 0.2 s.

``--earth flat`` or ``sphere`` does not state the Earth, with this truth in water of one speed.
``--lever-error F S`` and ``--heading-error DEG`` give the ship headings and a lever arm of 21 m
that are wrong by these (``0 0``: right), on a pattern that is sailed in all directions (``laps``)
as well.
"""

import argparse
import sys
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.stats import binomtest, chi2

from pymantaray.acoustics import Medium
from pymantaray.apps.locate import LeverArm, LocateOptions, Node, Pattern, Survey, locate
from pymantaray.apps.locate.linear import Linearization
from pymantaray.apps.locate.sound_speed import SpeedPrior, sound_speed_terms
from pymantaray.apps.locate.travel_times import predict
from pymantaray.apps.locate.unknowns import SurveyUnknowns
from pymantaray.geometry import EarthSphere

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from campaigns import GRADIENT, SURFACE_SPEED, direct_time, to_world
from drifting import STEP, deep_water, ornstein_uhlenbeck, pattern

DEPTH, RADIUS, PINGS, SPEED = 2000.0, 1500.0, 200, 2.0
DRIFT, MEMORY, CONSTANT = 1e-4, 3600.0, 1e-3
PRIOR = np.array([100.0, 100.0, 50.0])  # m
LEVER = np.array([6.0, -2.5, 20.0])  # m; stated, if lever arm and headings are wrong
EARTH, ONE_SPEED = 6371e3, 1500.0
# sound speed a - b r^2 at the radius r, whose rays on a sphere are arcs of circles
B = GRADIENT / (2.0 * EARTH)
A = SURFACE_SPEED + B * EARTH**2


def spherical_time(place: np.ndarray, node: np.ndarray) -> np.ndarray:
    """Travel time in water on a sphere: a distance in hyperbolic space (Poincare's ball). [s]"""
    first, second = EARTH - place[:, 2], EARTH - node[2]
    across = np.hypot(*(place - node)[:, :2].T)
    chord = (first - second) ** 2 + 4.0 * first * second * np.sin(0.5 * across / EARTH) ** 2
    speeds = (A - B * first**2) * (A - B * second**2)
    return np.arcsinh(np.sqrt(A * B * chord / speeds)) / np.sqrt(A * B)


@dataclass
class Truth:
    """What the file of a survey does not say, or says wrongly."""

    earth: str | None = None
    on_sphere: bool = False
    lever_error: tuple[float, float] | None = None
    heading_error: float = 0.0  # rad

    @property
    def has_lever(self) -> bool:
        """True if the ship has headings and a lever arm."""
        return self.lever_error is not None or self.heading_error != 0.0

    def time(self, place: np.ndarray, node: np.ndarray) -> np.ndarray:
        """Travel time, in water of one speed if the Earth may be a sphere. [s]"""
        if self.earth is None:
            return (spherical_time if self.on_sphere else direct_time)(place, node)
        first, second = EARTH - place[:, 2], EARTH - node[2]
        across = np.hypot(*(place - node)[:, :2].T)
        if self.earth == "sphere":
            across = 2.0 * np.sqrt(first * second) * np.sin(0.5 * across / EARTH)
        return np.hypot(across, first - second) / ONE_SPEED

    def medium(self) -> Medium:
        """Water of the travel times."""
        if self.earth is None and self.on_sphere:
            depth = np.arange(0.0, 7001.0, 100.0)
            water = Medium.from_profile(depth, A - B * (EARTH - depth) ** 2, bottom_depth=7000.0)
            return water.with_earth(EarthSphere(EARTH))
        if self.earth is None:
            return deep_water()
        speeds = [ONE_SPEED, ONE_SPEED]
        return Medium.from_profile([0.0, 7000.0], speeds, bottom_depth=7000.0)

    def true_medium(self) -> Medium:
        """Water of the travel times on the Earth that made them."""
        water = self.medium()
        return water.with_earth(EarthSphere(EARTH)) if self.earth == "sphere" else water


def sailed(shape: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, places and courses of a ship on a pattern."""
    if shape == "laps":
        time = np.linspace(0.0, 21_600.0, PINGS)
        points, step = (pattern(time + dt, RADIUS, SPEED) for dt in (0.0, 1.0))
        course = step - points
    else:
        points = Pattern(shape, RADIUS, PINGS).points()
        course = np.diff(points, axis=0, prepend=2.0 * points[:1] - points[1:2])
        length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
        time = length / SPEED * np.arange(PINGS) / PINGS
    place = np.column_stack([points, np.full(PINGS, 5.0)])
    return time, place, np.arctan2(course[:, 1], course[:, 0])


def made(
    seed: int, shape: str, noise: float, truth: Truth, *, drifts: bool
) -> tuple[Survey, np.ndarray]:
    """Survey of a ship on a pattern, and the true position of its node."""
    rng = np.random.default_rng([seed, 7])
    time, place, course = sailed(shape)
    position = np.array([200.0, 300.0, DEPTH]) + PRIOR * rng.normal(size=3)
    grid = np.arange(0.0, time[-1] + 60.0, STEP)
    series = ornstein_uhlenbeck(rng, grid.size, MEMORY)
    fraction = CONSTANT * rng.normal() + DRIFT * drifts * np.interp(time, grid, series)
    attitude = np.zeros((PINGS, 3))
    lever = np.zeros(3)
    transducer = place
    if truth.has_lever:
        attitude[:, 0] = course
        lever = LEVER
        arm = LEVER + np.append(truth.lever_error or (0.0, 0.0), 0.0)
        transducer = place + to_world(attitude + np.array([truth.heading_error, 0.0, 0.0]), arm)
    two_way = 2.0 * truth.time(transducer, position) * np.exp(-fraction)
    two_way += rng.normal(0.0, noise, PINGS)
    node = Node("A", (200.0, 300.0, DEPTH), tuple(PRIOR))
    survey = Survey((node,), np.zeros(PINGS, int), time, two_way, place, place, attitude, attitude)
    return survey.assign(lever=LeverArm(tuple(lever))), position


class Known:
    """
    Posteriors of the position with the noise and the drift that made a survey, linear at the truth.
    """

    def __init__(self, survey: Survey, medium: Medium, noise: float, truth: np.ndarray) -> None:
        speed = sound_speed_terms(survey, truth[None], "known", SpeedPrior())
        unknowns = SurveyUnknowns(survey, speed)
        values = unknowns.prior_mean
        values[:3] = truth
        legs = predict(survey, medium, truth[None], unknowns.lever(values))
        linear = Linearization(unknowns, values, legs, np.ones(PINGS))
        rows = linear.rows(slice(0, PINGS))[:, :3]
        apart = np.abs(survey.time[:, None] - survey.time)
        self._prior_error = np.array(survey.nodes[0].position) - truth
        self.posteriors = []
        for drift in (0.0, DRIFT):
            water = CONSTANT**2 + drift**2 * np.exp(-apart / MEMORY)
            whole = noise**2 * np.eye(PINGS) + water * np.outer(legs.travel_time, legs.travel_time)
            self.posteriors.append(self._posterior(rows, linear.residual, whole))

    def _posterior(
        self, rows: np.ndarray, residual: np.ndarray, whole: np.ndarray
    ) -> tuple[float, np.ndarray, np.ndarray]:
        """Log evidence, error of the position and its covariance, for a covariance of residuals."""
        weighted = np.linalg.solve(whole, rows)
        covariance = np.linalg.inv(rows.T @ weighted + np.diag(PRIOR**-2.0))
        error = covariance @ (weighted.T @ residual + PRIOR**-2.0 * self._prior_error)
        marginal = whole + (rows * PRIOR**2) @ rows.T
        odd = residual - rows @ self._prior_error
        evidence = -0.5 * (np.linalg.slogdet(marginal)[1] + odd @ np.linalg.solve(marginal, odd))
        return evidence, error, covariance

    def average(self) -> tuple[np.ndarray, np.ndarray]:
        """Error and covariance, if half of all surveys have the drift."""
        evidence, errors, covariances = (
            np.array(part) for part in zip(*self.posteriors, strict=True)
        )
        weight = np.exp(evidence - evidence.max())
        weight /= weight.sum()
        mean = weight @ errors
        apart = errors - mean
        return mean, np.tensordot(weight, covariances, 1) + (weight * apart.T) @ apart


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--surveys", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--shapes", nargs="+", default=["circle", "cross", "line"])
    parser.add_argument("--noises", nargs="+", type=float, default=[5e-5, 6e-4, 5e-3])
    parser.add_argument("--earth", choices=["flat", "sphere"])
    parser.add_argument("--lever-error", nargs=2, type=float)
    parser.add_argument("--heading-error", type=float, default=0.0)
    chosen = parser.parse_args()
    lever_error = None if chosen.lever_error is None else tuple(chosen.lever_error)
    heading_error = np.radians(chosen.heading_error)
    what = Truth(chosen.earth, lever_error=lever_error, heading_error=heading_error)
    seeds = range(chosen.first_seed, chosen.first_seed + chosen.surveys)
    print(
        "pattern  noise [ms]  drift  inside 95 %             sigma  median  ideal:    sigma  models"
    )
    for shape in chosen.shapes:
        for noise in chosen.noises:
            for drifts in (False, True):
                row = _row(shape, noise, what, seeds, drifts=drifts)
                print(f"{shape:8s} {1e3 * noise:10g} {drifts!s:>6s} {row}", flush=True)


def _row(shape: str, noise: float, what: Truth, seeds: range, *, drifts: bool) -> str:
    """Results of one class as text."""
    axes = [0, 2] if shape == "line" else [0, 1, 2]  # a line has a mirror image
    squares, ideal, ratios, ideal_ratios, kinds = [], [], [], [], Counter()
    for seed in seeds:
        survey_truth = replace(what, on_sphere=bool(seed % 2))
        medium = survey_truth.medium()
        survey, truth = made(seed, shape, noise, survey_truth, drifts=drifts)
        found = locate(survey, medium, options_of(survey_truth))
        covariance = found.covariance
        squares.append(_square(found.positions[0] - truth, covariance, axes))
        known = Known(survey, survey_truth.true_medium(), noise, truth)
        mean, unsure = known.average()
        ideal.append(_square(mean, unsure, axes))
        right = np.diag(known.posteriors[drifts][2])[axes]
        for found_ratios, one in ((ratios, covariance), (ideal_ratios, unsure)):
            found_ratios.append(np.sqrt((np.diag(one)[axes] / right).max()))
        kind = found.hyperparameters["sound_speed"]
        kinds[f"{kind} and lever arm" if found.solution.model.lever_doubt else kind] += 1
    inside, of_ideal = (np.sum(np.array(x) < chi2.ppf(0.95, len(axes))) for x in (squares, ideal))
    low, high = binomtest(int(inside), len(seeds)).proportion_ci(method="wilson")
    models = ", ".join(f"{kind} {number}" for kind, number in kinds.most_common())
    coverage = f"{inside / len(seeds):6.3f} ({low:.3f} to {high:.3f})"
    sizes = f"{np.mean(ratios):6.2f} {np.median(ratios):7.2f}"
    best = f"{of_ideal / len(seeds):6.3f} {np.mean(ideal_ratios):6.2f}"
    return f"{coverage} {sizes} {best}  {models}"


def _square(error: np.ndarray, covariance: np.ndarray, axes: list[int]) -> float:
    """Squared error in units of its covariance, on some axes."""
    some = error[axes]
    return float(some @ np.linalg.solve(covariance[np.ix_(axes, axes)], some))


def options_of(truth: Truth) -> LocateOptions:
    """Options that state what the file would."""
    stated = "sphere" if truth.on_sphere else "flat"
    prior = SpeedPrior(scale=CONSTANT)
    return LocateOptions(speed_prior=prior, earth=stated if truth.earth is None else "auto")


if __name__ == "__main__":
    main()

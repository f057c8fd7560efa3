r"""
Tests of positions from parts of a survey: halves in time, and odd and even pings.

Two parts share the priors :math:`P`. If their posterior covariances are :math:`S_1, S_2`, the
covariance of the difference of their estimates is
:math:`S_1 + S_2 - S_1 P^{-1} S_2 - S_2 P^{-1} S_1`.
"""

import numpy as np
from scipy.special import chdtrc

from pymantaray.apps.locate.evidence import Posterior, posterior
from pymantaray.apps.locate.patterns import LEVEL, STATED_NOISE, NoiseTest
from pymantaray.apps.locate.solve import SurveySolution
from pymantaray.arrays import Array, Mask

HALVES = "halves in time"
_PARTS = 2
_MIN_VARIANCE = 1e-10  # of the difference, relative to its largest
_MIN_PINGS = 10  # in each part


def part_tests(solution: SurveySolution, spread: Array) -> list[NoiseTest]:
    """
    Compare the mean position of all nodes from the halves in time, and from odd and even pings.

    ``spread`` [m²] is the covariance that the choice of the model adds to the positions. Each part
    has half of the pings, so the difference of two parts has four times of it.
    """
    rows = np.flatnonzero(solution.used)
    if rows.size < _PARTS * _MIN_PINGS:
        return []
    middle = np.median(solution.unknowns.survey.time[rows])
    order = np.zeros(len(solution.used), dtype=np.int64)
    order[rows] = np.arange(rows.size) // len(solution.unknowns.survey.nodes)
    late = solution.unknowns.survey.time > middle
    odd = order % 2 == 1
    # noise with a memory is in both of odd and even pings, which only the halves can test
    tests = [_difference(HALVES, solution, late, spread)]
    if solution.correlation.ratio == 0.0:
        tests.append(_difference("odd and even pings", solution, odd, spread))
    return [test for test in tests if test.degrees > 0.0]


def widening(tests: list[NoiseTest]) -> float:
    """
    Factor of the standard deviations due to failed tests, at least 1.

    The variances are multiplied by the largest ratio of a failed test. This is the chi-square per
    degree of freedom of a pattern over time and of a difference between parts. A pattern over the
    geometry is the trace of a systematic error, whose size in the positions is unknown: the whole
    excess of its chi-square may act on one position. The covariance contains the estimated noise,
    so residuals that differ from the stated noise do not count.
    """
    failed = [test for test in tests if not test.passed and test.name != STATED_NOISE]
    ratios = [
        1.0 + test.chi_square - test.degrees if test.systematic else test.chi_square / test.degrees
        for test in failed
    ]
    return float(np.sqrt(max([1.0, *ratios])))


def _difference(name: str, solution: SurveySolution, second: Mask, spread: Array) -> NoiseTest:
    """Chi-square of the difference between two parts in their mean position."""
    unknowns = solution.unknowns
    one, two = (_part(solution, solution.used & part) for part in (~second, second))
    sd = unknowns.scaled_sd(solution.posterior.hyperparameters)
    precision = np.zeros(sd.size)
    precision[sd > 0.0] = sd[sd > 0.0] ** -2.0
    shared = one.covariance @ (precision[:, None] * two.covariance)
    whole = one.covariance + two.covariance - shared - shared.T
    mean = unknowns.position_map(solution.values).mean(axis=0)
    nodes = np.tile(np.eye(3) / len(unknowns.survey.nodes), len(unknowns.survey.nodes))
    covariance = mean @ whole @ mean.T + _PARTS**2 * nodes @ spread @ nodes.T
    change = mean @ (two.change - one.change)
    values, vectors = np.linalg.eigh(covariance)
    free = values > _MIN_VARIANCE * values.max()
    normalized = (vectors.T @ change)[free] / np.sqrt(values[free])
    total = float(np.sum(normalized**2))
    degrees = float(free.sum())
    probability = float(chdtrc(degrees, total))
    variances = np.diag(covariance)
    known = variances > _MIN_VARIANCE * values.max()
    sigmas = change[known] / np.sqrt(variances[known])
    axes = np.array(["north", "east", "depth"])[known]
    details = ", ".join(
        f"{axis} {shift:+.3f} m ({sigma:+.1f} sigma)"
        for axis, shift, sigma in zip(axes, change[known], sigmas, strict=True)
    )
    return NoiseTest(name, total, degrees, probability, probability > LEVEL, details)


def _part(solution: SurveySolution, part: Mask) -> Posterior:
    """Posterior of a part of the pings, with the noise and smoothness of all."""
    fit = solution.posterior
    survey = solution.unknowns.survey
    products = solution.linear.products(
        part, solution.correlation, survey.platform_error, fit.sigma
    )
    return posterior(
        products,
        solution.unknowns,
        solution.linear.values,
        fit.hyperparameters,
        sigma=fit.sigma,
        steps=1,
    )

"""Chi-square tests of a fit: residuals against the stated noise, and against patterns over time, azimuth, range and attitude."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import chdtrc

from pymantaray.locate.solve import Solution
from pymantaray.locate.travel_times import transducers

Array = NDArray[np.float64]
LEVEL = 1e-3
"""Probability at which a right model fails any of the tests."""
_MOST_BINS, _FEWEST = 24, 8  # bins, and pings of each
_TURNED = 0.02  # rad; attitudes that vary by less show no pattern


@dataclass(frozen=True)
class NoiseTest:
    """Outcome of one test: what was tested, chi-square, degrees of freedom, probability of a larger value, and verdict."""

    name: str
    chi_square: float
    degrees: float
    probability: float
    passed: bool


def test_table(tests: list[NoiseTest]) -> pd.DataFrame:
    """Tests as a table."""
    return pd.DataFrame([vars(test) for test in tests])


def noise_tests(solution: Solution) -> list[NoiseTest]:
    """
    Tests of the residuals of a solution.

    ``stated noise`` compares them with the standard deviations that the survey states, if it does; both tails count. The
    others compare the means of bins with zero, at the estimated noise: a term that the model lacks leaves a pattern.
    """
    survey, used = solution.unknowns.survey, solution.used
    white = whitened_residuals(solution)
    tests = []
    stated = survey.sigma[used]
    if np.isfinite(stated).all():
        # solution weights are the stated sigmas over their median
        reference = float(np.median(stated / solution.linear.weight[used]))
        total = float(np.sum(white**2)) * solution.correlation.variance / reference**2
        degrees = max(white.size - solution.posterior.effective, 1.0)
        upper = float(chdtrc(degrees, total))
        probability = 2.0 * min(upper, 1.0 - upper)
        tests.append(NoiseTest("stated noise", total, degrees, probability, probability > LEVEL))
    patterns = _coordinates(solution)
    for name, (coordinate, group) in patterns.items():
        tests.append(_pattern(name, white / solution.posterior.sigma, coordinate, group, len(patterns)))
    return tests


def whitened_residuals(solution: Solution) -> Array:
    """Independent residuals of the used pings, of the standard deviation of the white noise. [s]"""
    s = solution
    platform = s.unknowns.survey.platform_error
    blocks = s.linear.whitened(s.used, s.correlation, platform, s.posterior.sigma)
    return np.concatenate([block[:, -1] - block[:, :-1] @ s.posterior.change for block, _ in blocks])


def _coordinates(solution: Solution) -> dict[str, tuple[Array, NDArray[np.int64]]]:
    """Coordinates in which residuals may have a pattern, and the node of each used ping where patterns are by node."""
    survey, used = solution.unknowns.survey, solution.used
    near, _ = transducers(survey, solution.unknowns.lever(solution.values))
    step = (near - solution.positions[survey.node])[used]
    node, alone = survey.node[used], np.zeros(int(used.sum()), dtype=np.int64)
    out = {"time": (survey.time[used], alone)}
    if not survey.between_nodes[used].any():
        out["azimuth"] = (np.arctan2(step[:, 1], step[:, 0]), node)
        out["range"] = (np.hypot(step[:, 0], step[:, 1]), node)
        heading = survey.transmit_attitude[used, 0]
        if np.ptp(heading) > _TURNED:
            bearing = np.arctan2(-step[:, 1], -step[:, 0]) - heading
            out["bearing from the bow"] = (np.mod(bearing, 2.0 * np.pi), alone)
    return out


def _pattern(
    name: str, residual: Array, coordinate: Array, group: NDArray[np.int64], count: int
) -> NoiseTest:
    """Chi-square of the means of bins of equal numbers of pings."""
    total, bins = 0.0, 0
    for one in np.unique(group):
        mine = group == one
        order = np.argsort(coordinate[mine], kind="stable")
        parts = min(_MOST_BINS, max(order.size // _FEWEST, 1))
        for part in np.array_split(residual[mine][order], parts):
            total += float(part.sum() ** 2 / part.size)
            bins += 1
    probability = float(chdtrc(bins, total))
    return NoiseTest(f"pattern over {name}", total, float(bins), probability, probability > LEVEL / count)

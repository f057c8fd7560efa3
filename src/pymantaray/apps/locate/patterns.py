"""Chi-square tests of a fit: residuals against the stated noise, and against patterns."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import chdtrc, ndtri

from pymantaray.apps.locate.solve import SurveySolution
from pymantaray.arrays import Array

LEVEL = 1e-3
"""Probability that a correct model fails any of the tests of patterns, or one of the others."""
STATED_NOISE = "stated noise"
_BEARING = "bearing from the bow"
_GEOMETRY = ("azimuth", "range", _BEARING)
_MAX_BINS = 24  # number of bins, and pings per bin
_MIN_PINGS = 8
_MIN_ATTITUDE_SPREAD = 0.02  # rad; with a smaller spread, patterns over attitude are not tested


@dataclass(frozen=True)
class NoiseTest:
    """Result of one test; `probability` is that of a larger value."""

    name: str
    chi_square: float
    degrees: float
    probability: float
    passed: bool
    details: str = ""

    @property
    def systematic(self) -> bool:
        """True for a pattern over the geometry of the pings."""
        return self.name in (f"pattern over {name}" for name in _GEOMETRY)

    @property
    def equivalent_sigma(self) -> float:
        """Standard deviations of a normal variable that is beyond them with the probability."""
        return float(-ndtri(0.5 * max(self.probability, 1e-300)))

    @property
    def text(self) -> str:
        """Result in one line."""
        verdict = "passed" if self.passed else "FAILED"
        details = f": {self.details}" if self.details else ""
        return (
            f"{self.name}{details}; chi-square {self.chi_square:.1f} of {self.degrees:.0f},"
            f" probability {self.probability:.2g}, {verdict}"
        )


def test_table(tests: list[NoiseTest]) -> pd.DataFrame:
    """Tests as a table."""
    return pd.DataFrame([vars(test) for test in tests])


def noise_tests(solution: SurveySolution) -> list[NoiseTest]:
    """
    Test the residuals of a solution.

    ``stated noise`` compares residuals with the standard deviations in the survey, if there are
    any; it is two-sided. The other tests compare means of bins with zero at the estimated noise. A
    term that the model lacks causes a pattern.
    """
    survey = solution.unknowns.survey
    used = solution.used
    white = whitened_residuals(solution)
    tests = []
    stated_sigma = survey.sigma[used]
    if np.isfinite(stated_sigma).all():
        # weights of the solution are the stated sigmas over their median
        reference = float(np.median(stated_sigma / solution.linear.weight[used]))
        total = float(np.sum(white**2)) * solution.correlation.variance / reference**2
        degrees = max(white.size - solution.posterior.effective, 1.0)
        upper = float(chdtrc(degrees, total))
        probability = 2.0 * min(upper, 1.0 - upper)
        tests.append(NoiseTest(STATED_NOISE, total, degrees, probability, probability > LEVEL))
    patterns = _coordinates(solution)
    for name, (coordinate, group) in patterns.items():
        tests.append(
            _pattern(name, white / solution.posterior.sigma, coordinate, group, len(patterns))
        )
    return tests


def whitened_residuals(solution: SurveySolution) -> Array:
    """Independent residuals of the used pings, with the sigma of the white noise. [s]"""
    change = solution.posterior.change
    return np.concatenate(
        [block[:, -1] - block[:, :-1] @ change for block in solution.whitened_rows()]
    )


def _coordinates(solution: SurveySolution) -> dict[str, tuple[Array, NDArray[np.int64]]]:
    """Coordinates for tests of patterns, and the node of each used ping for patterns by node."""
    survey = solution.unknowns.survey
    used = solution.used
    transmit_position, _ = solution.transducers()
    step = (transmit_position - solution.positions[survey.node])[used]
    node = survey.node[used]
    one_group = np.zeros(int(used.sum()), dtype=np.int64)
    out = {"time": (survey.time[used], one_group)}
    if not survey.between_nodes[used].any():
        out["azimuth"] = (np.arctan2(step[:, 1], step[:, 0]), node)
        out["range"] = (np.hypot(step[:, 0], step[:, 1]), node)
        heading = survey.transmit_attitude[used, 0]
        if np.ptp(heading) > _MIN_ATTITUDE_SPREAD:
            bearing = np.arctan2(-step[:, 1], -step[:, 0]) - heading
            out[_BEARING] = (np.mod(bearing, 2.0 * np.pi), one_group)
    return out


def _pattern(
    name: str, residual: Array, coordinate: Array, group: NDArray[np.int64], count: int
) -> NoiseTest:
    """Chi-square of the means of bins with equal numbers of pings."""
    total = 0.0
    bins = 0
    for label in np.unique(group):
        members = group == label
        order = np.argsort(coordinate[members], kind="stable")
        parts = min(_MAX_BINS, max(order.size // _MIN_PINGS, 1))
        for part in np.array_split(residual[members][order], parts):
            total += float(part.sum() ** 2 / part.size)
            bins += 1
    probability = float(chdtrc(bins, total))
    return NoiseTest(
        f"pattern over {name}", total, float(bins), probability, probability > LEVEL / count
    )

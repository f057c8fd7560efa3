r"""
Chi-square tests of a fit: stated noise, patterns of residuals, and positions from both halves.

Two halves share the priors :math:`P`. If their posterior covariances are :math:`S_1, S_2`, the
covariance of the difference of their estimates is
:math:`S_1 + S_2 - S_1 P^{-1} S_2 - S_2 P^{-1} S_1`.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import chdtrc, ndtri

from pymantaray.apps.locate.evidence import posterior
from pymantaray.apps.locate.solve import SurveySolution
from pymantaray.arrays import Array

LEVEL = 0.01
"""Probability that a correct model fails any of the tests."""
STATED_NOISE = "stated noise"
PATTERN = "pattern of residuals"
HALVES = "halves in time"
_BEARING = "bearing from the bow"
_REMEDIES = {
    "time": "let the sound speed vary over time with `speed_model='time'`",
    "azimuth": "check the positions of the platform, or use `speed_model='gradient'`",
    "range": "check the profile of sound speed",
    _BEARING: "check the lever arm, or estimate it with `lever_sigma`",
    STATED_NOISE: "check `sigma`; the standard deviations follow the estimated noise",
    HALVES: "check whether a node or the frame of the platform moved",
}
_MAX_BINS = 24  # number of bins, and pings per bin
_MIN_PINGS = 8
_MIN_ATTITUDE_SPREAD = 0.02  # rad; with a smaller spread, patterns over attitude are not tested
_MIN_HALF = 10  # pings
_HALVES = 2
_MIN_VARIANCE = 1e-10  # of the difference of halves, relative to its largest


@dataclass(frozen=True)
class FitTest:
    """
    Result of one test.

    ``probability`` is that of a larger value if the model is right. A failed test multiplies the
    variances of the positions by ``variance_factor``.
    """

    name: str
    chi_square: float
    degrees: float
    probability: float
    variance_factor: float = 1.0
    level: float = LEVEL
    passed: bool = True
    details: str = ""
    remedy: str = ""

    @property
    def equivalent_sigma(self) -> float:
        """Standard deviations of a normal variable that is beyond them with the probability."""
        return float(-ndtri(0.5 * max(self.probability, 1e-300)))

    @property
    def text(self) -> str:
        """Result in one line."""
        verdict = "passed" if self.passed else f"FAILED; {self.remedy}"
        details = f": {self.details}" if self.details else ""
        return (
            f"{self.name}{details}; chi-square {self.chi_square:.1f} of {self.degrees:.0f},"
            f" probability {self.probability:.2g}, level {self.level:.2g}: {verdict}"
        )


def fit_tests(solution: SurveySolution, spread: Array) -> list[FitTest]:
    """
    Test residuals and positions at one level of all tests together (Holm's correction).

    ``spread`` [m²] is the covariance that the choice of the model adds to the positions.
    """
    white = whitened_residuals(solution)
    tests = [*_stated_noise(solution, white), _pattern(solution, white)]
    return judged([*tests, *_halves(solution, spread)])


def judged(tests: Iterable[FitTest]) -> list[FitTest]:
    """Tests with Holm's levels: the least probable one has that of all divided by their number."""
    out = list(tests)
    passed = False
    for rank, k in enumerate(np.argsort([test.probability for test in out], kind="stable")):
        level = LEVEL / (len(out) - rank)
        passed = passed or out[k].probability > level
        remedy = "" if passed else out[k].remedy
        out[k] = replace(out[k], level=level, passed=passed, remedy=remedy)
    return out


def widening(tests: Iterable[FitTest]) -> float:
    """Factor of the standard deviations due to failed tests, at least 1."""
    factors = [test.variance_factor for test in tests if not test.passed]
    return float(np.sqrt(max([1.0, *factors])))


def test_table(tests: Iterable[FitTest]) -> pd.DataFrame:
    """Tests as a table."""
    return pd.DataFrame([vars(test) for test in tests])


def whitened_residuals(solution: SurveySolution) -> Array:
    """Independent residuals of the used pings, with the sigma of the white noise. [s]"""
    change = solution.posterior.change
    return np.concatenate(
        [block[:, -1] - block[:, :-1] @ change for block in solution.whitened_rows()]
    )


def _stated_noise(solution: SurveySolution, white: Array) -> list[FitTest]:
    """
    Residuals against the standard deviations in the survey, if there are any; two-sided.

    The covariance contains the estimated noise, so a failure does not change it.
    """
    stated_sigma = solution.unknowns.survey.sigma[solution.used]
    if not np.isfinite(stated_sigma).all():
        return []
    # weights of the solution are the stated sigmas over their median
    reference = float(np.median(stated_sigma / solution.linear.weight[solution.used]))
    total = float(np.sum(white**2)) * solution.correlation.variance / reference**2
    degrees = max(white.size - solution.posterior.effective, 1.0)
    upper = float(chdtrc(degrees, total))
    probability = 2.0 * min(upper, 1.0 - upper)
    return [FitTest(STATED_NOISE, total, degrees, probability, remedy=_REMEDIES[STATED_NOISE])]


def _pattern(solution: SurveySolution, white: Array) -> FitTest:
    """
    Means of bins of residuals over the coordinate in which they are least probable.

    The probability is multiplied by the number of coordinates. A term that the model lacks causes a
    pattern. A pattern over the geometry is the trace of a systematic error, whose size in the
    positions is unknown: the whole excess of its chi-square may act on one position.
    """
    residual = white / solution.posterior.sigma
    results = []
    coordinates = _coordinates(solution)
    for name, (coordinate, group) in coordinates.items():
        total = 0.0
        bins = 0
        for label in np.unique(group):
            members = group == label
            order = np.argsort(coordinate[members], kind="stable")
            parts = min(_MAX_BINS, max(order.size // _MIN_PINGS, 1))
            for part in np.array_split(residual[members][order], parts):
                total += float(part.sum() ** 2 / part.size)
                bins += 1
        factor = total / bins if name == "time" else 1.0 + total - bins
        results.append((float(chdtrc(bins, total)), name, total, bins, factor))
    probability, worst, total, bins, _ = min(results)
    factors = [result[-1] for result in results if result[0] * len(results) <= LEVEL]
    return FitTest(
        PATTERN,
        total,
        float(bins),
        min(len(results) * probability, 1.0),
        max([1.0, *factors]),
        details=", ".join(f"{name} {value:.0f} of {count}" for _, name, value, count, _ in results),
        remedy=_REMEDIES[worst],
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


def _halves(solution: SurveySolution, spread: Array) -> list[FitTest]:
    """
    Difference of the mean position of all nodes between both halves in time.

    Each half has half of the pings, so the difference has four times the spread of the models.
    """
    used = solution.used
    if used.sum() < _HALVES * _MIN_HALF:
        return []
    # posteriors of both halves, with the noise and smoothness of all pings
    unknowns = solution.unknowns
    fit = solution.posterior
    time = unknowns.survey.time
    late = time > np.median(time[used])
    one, two = (
        posterior(
            solution.linear.products(
                used & half, solution.correlation, unknowns.survey.platform_error, fit.sigma
            ),
            unknowns,
            solution.linear.values,
            fit.hyperparameters,
            sigma=fit.sigma,
            steps=1,
        )
        for half in (~late, late)
    )
    # covariance of their difference, with the shared priors
    sd = unknowns.scaled_sd(fit.hyperparameters)
    precision = np.zeros(sd.size)
    precision[sd > 0.0] = sd[sd > 0.0] ** -2.0
    shared = one.covariance @ (precision[:, None] * two.covariance)
    whole = one.covariance + two.covariance - shared - shared.T
    mean = unknowns.position_map(solution.values).mean(axis=0)
    nodes = np.tile(np.eye(3) / len(unknowns.survey.nodes), len(unknowns.survey.nodes))
    covariance = mean @ whole @ mean.T + _HALVES**2 * nodes @ spread @ nodes.T
    change = mean @ (two.change - one.change)
    values, vectors = np.linalg.eigh(covariance)
    free = values > _MIN_VARIANCE * values.max()
    if not free.any():
        return []
    total = float(np.sum((vectors.T @ change)[free] ** 2 / values[free]))
    degrees = float(free.sum())
    details = ", ".join(
        f"{axis} {shift:+.3f} m ({shift / np.sqrt(variance):+.1f} sigma)"
        for axis, shift, variance in zip(
            ("north", "east", "depth"), change, np.diag(covariance), strict=True
        )
        if variance > _MIN_VARIANCE * values.max()
    )
    return [
        FitTest(
            HALVES,
            total,
            degrees,
            float(chdtrc(degrees, total)),
            total / degrees,
            details=details,
            remedy=_REMEDIES[HALVES],
        )
    ]

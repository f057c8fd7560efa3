"""One noise realization, solved under every condition and by every estimator; the unit of work of a process."""

from typing import NamedTuple

from pymantaray.estimation import GraphSolver, Solution, solve_conditions
from pymantaray.estimation.conditions import Estimator
from pymantaray.estimation.covariance import fixed_epochs
from pymantaray.study.config import StudyConfig
from pymantaray.study.config_estimators import RangeEstimatorSection
from pymantaray.study.store import Run


class Solved(NamedTuple):
    """What became of one realization."""

    solutions: dict[str, Solution]
    true_unknowns: dict[str, dict[str, float]]
    """For each solution with unknowns besides the poses: their true values by name."""


class RealizationSolver:
    """
    Solves realizations of one study; keeps what they share, so that a process builds it once.

    Parameters
    ----------
    run : Run
        Of whose folder the configuration, the truth, the true ocean and the noise-free measurements are there
        already.
    """

    def __init__(self, run: Run) -> None:
        self._run = run
        self._solver = GraphSolver()
        self._sections = estimator_sections(run.config)
        if self._sections:  # ray tracing and the ocean are heavy
            from pymantaray.study.estimators import EstimatorFactory

            self._factory = EstimatorFactory(run)

    def solve(self, realization: int) -> Solved:
        """
        Perturb, dead reckon and solve one realization.

        Parameters
        ----------
        realization : int
            Index, which names its random streams.

        Returns
        -------
        Solved
            One solution for each condition, then one for each estimator, in the configured order; all see the same noise.
        """
        config, truth = self._run.config, self._run.truth
        initial = (truth.position, truth.quaternion) if config.estimator.initialise == "truth" else None
        noisy = self._run.noisy_measurements(realization)
        estimators: dict[str, Estimator] = {
            section.name: self._factory.estimator(section, realization) for section in self._sections
        }
        solutions = solve_conditions(
            noisy,
            config.study.conditions,
            initial,
            estimators=estimators,
            solver=self._solver,
            covariance_samples=fixed_epochs(truth.time, config.estimator.covariance_interval_h * 3600.0),
        )
        joint = (s for s in self._sections if solutions[s.name].unknowns is not None)
        return Solved(solutions, {s.name: self._factory.true_unknowns(s, realization) for s in joint})


def estimator_sections(config: StudyConfig) -> tuple[RangeEstimatorSection, ...]:
    """
    Estimators of a study.

    Parameters
    ----------
    config : StudyConfig

    Returns
    -------
    tuple of RangeEstimatorSection
    """
    return config.estimators or ()

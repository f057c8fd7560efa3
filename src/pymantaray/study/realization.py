"""One noise realization, solved under every condition; the unit of work of a process."""

from pymantaray.estimation import GraphSolver, Solution, solve_conditions
from pymantaray.study.store import Run


class RealizationSolver:
    """
    Solves realizations of one study; keeps what they share, so that a process builds it once.

    Parameters
    ----------
    run : Run
        Of whose folder the configuration, the truth and the noise-free observations are there already.
    """

    def __init__(self, run: Run) -> None:
        self._run = run
        self._solver = GraphSolver()

    def solve(self, realization: int) -> dict[str, Solution]:
        """
        Perturb, dead reckon and solve one realization.

        Parameters
        ----------
        realization : int
            Index, which names its random streams.

        Returns
        -------
        dict of str to Solution
            One for each condition, in the configured order; all see the same noise.
        """
        config, truth = self._run.config, self._run.truth
        initial = (truth.position, truth.quaternion) if config.estimator.initialise == "truth" else None
        noisy = self._run.noisy_observations(realization)
        return solve_conditions(noisy, config.study.conditions, initial, solver=self._solver)

"""From the sections of a configuration to estimators with their range models and uncertainties."""

from pymantaray.estimation.conditions import Estimator
from pymantaray.estimation.losses import LOSSES
from pymantaray.estimation.range_models import (
    ConstantSpeed,
    MeanSlowness,
    RangeModel,
    TransmitterSpeed,
)
from pymantaray.estimation.unknowns import ClockPrior
from pymantaray.study.assemble import build_currents, build_medium
from pymantaray.study.beliefs import Beliefs
from pymantaray.study.config_estimators import (
    AnyBelief,
    ExactBelief,
    OtherDayBelief,
    PerturbedBelief,
    RangeEstimatorSection,
)
from pymantaray.study.range_models.adjustable_eigenrays import AdjustableEigenrays
from pymantaray.study.range_models.eigenray import EigenrayModel
from pymantaray.study.range_models.ray_uncertainty import RayUncertainty
from pymantaray.study.range_models.varying_eigenrays import VaryingEigenrays
from pymantaray.study.store import Run
from pymantaray.study.true_unknowns import true_amplitudes, true_clocks


class EstimatorFactory:
    """
    Makes the estimators of a study; what realizations share is made once.

    Parameters
    ----------
    run : Run
    """

    def __init__(self, run: Run) -> None:
        self._run = run
        self._beliefs = Beliefs(run)
        self._eigenray: dict[AnyBelief, tuple[int, EigenrayModel]] = {}

    def estimator(self, section: RangeEstimatorSection, realization: int) -> Estimator:
        """
        Estimator of one section, for one realization.

        Parameters
        ----------
        section : RangeEstimatorSection
        realization : int

        Returns
        -------
        Estimator
            Its cost has to lie within its chi-square bounds where what is believed is how things are: straight
            ranges, or eigenrays through the exact ocean.

        Raises
        ------
        OceanError
            If the believed ocean cannot be made.
        """
        model = self._model(section, realization)
        uncertainty = None
        if section.uncertainty is not None and isinstance(model, EigenrayModel):
            uncertainty = RayUncertainty(model, self._beliefs.covariance(*section.uncertainty))
        if section.modes is not None and isinstance(model, EigenrayModel):
            model = AdjustableEigenrays(model, *self._beliefs.modes(section.modes))
        truth = self._run.truth
        exact = section.range_model == "eigenray" and isinstance(section.belief, ExactBelief)
        return Estimator(
            ranges=section.ranges,
            links=section.links,
            model=model,
            uncertainty=uncertainty,
            correlated=section.variance == "correlated",
            loss=LOSSES.get(section.loss),
            incremental=section.solver == "incremental",
            initial=(truth.position, truth.quaternion) if section.start == "truth" else None,
            model_is_right=section.variance == "fixed" and (section.ranges == "straight" or exact),
            clocks=self._clocks(section),
        )

    def true_unknowns(self, section: RangeEstimatorSection, realization: int) -> dict[str, float]:
        """
        True values of what an estimator estimates besides the poses.

        Parameters
        ----------
        section : RangeEstimatorSection
        realization : int

        Returns
        -------
        dict of str to float
            By the names of `Unknowns`, in their units; more than those perhaps.
        """
        run = self._run
        out: dict[str, float] = {}
        if section.modes is not None:
            assert section.belief is not None  # checked by the section; for the type checker
            believed = self._beliefs.believed(section.belief, realization)
            rays = self._eigenrays(section.belief, realization)
            model = AdjustableEigenrays(rays, *self._beliefs.modes(section.modes))
            out |= true_amplitudes(model, run.ocean, believed.local, run.truth)
        if section.clocks is not None:
            out |= true_clocks(run.config, run.truth.name.tolist(), realization)
        return out

    def _clocks(self, section: RangeEstimatorSection) -> ClockPrior | None:
        if section.clocks is None:
            return None
        ranging = self._run.config.ranging
        offset, skew = section.clocks.priors(ranging.clock_offset_sigma, ranging.clock_skew_sigma)
        return ClockPrior(offset, skew, None if ranging.timing == "one-way" else ranging.turn_around_s)

    def _model(self, section: RangeEstimatorSection, realization: int) -> RangeModel:
        if section.range_model == "constant":
            assert section.sound_speed is not None  # checked by the section; for the type checker
            return ConstantSpeed(section.sound_speed)
        if section.range_model == "transmitter":
            return TransmitterSpeed()
        assert section.belief is not None  # checked by the section; for the type checker
        if section.range_model == "mean-slowness":
            return MeanSlowness(*self._beliefs.believed(section.belief, realization).profile())
        if section.belief_varies:
            return self._varying_rays(section.belief)
        return self._eigenrays(section.belief, realization)

    def _varying_rays(self, section: AnyBelief) -> VaryingEigenrays:
        assert isinstance(
            section, ExactBelief | OtherDayBelief
        )  # checked by the section; for the type checker
        config, ocean = self._run.config, self._beliefs.varying(section)
        medium_at, currents_at = build_medium(config, ocean), build_currents(config, ocean)
        assert callable(medium_at)  # it varies
        assert currents_at is None or callable(currents_at)
        return VaryingEigenrays(medium_at, currents_at, spreading_cutoff_db=config.acoustics.cutoff_db)

    def _eigenrays(self, section: AnyBelief, realization: int) -> EigenrayModel:
        """Model of a belief: estimators that share the belief share the rays."""
        of = realization if isinstance(section, PerturbedBelief) else -1
        kept = self._eigenray.get(section)
        if kept is None or kept[0] != of:
            belief = self._beliefs.believed(section, realization)
            model = EigenrayModel(
                belief.medium,
                spreading_cutoff_db=self._run.config.acoustics.cutoff_db,
                currents=belief.currents,
            )
            self._eigenray[section] = kept = (of, model)
        return kept[1]

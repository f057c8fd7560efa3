"""Estimators, with their range models and uncertainties, of the conditions of a study."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import xarray as xr

from pymantaray.acoustics.ocean_fields import OceanFields
from pymantaray.config.door.beliefs import Beliefs, KnownMission
from pymantaray.config.door.range_models import build_range_model
from pymantaray.config.estimators import (
    STANDARD,
    AnyRangeModel,
    CastBelief,
    ConditionSection,
    ExactBelief,
    FixedLagSolver,
    GtsamSolver,
)
from pymantaray.estimation import LOSSES, ClockPrior, Estimator, Method, RangeModel
from pymantaray.estimation.names import MeasuredRanges
from pymantaray.estimation.ranges.on_sphere import ALONG_CHORDS, OnSphere
from pymantaray.geometry.sphere import EarthSphere
from pymantaray.range_models.eigenray_model import AdjustableEigenrays, EigenrayModel
from pymantaray.range_models.ray_uncertainty import RayUncertainty


@dataclass(frozen=True)
class Condition:
    """Condition of a study as tables and files need it; `EstimatorFactory` builds its estimator."""

    name: str
    standard: bool
    """True if the name defines the condition completely."""
    standard_equivalent: str
    """The standard condition with the same kind of measurements."""
    ranges: MeasuredRanges
    """Measured ranges that its estimator uses; None for no ranges."""
    needs_cast: bool
    """True if its estimator assumes the water of a cast."""
    estimates_clocks: bool
    files: tuple[str, ...]
    """Input files."""
    settings: Mapping[str, Any]
    """Keys with values, as in JSON, that the name does not define."""


def build_condition(section: ConditionSection) -> Condition:
    """Condition of a section."""
    return Condition(
        name=section.name,
        standard=section.standard,
        standard_equivalent=section.standard_equivalent,
        ranges=None if section.ranges == "none" else section.ranges,
        needs_cast=isinstance(section.belief, CastBelief),
        estimates_clocks=section.clocks is not None,
        files=section.files,
        settings=section.model_dump(
            mode="json",
            exclude_defaults=True,
            exclude={"name", *STANDARD.get(section.name, ())},
        ),
    )


class EstimatorFactory:
    """
    Builds the estimators of a run; parts that realizations share are built once.

    ``ocean`` replaces the ocean of the run's configuration if it is in memory.
    """

    def __init__(self, run: KnownMission, ocean: OceanFields | None = None) -> None:
        self._run, self._beliefs = run, Beliefs(run, ocean)
        self._models: dict[AnyRangeModel, RangeModel] = {}
        self._realization = -1  # of the models

    def estimator(self, condition: str | ConditionSection, realization: int) -> Estimator:
        """Estimator of one condition, by its name or section, for one realization."""
        section = self._section(condition)
        truth = self._run.truth
        start = section.start or self._run.config.estimator.start
        earth = self._earth(section)
        model = self._model(section, realization) if self._needs_model(section) else None
        if earth is not None and isinstance(model, ALONG_CHORDS):
            model = OnSphere(model, earth)
        uncertainty = None
        if section.uncertainty is not None and isinstance(model, EigenrayModel):
            uncertainty = RayUncertainty(model, self._beliefs.covariance(*section.uncertainty))
        # if all assumptions hold, the cost must be within its chi-square bounds
        exact = section.range_model.kind == "eigenray" and isinstance(section.belief, ExactBelief)
        return Estimator(
            ranges=None if section.ranges == "none" else section.ranges,
            links=section.links,
            model=model,
            uncertainty=uncertainty,
            correlated=section.variance.kind == "correlated",
            method=self._method(section),
            initial=(truth.position, truth.quaternion) if start == "truth" else None,
            model_is_right=section.variance.kind == "fixed"
            and section.range_sigma is None
            and (section.ranges != "refracted" or exact),
            clocks=self._clocks(section),
            scale_sigma=section.scale_sigma,
            bias_sigma=section.bias_sigma,
            range_sigma=section.range_sigma,
            mean_of_directions=section.directions == "mean",
            dead_reckoned=section.solver.kind == "dead-reckoning",
        )

    def without_model(self, condition: str) -> Estimator | None:
        """Estimator that is the same in all realizations, or None if it has a range model."""
        return None if self._needs_model(self._section(condition)) else self.estimator(condition, 0)

    def _needs_model(self, section: ConditionSection) -> bool:
        """False if ranges are distances without correction."""
        kind = section.range_model.kind
        return kind != "transmitter" or section.estimates_more or self._earth(section) is not None

    def _method(self, section: ConditionSection) -> Method:
        """Solver and loss of a condition."""
        solver = self._run.config.solver_of(section)
        gtsam: Literal["converged", "default"] | None = None
        if isinstance(solver, GtsamSolver):
            gtsam = "converged" if solver.converged else "default"
        return Method(
            LOSSES.get(section.loss),
            incremental=solver.kind == "incremental" or getattr(solver, "incremental", False),
            lag=3600.0 * solver.lag_h if isinstance(solver, FixedLagSolver) else None,
            kalman=solver.kind == "kalman-filter",
            gtsam=gtsam,
        )

    def adjustable(
        self, condition: str, realization: int
    ) -> tuple[AdjustableEigenrays, xr.Dataset] | None:
        """
        Rays whose modes a condition estimates, and the local ocean that it assumes; None without
        modes.
        """
        section = self._section(condition)
        model = self._model(section, realization)
        if not isinstance(model, AdjustableEigenrays) or section.belief is None:
            return None
        return model, self._beliefs.believed(section.belief, realization).local

    def _section(self, condition: str | ConditionSection) -> ConditionSection:
        if isinstance(condition, ConditionSection):
            return condition
        return next(one for one in self._run.config.conditions if one.name == condition)

    def _model(self, section: ConditionSection, realization: int) -> RangeModel:
        """
        Range model of a condition; conditions of one realization with the same model share it.
        """
        if realization != self._realization:
            self._models = {}
            self._realization = realization
        if section.range_model not in self._models:
            self._models[section.range_model] = build_range_model(
                section.range_model, self._beliefs, realization
            )
        return self._models[section.range_model]

    def _earth(self, section: ConditionSection) -> EarthSphere | None:
        """
        Sphere on which an estimator measures distances; None in a flat frame and without ranges.
        """
        if self._run.config.acoustics.earth != "sphere" or section.ranges == "none":
            return None
        return EarthSphere.at_latitude(float(self._run.ocean.attrs["centre_latitude_deg"]))

    def _clocks(self, section: ConditionSection) -> ClockPrior | None:
        if section.clocks is None:
            return None
        ranging = self._run.config.ranging
        noise = self._run.config.noise
        offset, skew = section.clocks.priors(noise.clock_offset_sigma, noise.clock_skew_sigma)
        return ClockPrior(
            offset, skew, None if ranging.timing == "one-way" else ranging.turn_around_s
        )

"""
Range models of a study's estimators: one table from a section's kind to its builder.

A new one is an entry here, a section in `AnyRangeModel` of `config.estimators`, and a test.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from pymantaray.acoustics.ocean_fields import build_currents, medium_around
from pymantaray.config.door.beliefs import Beliefs
from pymantaray.config.door.fleet import planned_points
from pymantaray.config.door.sound import build_picker, build_timing
from pymantaray.config.estimators import (
    AnyRangeModel,
    ConstantRangeModel,
    EigenrayRangeModel,
    MeanSlownessRangeModel,
    MixtureRangeModel,
    TransmitterRangeModel,
)
from pymantaray.estimation import (
    ConstantSpeed,
    MeanSlowness,
    MixtureOptions,
    RangeEndpoints,
    RangeModel,
    TransmitterSpeed,
)
from pymantaray.range_models.candidate_rays import CandidateRays
from pymantaray.range_models.eigenray_model import AdjustableEigenrays, VaryingEigenrays


def build_range_model(section: AnyRangeModel, beliefs: Beliefs, realization: int) -> RangeModel:
    """Range model of a condition."""
    return BUILDERS[section.kind](section, beliefs, realization)


def _transmitter(_section: TransmitterRangeModel, _beliefs: Beliefs, _n: int) -> TransmitterSpeed:
    return TransmitterSpeed()


def _constant(section: ConstantRangeModel, beliefs: Beliefs, realization: int) -> ConstantSpeed:
    """
    Range model with the configured sound speed, or the mean slowness of a belief down to the
    deepest place that is planned.
    """
    if section.sound_speed is not None:
        return ConstantSpeed(section.sound_speed)
    assert section.belief is not None  # checked by the section; for the type checker
    profile = MeanSlowness(*beliefs.believed(section.belief, realization).profile())
    deepest = max(float(points[:, 2].max()) for points in planned_points(beliefs.config).values())
    down = RangeEndpoints(
        np.zeros(1), np.zeros((1, 3)), np.array([[0.0, 0.0, deepest]]), np.ones(1)
    )
    return ConstantSpeed(deepest / float(profile.predict(down).travel_time[0]))


def _mean_slowness(
    section: MeanSlownessRangeModel, beliefs: Beliefs, realization: int
) -> MeanSlowness:
    return MeanSlowness(*beliefs.believed(section.belief, realization).profile())


def _eigenray(section: EigenrayRangeModel, beliefs: Beliefs, realization: int) -> RangeModel:
    """
    Eigenrays through the assumed ocean, which may vary in time or have modes of unknown amplitude;
    estimators that share the belief share the rays.
    """
    belief = section.belief
    if belief.varies:
        ocean = beliefs.varying(belief)
        search = beliefs.config.acoustics
        medium_at = partial(medium_around, ocean, search.interpolation, search.earth)
        currents_at = build_currents(ocean) if search.currents else None
        assert currents_at is None or callable(currents_at)
        return VaryingEigenrays(medium_at, currents_at, spreading_cutoff_db=search.cutoff_db)
    rays = beliefs.believed(belief, realization).rays
    if section.modes is None:
        return rays
    return AdjustableEigenrays(rays, *beliefs.modes(section.modes))


def _mixture(section: MixtureRangeModel, beliefs: Beliefs, realization: int) -> CandidateRays:
    """Mixture of all arrivals that a receiver may take, with the study's modems."""
    config = beliefs.config
    believed = beliefs.believed(section.belief, realization)
    return CandidateRays(
        believed.medium,
        beliefs.reception,
        build_timing(config.ranging),
        MixtureOptions(
            section.null_weight, section.null_width, section.persistence_s, section.gate
        ),
        picker=build_picker(config) if section.weights == "receiver" else None,
        sound_speed_sigma=section.sound_speed_sigma,
        currents=believed.currents,
    )


BUILDERS: dict[str, Callable[[Any, Beliefs, int], RangeModel]] = {
    "transmitter": _transmitter,
    "constant": _constant,
    "mean-slowness": _mean_slowness,
    "eigenray": _eigenray,
    "mixture": _mixture,
}
"""Builder of each kind of range model."""

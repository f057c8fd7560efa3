"""Max-mixture of all arrivals that a receiver may take in an assumed ocean."""

from pymantaray.apps.study.beliefs import Beliefs
from pymantaray.config.estimators import MixtureRangeModel
from pymantaray.estimation import MixtureOptions
from pymantaray.range_models.candidate_rays import CandidateRays


def build(section: MixtureRangeModel, beliefs: Beliefs, realization: int) -> CandidateRays:
    """Range model of the belief, with the study's modems."""
    config = beliefs.config
    believed = beliefs.believed(section.belief, realization)
    picker = config.ranging.build_picker(config.build_sonar())
    return CandidateRays(
        believed.medium,
        beliefs.reception,
        config.ranging.build_timing(),
        MixtureOptions(
            section.null_weight, section.null_width, section.persistence_s, section.gate
        ),
        picker=picker if section.weights == "receiver" else None,
        sound_speed_sigma=section.sound_speed_sigma,
        currents=believed.currents,
    )

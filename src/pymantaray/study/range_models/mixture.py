"""Max-mixture of all arrivals that a receiver may take in an assumed ocean."""

from pymantaray.config.estimators import MixtureRangeModel
from pymantaray.estimation import Mixture
from pymantaray.study.assemble import build_picker
from pymantaray.study.beliefs import Beliefs
from pymantaray.study.range_models.candidate_rays import CandidateRays
from pymantaray.water.listening import build_sonar, build_timing


def build(section: MixtureRangeModel, beliefs: Beliefs, realization: int) -> CandidateRays:
    """Range model of the belief, with the study's modems."""
    config = beliefs.config
    believed = beliefs.believed(section.belief, realization)
    picker = build_picker(config.ranging, build_sonar(config.detection))
    return CandidateRays(
        believed.medium,
        beliefs.reception,
        build_timing(config.ranging),
        Mixture(section.null_weight, section.null_width, section.persistence_s, section.gate),
        picker=picker if section.weights == "receiver" else None,
        sound_speed_sigma=section.sound_speed_sigma,
        currents=believed.currents,
    )

"""
Eigenrays through a believed ocean: as it is believed, as it varies, or with modes of unknown
amplitude.
"""

from functools import partial

from pymantaray.acoustics.ocean_fields import build_currents, medium_around
from pymantaray.apps.study.beliefs import Beliefs
from pymantaray.config.estimators import EigenrayRangeModel, varies
from pymantaray.estimation import RangeModel
from pymantaray.range_models.adjustable_eigenrays import AdjustableEigenrays
from pymantaray.range_models.varying_eigenrays import VaryingEigenrays


def build(section: EigenrayRangeModel, beliefs: Beliefs, realization: int) -> RangeModel:
    """Range model of the belief; estimators that share the belief share the rays."""
    config = beliefs.config
    belief = section.belief
    if varies(belief):
        ocean = beliefs.varying(belief)
        search = config.acoustics
        medium_at = partial(medium_around, ocean, search.interpolation, search.earth)
        currents_at = build_currents(ocean) if search.currents else None
        assert currents_at is None or callable(currents_at)
        return VaryingEigenrays(medium_at, currents_at, spreading_cutoff_db=search.cutoff_db)
    rays = beliefs.believed(belief, realization).rays
    return (
        rays if section.modes is None else AdjustableEigenrays(rays, *beliefs.modes(section.modes))
    )

"""Range models of a study's estimators: a module for each, of its name, with a function ``build``.

A new one is a module here, its name and what it needs in `RANGE_MODELS` of `config.estimators`, and a test.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pymantaray.config.estimators import RangeEstimatorSection
    from pymantaray.estimation import RangeModel
    from pymantaray.study.beliefs import Beliefs


def build_range_model(section: "RangeEstimatorSection", beliefs: "Beliefs", realization: int) -> "RangeModel":
    """Range model that an estimator is configured with."""
    module = import_module(f"{__name__}.{section.range_model.replace('-', '_')}")
    model: RangeModel = module.build(section, beliefs, realization)
    return model

"""Range models of a study's estimators: a module for each, of its name, with a function ``build``.

A new one is a module here, a section in `AnyRangeModel` of `config.estimators`, and a test.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pymantaray.apps.study.beliefs import Beliefs
    from pymantaray.config.estimators import AnyRangeModel
    from pymantaray.estimation import RangeModel


def build_range_model(
    section: "AnyRangeModel", beliefs: "Beliefs", realization: int
) -> "RangeModel":
    """Range model of a condition."""
    module = import_module(f"{__name__}.{section.kind.replace('-', '_')}")
    model: RangeModel = module.build(section, beliefs, realization)
    return model

"""Interface of a sensor's module: noise levels, measurements and random perturbation."""

from collections.abc import Callable, Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from pymantaray.arrays import AnyArray
from pymantaray.records import Measurements, Trajectories

if TYPE_CHECKING:
    from pymantaray.sensing.landmarks import Landmark

Columns = dict[str, AnyArray]
"""Columns of `Measurements` by name."""
Normal = Callable[..., AnyArray]
"""Standard normal draws of a shape, from the stream named by the other arguments."""


class Scene(NamedTuple):
    """Truth that sensors measure."""

    truth: Trajectories
    landmarks: Sequence["Landmark"]
    gnss_depth: float | AnyArray
    """Depth above which a vehicle has a GNSS fix; one value, or one per vehicle and sample. [m]"""
    altitude: float | AnyArray = 0.0
    """Height above the sea floor; one value, or one per vehicle and sample. [m]"""


class Sensor(Protocol):
    """The module of a sensor; `pymantaray.sensing.noise.SENSORS` lists them."""

    def measure(self, scene: Scene, noise: Any, /) -> Columns:
        """Return the columns without noise, with the standard deviations that estimators assume."""

    def perturb(self, measurements: Measurements, normal: Normal, /) -> Columns:
        """Return the columns that noise changes."""


def level(default: float, description: str, *, may_be_zero: bool = False) -> Any:
    """Return a field of a noise model; a configuration refuses 0 unless ``may_be_zero``."""
    return field(default=default, metadata={"description": description, "may_be_zero": may_be_zero})

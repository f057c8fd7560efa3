"""What the module of a sensor has: levels of its noise, what it measures of the truth, and how chance perturbs that."""

from collections.abc import Callable, Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from numpy.typing import NDArray

from pymantaray.records import Measurements, Trajectories

if TYPE_CHECKING:
    from pymantaray.sensing.landmarks import Landmark

Columns = dict[str, NDArray[Any]]
"""Columns of `Measurements` by name."""
Normal = Callable[..., NDArray[Any]]
"""Standard normal draws of a shape, from the stream that the further arguments name."""


class Scene(NamedTuple):
    """What there is to measure."""

    truth: Trajectories
    landmarks: Sequence["Landmark"]
    gnss_depth: float | NDArray[Any]
    """A vehicle has a GNSS fix while it is shallower; one value, or for each vehicle and sample. [m]"""
    altitude: float | NDArray[Any] = 0.0
    """Height of each vehicle above the sea floor; one value, or for each vehicle and sample. [m]"""


class Sensor(Protocol):
    """The module of a sensor; `pymantaray.sensing.noise.SENSORS` lists them."""

    def measure(self, scene: Scene, noise: Any, /) -> Columns:
        """Its columns without noise, and the standard deviations that they are believed to have."""

    def perturb(self, measurements: Measurements, normal: Normal, /) -> Columns:
        """Those of its columns that noise changes."""


def level(default: float, description: str, *, may_be_zero: bool = False) -> Any:
    """Give a field of a noise model; a configuration refuses 0 where no estimator could weigh it."""
    return field(default=default, metadata={"description": description, "may_be_zero": may_be_zero})

"""Water columns as named water masses joined by monotone curves."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pymantaray.arrays import Array

if TYPE_CHECKING:
    from scipy.interpolate import PchipInterpolator


@dataclass(frozen=True)
class WaterMass:
    """Core of a water mass: name, depth, temperature and salinity."""

    name: str
    depth: float
    """Depth of the core. [m]"""
    potential_temperature: float
    """Potential temperature referred to the surface. [degC]"""
    salinity: float
    """Practical salinity. [-]"""


@dataclass(frozen=True)
class WaterColumn:
    """Water masses from the surface down; properties are monotonic between cores."""

    name: str
    masses: tuple[WaterMass, ...]

    @cached_property
    def _curve(self) -> "PchipInterpolator":
        from scipy.interpolate import PchipInterpolator

        depth = [m.depth for m in self.masses]
        return PchipInterpolator(
            depth, [[m.potential_temperature, m.salinity] for m in self.masses]
        )

    def evaluate(self, depth: Array) -> Array:
        """
        Potential temperature [degC] and practical salinity (..., 2) at depths [m]; constant beyond
        the outer cores.
        """
        return np.asarray(self._curve(np.clip(depth, self.masses[0].depth, self.masses[-1].depth)))

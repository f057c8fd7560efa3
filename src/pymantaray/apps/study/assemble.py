"""Places of vehicles in their ocean: ice above, sea floor below, and refusals."""

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics.ocean_fields import OceanFields
from pymantaray.config.door.study import Study
from pymantaray.fleet.simulation import fleet_refusals
from pymantaray.geometry.boundary import BoundarySurface
from pymantaray.ocean.schema import Finding
from pymantaray.records import Trajectories


def gnss_depth(
    depth: float, ocean: OceanFields, truth: Trajectories
) -> float | NDArray[np.float64]:
    """Maximum depth of a GNSS fix: the argument in open water, 0 under ice. [m]"""
    if "sea_ice_draft" not in ocean.local:
        return depth
    surface = BoundarySurface.from_dataset(ocean.local, "sea_ice_draft")
    if surface.depth.size == 1:
        return 0.0 if surface.depth.any() else depth
    draft = surface.depth_at(truth.position.reshape(-1, 3)).reshape(truth.position.shape[:2])
    return np.where(draft > 0.0, 0.0, depth)


def altitude(ocean: OceanFields, truth: Trajectories) -> NDArray[np.float64]:
    """Height of each vehicle above the sea floor at each sample. [m]"""
    bed = BoundarySurface.from_dataset(ocean.local, "sea_floor_depth")
    depth = bed.depth_at(truth.position.reshape(-1, 3)).reshape(truth.position.shape[:2])
    return np.asarray(depth - truth.position[..., 2])


def fleet_findings(study: Study) -> list[Finding]:
    """Findings of the check of a run's vehicles in its ocean; none for existing trajectories."""
    fleet = study.fleet
    refusals = fleet_refusals(fleet.vehicles, study.ocean.local_start(), fleet.physics_step)
    return [Finding("wrong", "fleet", str(refusal)) for refusal in refusals]

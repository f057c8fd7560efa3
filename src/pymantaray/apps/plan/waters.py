"""
Missions without noise in the waters of a plan; waters, trajectories and links of earlier designs
stay in memory.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from pymantaray.acoustics import Medium
from pymantaray.acoustics.ocean_fields import OceanFields
from pymantaray.apps.plan.definition import DeploymentPlan, Design
from pymantaray.apps.plan.solved_links import SolvedLinks
from pymantaray.apps.study.mission import assemble_mission, range_fleet, simulate_fleet
from pymantaray.apps.study.runner import refuse_too_large
from pymantaray.apps.study.store import Run, run_in_memory
from pymantaray.apps.sweep.keys import FLEET, OCEAN, task_keys
from pymantaray.config.door.study import Study, build_study
from pymantaray.geometry import stream
from pymantaray.jobs.keys import FileChecksums
from pymantaray.ocean import perturb_ocean
from pymantaray.records import Trajectories

_KEPT = 8  # waters, and trajectories of fleets, in memory


class DesignWater(NamedTuple):
    """Ocean and medium of a mission."""

    ocean: OceanFields
    medium: Medium | Callable[[float], Medium]
    drawn: bool
    """True if the ocean is a random member, which is in memory only."""


class Missions:
    """Missions of the designs of a plan."""

    def __init__(self, plan: DeploymentPlan) -> None:
        self._plan = plan
        self._waters: dict[Any, DesignWater] = {}
        self._fleets: dict[Any, Trajectories] = {}
        self._checksums = FileChecksums()
        self.links = SolvedLinks()
        """Solved links, which designs with the same ends in the same water share."""

    def run(self, design: Design, ocean: int, member: int | None) -> tuple[Run, OceanFields | None]:
        """
        Mission of a design without noise, as a run in memory, and its ocean if the run's
        configuration does not define it.
        """
        study = build_study(self._plan.study(design, ocean))
        refuse_too_large(study, 1)
        keys = task_keys(study, self._checksums.of(study.files))
        at = keys[OCEAN], study.sound.interpolation, study.sound.earth, member
        water = _kept(self._waters, at, lambda: self._water(study, member))
        truth = _kept(
            self._fleets, (keys[FLEET], member), lambda: simulate_fleet(study.fleet, water.ocean)
        )
        ranging = range_fleet(study.ranging, water.ocean, water.medium, truth, solved=self.links)
        run = run_in_memory(study, assemble_mission(study, water.ocean, truth, ranging))
        return run, water.ocean if water.drawn else None

    def _water(self, study: Study, member: int | None) -> DesignWater:
        """Water of a study, or of a random member."""
        errors = self._plan.section.perturbed
        data = None
        if errors is not None:
            assert member is not None  # each water of a plan with perturbations has a member
            data = perturb_ocean(
                study.ocean.geographic_start(),
                rms=errors.rms,
                horizontal_scale=errors.horizontal_scale,
                down_to=errors.down_to,
                modes=errors.n_modes,
                rng=stream(self._plan.base.study.seed, member, "plan", "water"),
                equation=study.ocean.equation,
            )
        ocean = study.ocean.open(study.sound.interpolation, data)
        return DesignWater(ocean, study.sound.medium(ocean), data is not None)


def _kept(kept: dict[Any, Any], key: Any, make: Callable[[], Any]) -> Any:
    """
    Value of a key, which is made if it is not in memory; the oldest value goes if there are too
    many.
    """
    if key not in kept:
        value = make()
        while len(kept) >= _KEPT:
            kept.pop(next(iter(kept)))
        kept[key] = value
    return kept[key]

"""
Missions without noise in the waters of a plan; waters, trajectories and links of earlier designs
stay in memory.
"""

import hashlib
import pickle
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from pymantaray.acoustics import Medium
from pymantaray.acoustics.currents import Currents
from pymantaray.acoustics.ocean_fields import OceanFields
from pymantaray.apps.plan.definition import DeploymentPlan, Design
from pymantaray.apps.study.mission import assemble_mission, range_fleet, simulate_fleet
from pymantaray.apps.study.runner import refuse_too_large
from pymantaray.apps.study.store import Run, run_in_memory
from pymantaray.apps.sweep.keys import FLEET, OCEAN, task_keys
from pymantaray.arrays import Array, Indices
from pymantaray.config.door.study import Study, build_study
from pymantaray.geometry import stream
from pymantaray.jobs.keys import FileChecksums
from pymantaray.jobs.progress import CountProgress
from pymantaray.ocean import perturb_ocean
from pymantaray.records import Trajectories
from pymantaray.sensing.ranging import join_transmissions
from pymantaray.sensing.receptions import Direction, Receptions, rows_between
from pymantaray.sensing.transmission import ReceptionOptions, Transmission, find_receptions

_KEPT = 8  # waters, and trajectories of fleets, in memory
_LINKS = 200_000  # links in memory; about 1 kB each


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


class SolvedLinks:
    """
    Receptions of links by the positions of their ends, their water and the options of the search.

    The results of a link are independent of the other links, so stored and new results are equal to
    the last bit.
    """

    def __init__(self) -> None:
        self.solved = 0
        """Number of links that were solved, not found in memory."""
        self._by_water: dict[bytes, _Water] = {}
        self._latest: tuple[object, object, bytes] = (None, None, b"")

    def find(
        self,
        source: Array,
        receiver: Array,
        medium: Medium,
        reception: ReceptionOptions,
        *,
        currents: Currents | None = None,
        progress: CountProgress | None = None,
    ) -> Transmission:
        """Receptions as from `find_receptions`; only new links are solved."""
        water = self._water(medium, currents, reception)
        ends = np.ascontiguousarray(np.concatenate([source, receiver], axis=1))
        keys = [row.tobytes() for row in ends]
        new = {key: k for k, key in enumerate(keys) if key not in water.row}
        if new:
            rows = np.fromiter(new.values(), dtype=np.int64)
            some = source[rows], receiver[rows]
            water.add(
                list(new),
                find_receptions(*some, medium, reception, currents=currents, progress=progress),
            )
            self.solved += len(new)
        if water.links is None:  # no link at all
            return find_receptions(source, receiver, medium, reception, currents=currents)
        result = links_of(water.links, np.array([water.row[key] for key in keys], dtype=np.int64))
        # forget the oldest waters, and the links of a single one, above the limit
        while sum(len(water.row) for water in self._by_water.values()) > _LINKS:
            self._by_water.pop(next(iter(self._by_water)))
        return result

    def _water(
        self, medium: Medium, currents: Currents | None, reception: ReceptionOptions
    ) -> "_Water":
        """
        Links of a water, which is recognized by its content, because a varying ocean is built again
        at each ping.
        """
        if not (self._latest[0] is medium and self._latest[1] is currents):
            self._latest = (
                medium,
                currents,
                hashlib.sha256(pickle.dumps((medium, currents))).digest(),
            )
        name = self._latest[2] + pickle.dumps(reception)
        return self._by_water.setdefault(name, _Water())


class _Water:
    """Solved links of one water, and the row of each by its ends."""

    def __init__(self) -> None:
        self.links: Transmission | None = None
        self.row: dict[bytes, int] = {}

    def add(self, keys: list[bytes], links: Transmission) -> None:
        self.row |= {key: len(self.row) + k for k, key in enumerate(keys)}
        self.links = links if self.links is None else join_transmissions([self.links, links])


def links_of(sound: Transmission, links: Indices) -> Transmission:
    """Results of some links, in a new order; a link may occur more than once."""
    arrivals = sound.arrivals
    start, stop = (np.searchsorted(arrivals.link, links, side=side) for side in ("left", "right"))
    link, row = rows_between(start, stop)
    some = replace(arrivals.at({"arrival": row, "n_links": links}), link=link)
    first = np.cumsum(stop - start) - (stop - start)  # first arrival of each link in the result
    parts = [
        _receptions(sound.receptions, links, direction, first - start) for direction in Direction
    ]
    return Transmission(
        some, sound.status[links], sound.near_cutoff[links], Receptions.stack(parts)
    )


def _receptions(
    receptions: Receptions, links: Indices, direction: Direction, shift: Indices
) -> Receptions:
    """
    Receptions of some links in one direction; ``shift`` moves the rows of the arrivals of each
    link.
    """
    link, row = rows_between(
        *receptions.rows_of(links, np.full(links.size, direction, dtype=np.int64))
    )
    some = receptions.at({"reception": row})
    return replace(
        some, link=link, arrival=np.where(some.arrival < 0, -1, some.arrival + shift[link])
    )

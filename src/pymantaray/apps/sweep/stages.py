"""
Stages of a mission that points share. Each is computed once and stays in memory and in the store.
"""

import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache, partial
from time import perf_counter
from typing import Any, TypeVar

import pandas as pd
import xarray as xr

from pymantaray.acoustics import Medium
from pymantaray.acoustics.medium import Interpolation
from pymantaray.acoustics.ocean_fields import OceanFields
from pymantaray.apps.study.mission import range_fleet, simulate_fleet
from pymantaray.apps.sweep.keys import FLEET, OCEAN, RAYS, STAGES, parse_failure, stage_name
from pymantaray.config.door.ocean import MissionOcean
from pymantaray.config.door.study import Study
from pymantaray.errors import SweepError, WriteError
from pymantaray.jobs.store import Store, failure_content, read_sealed, read_valid, write_sealed
from pymantaray.records import Arrivals, RangingTruth, Trajectories
from pymantaray.records.nested import from_groups, to_groups
from pymantaray.records.writing import netcdf_content, netcdf_groups
from pymantaray.sensing import Links, Ranging, Receptions
from pymantaray.sensing.schedule import Attempts

_T = TypeVar("_T")
_MEDIUM = "medium"
_RANGING = Ranging, Attempts, RangingTruth, Links, Arrivals, Receptions


@dataclass(frozen=True)
class _Stage:
    """Result of a point, equal to that of any other point with the same key."""

    key: str
    compute: Callable[[], Any] = field(compare=False)


LATEST = {name: lru_cache(maxsize=1)(lambda stage: stage.compute()) for name in (*STAGES, _MEDIUM)}
"""
Caches of the latest result of each stage in this process, by its key: the stage and the duration of
its computation [s], or the medium.
"""


def open_ocean(ocean: MissionOcean, interpolation: Interpolation) -> OceanFields:
    """Ocean of a mission."""
    return ocean.open(interpolation)


class Stages:
    """Stages of one study; shared stages are written to the store for other points."""

    def __init__(
        self, study: Study, keys: Mapping[str, str], store: Store, shared: frozenset[str]
    ) -> None:
        self._study = study
        self._keys = keys
        self._store = store
        self.seconds: dict[str, float] = {}
        """Duration of the computation of each requested stage. [s]"""
        # a profile is faster to read again than from the store
        self._shared = shared - {OCEAN} if study.ocean.is_profile else shared

    @property
    def ocean(self) -> OceanFields:
        """Ocean of the mission."""
        study = self._study
        return self._get(OCEAN, lambda: open_ocean(study.ocean, study.sound.interpolation))

    @property
    def fleet(self) -> Trajectories:
        """True poses of the vehicles."""
        ocean = self.ocean
        return self._get(FLEET, lambda: simulate_fleet(self._study.fleet, ocean))

    @property
    def rays(self) -> Ranging:
        """Ranges without noise."""
        ocean = self.ocean
        truth = self.fleet
        return self._get(RAYS, lambda: range_fleet(self._study.ranging, ocean, self.medium, truth))

    @property
    def medium(self) -> Medium | Callable[[float], Medium]:
        """
        Medium of the rays; it is not stored, because building it from the ocean is faster than
        reading it.
        """
        sound = self._study.sound
        key = f"{self._keys[OCEAN]} {sound.interpolation} {sound.earth}"
        medium: Medium | Callable[[float], Medium]
        medium = LATEST[_MEDIUM](_Stage(key, lambda: sound.medium(self.ocean)))
        return medium

    def ensure(self, stage: str) -> None:
        """Compute a shared stage unless the store has it."""
        if stage in self._shared and not self._store.has(stage_name(self._keys[stage])):
            result = getattr(self, stage)
            self._write(stage, result, self.seconds[stage])

    def _write(self, stage: str, result: Any, seconds: float) -> None:
        cost = xr.Dataset(attrs={"seconds": seconds})
        content = netcdf_content({"cost": cost, **_PACK[stage](result)})
        write_sealed(self._store, stage_name(self._keys[stage]), content)

    def _read(self, stage: str) -> tuple[Any, float] | None:
        """
        Stage from the store and the duration of its computation [s]; None without it. A damaged one
        is removed.
        """

        def parse(content: bytes) -> tuple[Any, float]:
            groups = netcdf_groups(content)
            seconds = float(groups.pop("cost").attrs["seconds"])
            return _UNPACK[stage](groups), seconds

        return read_sealed(self._store, stage_name(self._keys[stage]), parse)

    def _get(self, stage: str, compute: Callable[[], _T]) -> _T:
        latest = _Stage(self._keys[stage], lambda: self._read_or_compute(stage, compute))
        out: _T
        out, self.seconds[stage] = LATEST[stage](latest)
        return out

    def _read_or_compute(self, stage: str, compute: Callable[[], _T]) -> tuple[_T, float]:
        """Stage and the duration of its computation. [s]"""
        key = self._keys[stage]
        shared = stage in self._shared
        there = shared and self._store.has(stage_name(key))
        read = self._read(stage) if there else None
        if read is not None:
            return read
        start = perf_counter()
        result = self._compute(key, compute) if shared else compute()
        seconds = perf_counter() - start
        if there and not self._store.has(stage_name(key)):
            # the file was damaged; store the result for other points
            self._write(stage, result, seconds)
        return result, seconds

    def _compute(self, key: str, compute: Callable[[], Any]) -> Any:
        """
        Compute a shared stage once, even if it fails: all points that need it then get the same
        error line.
        """
        failure = read_valid(self._store, stage_name(key, failed=True), parse_failure)
        if failure is not None:
            raise SweepError(failure.error)
        try:
            return compute()
        except WriteError:  # the store failed, not the stage
            raise
        except Exception as error:
            self._store.write(stage_name(key, failed=True), failure_content(error))
            raise


def _pack_ocean(ocean: OceanFields) -> dict[str, xr.Dataset]:
    region = io.StringIO()
    ocean.region.to_csv(region)
    fields = {name: getattr(ocean, name) for name in ("geographic", "local", "profile", "series")}
    groups = {name: field for name, field in fields.items() if field is not None}
    text = {"csv": region.getvalue(), "notes": "\n".join(ocean.notes)}
    return {"region": xr.Dataset(attrs=text), **groups}


def _stored(profile: xr.Dataset, region: pd.DataFrame) -> tuple[xr.Dataset, pd.DataFrame]:
    """Summary of an ocean that was stored with it."""
    return profile, region


def _unpack_ocean(groups: dict[str, xr.Dataset]) -> OceanFields:
    text = groups.pop("region").attrs
    region = pd.read_csv(io.StringIO(text["csv"]), index_col=0)
    geographic = groups.get("geographic")  # none for water in metres
    if geographic is not None:
        geographic = xr.decode_cf(geographic, decode_timedelta=False)
    return OceanFields(
        geographic,
        groups["local"],
        groups.get("series"),
        notes=tuple(text["notes"].splitlines()),
        summarize=partial(_stored, groups["profile"], region),
    )


_PACK: dict[str, Callable[[Any], dict[str, xr.Dataset]]] = {
    OCEAN: _pack_ocean,
    FLEET: to_groups,
    RAYS: to_groups,
}
_UNPACK: dict[str, Callable[[dict[str, xr.Dataset]], Any]] = {
    OCEAN: _unpack_ocean,
    FLEET: lambda groups: from_groups(groups, Trajectories),
    RAYS: lambda groups: from_groups(groups, *_RANGING),
}

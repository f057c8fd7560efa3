"""The oceans that estimators believe in: exact, perturbed, averaged, one cast, or another day's."""

import datetime as dt
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.acoustics import Currents, Medium
from pymantaray.errors import OceanError
from pymantaray.geometry import LocalFrame, stream
from pymantaray.ocean import (
    SoundSpeedCovariance,
    column_ocean,
    mean_ocean,
    open_ocean,
    perturb_ocean,
    pooled_rms,
    read_casts,
    vertical_modes,
)
from pymantaray.study.assemble import (
    StudyOcean,
    build_ocean,
    build_sea_floor,
    local_ocean,
    mission_start,
    open_start,
)
from pymantaray.study.config import StationVehicle
from pymantaray.study.config_estimators import (
    AnyBelief,
    CastBelief,
    ExactBelief,
    MeanBelief,
    ModesSection,
    OtherDayBelief,
    PerturbedBelief,
)
from pymantaray.study.range_models.eigenray_model import EigenrayModel
from pymantaray.study.store import Run

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Belief:
    """An ocean as an estimator has it."""

    local: xr.Dataset
    medium: Medium
    currents: Currents | None
    """None unless the study's rays run through currents."""
    spreading_cutoff_db: float | None

    @cached_property
    def rays(self) -> EigenrayModel:
        """Eigenrays through it, shared by all estimators that believe in it."""
        return EigenrayModel(
            self.medium, spreading_cutoff_db=self.spreading_cutoff_db, currents=self.currents
        )

    def profile(self) -> tuple[Array, Array]:
        """Levels, and the horizontal mean of the sound speed at them. [m, m/s]"""
        return self.medium.depth, self.medium.sound_speed.mean(axis=(0, 1))


class Beliefs:
    """The believed oceans of one run, each made once: for all realizations, or for one if it is random."""

    def __init__(self, run: Run) -> None:
        self.config, self._run = run.config, run
        self._latest: dict[AnyBelief, tuple[int, Belief]] = {}
        self._over_time: dict[AnyBelief, StudyOcean] = {}

    def believed(self, section: AnyBelief, realization: int) -> Belief:
        """Ocean that an estimator believes in; where the true one varies in time, a snapshot of its start."""
        member = realization if isinstance(section, PerturbedBelief) else -1
        if section not in self._latest or self._latest[section][0] != member:
            self._latest[section] = member, self._make(section, realization)
        return self._latest[section][1]

    def varying(self, section: ExactBelief | OtherDayBelief) -> StudyOcean:
        """Ocean over the mission, of the day that is believed in."""
        if section not in self._over_time:
            ocean = self.config.ocean
            if isinstance(section, OtherDayBelief):
                day = mission_start(ocean) - np.timedelta64(dt.timedelta(days=section.days_earlier))
                ocean = ocean.model_copy(update={"time": day.astype("datetime64[us]").item()})
            self._over_time[section] = build_ocean(ocean, self.config.mission.duration_h * 3600.0)
        return self._over_time[section]

    def covariance(self, rms: float, horizontal_scale: float, down_to: float | None) -> SoundSpeedCovariance:
        """Covariance of an error of some rms [m/s] down to a depth [m], in the vertical modes of the region."""
        depth, shapes, sigma = self._scaled_modes((), rms, down_to)
        matrix = np.einsum("k,ki,kj->ij", sigma**2, shapes, shapes)
        return SoundSpeedCovariance(depth, 0.5 * (matrix + matrix.T), horizontal_scale)

    def modes(self, section: ModesSection) -> tuple[Array, Array, Array]:
        """Levels [m], shapes (n_modes, n_levels) and prior sigma [m/s] of the modes to be estimated."""
        depth, shapes, sigma = self._scaled_modes(section.casts, section.rms, section.down_to)
        if section.count > sigma.size:
            raise OceanError(
                f"modes: count is {section.count}, but there are {sigma.size} that vary; give at most so many"
            )
        return depth, shapes[: section.count], sigma[: section.count]

    def _scaled_modes(
        self, casts: tuple[str, ...], rms: float | None, down_to: float | None
    ) -> tuple[Array, Array, Array]:
        """Levels, shapes and standard deviations of the modes of the ocean, or of casts in files."""
        ocean = self._true
        columns = read_casts(casts) if casts else ocean
        modes = vertical_modes(columns, equation=self.config.ocean.equation)
        depth = np.asarray(ocean["depth"].values, dtype=float)
        shapes = modes.at(depth)
        factor = 1.0 if rms is None else rms / pooled_rms(ocean, modes.variance @ shapes**2, down_to)
        return depth, shapes, factor * np.sqrt(modes.variance)

    def _make(self, section: AnyBelief, realization: int) -> Belief:
        ocean, acoustics = self.config.ocean, self.config.acoustics
        local = self._run.ocean
        if not isinstance(section, ExactBelief):
            geographic = self._geographic_belief(section, realization)
            local = local_ocean(ocean, geographic, build_sea_floor(ocean, self._true))
        return Belief(
            local=local,
            medium=Medium.from_dataset(local, interpolation=acoustics.interpolation),
            currents=Currents.from_dataset(local) if acoustics.currents else None,
            spreading_cutoff_db=acoustics.cutoff_db,
        )

    def _geographic_belief(self, section: AnyBelief, realization: int) -> xr.Dataset:
        true, config = self._true, self.config
        if isinstance(section, PerturbedBelief):
            return perturb_ocean(
                true,
                rms=section.rms,
                horizontal_scale=section.horizontal_scale,
                down_to=section.down_to,
                modes=section.n_modes,
                rng=stream(config.study.seed, realization, "belief", "perturbed"),
                equation=config.ocean.equation,
            )
        if isinstance(section, MeanBelief):
            return mean_ocean(true)
        if isinstance(section, CastBelief):
            return column_ocean(true, self._cast_place(section))
        assert isinstance(section, OtherDayBelief)  # the exact one is on disk; for the type checker
        earlier = np.timedelta64(round(section.days_earlier * 86400), "s")
        time = np.datetime64(str(true["time"].values), "ns") - earlier
        return open_ocean(config.ocean.source, time=time, currents=config.ocean.currents)

    @cached_property
    def _true(self) -> xr.Dataset:
        """Geographic ocean of the mission's start."""
        return open_start(self.config.ocean)

    def _cast_place(self, section: CastBelief) -> tuple[float, float]:
        """Latitude and longitude of the cast. [degrees]."""
        north, east = section.north, section.east
        if north is None or east is None:
            stations = (v for v in self.config.fleet.vehicles if isinstance(v, StationVehicle))
            first = next(stations, None)
            north, east = (0.0, 0.0) if first is None else (first.north, first.east)
        attrs = self._run.ocean.attrs
        frame = LocalFrame(attrs["centre_latitude_deg"], attrs["centre_longitude_deg"])
        lat, lon = frame.to_geodetic(north, east)
        return float(lat), float(lon)

"""The oceans that estimators believe in: exact, perturbed, averaged, one cast, or another day's."""

import datetime as dt
from typing import NamedTuple

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
    ocean_times,
    open_ocean,
    open_sea_floor,
    perturb_ocean,
    pooled_rms,
    read_casts,
    to_local,
    vertical_modes,
    window_of,
)
from pymantaray.study.assemble import StudyOcean, build_ocean
from pymantaray.study.config import OceanSection, StationVehicle
from pymantaray.study.config_estimators import (
    AnyBelief,
    CastBelief,
    ExactBelief,
    MeanBelief,
    ModesSection,
    OtherDayBelief,
    PerturbedBelief,
)
from pymantaray.study.store import Run

Array = NDArray[np.float64]


class Belief(NamedTuple):
    """An ocean as an estimator has it."""

    local: xr.Dataset
    medium: Medium
    currents: Currents | None
    """None unless the study's rays run through currents."""

    def profile(self) -> tuple[Array, Array]:
        """
        Horizontal mean of the sound speed.

        Returns
        -------
        depth, sound_speed : ndarray, shape (n_levels,)
            [m, m s⁻¹]
        """
        return self.medium.depth, self.medium.sound_speed.mean(axis=(0, 1))


class Beliefs:
    """
    Makes the believed oceans of one study, each once: for the study, or for a realization if it is random.

    Parameters
    ----------
    run : Run
        Of whose folder the configuration and the true ocean are there already.
    """

    def __init__(self, run: Run) -> None:
        self._run = run
        self._config = run.config
        self._geographic: xr.Dataset | None = None
        self._sea_floor: xr.DataArray | None = None
        self._kept: dict[AnyBelief, tuple[int, Belief]] = {}
        self._over_time: dict[AnyBelief, StudyOcean] = {}

    def believed(self, section: AnyBelief, realization: int) -> Belief:
        """
        Ocean that an estimator believes in.

        Parameters
        ----------
        section : ExactBelief, PerturbedBelief, MeanBelief, CastBelief or OtherDayBelief
        realization : int
            Names the random stream of a perturbed one.

        Returns
        -------
        Belief
            Where the true ocean varies in time, the believed one is a snapshot of its start.

        Raises
        ------
        OceanError
            If the ocean cannot be made, for example there is none on the other day.
        """
        of = realization if isinstance(section, PerturbedBelief) else -1
        kept = self._kept.get(section)
        if kept is None or kept[0] != of:
            self._kept[section] = kept = (of, self._made(section, realization))
        return kept[1]

    def varying(self, section: ExactBelief | OtherDayBelief) -> StudyOcean:
        """
        Ocean over the mission, of the day that is believed in.

        Parameters
        ----------
        section : ExactBelief or OtherDayBelief

        Returns
        -------
        StudyOcean

        Raises
        ------
        OceanError
            If the source does not hold these times.
        """
        if section not in self._over_time:
            ocean = self._config.ocean
            if isinstance(section, OtherDayBelief):
                ocean = ocean.model_copy(
                    update={"time": _start(ocean) - dt.timedelta(days=section.days_earlier)}
                )
            self._over_time[section] = build_ocean(ocean, self._config.mission.duration_h * 3600.0)
        return self._over_time[section]

    def covariance(self, rms: float, horizontal_scale: float, down_to: float | None) -> SoundSpeedCovariance:
        """
        Covariance of a sound-speed error in the vertical modes of the study's region.

        Parameters
        ----------
        rms : float
            Pooled over the water as in `perturb_ocean`. [m s⁻¹]
        horizontal_scale : float
            [m]
        down_to : float or None
            Depth down to which it is pooled; None for all. [m]

        Returns
        -------
        SoundSpeedCovariance
        """
        depth, shapes, sigma = self._scaled_modes((), rms, down_to)
        matrix = np.einsum("k,ki,kj->ij", sigma**2, shapes, shapes)
        return SoundSpeedCovariance(depth, 0.5 * (matrix + matrix.T), horizontal_scale)

    def modes(self, section: ModesSection) -> tuple[Array, Array, Array]:
        """
        Vertical modes whose amplitudes are to be estimated.

        Parameters
        ----------
        section : ModesSection

        Returns
        -------
        depth : ndarray, shape (n_levels,)
            [m]
        shapes : ndarray, shape (n_modes, n_levels)
            [-]
        sigma : ndarray, shape (n_modes,)
            Standard deviation of each amplitude, beforehand. [m s⁻¹]

        Raises
        ------
        OceanError
            If a cast cannot be read, or ocean or casts do not have so many modes.
        """
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
        ocean = self._true()
        columns = read_casts(casts) if casts else ocean
        taken = vertical_modes(columns, equation=self._config.ocean.equation)
        depth = np.asarray(ocean["depth"].values, dtype=float)
        shapes = taken.at(depth)
        factor = 1.0 if rms is None else rms / pooled_rms(ocean, taken.variance @ shapes**2, down_to)
        return depth, shapes, factor * np.sqrt(taken.variance)

    def _made(self, section: AnyBelief, realization: int) -> Belief:
        local = self._run.ocean if isinstance(section, ExactBelief) else self._local(section, realization)
        acoustics = self._config.acoustics
        return Belief(
            local=local,
            medium=Medium.from_dataset(local, interpolation=acoustics.interpolation),
            currents=Currents.from_dataset(local) if acoustics.currents else None,
        )

    def _local(self, section: AnyBelief, realization: int) -> xr.Dataset:
        ocean = self._config.ocean
        return to_local(
            self._geographic_belief(section, realization),
            centre=ocean.centre,
            half_extent=ocean.half_extent,
            sea_floor=self._sea_floor,
            equation=ocean.equation,
        )

    def _geographic_belief(self, section: AnyBelief, realization: int) -> xr.Dataset:
        true, config = self._true(), self._config
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

    def _true(self) -> xr.Dataset:
        """Geographic ocean of the mission's start, and with it the sea floor."""
        if self._geographic is None:
            section = self._config.ocean
            self._geographic = build_ocean(section, self._config.mission.duration_h * 3600.0).geographic
            if section.bathymetry is not None:
                self._sea_floor = open_sea_floor(section.bathymetry, window=window_of(self._geographic))
        return self._geographic

    def _cast_place(self, section: CastBelief) -> tuple[float, float]:
        """Latitude and longitude of the cast. [degrees]."""
        north, east = section.north, section.east
        if north is None or east is None:
            stations = (v for v in self._config.fleet.vehicles if isinstance(v, StationVehicle))
            first = next(stations, None)
            north, east = (0.0, 0.0) if first is None else (first.north, first.east)
        attrs = self._run.ocean.attrs
        frame = LocalFrame(attrs["centre_latitude_deg"], attrs["centre_longitude_deg"])
        lat, lon = frame.to_geodetic(north, east)
        return float(lat), float(lon)


def _start(ocean: OceanSection) -> dt.datetime:
    """Start of the mission; the first time of the source if the study names none."""
    if ocean.time is not None:
        return ocean.time
    first = ocean_times(ocean.source)[0].astype("datetime64[us]").astype(dt.datetime)
    assert isinstance(first, dt.datetime)  # for the type checker
    return first

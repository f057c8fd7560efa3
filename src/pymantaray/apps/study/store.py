"""Run on disk: the content of each file, and its reader."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from pymantaray.apps.study.data_frames import error_frame, pose_frame, range_frame
from pymantaray.apps.study.noise import NoiseSource
from pymantaray.apps.study.tables import SUMMARY, RunTables
from pymantaray.config.door.study import Study, build_study
from pymantaray.config.load import load_study
from pymantaray.config.sections import StudyConfig
from pymantaray.errors import StudyError
from pymantaray.estimation import CONDITIONS
from pymantaray.evaluation import DegreesOfFreedom, error_bound
from pymantaray.jobs.folder import MANIFEST
from pymantaray.jobs.run_folder import (
    ARRIVALS,
    CANDIDATES,
    CONFIG,
    COVARIANCES,
    ESTIMATES,
    HEARING,
    LINKS,
    MEASUREMENTS,
    OCEAN,
    PROFILE,
    RANGING_DRAWS,
    RANGING_TRUTH,
    RAY_PICTURE,
    REGION,
    TRUTH,
    UNKNOWNS,
    checked_file,
    checked_manifest,
)
from pymantaray.ocean.ice import with_ice_draw
from pymantaray.records import (
    Arrivals,
    Estimates,
    Measurements,
    PoseCovariances,
    RangingTruth,
    RayStatus,
    SharedUnknowns,
    SolveStatus,
    Trajectories,
    read_netcdf,
)
from pymantaray.records.result_table import ResultTable, notebook_html
from pymantaray.records.status import ARRIVES
from pymantaray.sensing import Candidates, Hearing, Links, RangingDraws, draw_picks

if TYPE_CHECKING:
    from pymantaray.acoustics.ocean_fields import OceanFields
    from pymantaray.apps.study.mission import Mission


_T = TypeVar("_T")


@dataclass(frozen=True)
class Run:
    """
    Results of one study, each read from its folder at its first use.

    Parameters
    ----------
    path : pathlib.Path
        Folder of the run.
    """

    path: Path

    def __repr__(self) -> str:
        """Folder of the run, or its study if it is in memory."""
        return f"<Run {self.study.name} in memory>" if self.path == Path() else f"<Run {self.path}>"

    @cached_property
    def tables(self) -> RunTables:
        """
        Tables of the run by name, as in the report and commands; each is computed at its first use.
        """
        return RunTables(self)

    @property
    def plot(self) -> Any:
        """
        Plots of the run, see `pymantaray.apps.study.plots.RunPlots`: ``run.plot.range_error()``
        returns matplotlib axes.
        """
        from pymantaray.apps.study.plots import RunPlots

        return RunPlots(self)

    @property
    def summary(self) -> list[ResultTable]:
        """Tables that commands print and notebooks show after a run, with their columns only."""
        return [self.tables[name].short() for name in SUMMARY if name in self.tables]

    def _repr_html_(self) -> str:
        """
        HTML for a notebook: study, folder, range errors and, if there are estimates, position
        errors.
        """
        study = self.study
        facts = {
            "vehicles": self.truth.name.size,
            "hours": f"{study.duration / 3600.0:g}",
            "realizations": study.realizations if study.solves else 0,
            "ocean": f"{self.ocean.attrs['title']}{', synthetic' if self.synthetic else ''}",
            "folder": self.path,
        }
        return notebook_html(f"Run of {study.name}: {study.description}", facts, self.summary)

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """Versions, seeds, checksums, timings, memory, platform and the summary of outcomes."""
        return checked_manifest(self.path)

    @property
    def _is_finished(self) -> bool:
        """False if the run is in memory, or its files are still being written."""
        return self.path != Path() and (self.path / MANIFEST).is_file()

    def has_file(self, name: str) -> bool:
        """
        Return True if the run has a file, according to its manifest.

        Parameters
        ----------
        name : str
            Name of the file.

        Returns
        -------
        bool
        """
        if self._is_finished:
            return name in self.manifest["files"]
        return self.path != Path() and (self.path / name).is_file()

    def _file(self, name: str) -> Path:
        """Path of a file, whose checksum is checked if the run is finished."""
        return (
            checked_file(self.path, self.manifest, name) if self._is_finished else self.path / name
        )

    @property
    def notes(self) -> list[str]:
        """Notes of the readers of the ocean, of trajectories and of oceans that are assumed."""
        names = "ocean", "fleet", "estimators"
        parts = (self.manifest.get(name, {}).get("notes", []) for name in names)
        return [note for part in parts for note in part]

    @cached_property
    def config(self) -> StudyConfig:
        """Resolved configuration, defaults included."""
        return load_study(self._file(CONFIG))

    @cached_property
    def study(self) -> Study:
        """The configuration as objects of the library."""
        return build_study(self.config)

    @cached_property
    def ocean(self) -> xr.Dataset:
        """Local ocean: sound speed, currents and sea floor over (north, east, depth)."""
        return read_netcdf(self._file(OCEAN))

    @cached_property
    def profile(self) -> xr.Dataset:
        """Mean, minimum and maximum sound speed of each level over the study's domain."""
        return read_netcdf(self._file(PROFILE))

    @cached_property
    def region(self) -> pd.DataFrame:
        """Properties of the region as in the paper's first table: one row each, one column."""
        return pd.read_csv(self._file(REGION), index_col=0)

    @cached_property
    def truth(self) -> Trajectories:
        """True poses of the fleet."""
        return Trajectories.load(self._file(TRUTH))

    @cached_property
    def links(self) -> Links:
        """Participants at both ends of each link in `arrivals`, and the times of the links."""
        return Links.load(self._file(LINKS))

    @cached_property
    def arrivals(self) -> Arrivals:
        """Arrivals of all links; a link is an unordered pair of participants at one ping."""
        return Arrivals.load(self._file(ARRIVALS))

    @cached_property
    def measurements(self) -> Measurements:
        """Measurements without noise."""
        return Measurements.load(self._file(MEASUREMENTS))

    @cached_property
    def ranging_truth(self) -> RangingTruth:
        """
        True distance and travel times of every range attempt, in the same rows as the measurements.
        """
        return RangingTruth.load(self._file(RANGING_TRUTH))

    @cached_property
    def ranging_draws(self) -> RangingDraws | None:
        """
        Ranges of every realization, if each has its own ice; None if all have the same.

        ``measurements``, ``ranging_truth``, ``arrivals``, ``hearing`` and ``ocean`` are then those
        of the first realization.
        """
        if not self.study.ocean.own_ice:
            return None
        return RangingDraws.load(self._file(RANGING_DRAWS))

    @cached_property
    def hearing(self) -> Hearing | None:
        """Detection probability of each range attempt; None if every arrival is detected."""
        return Hearing.load(self._file(HEARING)) if self.study.detects else None

    @cached_property
    def candidates(self) -> Candidates | None:
        """
        Arrivals that each range attempt may mistake for its direct arrival; None if no receiver
        makes mistakes.
        """
        if self.study.picker is None:
            return None
        return Candidates.load(self._file(CANDIDATES))

    @cached_property
    def estimates(self) -> Estimates:
        """
        Estimated trajectories of all conditions and realizations, with the status of each solve.
        """
        if not self.study.solves:
            return Estimates.without_conditions(self.measurements)
        return Estimates.load(self._file(ESTIMATES))

    @cached_property
    def covariances(self) -> PoseCovariances | None:
        """Covariances of all solves at fixed epochs; None in a study without conditions."""
        return PoseCovariances.load(self._file(COVARIANCES)) if self.has_file(COVARIANCES) else None

    @cached_property
    def unknowns(self) -> SharedUnknowns | None:
        """Estimates of modes and clocks; None if no condition estimates any."""
        return SharedUnknowns.load(self._file(UNKNOWNS)) if self.has_file(UNKNOWNS) else None

    @cached_property
    def bounds(self) -> dict[str, NDArray[np.float64]]:
        """Lower bound of unbiased estimators at the pings for each condition, see `error_bound`."""
        return self._by_measurements(error_bound)

    @cached_property
    def degrees_of_freedom(self) -> dict[str, DegreesOfFreedom]:
        """
        Effective degrees of freedom of the squared errors of each condition, see
        `DegreesOfFreedom`.
        """
        return self._by_measurements(DegreesOfFreedom)

    def expect_errors(self) -> Iterator[object]:
        """
        Compute `bounds` and `degrees_of_freedom` for all tables, one number at each step; they do
        not depend on estimates.
        """
        if not self.study.solves:
            return
        yield self.bounds
        for expected in self.degrees_of_freedom.values():
            yield expected.fleet
            yield expected.vehicle
            yield expected.at_pings
            if self.measurements.attitude_vehicle.size:
                yield expected.tilt
                yield expected.heading

    def _by_measurements(
        self, function: Callable[[Trajectories, Measurements, str], _T]
    ) -> dict[str, _T]:
        """
        Results of a function by condition; conditions with the same kind of measurements share one.
        """
        equivalents = {c.name: c.standard_equivalent for c in self.study.conditions}
        is_solved = self.has_file(ESTIMATES)
        made: dict[str, _T] = {}
        out = {}
        for name in self.estimates.condition.tolist() if is_solved else equivalents:
            like = equivalents.get(name, name if name in CONDITIONS else "straight")
            like = "straight" if like == "refracted" else like
            if like not in made:
                made[like] = function(self.truth, self.measurements, like)
            out[name] = made[like]
        return out

    @cached_property
    def ray_picture(self) -> xr.Dataset:
        """Vertical section through one link, its ray and its straight chord."""
        return read_netcdf(self._file(RAY_PICTURE))

    @property
    def synthetic(self) -> bool:
        """
        True if the ocean is synthetic: one of this package, or a file whose attributes say so.
        """
        return bool(self.ocean.attrs["synthetic"])

    @property
    def noise(self) -> NoiseSource:
        """All that the measurements of realizations are drawn from."""
        study, hearing = self.study, self.hearing
        return NoiseSource(
            self.measurements,
            self.ranging_truth,
            self.ranging_draws,
            None if hearing is None else hearing.probability,
            self.candidates,
            study.seed,
            study.sound.timing,
            study.clocks,
            study.pick_correlation_time,
            study.sensors,
        )

    def noisy_measurements(self, realization: int) -> Measurements:
        """
        Return the measurements of one realization, with noise drawn again from the same streams.

        Parameters
        ----------
        realization : int
            Index of the realization, from 0.

        Returns
        -------
        Measurements

        Raises
        ------
        StudyError
            If the run has no such realization.
        """
        self._check(realization)
        return self.noise.noisy(realization)

    def ranging_truth_in(self, realization: int | None) -> RangingTruth:
        """
        Return the true values of all range attempts in a realization.

        Parameters
        ----------
        realization : int or None
            Index of the realization; None for the first.

        Returns
        -------
        RangingTruth
        """
        return self.noise.ranging_truth_in(realization)

    def ocean_in(self, realization: int) -> xr.Dataset:
        """
        Return the local ocean with the ice of a realization.

        Parameters
        ----------
        realization : int
            Index of the realization.

        Returns
        -------
        xarray.Dataset
        """
        return self.ocean if self.ranging_draws is None else with_ice_draw(self.ocean, realization)

    def ranges(self, realization: int | None = None) -> pd.DataFrame:
        """
        Return measured and true values of all range attempts, one row each.

        Parameters
        ----------
        realization : int, optional
            Index of the realization of the noise. Default: measurements without noise.

        Returns
        -------
        pandas.DataFrame
            ``time`` since the start and ``date`` (UTC, if the mission has one), ``transmitter``,
            ``receiver``, ``status`` (`RayStatus`); true ``distance``; ``straight_range`` and
            ``refracted_range`` as measured, ``range_sigma``; true ``sound_speed`` at the
            transmitter, ``travel_time``, ``chord_travel_time``, ``near_cutoff``,
            ``departure_angle`` and ``arrival_angle``, see `RangingTruth`. Units are in
            ``attrs["units"]``, by column.

        Raises
        ------
        StudyError
            If the run has no such realization.
        """
        return range_frame(self, realization)

    def errors(self) -> pd.DataFrame:
        """
        Return position errors of all estimates, without alignment, one row per condition,
        realization, vehicle and time.

        Returns
        -------
        pandas.DataFrame
            ``condition``, ``realization``, ``vehicle``, ``time`` and ``date``; the difference
            estimate minus truth ``north``, ``east``, ``down``, and its length ``error``; NaN for a
            failed solve. Units are in ``attrs["units"]``.
        """
        return error_frame(self)

    def trajectories(self, realization: int = 0) -> pd.DataFrame:
        """
        Return poses of one realization, one row per condition, vehicle and time; condition
        ``truth`` has the true poses.

        Parameters
        ----------
        realization : int
            Index of the realization, from 0.

        Returns
        -------
        pandas.DataFrame
            ``condition``, ``vehicle``, ``time`` and ``date``, ``latitude``, ``longitude``,
            ``north``, ``east``, ``down``; ``qw``, ``qx``, ``qy``, ``qz`` rotate body axes (forward,
            right, down) to north, east, down; ``status`` (`VehicleStatus`). Units are in
            ``attrs["units"]``.

        Raises
        ------
        StudyError
            If the run has no such realization.
        """
        self._check(realization)
        return pose_frame(self, realization)

    def mistaken(self, realization: int) -> NDArray[np.bool_]:
        """
        Return the range attempts of one realization that mistook another arrival for the direct
        one.

        Parameters
        ----------
        realization : int
            Index of the realization, from 0.

        Returns
        -------
        ndarray of bool, shape (n_ranges,)

        Raises
        ------
        StudyError
            If the run has no such realization.
        """
        self._check(realization)
        candidates = self.candidates
        if candidates is None:
            return np.zeros(self.measurements.range_status.size, dtype=bool)
        picks = draw_picks(
            self.measurements,
            candidates,
            root_seed=self.study.seed,
            realization=realization,
            correlation_time=self.study.pick_correlation_time,
        )
        return candidates.mistaken(picks)

    def _check(self, realization: int) -> None:
        count = self.study.realizations
        if not 0 <= realization < count:
            raise StudyError(f"realization {realization}: the run has 0 to {count - 1}")


class _RunInMemory(Run):
    """Run without a folder, whose summaries of the ocean wait: few ask for them."""

    _fields: "OceanFields"

    @property
    def manifest(self) -> dict[str, Any]:
        raise StudyError("a run in memory has no manifest; run_study writes one to a folder")

    @property
    def notes(self) -> list[str]:
        from pymantaray.apps.study.manifest import fleet_notes, ocean_notes

        attrs = self.ocean.attrs
        return [*ocean_notes(attrs), *fleet_notes(self.study, attrs)]

    @cached_property
    def profile(self) -> xr.Dataset:
        return self._fields.profile

    @cached_property
    def region(self) -> pd.DataFrame:
        return self._fields.region


def run_in_memory(study: Study, mission: "Mission") -> Run:
    """Run without a folder and without estimates, from a mission."""
    run = _RunInMemory(Path())
    vars(run).update(  # values that would be read from files
        config=study.config,
        study=study,
        ocean=mission.ocean.local,
        _fields=mission.ocean,
        truth=mission.truth,
        links=mission.links,
        arrivals=mission.arrivals,
        measurements=mission.measurements,
        ranging_truth=mission.ranging_truth,
        hearing=mission.hearing,
        candidates=mission.candidates,
        ranging_draws=mission.draws,
    )
    return run


def open_run(path: str | Path) -> Run:
    """
    Open the results of a finished study.

    Parameters
    ----------
    path : str or pathlib.Path
        Run folder; ``runs/latest`` is the newest.

    Returns
    -------
    Run
        Results, each read from its file at its first use.

    Raises
    ------
    StudyError
        If the folder is not a run of this version's format.

    Examples
    --------
    >>> open_run("nowhere")
    Traceback (most recent call last):
        ...
    pymantaray.errors.StudyError: nowhere: not a run folder: it has no manifest.json
    """
    manifest = checked_manifest(path)
    run = Run(Path(path).resolve())
    vars(run)["manifest"] = manifest
    return run


def summarize(run: Run, estimates: Estimates | None) -> dict[str, Any]:
    """
    Count outcomes of links, vehicles and solves, for the manifest and for warnings.

    ``links``: attempts by `RayStatus`; ``incomplete_searches``: links that may have more rays than
    were found; ``stopped_vehicles``: status and time by name; ``unhealthy_solves``: condition,
    realization and `SolveStatus` of each solve that is not OK. With a detector,
    ``expected_unheard``: mean number per realization of attempts whose arrival is not detected; if
    receivers make mistakes, ``expected_mistaken``: mean number of attempts that mistake another
    arrival for the direct one.
    """
    status = run.measurements.range_status
    candidates = run.candidates
    stopped = {
        name: {"status": stop.name, "time_s": time}
        for name, (stop, time) in run.truth.stops.items()
    }
    unhealthy = (
        []
        if estimates is None
        else [
            {
                "condition": str(estimates.condition[c]),
                "realization": int(estimates.realization[r]),
                "status": SolveStatus(int(estimates.solve_status[c, r])).name,
            }
            for c, r in np.argwhere(estimates.solve_status != SolveStatus.OK)
        ]
    )
    chance: dict[str, float] = {}
    if run.hearing is not None:
        probability = run.hearing.probability
        if candidates is not None:
            probability = np.bincount(
                candidates.attempt, candidates.probability, minlength=status.size
            )
        chance["expected_unheard"] = float(np.sum(1.0 - probability[np.isin(status, ARRIVES)]))
    if candidates is not None:
        chance["expected_mistaken"] = candidates.expected_mistaken
    return {
        "range_attempts": int(status.size),
        "links": {member.name: int(np.count_nonzero(status == member)) for member in RayStatus},
        "incomplete_searches": int(np.count_nonzero(~run.arrivals.complete)),
        **chance,
        "stopped_vehicles": stopped,
        "unhealthy_solves": unhealthy,
    }

"""A run on disk: the folder that it is written into, which file holds what, and reading it back."""

import datetime as dt
import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from pymantaray.errors import StudyError
from pymantaray.records import (
    Arrivals,
    Estimates,
    Measurements,
    RangingTruth,
    RayStatus,
    SolveStatus,
    Trajectories,
    VehicleStatus,
    read_netcdf,
)
from pymantaray.records.covariances import PoseCovariances
from pymantaray.records.unknowns import SharedUnknowns
from pymantaray.sensing import Hearing, Links, perturb
from pymantaray.sensing.mistaken import Candidates, draw_taken
from pymantaray.study.assemble import build_clocks, build_timing
from pymantaray.study.config import StudyConfig
from pymantaray.study.load import load_study

if TYPE_CHECKING:
    from pymantaray.study.mission import Mission

RUNS = Path("runs")


def default_out(name: str) -> Path:
    """
    Dated folder for a run of a study that was given none.

    Parameters
    ----------
    name : str
        Name of the study.

    Returns
    -------
    pathlib.Path
        ``runs/<name>-<YYYYmmdd-HHMMSS>`` in the working folder, with a number where that is taken.
    """
    stamp = dt.datetime.now().astimezone().strftime("%Y%m%d-%H%M%S")
    candidate, n = RUNS / f"{name}-{stamp}", 1
    while candidate.exists():
        n += 1
        candidate = RUNS / f"{name}-{stamp}-{n}"
    return candidate


@contextmanager
def staged_folder(out: Path) -> Iterator[Path]:
    """
    Folder to write a run into; takes its final name only if the block ends well.

    On any exception, Ctrl-C included, it is removed, and so are the parents made for it.

    Parameters
    ----------
    out : pathlib.Path
        Final name. May exist if it is an empty folder.

    Yields
    ------
    pathlib.Path
        Temporary folder beside ``out``.

    Raises
    ------
    StudyError
        If ``out`` is a file or a folder with something in it, or nothing can be written there.
    """
    _require_free(out)
    out = out.absolute()
    made = [parent for parent in out.parents if not parent.exists()]
    stage = out.with_name(f".{out.name}.{os.getpid()}.part")
    try:
        stage.mkdir(parents=True)
    except OSError as error:
        _remove_empty(made)
        raise StudyError(f"{out}: cannot be written: {error.strerror}; choose another with --out") from None
    try:
        yield stage
        _require_free(out)
        stage.replace(out)
    except BaseException:
        shutil.rmtree(stage, ignore_errors=True)
        _remove_empty(made)
        raise


def point_latest_at(run: Path) -> None:
    """
    Make ``latest`` beside a run point at it.

    Parameters
    ----------
    run : pathlib.Path
        Folder of a finished run.
    """
    link = run.parent / "latest"
    if link.exists() and not link.is_symlink():
        return
    temporary = run.parent / f".latest.{os.getpid()}"
    temporary.unlink(missing_ok=True)
    temporary.symlink_to(run.name)
    temporary.replace(link)


def _require_free(out: Path) -> None:
    if out.is_dir():
        if any(out.iterdir()):
            raise StudyError(f"{out}: folder is not empty; give an empty or a new one")
    elif out.exists():
        raise StudyError(f"{out}: is a file; give an empty or a new folder")


def _remove_empty(folders: list[Path]) -> None:
    for folder in folders:
        try:
            folder.rmdir()
        except OSError:
            return


MANIFEST, CONFIG = "manifest.json", "config.toml"
OCEAN, PROFILE, REGION = "ocean.nc", "profile.nc", "region.csv"
TRUTH, LINKS, ARRIVALS = "truth.nc", "links.nc", "arrivals.nc"
MEASUREMENTS, RANGING_TRUTH = "measurements.nc", "ranging_truth.nc"
HEARING, ESTIMATES = "hearing.nc", "estimates.nc"
COVARIANCES, UNKNOWNS = "covariances.nc", "unknowns.nc"
CANDIDATES, RAY_PICTURE = "candidates.nc", "ray_picture.nc"
PYFG, TABLES, FIGURES = "pyfg", "tables", "figures"


@dataclass(frozen=True)
class Run:
    """
    Results of one study, read from its folder when first asked for.

    Parameters
    ----------
    path : pathlib.Path
        Folder of the run.
    """

    path: Path

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """Versions, seeds, checksums, timings, memory, platform and the summary of outcomes."""
        try:
            content: dict[str, Any] = json.loads((self.path / MANIFEST).read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise StudyError(f"{self.path / MANIFEST}: not a readable manifest: {error}") from None
        return content

    @cached_property
    def config(self) -> StudyConfig:
        """Resolved configuration, defaults included."""
        return load_study(self.path / CONFIG)

    @cached_property
    def ocean(self) -> xr.Dataset:
        """Local ocean: sound speed, currents and sea floor over (north, east, depth)."""
        return self._dataset(OCEAN)

    @cached_property
    def profile(self) -> xr.Dataset:
        """Mean, least and greatest sound speed of each level over the region."""
        return self._dataset(PROFILE)

    @cached_property
    def region(self) -> pd.DataFrame:
        """Properties of the region as in the paper's first table: one row each, one column."""
        try:
            return pd.read_csv(self.path / REGION, index_col=0)
        except (OSError, ValueError) as error:
            raise StudyError(f"{self.path / REGION}: not a readable table: {error}") from None

    @cached_property
    def truth(self) -> Trajectories:
        """True poses of the fleet."""
        return Trajectories.load(self.path / TRUTH)

    @cached_property
    def links(self) -> Links:
        """Who is at either end of each link in `arrivals`, and when."""
        return Links.load(self.path / LINKS)

    @cached_property
    def arrivals(self) -> Arrivals:
        """Arrivals of every link that was solved, one link an unordered pair and ping."""
        return Arrivals.load(self.path / ARRIVALS)

    @cached_property
    def measurements(self) -> Measurements:
        """Measurements without noise."""
        return Measurements.load(self.path / MEASUREMENTS)

    @cached_property
    def ranging_truth(self) -> RangingTruth:
        """True distance and travel times of every range attempt, row by row those of the measurements."""
        return RangingTruth.load(self.path / RANGING_TRUTH)

    @cached_property
    def hearing(self) -> Hearing | None:
        """Probability of each range attempt to be heard; None if every arrival is."""
        return None if self.config.detection is None else Hearing.load(self.path / HEARING)

    @cached_property
    def candidates(self) -> Candidates | None:
        """What each range attempt may take for its direct arrival; None if no receiver errs."""
        if self.config.ranging.mistaken == "off":
            return None
        return Candidates.load(self.path / CANDIDATES)

    @cached_property
    def estimates(self) -> Estimates:
        """Estimated trajectories of all conditions and realizations, with the health of each solve."""
        return Estimates.load(self.path / ESTIMATES)

    @cached_property
    def covariances(self) -> PoseCovariances | None:
        """Covariances of all solves at fixed epochs; None in a run of an older version."""
        path = self.path / COVARIANCES
        return PoseCovariances.load(path) if path.is_file() else None

    @cached_property
    def unknowns(self) -> SharedUnknowns | None:
        """What estimators found of modes and clocks; None if none estimated any."""
        path = self.path / UNKNOWNS
        return SharedUnknowns.load(path) if path.is_file() else None

    @cached_property
    def ray_picture(self) -> xr.Dataset:
        """Vertical section through one link, its ray and its straight chord."""
        return self._dataset(RAY_PICTURE)

    @property
    def synthetic(self) -> bool:
        """Whether the ocean is a synthetic one."""
        return self.config.ocean.synthetic

    def noisy_measurements(self, realization: int) -> Measurements:
        """
        Measurements as they were in one realization, drawn again from the same streams.

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
        ranging, candidates = self.config.ranging, self.candidates
        hearing = self.hearing if candidates is None else None  # what is heard is in the candidates then
        return perturb(
            self.measurements,
            root_seed=self.config.study.seed,
            realization=realization,
            timing=build_timing(ranging),
            clocks=build_clocks(ranging),
            ranging_truth=self.ranging_truth,
            probability=None if hearing is None else hearing.probability,
            candidates=candidates,
        )

    def mistaken(self, realization: int) -> NDArray[np.bool_]:
        """
        Range attempts that took another arrival for the direct one in one realization.

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
        candidates, seed = self.candidates, self.config.study.seed
        if candidates is None:
            return np.zeros(self.measurements.range_status.size, dtype=bool)
        taken = draw_taken(self.measurements, candidates, root_seed=seed, realization=realization)
        return candidates.mistaken(taken)

    def _check(self, realization: int) -> None:
        count = self.config.study.realizations
        if not 0 <= realization < count:
            raise StudyError(f"realization {realization}: the run has 0 to {count - 1}")

    def _dataset(self, name: str) -> xr.Dataset:
        return read_netcdf(self.path / name)


def open_run(path: str | Path) -> Run:
    """
    Results of a study that was run before.

    Parameters
    ----------
    path : str or pathlib.Path
        Run folder, ``runs/latest`` for the newest.

    Returns
    -------
    Run
        Reads each file when it is first asked for.

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
    folder = Path(path)
    if not (folder / MANIFEST).is_file():
        raise StudyError(f"{folder}: not a run folder: it has no {MANIFEST}")
    run = Run(folder.resolve())
    if run.manifest.get("format") != 2:
        raise StudyError(f"{folder}: run format {run.manifest.get('format')!r}; this version reads 2")
    return run


def write_json(content: dict[str, Any], path: Path) -> None:
    """
    Write a dictionary as indented JSON.

    Parameters
    ----------
    content : dict
        numpy scalars are written as numbers.
    path : pathlib.Path
    """
    text = json.dumps(content, indent=2, default=_plain)
    path.write_text(text + "\n", encoding="utf-8")


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"cannot write {type(value).__name__} as JSON")


def summarize(mission: "Mission", estimates: Estimates) -> dict[str, Any]:
    """
    Count what happened to links, vehicles and solves.

    Parameters
    ----------
    mission : Mission
    estimates : Estimates

    Returns
    -------
    dict
        ``links``: attempts by `RayStatus`; ``stopped_vehicles``: status and time by name;
        ``unhealthy_solves``: condition, realization and `SolveStatus` of each solve that is not OK; with a
        detector, ``expected_unheard``: mean number of attempts with an arrival that a realization does not hear;
        where receivers err, ``expected_mistaken``: mean number that take another arrival for the direct one.
    """
    status = mission.measurements.range_status
    truth = mission.truth
    stopped = {
        str(name): {
            "status": VehicleStatus(int(row[-1])).name,
            "time_s": float(truth.time[np.argmax(row != VehicleStatus.ACTIVE)]),
        }
        for name, row in zip(truth.name, truth.status, strict=True)
        if row[-1] != VehicleStatus.ACTIVE
    }
    unhealthy = [
        {
            "condition": str(estimates.condition[c]),
            "realization": int(estimates.realization[r]),
            "status": SolveStatus(int(estimates.solve_status[c, r])).name,
        }
        for c, r in np.argwhere(estimates.solve_status != SolveStatus.OK)
    ]
    hearing = mission.hearing
    chance = {} if hearing is None else {"expected_unheard": _expected_unheard(status, mission)}
    if mission.candidates is not None:
        chance["expected_mistaken"] = mission.candidates.expected_mistaken
    return {
        "range_attempts": int(status.size),
        "links": {member.name: int(np.count_nonzero(status == member)) for member in RayStatus},
        **chance,
        "stopped_vehicles": stopped,
        "unhealthy_solves": unhealthy,
    }


def _expected_unheard(status: NDArray[np.int8], mission: "Mission") -> float:
    probability = None if mission.hearing is None else mission.hearing.probability
    if mission.candidates is not None:
        taken = mission.candidates
        probability = np.bincount(taken.attempt, taken.probability, minlength=status.size)
    return 0.0 if probability is None else float(np.sum(1.0 - probability[status == RayStatus.OK]))

"""Which step of which data set: year files, steps that do not exist, and the nearest ones."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import OceanError
from pymantaray.ocean.fetch.catalogue import Experiment, known_missing, minute
from pymantaray.ocean.fetch.dap import DapDataset, open_dataset
from pymantaray.ocean.fetch.kept import Source
from pymantaray.ocean.fetch.transport import ServerError

Instants = NDArray[np.datetime64]
_MINUTE = np.timedelta64(60, "s")
_FARTHEST = np.timedelta64(72, "h")  # that still counts as nearest; gaps of 51 h have been reported


@dataclass(frozen=True)
class Step:
    """A step that exists, and the data set that holds each variable."""

    time: np.datetime64
    datasets: dict[str, DapDataset]


class StepMissingError(OceanError):
    """There is no such step."""


def expected_step(experiment: Experiment, wanted: np.datetime64, *, nearest: bool) -> np.datetime64:
    """
    Step to ask a server for, by what is known of the experiment without asking.

    Parameters
    ----------
    experiment : Experiment
    wanted : numpy.datetime64
    nearest : bool
        Take the nearest step that is not known to be missing.

    Returns
    -------
    numpy.datetime64

    Raises
    ------
    StepMissingError
        If the step is known not to exist and ``nearest`` is False.
    """
    missing = known_missing(experiment)
    if not nearest:
        if wanted in missing:
            raise _missing_error(experiment, wanted, _regular_steps(experiment, wanted, missing))
        return wanted
    return _nearest(experiment, wanted, _regular_steps(experiment, wanted, missing))


def find_step(
    source: Source,
    root: str,
    experiment: Experiment,
    wanted: np.datetime64,
    *,
    nearest: bool,
    fresh: bool = False,
) -> Step | None:
    """
    Find a step on the time axes that the server reports.

    Parameters
    ----------
    source : Source
    root : str
        Address of the OPeNDAP service.
    experiment : Experiment
    wanted : numpy.datetime64
    nearest : bool
        Take the nearest step where the one asked for does not exist.
    fresh : bool, optional
        Ask the server for its axes even where they are kept.

    Returns
    -------
    Step or None
        None if the server's axes end before or begin after the time.

    Raises
    ------
    StepMissingError
        If the axes reach over the time but lack it; the message gives the nearest steps.
    ServerError
        If a data set cannot be opened.
    """
    opened = [_open(source, root, experiment, wanted, fresh=fresh)]
    if not fresh and experiment.last is None and not np.any(np.abs(_common(opened[0]) - wanted) < _MINUTE):
        opened = [_open(source, root, experiment, wanted, fresh=True)]  # perhaps it has grown
    times = _common(opened[0])
    if not times.size:
        raise ServerError(f"{experiment.title}: its data sets have no step in common")
    if experiment.by_year and not times.min() <= wanted <= times.max():
        turn = -1 if wanted < times.min() else 1
        if (neighbour := _open_neighbour(source, root, experiment, wanted, turn)) is not None:
            opened.append(neighbour)
            times = np.unique(np.concatenate([times, _common(neighbour)]))
    closest = times[np.argmin(np.abs(times - wanted))]
    if abs(closest - wanted) >= _MINUTE:
        if not times.min() < wanted < times.max():
            return None
        if not nearest:
            raise _missing_error(experiment, wanted, times)
        closest = _nearest(experiment, wanted, times)
    return next(Step(closest, datasets) for datasets in opened if closest in _common(datasets))


def _open(
    source: Source,
    root: str,
    experiment: Experiment,
    wanted: np.datetime64,
    *,
    turn: int = 0,
    fresh: bool = False,
) -> dict[str, DapDataset]:
    year = experiment.year_of(wanted) + turn
    datasets = {}
    for part in experiment.datasets:
        opened = open_dataset(source, f"{root.rstrip('/')}/{part.path.format(year=year)}", fresh=fresh)
        datasets.update(dict.fromkeys(part.variables, opened))
    return datasets


def _open_neighbour(
    source: Source, root: str, experiment: Experiment, wanted: np.datetime64, turn: int
) -> dict[str, DapDataset] | None:
    year = experiment.year_of(wanted) + turn
    if year < experiment.first.year or (experiment.last is not None and year > experiment.last.year):
        return None
    try:
        return _open(source, root, experiment, wanted, turn=turn)
    except ServerError:
        return None  # there may be none, and the answer to the question is the same: no such step


def _common(datasets: dict[str, DapDataset]) -> Instants:
    """Steps that all variables have, sorted: axes that step back and repeat have been reported."""
    parts = [d.times for d in {d.url: d for d in datasets.values()}.values()]
    common = np.unique(parts[0])
    for part in parts[1:]:
        common = np.intersect1d(common, part)
    return common


def _regular_steps(experiment: Experiment, wanted: np.datetime64, missing: Instants) -> Instants:
    """Steps about a time that a complete experiment would have, without the known missing ones."""
    step = np.timedelta64(round(experiment.step_h * 3600.0), "s")
    first = np.datetime64(experiment.first, "s")
    middle = first + step * ((wanted - first) // step)
    reach = int(_FARTHEST / step) + 1
    steps = middle + step * np.arange(-reach, reach + 1)
    last = steps[-1] if experiment.last is None else np.datetime64(experiment.last, "s")
    return steps[(steps >= first) & (steps <= last) & ~np.isin(steps, missing)]


def _nearest(experiment: Experiment, wanted: np.datetime64, times: Instants) -> np.datetime64:
    closest = times[np.argmin(np.abs(times - wanted))] if times.size else None
    if closest is None or abs(closest - wanted) > _FARTHEST:
        raise StepMissingError(
            f"{experiment.title}: no step within 72 h of {minute(wanted)}; choose another time"
        )
    return np.datetime64(closest)


def _missing_error(experiment: Experiment, wanted: np.datetime64, times: Instants) -> StepMissingError:
    sides = (times[times < wanted][-1:], times[times > wanted][:1])
    found = " and ".join(minute(t) for side in sides for t in side)
    return StepMissingError(
        f"{experiment.title} has no step {minute(wanted)}; nearest: {found or 'none'};"
        " choose one, or let the nearest be taken (--nearest)"
    )

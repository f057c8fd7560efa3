"""True values of unknowns other than poses: amplitudes of sound-speed modes, and clocks."""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from pymantaray.apps.study.store import Run
from pymantaray.config.door.estimators import Condition, EstimatorFactory
from pymantaray.estimation import GraphSolution, UnknownsEstimate
from pymantaray.ocean import layer_weights
from pymantaray.range_models.eigenray_model import AdjustableEigenrays
from pymantaray.records import SharedUnknowns, Trajectories
from pymantaray.sensing import ClockModel


def true_unknowns(
    run: Run, factory: EstimatorFactory, condition: Condition, realization: int
) -> dict[str, float]:
    """True values of a condition's unknowns other than poses, by the names of `Unknowns`."""
    out: dict[str, float] = {}
    rays = factory.adjustable(condition.name, realization)
    if rays is not None:
        model, believed = rays
        out |= true_amplitudes(model, run.ocean, believed, run.truth)
    if condition.estimates_clocks:
        clocks = run.study.clocks
        names = run.truth.name.tolist()
        out |= true_clocks(clocks, names, root_seed=run.study.seed, realization=realization)
    return out


def true_amplitudes(
    model: AdjustableEigenrays, true: xr.Dataset, believed: xr.Dataset, fleet: Trajectories
) -> dict[str, float]:
    """
    Amplitudes of modes that best fit the error of the assumed ocean, by the names of `Unknowns`.
    [m/s]

    The fit has the least mean square over the water column of the error averaged over the vehicles'
    mean positions. An error that varies horizontally has no single true amplitude.
    """
    place = fleet.position.mean(axis=1)
    at = [
        np.abs(true[x].values[:, None] - place[:, k]).argmin(axis=0)
        for k, x in enumerate(("north", "east"))
    ]
    true_column, believed_column = (
        o["sound_speed"].transpose("north", "east", "depth").values[at[0], at[1]].mean(axis=0)
        for o in (true, believed)
    )
    depth = true["depth"].values
    wet = depth <= float(model.medium.bottom_depth(place).min())
    amplitudes = model.fit(true_column - believed_column, np.where(wet, layer_weights(depth), 0.0))
    return {f"mode {k + 1}": float(a) for k, a in enumerate(amplitudes)}


def true_clocks(
    model: ClockModel | None, names: list[str], *, root_seed: int, realization: int
) -> dict[str, float]:
    """
    Offsets [s] and skews of one realization's clocks by the names of `Unknowns`; zero for exact
    clocks.
    """
    offset = skew = np.zeros(len(names))
    if model is not None:
        clocks = model.draw(names, root_seed=root_seed, realization=realization)
        offset = clocks.offset
        skew = clocks.skew
    return {
        f"{what} {name}": float(value)
        for what, values in (("clock offset", offset), ("clock skew", skew))
        for name, value in zip(names, values, strict=True)
    }


def collect_unknowns(
    solutions: Sequence[Mapping[str, GraphSolution]],
    truths: Sequence[Mapping[str, Mapping[str, float]]],
) -> SharedUnknowns | None:
    """Record of the unknowns of all realizations with their true values; None if there are none."""
    by_condition: dict[str, list[UnknownsEstimate | None]] = {}
    for name in dict.fromkeys(name for one in solutions for name in one):
        estimates = [one[name].unknowns for one in solutions]
        if any(e is not None for e in estimates):
            by_condition[name] = estimates
    solved = [e for estimates in by_condition.values() for e in estimates if e is not None]
    units = {name: unit for e in solved for name, unit in zip(e.name, e.unit, strict=True)}
    if not units:
        return None
    place = {name: i for i, name in enumerate(units)}
    shape = len(by_condition), len(solutions), len(units)
    prior = np.full((shape[0], shape[2]), np.nan)
    value = np.full(shape, np.nan)
    truth = np.full(shape, np.nan)
    covariance = np.full((*shape, shape[2]), np.nan)
    for c, (name, estimates) in enumerate(by_condition.items()):
        for r, e in enumerate(estimates):
            if e is not None:
                rows = [place[n] for n in e.name]  # a solve without a fitted sigma has fewer
                prior[c, rows] = e.prior_sigma
                value[c, r, rows] = e.value
                truth[c, r, rows] = [truths[r][name].get(n, np.nan) for n in e.name]
                covariance[c, r][np.ix_(rows, rows)] = e.covariance
    return SharedUnknowns(
        condition=np.array(list(by_condition)),
        realization=np.arange(len(solutions)),
        name=np.array(list(units)),
        unit=np.array(list(units.values())),
        prior_sigma=prior,
        value=value,
        truth=truth,
        covariance=covariance,
    )

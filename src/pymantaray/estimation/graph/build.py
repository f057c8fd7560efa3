"""From measurements to factor graph: which measurements enter under which ranging condition."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pymantaray.arrays import Mask
from pymantaray.errors import EstimationError
from pymantaray.estimation.graph.graph import (
    KINDS,
    FactorGraph,
    FactorKind,
    Factors,
    FactorSource,
    check_anchored,
    check_graph,
)
from pymantaray.estimation.names import LinkChoice, MeasuredRanges
from pymantaray.estimation.ranges.range_models import TimedRanges
from pymantaray.geometry.se3 import matrix_from_quaternion
from pymantaray.records import Measurements, RayStatus
from pymantaray.records.status import ARRIVES


def build_graph(
    measurements: Measurements, ranges: MeasuredRanges = None, links: LinkChoice = "refracted"
) -> FactorGraph:
    """
    Factor graph of a fleet's measurements.

    Parameters
    ----------
    measurements : Measurements
        A first-pose prior of NaN in every entry means that the vehicle has no such prior.
    ranges : {"straight", "refracted"} or None
        Measured range of each link; None omits ranges.
    links : {"refracted", "all"}
        "refracted" uses the links with a refracted range, for either kind of range;
        "all" adds acoustic dropouts, except of silent vehicles, and needs ``ranges="straight"``.

    Returns
    -------
    FactorGraph
        Poses are ordered by vehicle: the pose of vehicle ``a`` at sample ``k`` is variable ``a *
        n_time + k``.

    Raises
    ------
    EstimationError
        If a measurement is not finite, a noise level is not positive, or a vehicle has no prior and
        no other factor anchors it; the message names the variable.

    See Also
    --------
    CONDITIONS : names of these choices in a study.

    Examples
    --------
    Continues the example of `pymantaray.estimation`:

    >>> from pymantaray.estimation import build_graph
    >>> build_graph(noisy, "straight").n_factors, build_graph(noisy).n_factors
    (10, 8)
    """
    graph = with_ranges(_without_ranges(measurements), measurements, ranges, links)
    check_graph(graph)
    check_anchored(graph)
    return graph


def with_ranges(
    graph: FactorGraph, measurements: Measurements, ranges: MeasuredRanges, links: LinkChoice
) -> FactorGraph:
    """Replace the ranges of a graph by those of one condition."""
    use = _used(measurements, ranges, links)
    ends = [
        _variables(measurements, end[use], measurements.range_sample[use])
        for end in (measurements.range_transmitter, measurements.range_receiver)
    ]
    # the pose comes first; a distance is symmetric
    swap = (ends[0] >= graph.n_poses) & (ends[1] < graph.n_poses)
    variables = np.stack(
        [np.where(swap, ends[1], ends[0]), np.where(swap, ends[0], ends[1])], axis=1
    )
    distance = (
        measurements.refracted_range if ranges == "refracted" else measurements.straight_range
    )
    return graph.with_factors(
        range=_table(
            graph, "range", variables, [distance[use]], measurements.range_sigma[use, None]
        )
    )


def timed_ranges(
    measurements: Measurements, ranges: MeasuredRanges, links: LinkChoice
) -> TimedRanges:
    """
    Travel times of the ranges of a graph, row by row.

    A range is the sound speed at its transmitter times the measured travel time, so the travel time
    is their quotient, noise included.
    """
    use = _used(measurements, ranges, links)
    speed = measurements.transmitter_sound_speed[use]
    if not np.all(speed > 0.0):
        first = int(np.argmin(speed > 0.0))
        raise EstimationError(
            f"sound speed at the transmitter of range {np.flatnonzero(use)[first]} is"
            f" {speed[first]:g} m/s; it must be positive"
        )
    distance = (
        measurements.refracted_range if ranges == "refracted" else measurements.straight_range
    )
    sample = measurements.range_sample[use]
    return TimedRanges(
        transmitter=_variables(measurements, measurements.range_transmitter[use], sample),
        receiver=_variables(measurements, measurements.range_receiver[use], sample),
        epoch=np.unique(sample, return_inverse=True)[1],
        time=measurements.time[sample],
        sound_speed=speed,
        travel_time=distance[use] / speed,
    )


def _used(measurements: Measurements, ranges: MeasuredRanges, links: LinkChoice) -> Mask:
    """Select the attempts whose ranges enter the graph."""
    if ranges not in {"straight", "refracted", None} or links not in {"refracted", "all"}:
        raise EstimationError(
            f"ranges {ranges!r} over links {links!r}; allowed are 'straight', 'refracted' or None"
            " over 'refracted' or 'all'"
        )
    if ranges == "refracted" and links == "all":
        raise EstimationError(
            "refracted ranges over all links: a dropout has none; use links = 'refracted'"
        )
    if ranges is None:
        return np.zeros(measurements.range_status.size, dtype=bool)
    if links == "refracted":
        return np.isin(measurements.range_status, ARRIVES)
    return np.asarray(measurements.range_status != RayStatus.STOPPED)


def _without_ranges(measurements: Measurements) -> FactorGraph:
    n_vehicles, n_times = measurements.depth.shape
    poses = np.arange(n_vehicles * n_times)
    chain = poses.reshape(n_vehicles, n_times)
    bare = FactorGraph(
        vehicle_name=measurements.name,
        landmark_name=measurements.landmark_name,
        pose_vehicle=np.repeat(np.arange(n_vehicles), n_times),
        pose_number=np.tile(np.arange(n_times), n_vehicles),
        pose_time=np.tile(measurements.time, n_vehicles),
    )
    # vehicles without a first pose have no prior
    known = ~np.isnan(
        np.hstack(
            [measurements.first_position, measurements.first_quaternion, measurements.first_sigma]
        )
    ).all(axis=1)
    edges = np.stack([chain[:, :-1].ravel(), chain[:, 1:].ravel()], axis=1)
    landmarks = poses.size + np.arange(measurements.landmark_name.size)
    first = [measurements.first_position[known], measurements.first_quaternion[known]]
    steps = [measurements.odometry_translation, measurements.odometry_rotation]
    # variables, measurements and sigmas of each kind of factor
    tables = {
        "prior": (chain[known, 0], first, measurements.first_sigma[known]),
        "depth": (
            poses,
            [measurements.depth],
            np.repeat(measurements.depth_sigma, n_times)[:, None],
        ),
        "survey": (
            landmarks,
            [measurements.landmark_position],
            np.repeat(measurements.landmark_sigma[:, None], 3, axis=1),
        ),
        "edge": (edges, steps, measurements.odometry_sigma.reshape(-1, 6)),
    }
    tables |= {
        name: _columns(measurements, chain, kind, source)
        for name, kind in KINDS.items()
        if (source := kind.source) is not None
    }
    graph = bare.with_factors(
        **{name: _table(bare, name, *columns) for name, columns in tables.items()}
    )
    # attitudes are measured in the axes of the world, their factors in those of the body
    rotations = [
        name
        for name, kind in KINDS.items()
        if kind.source is not None and kind.row_names == ("rx", "ry", "rz")
    ]
    return graph.with_factors(**{name: _in_body(graph[name]) for name in rotations})


def _columns(
    measurements: Measurements, chain: NDArray[Any], kind: FactorKind, source: FactorSource
) -> tuple[NDArray[Any], list[NDArray[Any]], NDArray[Any]]:
    """
    Variables, measured columns and standard deviations of a kind, from the columns of its source.
    """
    vehicle, sample, sigma = (
        getattr(measurements, name) for name in (source.vehicle, source.sample, source.sigma)
    )
    variables = np.stack([chain[vehicle, sample + k] for k in range(len(kind.ends))], axis=1)
    columns = [getattr(measurements, name) for name in source.columns]
    if sigma.ndim == 1:
        sigma = np.repeat(sigma[:, None], kind.rows, axis=1)
    if source.rate:
        duration = (measurements.time[sample + 1] - measurements.time[sample])[:, None]
        columns = [values * duration for values in columns]
        sigma = sigma * duration
    return variables, columns, sigma


def _in_body(attitudes: Factors) -> Factors:
    """Rotate attitude covariances from the world's axes to the tangent of the body."""
    rotation = matrix_from_quaternion(attitudes.column("quaternion"))
    covariance = np.swapaxes(rotation, 1, 2) @ attitudes.covariance @ rotation
    return replace(attitudes, covariance=0.5 * (covariance + np.swapaxes(covariance, 1, 2)))


def _variables(
    measurements: Measurements, participant: NDArray[Any], sample: NDArray[Any]
) -> NDArray[Any]:
    n_vehicles, n_times = measurements.depth.shape
    landmark = participant >= n_vehicles
    pose = participant * n_times + sample
    return np.asarray(np.where(landmark, n_vehicles * n_times + participant - n_vehicles, pose))


def _table(
    graph: FactorGraph,
    name: str,
    variables: NDArray[Any],
    columns: list[NDArray[Any]],
    sigma: NDArray[Any],
) -> Factors:
    """
    Factors with diagonal covariances from standard deviations (n, rows), which must be positive.
    """
    kind = KINDS[name]
    covariance = np.zeros((len(sigma), kind.rows, kind.rows))
    row = np.arange(kind.rows)
    covariance[:, row, row] = sigma**2
    factors = kind.owning_table(variables, columns, covariance)
    fine = (np.isfinite(sigma) & (sigma > 0.0)).all(axis=1)
    if not fine.all():
        first = int(np.argmin(fine))
        numbers = ", ".join(f"{v:g}" for v in sigma[first])
        raise EstimationError(
            f"{graph.variable_name(int(factors.subject[first]))}: {kind.what} sigma is [{numbers}];"
            " it must be positive and finite"
        )
    return factors

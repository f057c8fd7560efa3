"""From measurements to factor graph: which measurements enter under which ranging condition."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import EstimationError
from pymantaray.estimation.graph import FactorGraph, check_anchored, check_graph
from pymantaray.records import Measurements, RayStatus

Ranges = Literal["straight", "refracted"] | None
Links = Literal["refracted", "all"]


@dataclass(frozen=True)
class Condition:
    """
    Ranging condition: which ranges enter the graph, over which links, and whether the model fits them.

    ``dead_reckoned`` means that no graph is solved at all.
    """

    ranges: Ranges
    links: Links = "refracted"
    model_is_right: bool = True
    dead_reckoned: bool = False


CONDITIONS: Mapping[str, Condition] = MappingProxyType(
    {
        "odometry": Condition(ranges=None, dead_reckoned=True),
        "no-ranges": Condition(ranges=None),
        "straight": Condition(ranges="straight"),
        "refracted": Condition(ranges="refracted", model_is_right=False),
        "straight-all": Condition(ranges="straight", links="all"),
    }
)


class TimedRanges(NamedTuple):
    """What was measured of each range of a graph, row by row; the transmitter may be either of its variables."""

    transmitter: NDArray[np.intp]
    """Variable, shape (n,)."""
    receiver: NDArray[np.intp]
    """Variable, shape (n,)."""
    epoch: NDArray[np.intp]
    """Number of the ping, from 0, shape (n,)."""
    time: NDArray[np.float64]
    """Of the ping since the start of the mission, shape (n,). [s]"""
    sound_speed: NDArray[np.float64]
    """Measured at the transmitter, shape (n,). [m s⁻¹]"""
    travel_time: NDArray[np.float64]
    """Measured, with its noise, shape (n,). [s]"""


def build_graph(measurements: Measurements, ranges: Ranges = None, links: Links = "refracted") -> FactorGraph:
    """
    Factor graph of a fleet's measurements.

    Parameters
    ----------
    measurements : Measurements
        A vehicle whose first-pose prior is NaN in every entry has no such prior.
    ranges : {"straight", "refracted"} or None
        Which range of each link is measured; None leaves ranges out.
    links : {"refracted", "all"}
        "refracted" takes exactly the links with a refracted range (status OK), whichever range is used;
        "all" takes also the acoustic dropouts, but no silent vehicle, and needs ``ranges="straight"``.

    Returns
    -------
    FactorGraph
        Poses vehicle by vehicle: the pose of vehicle ``a`` at sample ``k`` is variable ``a * n_time + k``.

    Raises
    ------
    EstimationError
        If a measurement is not finite, a noise level is not positive, or a vehicle has no prior and
        nothing that anchors it; the message names the variable.

    See Also
    --------
    CONDITIONS : the studies' names for these choices.
    """
    graph = with_ranges(_without_ranges(measurements), measurements, ranges, links)
    check_graph(graph)
    check_anchored(graph)
    return graph


def with_ranges(graph: FactorGraph, measurements: Measurements, ranges: Ranges, links: Links) -> FactorGraph:
    """
    Put the ranges of one condition into a graph in place of those it has.

    Parameters
    ----------
    graph : FactorGraph
        From `build_graph` of the same measurements.
    measurements : Measurements
    ranges, links : str
        As in `build_graph`.

    Returns
    -------
    FactorGraph

    Raises
    ------
    EstimationError
        If ``ranges`` or ``links`` is not one of the allowed words, or both contradict each other.
    """
    o = measurements
    use = _used(o, ranges, links)
    first, second = (
        _variables(o, end[use], o.range_sample[use]) for end in (o.range_transmitter, o.range_receiver)
    )
    # the file format wants the pose first; a distance does not mind
    swap = (first >= graph.n_poses) & (second < graph.n_poses)
    first, second = np.where(swap, second, first), np.where(swap, first, second)
    distance = o.refracted_range if ranges == "refracted" else o.straight_range
    return replace(
        graph,
        range_first=first,
        range_second=second,
        range_distance=distance[use],
        range_variance=_variance("range", graph, first, o.range_sigma[use]),
    )


def timed_ranges(measurements: Measurements, ranges: Ranges, links: Links) -> TimedRanges:
    """
    Travel times behind the ranges of a graph.

    Parameters
    ----------
    measurements : Measurements
    ranges, links : str
        As in `build_graph`, for a graph with whose ranges the rows are to agree.

    Returns
    -------
    TimedRanges
        A range is the sound speed at its transmitter times what is measured: the travel time is the
        quotient of both, noise included.

    Raises
    ------
    EstimationError
        As `with_ranges`, or if a sound speed at a transmitter is not positive.
    """
    o = measurements
    use = _used(o, ranges, links)
    speed = o.transmitter_sound_speed[use]
    if not np.all(speed > 0.0):
        first = int(np.argmin(speed > 0.0))
        raise EstimationError(
            f"sound speed at the transmitter of range {np.flatnonzero(use)[first]} is {speed[first]:g} m/s; needs"
            " positive values"
        )
    distance = o.refracted_range if ranges == "refracted" else o.straight_range
    sample = o.range_sample[use]
    return TimedRanges(
        transmitter=_variables(o, o.range_transmitter[use], sample),
        receiver=_variables(o, o.range_receiver[use], sample),
        epoch=np.unique(sample, return_inverse=True)[1],
        time=o.time[sample],
        sound_speed=speed,
        travel_time=distance[use] / speed,
    )


def _used(o: Measurements, ranges: Ranges, links: Links) -> NDArray[np.bool_]:
    """Attempts whose ranges enter the graph."""
    if ranges not in {"straight", "refracted", None} or links not in {"refracted", "all"}:
        raise EstimationError(
            f"ranges {ranges!r} over links {links!r}; allowed are 'straight', 'refracted' or None over 'refracted' or"
            " 'all'"
        )
    if ranges == "refracted" and links == "all":
        raise EstimationError("refracted ranges over all links: a dropout has none; use links='refracted'")
    if ranges is None:
        return np.zeros(o.range_status.size, dtype=bool)
    if links == "refracted":
        return np.asarray(o.range_status == RayStatus.OK)
    return np.asarray(o.range_status != RayStatus.STOPPED)


def _without_ranges(o: Measurements) -> FactorGraph:
    n_agents, n_times = o.depth.shape
    poses = np.arange(n_agents * n_times)
    with_prior = ~np.isnan(np.hstack([o.first_position, o.first_quaternion, o.first_sigma])).all(axis=1)
    chain = poses.reshape(n_agents, n_times)
    none = np.empty(0)
    bare = FactorGraph(
        agent_name=o.name,
        landmark_name=o.landmark_name,
        pose_agent=np.repeat(np.arange(n_agents), n_times),
        pose_number=np.tile(np.arange(n_times), n_agents),
        pose_time=np.tile(o.time, n_agents),
        prior_pose=chain[with_prior, 0],
        prior_position=o.first_position[with_prior],
        prior_quaternion=o.first_quaternion[with_prior],
        prior_covariance=_square(o.first_sigma[with_prior]),
        fix_pose=chain[o.gnss_agent, o.gnss_sample],
        fix_position=o.gnss_position,
        fix_covariance=_square(np.repeat(o.gnss_sigma[:, None], 3, axis=1)),
        depth_pose=poses,
        depth=o.depth.ravel(),
        depth_variance=np.repeat(o.depth_sigma, n_times) ** 2,
        survey_landmark=np.arange(o.landmark_name.size),
        survey_position=o.landmark_position,
        survey_covariance=_square(np.repeat(o.landmark_sigma[:, None], 3, axis=1)),
        edge_from=chain[:, :-1].ravel(),
        edge_to=chain[:, 1:].ravel(),
        edge_quaternion=o.odometry_rotation.reshape(-1, 4),
        edge_translation=o.odometry_translation.reshape(-1, 3),
        edge_covariance=_square(o.odometry_sigma.reshape(-1, 6)),
        range_first=none,
        range_second=none,
        range_distance=none,
        range_variance=none,
    )
    for what, variables, sigma in (
        ("first-pose prior", bare.prior_pose, o.first_sigma[with_prior]),
        ("GNSS fix", bare.fix_pose, o.gnss_sigma),
        ("depth", bare.depth_pose, np.repeat(o.depth_sigma, n_times)),
        ("landmark prior", bare.survey_landmark + bare.n_poses, o.landmark_sigma),
        ("odometry", bare.edge_to, o.odometry_sigma.reshape(-1, 6)),
    ):
        _variance(what, bare, variables, sigma)
    return bare


def _variables(o: Measurements, participant: NDArray[Any], sample: NDArray[Any]) -> NDArray[Any]:
    n_agents, n_times = o.depth.shape
    landmark = participant >= n_agents
    pose = participant * n_times + sample
    return np.asarray(np.where(landmark, n_agents * n_times + participant - n_agents, pose))


def _variance(what: str, graph: FactorGraph, variables: NDArray[Any], sigma: NDArray[Any]) -> NDArray[Any]:
    """Square a standard deviation; its sign would be lost after this."""
    flat = sigma.reshape(variables.size, -1) if sigma.size else np.ones((0, 1))
    fine = (np.isfinite(flat) & (flat > 0.0)).all(axis=1)
    if not fine.all():
        first = int(np.argmin(fine))
        found = ", ".join(f"{v:g}" for v in flat[first])
        raise EstimationError(
            f"{graph.variable_name(int(variables[first]))}: {what} sigma is [{found}]; needs positive finite values"
        )
    return np.asarray(sigma**2)


def _square(sigma: NDArray[Any]) -> NDArray[Any]:
    """Diagonal covariance matrices of rows of standard deviations."""
    return np.asarray(sigma[:, :, None] ** 2 * np.eye(sigma.shape[1]))

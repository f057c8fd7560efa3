"""The least error that measurements allow: posterior Cramér-Rao bounds along the truth, and what a ping leaves open."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymantaray.errors import EvaluationError
from pymantaray.estimation import CONDITIONS, GraphValues, build_graph, covariances_at
from pymantaray.estimation.covariance import dead_reckoning_covariances
from pymantaray.records import Measurements, Trajectories, VehicleStatus
from pymantaray.records.status import ARRIVES

Array = NDArray[np.float64]
_RANK = 1e-9  # of the largest singular value; a direction below is not seen


def ping_samples(measurements: Measurements) -> NDArray[np.intp]:
    """Samples at which ranges were tried."""
    return np.unique(measurements.range_sample).astype(np.intp)


def submerged_at_pings(truth: Trajectories, measurements: Measurements) -> NDArray[np.bool_]:
    """Mask of vehicles that are active and have no GNSS fix at each ping, shape (n_pings, n_vehicles)."""
    if truth.name.tolist() != measurements.name.tolist():
        raise EvaluationError(
            f"measurements of vehicles {list(measurements.name)}, truth of {list(truth.name)}"
        )
    under = np.asarray(truth.status == VehicleStatus.ACTIVE)
    under[measurements.gnss_vehicle, measurements.gnss_sample] = False
    return np.asarray(under[:, ping_samples(measurements)].T)


def error_bound(truth: Trajectories, measurements: Measurements, condition: str = "straight") -> Array:
    r"""
    Posterior Cramér-Rao bound of the fleet's positions at the pings, along the true trajectories.

    Parameters
    ----------
    truth : Trajectories
    measurements : Measurements
        Without noise: which there are, and how good they are.
    condition : str
        Key of `CONDITIONS`: ``odometry`` is dead reckoning, ``no-ranges`` has depths and GNSS besides; of all others ranges
        are distances, over their links.

    Returns
    -------
    ndarray, shape (n_pings, n_vehicles, 3, n_vehicles, 3)
        Joint covariance of all positions at each ping. [m²]

    Raises
    ------
    EvaluationError
        If the vehicles of both records differ, or there is no such condition.

    Notes
    -----
    The inverse of the information :math:`\sum_k J_k^\top R_k^{-1} J_k` of all measurements and priors, past and future, with
    the Jacobians at the truth; for nonlinear measurements with additive Gaussian noise that is the Fisher information at
    these trajectories. No unbiased estimator has a smaller covariance; one that is biased may. Ranges by refracted sound
    in an ocean that is known say as much as distances, to the ratio of sound speeds. Links that are lost by chance are
    taken as heard, and clocks as right: both leave a lower bound, which is then not reached.

    Examples
    --------
    >>> bound = error_bound(run.truth, run.measurements)  # doctest: +SKIP
    """
    submerged_at_pings(truth, measurements)  # which refuses records of other vehicles
    if condition not in CONDITIONS:
        raise EvaluationError(f"error_bound: condition {condition!r}; allowed are {', '.join(CONDITIONS)}")
    o, samples, e = measurements, ping_samples(measurements), CONDITIONS[condition]
    if not samples.size:
        return np.empty((0, *2 * (o.name.size, 3)))
    if e.dead_reckoned:
        return dead_reckoning_covariances(o, samples).position
    graph = build_graph(o, None if e.ranges is None else "straight", e.links)
    values = GraphValues(
        position=truth.position.reshape(-1, 3),
        quaternion=truth.quaternion.reshape(-1, 4),
        landmark_position=o.landmark_position,
    )
    poses = np.arange(o.depth.size).reshape(o.depth.shape)[:, samples].T
    return covariances_at(graph, values, poses, innovations=False).position


def rms_bound(bound: Array, submerged: NDArray[np.bool_]) -> float:
    """Root mean square of the position error that a bound allows to vehicles under water at pings; NaN for none. [m]"""
    variance = np.einsum("eaiai->ea", bound)[submerged]
    return float(np.sqrt(variance.mean())) if variance.size else float("nan")


def bound_table(truth: Trajectories, measurements: Measurements) -> pd.DataFrame:
    """
    The bound at each ping, without ranges and with them, and what the ranges of that ping alone leave open.

    Parameters
    ----------
    measurements : Measurements
        Without noise.

    Returns
    -------
    pandas.DataFrame
        ``time_h``; ``anchors``, vehicles with a GNSS fix, and landmarks; ``submerged``, vehicles without; ``no_ranges_rmse_m`` and
        ``bound_rmse_m`` of these, with odometry, depth and GNSS of all times, without and with all ranges;
        ``unseen``, directions of all positions that ranges, depths and fixes of this ping do not see; ``rotation_deg``,
        standard deviation in the bound with ranges of a rotation of the vehicles under water about the mean of the anchors,
        and ``rotation_percent``, its share of the horizontal variance; NaN without an anchor.

    Raises
    ------
    EvaluationError
        If the vehicles of both records differ.

    Notes
    -----
    Ranges and depths do not change when a fleet turns about the vertical through its only anchor: odometry alone holds that
    direction, or a second anchor.
    """
    samples, submerged = ping_samples(measurements), submerged_at_pings(truth, measurements)
    blind, best = (error_bound(truth, measurements, name) for name in ("no-ranges", "straight"))
    rows = []
    for e, (sample, under) in enumerate(zip(samples, submerged, strict=True)):
        fixed = np.zeros(under.size, dtype=bool)
        fixed[measurements.gnss_vehicle[measurements.gnss_sample == sample]] = True
        place = truth.position[:, sample]
        anchors = np.concatenate([place[fixed], measurements.landmark_position])
        turn, share = _rotation(place[under], anchors, best[e][under][:, :2][..., under, :2])
        rows.append(
            {
                "time_h": float(truth.time[sample] / 3600.0),
                "anchors": len(anchors),
                "submerged": int(under.sum()),
                "no_ranges_rmse_m": rms_bound(blind[e : e + 1], under[None]),
                "bound_rmse_m": rms_bound(best[e : e + 1], under[None]),
                "unseen": _unseen(truth, measurements, int(sample), fixed),
                "rotation_deg": float(np.degrees(turn)),
                "rotation_percent": 100.0 * share,
            }
        )
    columns = ["time_h", "anchors", "submerged", "no_ranges_rmse_m", "bound_rmse_m", "unseen"]
    return pd.DataFrame(rows, columns=[*columns, "rotation_deg", "rotation_percent"])


def _rotation(place: Array, anchors: Array, covariance: Array) -> tuple[float, float]:
    """Standard deviation of the rotation about the mean of the anchors [rad], and its share of the horizontal variance."""
    if not (len(anchors) and len(place)):
        return np.nan, np.nan
    arm = place[:, :2] - anchors[:, :2].mean(axis=0)
    tangent = np.stack([-arm[:, 1], arm[:, 0]], axis=1).ravel()  # moved by a radian
    length = float(np.linalg.norm(tangent))
    joint = covariance.reshape(tangent.size, tangent.size)
    variance = float(tangent @ joint @ tangent) / length**2
    return np.sqrt(variance) / length, variance / float(np.trace(joint))


def _unseen(truth: Trajectories, o: Measurements, sample: int, fixed: NDArray[np.bool_]) -> int:
    """Directions of the positions of active vehicles that the measurements of one sample, odometry aside, do not see."""
    active = np.flatnonzero(truth.status[:, sample] == VehicleStatus.ACTIVE)
    column = np.full(len(truth.name) + o.landmark_name.size, -1)
    column[active] = np.arange(active.size)
    place = np.concatenate([truth.position[:, sample], o.landmark_position])
    heard = np.flatnonzero((o.range_sample == sample) & np.isin(o.range_status, ARRIVES))
    ends = np.stack([o.range_transmitter[heard], o.range_receiver[heard]], axis=1)
    apart = place[ends[:, 1]] - place[ends[:, 0]]
    unit = apart / np.linalg.norm(apart, axis=1, keepdims=True)
    by = np.zeros((len(ends), active.size, 3))
    for end, sign in ((0, -1.0), (1, 1.0)):
        (known,) = np.nonzero(column[ends[:, end]] >= 0)
        by[known, column[ends[known, end]]] += sign * unit[known]
    depths = np.zeros((active.size, active.size, 3))
    depths[np.arange(active.size), np.arange(active.size), 2] = 1.0
    fixes = np.eye(3 * active.size).reshape(active.size, 3, active.size, 3)[fixed[active]]
    rows = [part.reshape(-1, 3 * active.size) for part in (by, depths, fixes)]
    size = np.linalg.svd(np.concatenate(rows), compute_uv=False)
    return int(3 * active.size - np.count_nonzero(size > _RANK * size.max(initial=1.0)))

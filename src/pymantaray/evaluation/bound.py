"""
Posterior Cramér-Rao bounds of position errors along the true trajectories, and the degrees of
freedom of these errors.
"""

from collections.abc import Callable, Iterable
from functools import cached_property

import numpy as np
import pandas as pd

from pymantaray.arrays import Array, Codes, Indices, Mask
from pymantaray.errors import EvaluationError
from pymantaray.estimation import CONDITIONS, Estimator, GraphValues, build_graph, covariances_at
from pymantaray.estimation.graph.graph import FactorGraph, connected_parts
from pymantaray.estimation.solvers.covariance import dead_reckoning_covariances
from pymantaray.estimation.solvers.marginals import PoseCovariance
from pymantaray.estimation.solvers.starts import dead_reckon
from pymantaray.evaluation.ranging_error import check_same_vehicles
from pymantaray.geometry import stream
from pymantaray.geometry.spread import root_mean
from pymantaray.records import Measurements, Trajectories, VehicleStatus
from pymantaray.records.status import ARRIVES

# random vectors in memory; those of a vehicle, whose standard error is then accurate to 8 %
_PROBES = 16
_FLEET_SETS = 3  # sets of so many vectors for a fleet, whose standard error is then accurate to 5 %
_RANK = 1e-9  # of the largest singular value; directions with smaller ones are not determined


def ping_samples(measurements: Measurements) -> Indices:
    """Sample indices of range attempts."""
    return np.unique(measurements.range_sample).astype(np.intp)


def submerged_at_pings(truth: Trajectories, measurements: Measurements) -> Mask:
    """
    Mask of vehicles that are active and have no GNSS fix at each ping, shape (n_pings, n_vehicles).
    """
    check_same_vehicles(truth, measurements)
    return submerged_at(truth, measurements, ping_samples(measurements))


def submerged_at(truth: Trajectories, measurements: Measurements, samples: Indices) -> Mask:
    """
    Mask of vehicles that are active and have no GNSS fix at some samples, shape (n_samples,
    n_vehicles).
    """
    under = np.asarray(truth.status == VehicleStatus.ACTIVE)
    under[measurements.gnss_vehicle, measurements.gnss_sample] = False
    return np.asarray(under[:, samples].T)


def error_bound(
    truth: Trajectories,
    measurements: Measurements,
    condition: str = "straight",
    *,
    samples: Indices | None = None,
) -> Array:
    r"""
    Posterior Cramér-Rao bound of the fleet's positions at the pings, along the true trajectories.

    Parameters
    ----------
    truth : Trajectories
    measurements : Measurements
        Measurements without noise, with their standard deviations.
    condition : str
        Key of `CONDITIONS`. ``odometry`` is dead reckoning; ``no-ranges`` adds depths and GNSS; all
        other conditions add the ranges of their links as straight distances.
    samples : ndarray of int, optional
        Samples at which the bound is wanted. Default: those of the pings.

    Returns
    -------
    ndarray, shape (n_pings, n_vehicles, 3, n_vehicles, 3)
        Joint covariance of all positions at each ping or sample. [m²]

    Raises
    ------
    EvaluationError
        If the vehicles of both records differ, or the condition does not exist.

    Notes
    -----
    The bound is the inverse of the information :math:`\sum_k J_k^\top R_k^{-1} J_k` of all
    measurements and priors, past and future, with the Jacobians at the true trajectories. For
    nonlinear measurements with additive Gaussian noise this is the Fisher information at these
    trajectories. No unbiased estimator has a smaller covariance; a biased one may have. The bound
    is an expectation over the noise, so the RMSE of a few realizations can be below it by chance.
    In a known ocean, refracted ranges contain the same information as distances, except for the
    ratio of sound speeds. The bound assumes that no link is lost by chance and that clocks have no
    error. If they do, it is still a lower bound, but no estimator reaches it.

    Examples
    --------
    Continues the example of `pymantaray.evaluation`:

    >>> from pymantaray.evaluation import error_bound
    >>> bound = error_bound(truth, measurements)
    >>> print(np.sqrt(np.diagonal(bound[0, 1, :, 1])).round(2))
    [5.32 7.5  0.01]
    """
    submerged_at_pings(truth, measurements)  # raises if the vehicles differ
    estimator = _known(condition)
    if samples is None:
        samples = ping_samples(measurements)
    if not samples.size:
        return np.empty((0, *2 * (measurements.name.size, 3)))
    if estimator.dead_reckoned:
        return dead_reckoning_covariances(measurements, samples, dead_reckon(measurements)).position
    graph = _bound_graph(estimator, measurements)
    values = _true_values(truth, measurements)
    poses = np.arange(measurements.depth.size).reshape(measurements.depth.shape)[:, samples].T
    return covariances_at(graph, values, poses, innovations=False).position


def _true_values(truth: Trajectories, measurements: Measurements) -> GraphValues:
    return GraphValues(
        position=truth.position.reshape(-1, 3),
        quaternion=truth.quaternion.reshape(-1, 4),
        landmark_position=measurements.landmark_position,
    )


class DegreesOfFreedom:
    r"""
    Effective degrees of freedom of the squared position and attitude errors of one realization.

    Each attribute is computed at its first use.

    Parameters
    ----------
    truth : Trajectories
    measurements : Measurements
        Measurements without noise, with their standard deviations.
    condition : str
        As in `error_bound`.

    Attributes
    ----------
    fleet : float
        Degrees of freedom of all poses of all vehicles.
    vehicle : ndarray, shape (n_vehicles,)
        Degrees of freedom of all poses of each vehicle.
    at_pings : float
        Degrees of freedom of the positions of vehicles under water at the pings.
    tilt, heading : float
        Degrees of freedom of the attitudes of all poses about both horizontal axes, and about the
        vertical.

    Raises
    ------
    EvaluationError
        If the vehicles of both records differ, or the condition does not exist.

    Notes
    -----
    They are :math:`\nu = (\mathrm{tr} P)^2 / \mathrm{tr}(P^2)` for the Cramér-Rao bound P, the
    joint covariance of these errors: the number of independent errors of equal variance whose sum
    of squares has the same mean and variance. An RMSE over n realizations then has the standard
    error :math:`\mathrm{RMSE} / \sqrt{2 n \nu}`. Both traces are estimated by Hutchinson's method,
    as means over random vectors of signs with a fixed seed. They are NaN if the measurements do not
    determine some direction.

    Examples
    --------
    Continues the example of `pymantaray.evaluation`:

    >>> from pymantaray.evaluation import DegreesOfFreedom
    >>> freedom = DegreesOfFreedom(truth, measurements)
    >>> round(freedom.at_pings, 1)
    2.8
    """

    def __init__(
        self, truth: Trajectories, measurements: Measurements, condition: str = "straight"
    ) -> None:
        self._submerged = submerged_at_pings(truth, measurements)
        self._shape, self._samples = truth.status.shape, ping_samples(measurements)
        self._graph = _bound_graph(_known(condition), measurements)
        self._covariance = PoseCovariance(self._graph, _true_values(truth, measurements))
        self._signs = _RandomSigns(self._graph.n_poses)

    @cached_property
    def fleet(self) -> float:
        """All poses of all vehicles."""
        return self._of(np.ones(self._shape, dtype=bool))

    @cached_property
    def vehicle(self) -> Array:
        """All poses of each vehicle."""
        return np.array(_of_vehicles(self._covariance.positions, self._graph, self._signs))

    @cached_property
    def at_pings(self) -> float:
        """Vehicles under water at the pings."""
        mask = np.zeros(self._shape, dtype=bool)
        mask[:, self._samples] = self._submerged.T
        return self._of(mask)

    @cached_property
    def tilt(self) -> float:
        """Attitudes of all poses about both horizontal axes."""
        return self._attitude([True, True, False])

    @cached_property
    def heading(self) -> float:
        """Attitudes of all poses about the vertical."""
        return self._attitude([False, False, True])

    def _attitude(self, axes: list[bool]) -> float:
        every = np.broadcast_to(axes, (*self._shape, 3))
        return _effective(self._covariance.rotations, every, self._signs)

    def _of(self, mask: Mask) -> float:
        """Degrees of freedom of the positions of the poses of a mask."""
        return _effective(
            self._covariance.positions, mask[..., None] & np.ones(3, dtype=bool), self._signs
        )


def graph_degrees_of_freedom(graph: FactorGraph, values: GraphValues) -> dict[str, float]:
    """
    Effective degrees of freedom of the squared position errors of a least-squares solution of a
    graph, as in `DegreesOfFreedom`.

    Parameters
    ----------
    graph : FactorGraph
    values : GraphValues
        Values for the linearization, such as the solution.

    Returns
    -------
    dict of str to float
        For each vehicle's name and ``"(all)"``; NaN if the measurements do not determine some
        direction.

    Examples
    --------
    Continues the example of `pymantaray.evaluation`:

    >>> from pymantaray.evaluation import graph_degrees_of_freedom
    >>> {name: round(value, 1) for name, value in graph_degrees_of_freedom(graph, start).items()}
    {'A': 1.8, 'B': 1.8, '(all)': 2.8}
    """
    covariance = PoseCovariance(graph, values).positions
    signs = _RandomSigns(graph.n_poses)
    own = dict(
        zip(graph.vehicle_name.tolist(), _of_vehicles(covariance, graph, signs), strict=True)
    )
    return {**own, "(all)": _effective(covariance, np.ones((graph.n_poses, 3), dtype=bool), signs)}


class _RandomSigns:
    """
    Sets of random vectors of signs for all poses, the same for each use; each set is drawn once.
    """

    def __init__(self, n_poses: int) -> None:
        self._rng = stream(0, 0, "evaluation", "degrees of freedom")
        self._shape = (_PROBES, n_poses, 3)
        self._sets: list[Codes] = []

    def __getitem__(self, number: int) -> Codes:
        """Set of vectors, (count, n_poses, 3)."""
        while len(self._sets) <= number:
            self._sets.append(self._rng.choice([-1.0, 1.0], self._shape).astype(np.int8))
        return self._sets[number]


def _effective(covariance: Callable[[Array], Array], mask: Mask, signs: _RandomSigns) -> float:
    """
    Degrees of freedom of the errors of a mask, (..., 3), from random products with their
    covariance.
    """
    if not mask.any():
        return np.nan
    own = mask.reshape(-1, 3).astype(float)
    sets = (own * signs[i].astype(float) for i in range(_FLEET_SETS))
    return _from_products((z, own * covariance(z)) for z in sets)


def _of_vehicles(
    covariance: Callable[[Array], Array], graph: FactorGraph, signs: _RandomSigns
) -> list[float]:
    """Degrees of freedom of the positions of all poses of each vehicle."""
    masks = (
        np.repeat(graph.pose_vehicle == a, 3).reshape(-1, 3) for a in range(graph.vehicle_name.size)
    )
    part = connected_parts(graph).part[: graph.n_poses]
    vectors = signs[0].astype(float)
    vehicles_and_parts = np.unique([part, graph.pose_vehicle], axis=1)
    if len(np.unique(part)) == vehicles_and_parts.shape[1]:  # vehicles do not depend on each other
        product = covariance(vectors)
        return [_from_products([(mask * vectors, mask * product)]) for mask in masks]
    return [_from_products([(mask * vectors, mask * covariance(mask * vectors))]) for mask in masks]


def _from_products(products: Iterable[tuple[Array, Array]]) -> float:
    """Degrees of freedom from random vectors and their products with a covariance, in sets."""
    trace = list[float]()
    square = list[float]()
    for vectors, product in products:
        trace += [float(np.sum(z * p)) for z, p in zip(vectors, product, strict=True)]
        square += [float(np.sum(p**2)) for p in product]
    return float(np.mean(trace) ** 2 / np.mean(square))


def _known(condition: str) -> Estimator:
    if condition not in CONDITIONS:
        raise EvaluationError(
            f"bound: condition {condition!r}; allowed are {', '.join(CONDITIONS)}"
        )
    return CONDITIONS[condition]


def _bound_graph(estimator: Estimator, measurements: Measurements) -> FactorGraph:
    """
    Graph of the measurements that a condition uses; dead reckoning has priors and odometry alone.
    """
    graph = build_graph(
        measurements, None if estimator.ranges is None else "straight", estimator.links
    )
    if not estimator.dead_reckoned:
        return graph
    others = {name: table[:0] for name, table in graph.tables.items() if not table.kind.reckons}
    return graph.with_factors(**others)


def rms_bound(bound: Array, submerged: Mask) -> float:
    """
    Lower bound of the root mean square position error of vehicles under water at pings; NaN without
    such vehicles. [m]
    """
    return root_mean(np.einsum("eaiai->ea", bound)[submerged])


def bound_table(truth: Trajectories, measurements: Measurements) -> pd.DataFrame:
    """
    Bound at each ping, without ranges and with them, and the directions that the ranges of this
    ping alone do not determine.

    Parameters
    ----------
    truth : Trajectories
        True trajectories.
    measurements : Measurements
        Measurements without noise.

    Returns
    -------
    pandas.DataFrame
        One row per ping. ``time_h``; ``anchors``, number of vehicles with a GNSS fix plus
        landmarks; ``submerged``, number of vehicles without a fix; ``no_ranges_rmse_m`` and
        ``bound_rmse_m``, bounds of the RMSE of submerged vehicles from odometry, depth and GNSS of
        all times, without and with all ranges; ``unseen``, number of directions of all positions
        that ranges, depths and fixes of this ping do not determine; ``rotation_deg``, standard
        deviation of the rotation of the submerged vehicles about the mean of the anchors, in the
        bound with ranges; ``rotation_percent``, its share of the horizontal variance. The last two
        are NaN without an anchor.

    Raises
    ------
    EvaluationError
        If the vehicles of both records differ.

    Notes
    -----
    If a fleet turns about the vertical through its only anchor, ranges and depths do not change.
    Only odometry or a second anchor determines this rotation.

    Examples
    --------
    Continues the example of `pymantaray.evaluation`:

    >>> from pymantaray.evaluation import bound_table
    >>> table = bound_table(truth, measurements)
    >>> table[["submerged", "no_ranges_rmse_m", "bound_rmse_m"]].round(2)
       submerged  no_ranges_rmse_m  bound_rmse_m
    0          2             10.61          9.19
    """
    samples = ping_samples(measurements)
    submerged = submerged_at_pings(truth, measurements)
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
    """
    Standard deviation of the rotation about the mean of the anchors [rad], and its share of the
    horizontal variance.
    """
    if not (len(anchors) and len(place)):
        return np.nan, np.nan
    arm = place[:, :2] - anchors[:, :2].mean(axis=0)
    tangent = np.stack([-arm[:, 1], arm[:, 0]], axis=1).ravel()  # displacement per radian
    length = float(np.linalg.norm(tangent))
    joint = covariance.reshape(tangent.size, tangent.size)
    variance = float(tangent @ joint @ tangent) / length**2
    return np.sqrt(variance) / length, variance / float(np.trace(joint))


def _unseen(truth: Trajectories, measurements: Measurements, sample: int, fixed: Mask) -> int:
    """
    Number of directions of active vehicles' positions that the measurements of one sample without
    odometry do not determine.
    """
    active = np.flatnonzero(truth.status[:, sample] == VehicleStatus.ACTIVE)
    column = np.full(len(truth.name) + measurements.landmark_name.size, -1)
    column[active] = np.arange(active.size)
    place = np.concatenate([truth.position[:, sample], measurements.landmark_position])
    received = np.flatnonzero(
        (measurements.range_sample == sample) & np.isin(measurements.range_status, ARRIVES)
    )
    ends = np.stack(
        [measurements.range_transmitter[received], measurements.range_receiver[received]], axis=1
    )
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

"""
The estimator's graph as a GTSAM user writes and solves it, for comparison; nothing but measurements
is shared.
"""

import gtsam
import numpy as np

from pymantaray.records import Measurements, RayStatus


def build(o: Measurements, refracted: bool) -> gtsam.NonlinearFactorGraph:
    """
    The graph as a GTSAM user writes it down: a loop over each sensor, a noise model for each level
    of noise.
    """
    graph = gtsam.NonlinearFactorGraph()
    sigmas, pose, rotation = gtsam.noiseModel.Diagonal.Sigmas, gtsam.Pose3, gtsam.Rot3.Quaternion
    n_vehicles, n_times = o.depth.shape
    for a in range(n_vehicles):
        first = pose(rotation(*o.first_quaternion[a]), o.first_position[a])
        graph.add(gtsam.PriorFactorPose3(a * n_times, first, sigmas(o.first_sigma[a])))
        vertical = gtsam.noiseModel.Diagonal.Precisions(
            np.array([0.0, 0.0, o.depth_sigma[a] ** -2])
        )
        for k in range(n_times):
            graph.add(
                gtsam.GPSFactor(a * n_times + k, np.array([0.0, 0.0, o.depth[a, k]]), vertical)
            )
        turns, moves, noise = o.odometry_rotation[a], o.odometry_translation[a], o.odometry_sigma[a]
        for k in range(n_times - 1):
            step = pose(rotation(*turns[k]), moves[k])
            key = a * n_times + k
            graph.add(gtsam.BetweenFactorPose3(key, key + 1, step, sigmas(noise[k])))
    model = gtsam.noiseModel.Isotropic.Sigma(3, o.gnss_sigma[0])
    for a, k, fix in zip(o.gnss_vehicle, o.gnss_sample, o.gnss_position, strict=True):
        graph.add(gtsam.GPSFactor(int(a * n_times + k), fix, model))
    model = gtsam.noiseModel.Isotropic.Sigma(1, o.range_sigma[0])
    distance = o.refracted_range if refracted else o.straight_range
    heard = np.flatnonzero(o.range_status == RayStatus.OK)
    first, second = (e * n_times + o.range_sample for e in (o.range_transmitter, o.range_receiver))
    for i in heard:
        graph.add(gtsam.RangeFactorPose3(int(first[i]), int(second[i]), distance[i], model))
    return graph


def start(truth: tuple[np.ndarray, np.ndarray]) -> gtsam.Values:
    values = gtsam.Values()
    for key, (t, q) in enumerate(
        zip(truth[0].reshape(-1, 3), truth[1].reshape(-1, 4), strict=True)
    ):
        values.insert(key, gtsam.Pose3(gtsam.Rot3.Quaternion(*q), t))
    return values


def gauss_newton(graph, values, ordering, tolerance: float) -> tuple[gtsam.Values, int]:
    parameters = gtsam.GaussNewtonParams()
    parameters.setLinearSolverType("SEQUENTIAL_CHOLESKY")
    parameters.setOrdering(ordering)
    optimizer = gtsam.GaussNewtonOptimizer(graph, values, parameters)
    while optimizer.iterations() < 50:
        before = gtsam.Values(
            optimizer.values()
        )  # what the optimizer shows dies with its next step
        optimizer.iterate()
        if np.abs(before.localCoordinates(optimizer.values()).vector()).max() <= tolerance:
            break
    return gtsam.Values(optimizer.values()), optimizer.iterations()


def levenberg_marquardt(graph, values, ordering, tolerance: float) -> tuple[gtsam.Values, int]:
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setLinearSolverType("SEQUENTIAL_CHOLESKY")
    parameters.setOrdering(ordering)
    parameters.setRelativeErrorTol(tolerance)
    parameters.setAbsoluteErrorTol(0.0)
    optimizer = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters)
    return optimizer.optimize(), optimizer.iterations()


def solve(o, condition, truth, method, tolerance, values) -> tuple[np.ndarray, int]:
    graph = build(o, condition == "refracted")
    ordering = gtsam.Ordering.ColamdNonlinearFactorGraph(graph)
    end, steps = method(graph, values or start(truth), ordering, tolerance)
    return gtsam.utilities.extractPose3(end)[:, 9:], steps

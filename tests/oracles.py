"""Independent solvers and closed forms that tests hold the package against; none of them uses its kernels."""

from types import SimpleNamespace

import gtsam
import numpy as np

from pymantaray.estimation import RangeLinks


def nonlinear_vector_factors(graph, believed, initial):
    """
    The optimum of a graph whose ranges are a model's, by factors that ask the model at every evaluation.

    One nonlinear factor for the ranges of each ping, with Jacobians of its own: slow, and independent of expansions.
    Variances that depend on the rays are those of the start. A link that is not possible has no residual and no
    gradient.
    """
    from pymantaray.estimation._gtsam.factors import FactorBuilder, to_graph_values, with_shared
    from pymantaray.estimation._gtsam.optimize import optimize
    from pymantaray.estimation.solution import SolveOptions

    builder, r = FactorBuilder(), believed.ranges
    values, ordering = builder.values(initial), builder.ordering(graph)
    factors = gtsam.NonlinearFactorGraph()
    factors.push_back(builder.common(graph))
    shared = []
    if believed.n_unknowns:
        shared, size = [graph.n_variables], believed.n_unknowns
        values, ordering = with_shared(values, ordering, shared[0], size)
        unit = gtsam.noiseModel.Unit.Create(size)
        factors.add(gtsam.PriorFactorVector(shared[0], np.zeros(size), unit))
    extra = None
    if believed.uncertainty is not None:
        links = _links_at(values, r, np.arange(r.time.size), graph.n_poses)
        extra = believed.uncertainty.covariances(links, r.epoch)
    for e in range(r.epoch.max() + 1):
        rows = np.flatnonzero(r.epoch == e)
        covariance = np.diag(graph["range"].variance[rows])
        if extra is not None:
            added = r.sound_speed[rows][:, None] * extra[e] * r.sound_speed[rows]
            covariance += added if believed.correlated else np.diag(np.diagonal(added))
        keys = np.unique([r.transmitter[rows], r.receiver[rows]]).tolist() + shared
        error = _asking(believed, rows, keys, np.linalg.cholesky(covariance), graph)
        factors.add(gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(rows.size), keys, error))
    problem = SimpleNamespace(loss=None, error=factors.error, linearize=factors.linearize, stock=factors)
    end, progress = optimize(problem, values, ordering, SolveOptions())
    return SimpleNamespace(
        **vars(to_graph_values(end, graph)),
        initial_cost=progress.initial_cost,
        final_cost=progress.final_cost,
        unknowns=np.array(end.atVector(shared[0])) if shared else None,
        unknowns_covariance=gtsam.Marginals(factors, end).marginalCovariance(shared[0]) if shared else None,
    )


def _links_at(values, r, rows, n_poses):
    """Links of some ranges with their ends where GTSAM values have them."""
    ends = (
        [values.atPose3(k).translation() if k < n_poses else values.atPoint3(k) for k in end[rows].tolist()]
        for end in (r.transmitter, r.receiver)
    )
    return RangeLinks(r.time[rows], *map(np.array, ends), r.sound_speed[rows])


def _asking(believed, rows, keys, root, graph):
    """Error function of the ranges in some rows, whitened by the root of their covariance."""
    r, n = believed.ranges, graph.n_poses
    speed = r.sound_speed[rows]

    def error(_factor, at, jacobians):
        u = at.atVector(keys[-1]) if keys[-1] == graph.n_variables else np.empty(0)
        found, by_unknowns = believed.predict(_links_at(at, r, rows, n), rows, u)
        fine = found.possible
        if jacobians is not None:
            gradients = (r.transmitter, found.transmitter_gradient), (r.receiver, found.receiver_gradient)
            for i, key in enumerate(keys):
                jacobian = sum((ends[rows] == key)[:, None] * by for ends, by in gradients)
                if key == graph.n_variables:
                    jacobian = by_unknowns
                elif key < n:
                    turned = jacobian @ at.atPose3(key).rotation().matrix()
                    jacobian = np.hstack([np.zeros((rows.size, 3)), turned])
                weighted = np.where(fine, speed, 0.0)[:, None] * np.where(fine[:, None], jacobian, 0.0)
                jacobians[i] = np.asfortranarray(np.linalg.solve(root, weighted))
        residual = np.where(fine, speed * (found.travel_time - r.travel_time[rows]), 0.0)
        return np.linalg.solve(root, residual)

    return error

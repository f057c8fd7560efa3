"""Independent solvers and closed forms that tests hold the package against; none of them uses its kernels."""

from types import SimpleNamespace

import gtsam
import numpy as np


def nonlinear_vector_factors(graph, believed, initial):
    """
    The optimum of a graph whose ranges are a model's, by factors that ask the model at every evaluation.

    One nonlinear factor for the ranges of each ping, with Jacobians of its own: slow, and independent of
    expansions. Variances that depend on the rays are those of the start. A link that is not possible has no
    residual and no gradient.
    """
    from pymantaray.estimation._gtsam.factors import FactorBuilder, to_graph_values, with_shared
    from pymantaray.estimation._gtsam.optimize import optimize
    from pymantaray.estimation.range_models import RangeLinks
    from pymantaray.estimation.solution import SolveOptions

    builder, r, n = FactorBuilder(), believed.ranges, graph.n_poses
    values, ordering = builder.values(initial), builder.ordering(graph)
    shared = None
    if believed.n_unknowns:
        shared = graph.n_variables
        values, ordering = with_shared(values, ordering, shared, believed.n_unknowns)

    def places(at, ends):
        return np.array([at.atPose3(k).translation() if k < n else at.atPoint3(k) for k in ends.tolist()])

    def asked(at, rows):
        links = RangeLinks(
            r.time[rows], places(at, r.transmitter[rows]), places(at, r.receiver[rows]), r.sound_speed[rows]
        )
        u = np.empty(0) if shared is None else at.atVector(shared)
        return *believed.predict(links, rows, u), links

    def error_of(rows, keys, root):
        speed = r.sound_speed[rows]

        def error(_factor, at, jacobians):
            found, by_unknowns, _ = asked(at, rows)
            fine = found.possible
            if jacobians is not None:
                gradients = (r.transmitter, found.transmitter_gradient), (r.receiver, found.receiver_gradient)
                for i, key in enumerate(keys):
                    if key == shared:
                        jacobian = by_unknowns
                    else:
                        jacobian = sum((ends[rows] == key)[:, None] * by for ends, by in gradients)
                        if key < n:
                            turned = jacobian @ at.atPose3(key).rotation().matrix()
                            jacobian = np.hstack([np.zeros((rows.size, 3)), turned])
                    weighted = np.where(fine, speed, 0.0)[:, None] * np.where(fine[:, None], jacobian, 0.0)
                    jacobians[i] = np.asfortranarray(np.linalg.solve(root, weighted))
            residual = np.where(fine, speed * (found.travel_time - r.travel_time[rows]), 0.0)
            return np.linalg.solve(root, residual)

        return error

    every = np.arange(r.time.size)
    variance = graph["range"].variance
    extra = None
    if believed.uncertainty is not None:
        extra = believed.uncertainty.covariances(asked(values, every)[2], r.epoch)
    factors = gtsam.NonlinearFactorGraph()
    factors.push_back(builder.common(graph))
    for e in range(r.epoch.max() + 1):
        rows = np.flatnonzero(r.epoch == e)
        covariance = np.diag(variance[rows])
        if extra is not None:
            added = r.sound_speed[rows][:, None] * extra[e] * r.sound_speed[rows]
            covariance += added if believed.correlated else np.diag(np.diagonal(added))
        keys = np.unique([r.transmitter[rows], r.receiver[rows]]).tolist() + [shared] * (shared is not None)
        error = error_of(rows, keys, np.linalg.cholesky(covariance))
        factors.add(gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(rows.size), keys, error))
    if shared is not None:
        dimension = believed.n_unknowns
        unit = gtsam.noiseModel.Unit.Create(dimension)
        factors.add(gtsam.PriorFactorVector(shared, np.zeros(dimension), unit))
    problem = SimpleNamespace(loss=None, error=factors.error, linearize=factors.linearize, stock=factors)
    end, progress = optimize(problem, values, ordering, SolveOptions())
    return SimpleNamespace(
        **vars(to_graph_values(end, graph)),
        initial_cost=progress.initial_cost,
        final_cost=progress.final_cost,
        unknowns=None if shared is None else np.array(end.atVector(shared)),
        unknowns_covariance=None
        if shared is None
        else gtsam.Marginals(factors, end).marginalCovariance(shared),
    )

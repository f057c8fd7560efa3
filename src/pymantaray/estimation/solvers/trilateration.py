"""Positions of landmarks that only ranges constrain: trilateration with its mirrored solutions."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pymantaray.arrays import Array, Indices
from pymantaray.estimation.graph.graph import FactorGraph, GraphValues

_CIRCLE_POINTS = 8  # starting points on the circle about a straight trajectory
_SAME_SOLUTION = 1e-3  # of the largest range; nearer solutions count as one
# of the sum of the weights; a more negative eigenvalue of the Hessian is that of a saddle point
_SADDLE = 1e-6
_DETERMINED = 0.1  # of the mean range; largest standard deviation of a determined landmark
_MAX_RANGES = 300  # used for each landmark, evenly spaced


def range_only_landmarks(graph: FactorGraph) -> Indices:
    """Variables of the landmarks that have ranges but neither a prior nor a sighting."""
    landmarks = np.arange(graph.n_poses, graph.n_variables)
    others = graph.of_ends(("landmark",), ("pose", "landmark"))
    positioned = np.concatenate([table.variables[:, -1] for table in others])
    return np.asarray(
        landmarks[np.isin(landmarks, graph["range"].variables) & ~np.isin(landmarks, positioned)]
    )


def trilaterate(
    graph: FactorGraph, values: GraphValues, landmarks: Sequence[int] | None = None
) -> dict[int, list[Array]]:
    """
    Solutions of the position of each range-only landmark, by cost of its ranges, with all other
    variables at some values.

    ``landmarks`` selects some of them; one without usable ranges has no entry.

    Ranges from points in a plane have two solutions, mirrored in that plane; ranges from points on
    a line have a circle of solutions. Every solution is a local minimum of the weighted squared
    range residuals.
    """
    position = np.concatenate([values.position, values.landmark_position])
    unknown = range_only_landmarks(graph)
    ranges = graph["range"]
    out: dict[int, list[Array]] = {}
    first, second = ranges.variables.T
    distance = ranges.column("distance")
    sigma = np.sqrt(ranges.variance)
    axes = 2 if graph.planar else 3
    for landmark in unknown.tolist() if landmarks is None else landmarks:
        mine = ((second == landmark) & ~np.isin(first, unknown)).nonzero()[0]
        rows = mine[:: -(-mine.size // _MAX_RANGES)] if mine.size else mine
        if rows.size:
            solutions = _solutions(position[first[rows], :axes], distance[rows], sigma[rows])
            out[landmark] = [np.pad(x, (0, 3 - axes)) for x in solutions]
    return out


def determined_times(graph: FactorGraph, values: GraphValues) -> Array:
    """
    Time from which each landmark is determined, shape (n_landmarks,): minus infinity with a prior.

    A sighting determines a landmark. Ranges do if its standard deviation, with all poses at the
    values, is below a tenth of their mean. A landmark that is never determined gets the time of its
    last range or sighting.
    """
    n = graph.n_poses
    ranges = graph["range"]
    sightings = np.concatenate([table.variables for table in graph.of_ends(("pose", "landmark"))])
    known = np.concatenate([table.subject for table in graph.of_ends(("landmark",))])
    out = np.full(graph.landmark_name.size, -np.inf)
    needed = np.setdiff1d(np.arange(n, graph.n_variables), known)
    solutions = trilaterate(graph, values)
    axes = 2 if graph.planar else 3
    for landmark in needed.tolist():
        sighting_times = graph.pose_time[sightings[sightings[:, 1] == landmark, 0]]
        rows = np.flatnonzero((ranges.variables[:, 1] == landmark) & (ranges.variables[:, 0] < n))
        rows = rows[np.argsort(graph.pose_time[ranges.variables[rows, 0]], kind="stable")]
        time = graph.pose_time[ranges.variables[rows, 0]]
        if sighting_times.size or not rows.size:
            out[landmark - n] = (
                sighting_times.min(initial=np.inf) if sighting_times.size else -np.inf
            )
            continue
        step = (solutions[landmark][0] - values.position[ranges.variables[rows, 0]])[:, :axes]
        unit = step / np.linalg.norm(step, axis=1)[:, None]
        information = np.cumsum(
            unit[:, :, None] * unit[:, None, :] / ranges.variance[rows, None, None], axis=0
        )
        least = np.linalg.eigvalsh(information)[:, 0]
        limit = _DETERMINED * float(ranges.column("distance")[rows].mean())
        fine = least * limit**2 >= 1.0
        out[landmark - n] = time[np.argmax(fine)] if fine.any() else time[-1]
    return out


def with_landmarks(
    graph: FactorGraph, values: GraphValues, positions: dict[int, Array]
) -> GraphValues:
    """Values with other positions of some landmarks."""
    landmark = np.array(values.landmark_position)
    for variable, position in positions.items():
        landmark[variable - graph.n_poses] = position
    return replace(values, landmark_position=landmark)


def _solutions(point: Array, distance: Array, sigma: Array) -> list[Array]:
    """Local minima of the range residuals from known points, lowest first."""

    def residual(x: Array) -> Array:
        return np.asarray((np.linalg.norm(x - point, axis=1) - distance) / sigma)

    from scipy.optimize import least_squares

    ends = [
        least_squares(residual, x, method="trf", x_scale="jac") for x in _guesses(point, distance)
    ]
    ends.sort(key=lambda end: float(end.cost))
    apart = _SAME_SOLUTION * float(distance.max())
    out: list[Array] = []
    for end in ends:
        if _is_minimum(end.x - point, distance, sigma) and all(
            np.linalg.norm(end.x - x) > apart for x in out
        ):
            out.append(end.x)
    return out


def _is_minimum(step: Array, distance: Array, sigma: Array) -> bool:
    """
    False at saddle points, such as those on the line of the points: the Hessian has a negative
    eigenvalue there.
    """
    length = np.linalg.norm(step, axis=1)
    unit = step / np.where(length > 0.0, length, 1.0)[:, None]
    across = np.eye(step.shape[1]) - unit[:, :, None] * unit[:, None, :]
    bend = (1.0 - distance / np.where(length > 0.0, length, np.inf))[:, None, None] * across
    each = (unit[:, :, None] * unit[:, None, :] + bend) / sigma[:, None, None] ** 2
    return bool(np.linalg.eigvalsh(each.sum(axis=0))[0] >= -_SADDLE * np.sum(sigma**-2.0))


def _guesses(point: Array, distance: Array) -> list[Array]:
    """
    Linear solution of the squared ranges, mirrored pair about their plane, and points of the circle
    about their line.

    With the mean c of the points p and u = x - c, squared ranges less their mean are linear in u:
    ``-2 (p - c) . u``. Their mean, ``|u|^2 + mean |p - c|^2``, gives the length of u, and so the
    part of u along directions in which the points do not extend.
    """
    centre = point.mean(axis=0)
    offset = point - centre
    square = np.sum(offset**2, axis=1)
    _, extent, axis = np.linalg.svd(offset, full_matrices=True)
    right = 0.5 * (square - square.mean() - distance**2 + np.mean(distance**2))
    along = np.zeros(point.shape[1])
    used = extent > 1e-9 * max(float(extent.max()), 1e-300)
    along[: used.size][used] = (axis[: used.size][used] @ (offset.T @ right)) / extent[used] ** 2
    length2 = float(np.mean(distance**2) - square.mean())
    out = [centre + along @ axis]
    for free in range(1, point.shape[1]):  # directions without use, the weakest last
        part = along.copy()
        part[-free:] = 0.0
        height = np.sqrt(max(length2 - float(part @ part), 0.0))
        if free == 1:
            directions = np.array([[1.0], [-1.0]])
        else:
            angle = 2.0 * np.pi * np.arange(_CIRCLE_POINTS) / _CIRCLE_POINTS
            directions = np.column_stack([np.cos(angle), np.sin(angle)])
        for direction in directions:
            part[-free:] = height * direction
            out.append(centre + part @ axis)
    return out

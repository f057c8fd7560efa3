"""Solver-free factor graph: tables of variables, priors, odometry edges and ranges, with their noise."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pymantaray.errors import EstimationError
from pymantaray.estimation._refusals import LARGEST, QUATERNION_TOLERANCE, VARIANCES, check_full, refuse
from pymantaray.records.base import Column, Record, column

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class GraphValues(Record):
    """A value for every variable of a `FactorGraph`: where to start, or what was found."""

    kind: ClassVar[str] = "graph_values"

    position: Column = column("pose axis", "m", "north, east, down in the local frame")
    quaternion: Column = column("pose quat", "1", "rotation body to world, (w, x, y, z)")
    landmark_position: Column = column("landmark axis", "m", "landmark position")


@dataclass(frozen=True, eq=False)
class FactorGraph(Record):
    """
    Variables and factors of one estimation problem; no solver is involved.

    A variable is a number: a row of the pose tables, or the number of poses plus a row of
    ``landmark_name``. Covariances of poses are in the tangent of the body, rotation before
    translation, perturbed from the right; those of positions are in the world's axes.
    """

    kind: ClassVar[str] = "factor_graph"

    agent_name: Column = column("agent", "", "vehicle name", "U")
    landmark_name: Column = column("landmark", "", "landmark name", "U")
    pose_agent: Column = column("pose", "1", "index of the vehicle", "i4")
    pose_number: Column = column("pose", "1", "number of the pose in its vehicle's chain", "i4")
    pose_time: Column = column("pose", "s", "time since the start of the mission")

    prior_pose: Column = column("prior", "1", "pose with a prior on all six axes", "i4")
    prior_position: Column = column("prior axis", "m", "position of the pose prior")
    prior_quaternion: Column = column("prior quat", "1", "orientation of the pose prior, (w, x, y, z)")
    prior_covariance: Column = column("prior tangent tangent_column", "1", "covariance [rad, m]")

    fix_pose: Column = column("fix", "1", "pose with a position fix", "i4")
    fix_position: Column = column("fix axis", "m", "position of the fix")
    fix_covariance: Column = column("fix axis axis_column", "m2", "covariance of the fix")

    depth_pose: Column = column("depth_prior", "1", "pose with a depth prior", "i4")
    depth: Column = column("depth_prior", "m", "depth, positive down")
    depth_variance: Column = column("depth_prior", "m2", "variance of the depth")

    survey_landmark: Column = column("survey", "1", "index of the landmark with a prior", "i4")
    survey_position: Column = column("survey axis", "m", "surveyed position")
    survey_covariance: Column = column("survey axis axis_column", "m2", "covariance of the survey")

    edge_from: Column = column("edge", "1", "pose that the motion starts from", "i4")
    edge_to: Column = column("edge", "1", "pose that the motion ends at", "i4")
    edge_quaternion: Column = column("edge quat", "1", "relative rotation, (w, x, y, z)")
    edge_translation: Column = column("edge axis", "m", "translation in the body frame of the first pose")
    edge_covariance: Column = column("edge tangent tangent_column", "1", "covariance [rad, m]")

    range_first: Column = column("range", "1", "variable at one end", "i4")
    range_second: Column = column("range", "1", "variable at the other end", "i4")
    range_distance: Column = column("range", "m", "measured distance")
    range_variance: Column = column("range", "m2", "variance of the distance")

    @property
    def n_poses(self) -> int:
        """Number of poses; the first landmark has this number as variable."""
        return int(self.pose_agent.size)

    @property
    def degrees_of_freedom(self) -> int:
        """Rows of all residuals minus the dimension of all variables; the cost's expectation is half of it."""
        rows = (
            6 * (self.prior_pose.size + self.edge_from.size)
            + 3 * (self.fix_pose.size + self.survey_landmark.size)
            + self.depth_pose.size
            + self.range_first.size
        )
        return int(rows - 6 * self.n_poses - 3 * self.landmark_name.size)

    def variable_name(self, variable: int) -> str:
        """
        Name of a variable for people and files, such as ``A17``.

        Parameters
        ----------
        variable : int

        Returns
        -------
        str
        """
        if variable >= self.n_poses:
            return str(self.landmark_name[variable - self.n_poses])
        return f"{self.agent_name[self.pose_agent[variable]]}{self.pose_number[variable]}"


def check_graph(graph: FactorGraph) -> None:
    """
    Refuse a graph whose measurements or noise levels cannot be used.

    Parameters
    ----------
    graph : FactorGraph

    Raises
    ------
    EstimationError
        If a measurement is not finite or beyond `LARGEST`, a quaternion is not of length 1, a variance is
        not positive and finite, a covariance is not symmetric or not safely positive definite, an edge or a
        range ends where it begins, or two variables share a name; the message names the first variable
        concerned.

    Notes
    -----
    What passes can be handed to GTSAM: there, a zero sigma silently becomes a hard constraint, one triangle
    of an asymmetric matrix is ignored, a scaled rotation is taken as it is, and a singular or overflowing
    covariance surfaces as an exception in the middle of a solve.
    """
    landmarks = np.asarray(graph.survey_landmark) + graph.n_poses
    _check_variables(graph)
    measured = [
        ("first-pose prior", graph.prior_pose, graph.prior_position),
        ("first-pose prior", graph.prior_pose, graph.prior_quaternion),
        ("GNSS fix", graph.fix_pose, graph.fix_position),
        ("depth", graph.depth_pose, graph.depth[:, None]),
        ("landmark prior", landmarks, graph.survey_position),
        ("odometry", graph.edge_to, graph.edge_quaternion),
        ("odometry", graph.edge_to, graph.edge_translation),
        ("range", graph.range_first, graph.range_distance[:, None]),
    ]
    for what, variables, values in measured:
        refuse(graph, what, variables, values, np.isfinite(values).all(axis=1), "finite values")
        fine = np.asarray((np.abs(values) <= LARGEST).all(axis=1))
        refuse(graph, what, variables, values, fine, f"values of at most {LARGEST:g}")
        if values.shape[1] == 4:
            fine = np.asarray(np.abs(np.linalg.norm(values, axis=1) - 1.0) <= QUATERNION_TOLERANCE)
            refuse(graph, f"{what} quaternion", variables, values, fine, "length 1")
    noises = [
        ("first-pose prior", graph.prior_pose, graph.prior_covariance),
        ("GNSS fix", graph.fix_pose, graph.fix_covariance),
        ("depth", graph.depth_pose, graph.depth_variance[:, None, None]),
        ("landmark prior", landmarks, graph.survey_covariance),
        ("odometry", graph.edge_to, graph.edge_covariance),
        ("range", graph.range_first, graph.range_variance[:, None, None]),
    ]
    for what, variables, covariance in noises:
        diagonal = np.diagonal(covariance, axis1=1, axis2=2)
        fine = np.asarray(
            ((diagonal >= VARIANCES[0]) & (diagonal <= VARIANCES[1])).all(axis=1)
        )  # NaN does not pass
        allowed = f"positive finite variances, {VARIANCES[0]:g} to {VARIANCES[1]:g}"
        refuse(graph, f"{what} variance", variables, diagonal, fine, allowed)
        check_full(graph, what, variables, covariance)
    still = graph.edge_from != graph.edge_to
    refuse(graph, "odometry", graph.edge_from, graph.edge_to[:, None], still, "two different poses")
    same = graph.range_first != graph.range_second
    refuse(graph, "range", graph.range_first, graph.range_second[:, None], same, "two different variables")
    turned = (graph.range_first >= graph.n_poses) & (graph.range_second < graph.n_poses)
    refuse(graph, "range", graph.range_first, graph.range_second[:, None], ~turned, "the pose named first")


def check_values(graph: FactorGraph, values: GraphValues) -> None:
    """
    Refuse values that do not fit a graph or cannot be a starting point.

    Parameters
    ----------
    graph : FactorGraph
    values : GraphValues

    Raises
    ------
    EstimationError
        If there are too few or too many, one is not finite or beyond `LARGEST`, or a quaternion is not of
        length 1; the message names the first variable concerned.
    """
    found = values.position.shape[0], values.landmark_position.shape[0]
    needed = graph.n_poses, int(graph.landmark_name.size)
    if found != needed:
        raise EstimationError(
            f"values for {found[0]} poses and {found[1]} landmarks; the graph has {needed[0]} and {needed[1]}"
        )
    variables = np.arange(sum(needed), dtype=np.int32)
    place = np.concatenate([values.position, values.landmark_position])
    fine = np.asarray((np.abs(place) <= LARGEST).all(axis=1))  # NaN does not pass
    refuse(graph, "position", variables, place, fine, f"finite values of at most {LARGEST:g}")
    fine = np.asarray(np.abs(np.linalg.norm(values.quaternion, axis=1) - 1.0) <= QUATERNION_TOLERANCE)
    refuse(graph, "quaternion", variables[: needed[0]], values.quaternion, fine, "length 1")


def _check_variables(graph: FactorGraph) -> None:
    n_poses, n_landmarks = graph.n_poses, int(graph.landmark_name.size)
    for what, variables, size in (
        ("pose", graph.pose_agent, int(graph.agent_name.size)),
        ("first-pose prior", graph.prior_pose, n_poses),
        ("GNSS fix", graph.fix_pose, n_poses),
        ("depth", graph.depth_pose, n_poses),
        ("odometry", np.concatenate([graph.edge_from, graph.edge_to]), n_poses),
        ("landmark prior", graph.survey_landmark, n_landmarks),
        ("range", np.concatenate([graph.range_first, graph.range_second]), n_poses + n_landmarks),
    ):
        wrong = (variables < 0) | (variables >= size)
        if wrong.any():
            raise EstimationError(
                f"{what}: refers to {'vehicle' if what == 'pose' else 'variable'} {variables[wrong][0]};"
                f" allowed are 0 to {size - 1}"
            )
    # one integer for each name: the chain's number is 32 bits wide
    pose = graph.pose_agent.astype(np.int64) << 32 | graph.pose_number.astype(np.int64) & 0xFFFFFFFF
    for names, first in ((pose, 0), (graph.landmark_name, n_poses)):
        kept = np.unique(names, return_index=True)[1]
        if kept.size != names.size:
            twice = first + int(np.setdiff1d(np.arange(names.size), kept)[0])
            raise EstimationError(f"{graph.variable_name(twice)}: two variables of this name; allowed is one")


def check_anchored(graph: FactorGraph) -> None:
    """
    Refuse a graph in which some variables are tied to the world by nothing.

    Odometry and ranges tie variables to each other; a first-pose prior, a GNSS fix or a landmark prior
    ties them to the world. A depth prior does not: it leaves the horizontal free.

    Parameters
    ----------
    graph : FactorGraph

    Raises
    ------
    EstimationError
        If a set of connected variables has no such prior; the message names its first variable.
    """
    _, loose = parts(graph)
    if loose.any():
        raise EstimationError(
            f"{graph.variable_name(int(np.argmax(loose)))}: no first-pose prior, GNSS fix or landmark prior anchors it,"
            f" nor anything that it is tied to ({np.count_nonzero(loose)} variables in all); give its vehicle a prior"
        )


def parts(graph: FactorGraph) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """
    Sets of variables that odometry and ranges connect, and those that nothing ties to the world.

    Parameters
    ----------
    graph : FactorGraph

    Returns
    -------
    part : ndarray, shape (n_variables,)
        Number of the set that each variable is in.
    loose : ndarray of bool, shape (n_variables,)
        Whether its set has no first-pose prior, GNSS fix or landmark prior.
    """
    n = graph.n_poses + graph.landmark_name.size
    ends = (
        np.concatenate([graph.edge_from, graph.range_first]),
        np.concatenate([graph.edge_to, graph.range_second]),
    )
    links = coo_array((np.ones(ends[0].size), ends), shape=(n, n))
    _, part = connected_components(links, directed=False)
    anchors = np.concatenate([graph.prior_pose, graph.fix_pose, graph.survey_landmark + graph.n_poses])
    return part, ~np.isin(part, part[anchors.astype(int)])

"""
Error-state Kalman filter: the state of vehicles and landmarks, its prediction by odometry, and its
update by measurements.

All functions return new arrays, so that a caller may keep earlier states. `kalman` feeds the
factors of a graph in the order of their times; `apps.online` feeds measurements as they arrive.
"""

import math
from typing import NamedTuple, Self

import numpy as np
from scipy.linalg.blas import dtrsm
from scipy.linalg.lapack import dpotrf

from pymantaray.arrays import Array, Indices
from pymantaray.geometry.se3 import hat, so3_exp, so3_log

SIZE = 6  # errors of a pose: rotation in the body's axes [rad], position in the world's axes [m]
ROTATION = slice(0, 3)
POSITION = slice(3, SIZE)


class State(NamedTuple):
    """
    Latest poses of the vehicles, then landmarks as poses without rotation, and the joint covariance
    of their errors.
    """

    rotation: Array  # (n, 3, 3), body to world
    position: Array  # (n, 3) [m]
    covariance: Array  # (6 n, 6 n), rotation in body axes and position in world axes

    @classmethod
    def at_start(
        cls,
        rotation: Array,
        position: Array,
        covariance: Array,
        landmark_position: Array,
        landmark_covariance: Array,
    ) -> Self:
        """
        State from priors of poses, with covariances in the tangent of the body (n, 6, 6), and of
        landmarks, with covariances (m, 3, 3).
        """
        n = len(rotation)
        size = n + len(landmark_position)
        joint = np.zeros((size, SIZE, size, SIZE))
        vehicles = np.arange(n)
        landmarks = np.arange(n, size)
        joint[vehicles, :, vehicles, :] = to_world_axes(rotation, covariance)
        joint[landmarks, POSITION, landmarks, POSITION] = landmark_covariance
        return cls(
            np.concatenate([rotation, np.tile(np.eye(3), (len(landmark_position), 1, 1))]),
            np.concatenate([position, landmark_position]),
            joint.reshape(SIZE * size, SIZE * size),
        )


class Motion(NamedTuple):
    """One step of each of n vehicles, with covariances in the tangent of the second body."""

    rotation: Array  # (n, 3, 3)
    translation: Array  # (n, 3) in the axes of the first body [m]
    covariance: Array  # (n, 6, 6)


class Innovation(NamedTuple):
    """
    Measurements against a state: residuals, predicted minus measured, and their covariance.

    ``by_errors`` contains derivatives by the errors (m, 6 n), or the columns (m,) of errors that
    are measured themselves.
    """

    residual: Array  # (m,)
    by_errors: Array | Indices
    variance: Array  # (m, m)


class Update(NamedTuple):
    """State after an update, and the squared normalized innovation."""

    state: State
    nis: float


def predict(state: State, vehicles: slice, motion: Motion) -> State:
    """Move some vehicles by one step each."""
    rotations = state.rotation.copy()
    positions = state.position.copy()
    rotations[vehicles], positions[vehicles], by_pose, by_step = propagate(
        state.rotation[vehicles], state.position[vehicles], motion.rotation, motion.translation
    )
    shape = state.covariance.shape
    rows = state.covariance.reshape(-1, SIZE, shape[1]).copy()
    rows[vehicles] = by_pose @ rows[vehicles]
    columns = rows.reshape(shape).T.copy().reshape(rows.shape)
    columns[vehicles] = by_pose @ columns[vehicles]
    covariance = columns.reshape(shape)
    noise = by_step @ motion.covariance @ np.swapaxes(by_step, 1, 2)
    square = covariance.reshape(-1, SIZE, len(rows), SIZE)
    np.einsum("iaib->iab", square)[vehicles] += noise  # a view of the diagonal blocks
    return State(rotations, positions, covariance)


def propagate(
    rotation: Array, position: Array, step_rotation: Array, step_translation: Array
) -> tuple[Array, Array, Array, Array]:
    """
    Poses after steps, and the derivatives of their errors by the errors before (n, 6, 6) and by
    those of the steps (n, 6, 6).

    Errors of poses are rotations in the body's axes and displacements in the world's; those of
    steps are in the tangent of the second body.
    """
    after = rotation @ step_rotation
    position_after = position + np.einsum("nij,nj->ni", rotation, step_translation)
    by_pose, by_step = np.zeros((2, len(rotation), SIZE, SIZE))
    by_pose[:, ROTATION, ROTATION] = np.swapaxes(step_rotation, 1, 2)
    by_pose[:, POSITION, ROTATION] = -rotation @ hat(step_translation)
    by_pose[:, POSITION, POSITION] = by_step[:, ROTATION, ROTATION] = np.eye(3)
    by_step[:, POSITION, POSITION] = after
    return after, position_after, by_pose, by_step


def to_world_axes(rotation: Array, covariance: Array) -> Array:
    """Covariances (n, 6, 6) of poses in the tangent of the body, with positions in world axes."""
    to_world = np.tile(np.eye(SIZE), (len(rotation), 1, 1))
    to_world[:, POSITION, POSITION] = rotation
    return np.asarray(to_world @ covariance @ np.swapaxes(to_world, 1, 2))


def range_innovation(
    state: State,
    ends: Indices,
    residual: Array,
    gradients: tuple[Array, Array],
    variance: Array,
    *,
    n_fixed: int = 0,
) -> Innovation:
    """
    Innovation of ranges or travel times, with gradients (m, 3) by the transmitters' and by the
    receivers' positions.

    ``ends`` (m, 2) are members of the state, or ones after them with exactly known positions.
    """
    n = len(state.position)
    by_errors = np.zeros((residual.size, n + n_fixed, SIZE))
    row = np.arange(residual.size)
    for end, gradient in zip(ends.T, gradients, strict=True):
        by_errors[row, end, POSITION] = gradient  # the ends of a range differ
    return Innovation(
        residual, by_errors[:, :n].reshape(residual.size, SIZE * n), np.diag(variance)
    )


def exceeds(state: State, innovation: Innovation, gate: float) -> bool:
    """True if an innovation with derivatives exceeds a number of standard deviations."""
    if not math.isfinite(gate):
        return False
    by_errors = innovation.by_errors
    spread = np.einsum("ij,jk,ik->i", by_errors, state.covariance, by_errors)
    limit = gate * gate * (spread + np.diagonal(innovation.variance))
    return bool((innovation.residual**2 > limit).any())


def log_likelihood(state: State, innovation: Innovation) -> float:
    """Log of the probability density of measurements, up to a constant factor for each."""
    residual, by_errors, variance = innovation
    if by_errors.ndim == 1:
        spread = state.covariance[np.ix_(by_errors, by_errors)]
    else:
        spread = by_errors @ state.covariance @ by_errors.T
    total = spread + variance
    squared = float(residual @ np.linalg.solve(total, residual))
    return -0.5 * (squared + float(np.linalg.slogdet(total)[1]))


def average_states(first: State, second: State, share: float) -> State:
    """State with the mean and the covariance of a mixture, of which the first has a share."""
    other = 1.0 - share
    turn = so3_log(np.swapaxes(first.rotation, 1, 2) @ second.rotation)
    apart = np.concatenate([turn, second.position - first.position], axis=1)
    return State(
        first.rotation @ so3_exp(other * turn),
        first.position + other * apart[:, POSITION],
        share * first.covariance
        + other * second.covariance
        + share * other * np.outer(apart, apart),
    )


def update(state: State, innovation: Innovation) -> Update | None:
    """Update by measurements; None if the innovations' covariance is not positive definite."""
    residual, by_errors, variance = innovation
    covariance = state.covariance
    if by_errors.ndim == 1:
        columns = by_errors.astype(np.intp, copy=False)
        weight = covariance.take(columns, axis=0)
        spread = weight.take(columns, axis=1)
    else:
        weight = by_errors @ covariance
        spread = weight @ by_errors.T
    root, failed = dpotrf(spread + variance, lower=1)
    if failed or not math.isfinite(root[-1, -1]):
        return None
    # LAPACK's solver starts all threads of OpenBLAS even for one row, which costs milliseconds on a
    # busy machine
    white = dtrsm(1.0, root, residual[:, None], lower=1)[:, 0]
    gain = dtrsm(1.0, root, weight, lower=1)
    error = -(gain.T @ white).reshape(-1, SIZE)
    reduced = covariance - gain.T @ gain
    after = State(
        state.rotation @ so3_exp(error[:, ROTATION]),
        state.position + error[:, POSITION],
        0.5 * (reduced + reduced.T),
    )
    return Update(after, float(white @ white))

"""
Residuals of poses, and the blocks of the normal equations that they add up to.

A pose moves by ``R Exp(w), p + d``: its rotation in the body's axes, its position in the world's,
``[w, d]`` in a block. A landmark is a pose that does not rotate. Row ``row[i]`` of the matrix is
that of variable i; a pair's block is ``above[block]``, in the order of the pair or, where
``reverse``, the other way round.
"""

import math
from collections import namedtuple

from pymantaray.compile import entry, inlined, kernel
from pymantaray.estimation._kernels.products import (
    add_transposed_product,
    add_transposed_product_half_empty,
    set_product,
    set_product_of_three,
    set_transposed_product_of_three,
    subtract_product_of_three,
)

_SMALL_ANGLE = 1e-2  # rad; below it series replace closed forms: what they leave out is below 1e-16
# rad; step of central differences of gradients, with a relative error of 1e-10
_DIFFERENCE_ANGLE = 1e-5


# Scratch: blocks of six by six and matrices of three by three; the latter, by what they hold:
TO_ERROR, ERROR, JACOBIAN, BY_ETA, BETWEEN, LEVER, CROSS = range(7)
# derivatives of rotation and translation by the second pose's rotation, of the translation by its
# position, and by the first's rotation
ROTATION_BY_SECOND = JACOBIAN
TRANSLATION_BY_SECOND, TRANSLATION_BY_POSITION = 7, 8
ROTATION_BY_FIRST, TRANSLATION_BY_FIRST = 9, 10
# Vectors beside them: the residual, whitened; R1^T (p2 - p1); the error's rotation vector and
# translation; and of the logarithm.
RESIDUAL, WHITE, STRIDE, ETA, TRANSLATION, BEND = range(6)
BLOCKS, MATRICES, VECTORS = 4, 11, 6


RelativePoses = namedtuple("RelativePoses", "first second rotation translation root")
RelativePoses.__doc__ = """Poses (n,) in the frames of others, and the root of their information.

Roots are lower triangular (n, 6, 6) or, if all are diagonal, their diagonals (n, 6)."""
Sightings = namedtuple("Sightings", "pose landmark measurement root")
Sightings.__doc__ = """Landmarks (n,) in the body frames of poses: measured positions.

The root of their information is of shape (n, 6, 6)."""
Positions = namedtuple("Positions", "variable measurement information")
Positions.__doc__ = "Measured positions (n, 3), and their information (n, 3, 3)."
PoseArrays = namedtuple("PoseArrays", "rotation position")
Matrix = namedtuple("Matrix", "row diagonal above gradient")
Matrix.__doc__ = """Normal equations: the row of each variable, blocks, and the gradient.

The blocks are on and above the diagonal."""


@inlined
def add_relative(relative, blocks, poses, matrix, order, i, work):  # type: ignore[no-untyped-def]
    """
    Cost of a relative pose; of order 1 add its blocks and gradient as well, of order 2 also its
    curvature.

    Residual ``root Log(Z^-1 T1^-1 T2)``; where ``first`` is negative T1 is the world. ``work`` is
    scratch: blocks, matrices, vectors of six.
    """
    root, row, diagonal, above, gradient = (
        relative.root,
        matrix.row,
        matrix.diagonal,
        matrix.above,
        matrix.gradient,
    )
    j, m, v = work
    a, b = relative.first[i], relative.second[i]
    _residual(relative, poses, i, m, v)
    total = 0.0
    _whiten(root, i, v)
    for r in range(6):
        total += v[WHITE, r] * v[WHITE, r]
    if order == 0:
        return 0.5 * total
    k = row[b]
    _by_second(m, v)
    if a >= 0:
        _by_first(a, b, relative.rotation, i, poses.rotation, m, v)
        if order == 2:
            _add_curvature(relative, blocks, poses, matrix, i, m, v)
        _whiten_block(root, i, j, 2, m, (ROTATION_BY_FIRST, TRANSLATION_BY_FIRST, -1.0))
        add_transposed_product_half_empty(diagonal, row[a], j, 2, j, 2)
        _add_gradient(gradient, row[a], j, 2, v)
    _whiten_block(root, i, j, 3, m, (ROTATION_BY_SECOND, TRANSLATION_BY_SECOND, 1.0))
    add_transposed_product_half_empty(diagonal, k, j, 3, j, 3)
    _add_gradient(gradient, k, j, 3, v)
    if a >= 0:
        reverse = blocks.reverse[i]
        add_transposed_product_half_empty(
            above, blocks.block[i], j, 3 if reverse else 2, j, 2 if reverse else 3
        )
    return 0.5 * total


@inlined
def _whiten(root, i, v):  # type: ignore[no-untyped-def]
    """Residual in standard deviations."""
    if root.ndim == 2:
        for r in range(6):
            v[WHITE, r] = root[i, r] * v[RESIDUAL, r]
    else:
        for r in range(6):
            white = 0.0
            for c in range(r + 1):
                white += root[i, r, c] * v[RESIDUAL, c]
            v[WHITE, r] = white


@inlined
def _whiten_block(root, i, j, to, m, parts):  # type: ignore[no-untyped-def]
    """
    Block of derivatives in standard deviations, from its quarters: by rotation, and by position
    with a sign.
    """
    rotation, translation, sign = parts
    whole = root.ndim == 3
    at = 0 if whole else to
    for r in range(3):
        by_rotation, by_translation = (1.0, 1.0) if whole else (root[i, r], root[i, 3 + r])
        for c in range(3):
            j[at, r, c], j[at, r, 3 + c] = by_rotation * m[rotation, r, c], 0.0
            j[at, 3 + r, c] = by_translation * m[translation, r, c]
            j[at, 3 + r, 3 + c] = by_translation * (sign * m[TRANSLATION_BY_POSITION, r, c])
    if whole:
        set_product(j, to, root, i, j, at)


@inlined
def _pull(root, i, r, v):  # type: ignore[no-untyped-def]
    """Derivative of the cost by an element of the residual."""
    if root.ndim == 2:
        return root[i, r] * v[WHITE, r]
    total = 0.0
    for k in range(r, 6):
        total += root[i, k, r] * v[WHITE, k]
    return total


@inlined
def _residual(relative, poses, i, m, v):  # type: ignore[no-untyped-def]
    """Logarithm of ``Z^-1 T1^-1 T2``, and what leads to it."""
    first, second = relative.first[i], relative.second[i]
    relative_rotation = relative.rotation
    translation = relative.translation
    rotation, position = poses.rotation, poses.position
    for r in range(3):
        v[STRIDE, r] = position[second, r]
        if first >= 0:
            v[STRIDE, r] = 0.0
            for c in range(3):
                v[STRIDE, r] += rotation[first, c, r] * (position[second, c] - position[first, c])
        for c in range(3):  # Z^T R1^T
            m[TO_ERROR, r, c] = relative_rotation[i, c, r]
            if first >= 0:
                m[TO_ERROR, r, c] = (
                    relative_rotation[i, 0, r] * rotation[first, c, 0]
                    + relative_rotation[i, 1, r] * rotation[first, c, 1]
                    + relative_rotation[i, 2, r] * rotation[first, c, 2]
                )
    for r in range(3):
        v[TRANSLATION, r] = 0.0
        for c in range(3):
            v[TRANSLATION, r] += relative_rotation[i, c, r] * (v[STRIDE, c] - translation[i, c])
            m[ERROR, r, c] = (
                m[TO_ERROR, r, 0] * rotation[second, 0, c]
                + m[TO_ERROR, r, 1] * rotation[second, 1, c]
                + m[TO_ERROR, r, 2] * rotation[second, 2, c]
            )
    _logarithm(m, v)


@inlined
def _logarithm(m, v):  # type: ignore[no-untyped-def]
    """
    Residual of an error: its rotation vector w, then ``V^-1 t = t - w x t / 2 + c w x (w x t)`` of
    its translation t.
    """
    # vector and scalar part of the quaternion, times a common factor
    trace = m[ERROR, 0, 0] + m[ERROR, 1, 1] + m[ERROR, 2, 2]
    if trace > 0.0:
        scalar = 1.0 + trace
        for r in range(3):
            p, q = (r + 1) % 3, (r + 2) % 3
            v[ETA, r] = m[ERROR, q, p] - m[ERROR, p, q]
    else:  # near half a turn
        k = 0
        for r in range(3):
            if m[ERROR, r, r] > m[ERROR, k, k]:
                k = r
        a, b = (k + 1) % 3, (k + 2) % 3
        scalar = m[ERROR, b, a] - m[ERROR, a, b]
        sign = -1.0 if scalar < 0.0 else 1.0
        scalar *= sign
        v[ETA, k] = sign * (1.0 + m[ERROR, k, k] - m[ERROR, a, a] - m[ERROR, b, b])
        v[ETA, a] = sign * (m[ERROR, a, k] + m[ERROR, k, a])
        v[ETA, b] = sign * (m[ERROR, b, k] + m[ERROR, k, b])
    # angle, and the factor that makes the vector part w
    size = math.sqrt(v[ETA, 0] ** 2 + v[ETA, 1] ** 2 + v[ETA, 2] ** 2)
    angle = 2.0 * math.atan2(size, scalar)
    scale = angle / size if size > 1e-12 * scalar else 2.0 / scalar
    # c and its derivative, by series near 0
    square = angle * angle
    if angle < _SMALL_ANGLE:
        bend, slope = (
            1.0 / 12.0 + square / 720.0 * (1.0 + square / 42.0),
            1.0 / 360.0 + square / 7560.0,
        )
    else:
        cot, sine = 1.0 / math.tan(0.5 * angle), math.sin(0.5 * angle)
        bend = (1.0 - 0.5 * angle * cot) / square
        slope = (-2.0 + 0.5 * angle * cot + 0.25 * square / (sine * sine)) / (square * square)
    v[BEND, 0], v[BEND, 1], v[BEND, 2] = bend, slope, square
    # w, its products with t, and the residual
    for r in range(3):
        v[ETA, r] *= scale
    for r in range(3):  # w x t and w x (w x t) follow w and t in their rows
        p, q = (r + 1) % 3, (r + 2) % 3
        v[ETA, 3 + r] = v[ETA, p] * v[TRANSLATION, q] - v[ETA, q] * v[TRANSLATION, p]
    for r in range(3):
        p, q = (r + 1) % 3, (r + 2) % 3
        v[TRANSLATION, 3 + r] = v[ETA, p] * v[ETA, 3 + q] - v[ETA, q] * v[ETA, 3 + p]
        v[RESIDUAL, r] = v[ETA, r]
    for r in range(3):
        v[RESIDUAL, 3 + r] = v[TRANSLATION, r] - 0.5 * v[ETA, 3 + r] + bend * v[TRANSLATION, 3 + r]


@inlined
def _cross(m, x, y, z):  # type: ignore[no-untyped-def]
    """Matrix of the cross product with a vector."""
    m[CROSS, 0, 0] = m[CROSS, 1, 1] = m[CROSS, 2, 2] = 0.0
    m[CROSS, 2, 1], m[CROSS, 0, 2], m[CROSS, 1, 0] = x, y, z
    m[CROSS, 1, 2], m[CROSS, 2, 0], m[CROSS, 0, 1] = -x, -y, -z


@inlined
def _by_second(m, v):  # type: ignore[no-untyped-def]
    """
    Derivatives by the second pose.

    The inverse right Jacobian is ``1 + [w] / 2 + c [w] [w]``, V^-1 its transpose, and V^-1 t
    changes with w by ``[t] / 2 - c ([w x t] + [w] [t]) + c' / |w| (w x (w x t)) w^T``.
    """
    bend, slope, square = v[BEND, 0], v[BEND, 1], v[BEND, 2]
    _cross(m, 0.5 * v[ETA, 0], 0.5 * v[ETA, 1], 0.5 * v[ETA, 2])
    for r in range(3):
        for c in range(3):
            m[JACOBIAN, r, c] = m[CROSS, r, c] + bend * v[ETA, r] * v[ETA, c]
        m[JACOBIAN, r, r] += 1.0 - bend * square
    along = (
        v[ETA, 0] * v[TRANSLATION, 0]
        + v[ETA, 1] * v[TRANSLATION, 1]
        + v[ETA, 2] * v[TRANSLATION, 2]
    )
    _cross(
        m,
        0.5 * v[TRANSLATION, 0] - bend * v[ETA, 3],
        0.5 * v[TRANSLATION, 1] - bend * v[ETA, 4],
        0.5 * v[TRANSLATION, 2] - bend * v[ETA, 5],
    )
    for r in range(3):
        for c in range(3):  # [w] [t] = t w^T - (w . t) 1
            m[BY_ETA, r, c] = (
                m[CROSS, r, c]
                + (slope * v[TRANSLATION, 3 + r] - bend * v[TRANSLATION, r]) * v[ETA, c]
            )
        m[BY_ETA, r, r] += bend * along
    set_product_of_three(m, TRANSLATION_BY_SECOND, m, BY_ETA, m, JACOBIAN)
    set_transposed_product_of_three(m, TRANSLATION_BY_POSITION, m, JACOBIAN, m, TO_ERROR)


@inlined
def _by_first(first, second, relative_rotation, i, rotation, m, v):  # type: ignore[no-untyped-def]
    """
    Derivatives by the first pose: it rotates the error by ``-R2^T R1``, and its stride by a lever.
    """
    _cross(m, v[STRIDE, 0], v[STRIDE, 1], v[STRIDE, 2])
    set_transposed_product_of_three(m, BETWEEN, rotation, second, rotation, first)
    set_transposed_product_of_three(m, LEVER, relative_rotation, i, m, CROSS)
    for r in range(3):
        for c in range(3):
            m[ROTATION_BY_FIRST, r, c] = 0.0
    subtract_product_of_three(m, ROTATION_BY_FIRST, m, JACOBIAN, m, BETWEEN)
    set_transposed_product_of_three(m, TRANSLATION_BY_FIRST, m, JACOBIAN, m, LEVER)
    subtract_product_of_three(m, TRANSLATION_BY_FIRST, m, TRANSLATION_BY_SECOND, m, BETWEEN)


@inlined
def _add_curvature(relative, blocks, poses, matrix, i, m, v):  # type: ignore[no-untyped-def]
    """
    Add how the pull on the translation rotates with the first pose, the largest part of the
    curvature.

    The residual's translation is linear in ``R1^T (p2 - p1)``: with its pull q there, ``[q] R1^T``
    between rotating the first pose and moving one against the other.
    """
    first, block = relative.first[i], blocks.block[i]
    relative_rotation, root = relative.rotation, relative.root
    row, diagonal, above, rotation = (
        matrix.row[first],
        matrix.diagonal,
        matrix.above,
        poses.rotation,
    )
    for r in range(3):  # on the residual, on the error, on the stride
        v[RESIDUAL, r] = _pull(root, i, 3 + r, v)
    for r in range(3):
        v[RESIDUAL, 3 + r] = 0.0
        for k in range(3):
            v[RESIDUAL, 3 + r] += m[JACOBIAN, r, k] * v[RESIDUAL, k]
    for r in range(3):
        v[BEND, 3 + r] = 0.0
        for k in range(3):
            v[BEND, 3 + r] += relative_rotation[i, r, k] * v[RESIDUAL, 3 + k]
    _cross(m, v[BEND, 3], v[BEND, 4], v[BEND, 5])
    for r in range(3):
        for c in range(3):
            bend = 0.0
            for k in range(3):
                bend += m[CROSS, r, k] * rotation[first, c, k]
            diagonal[row, r, 3 + c] -= bend
            diagonal[row, 3 + c, r] -= bend
            if blocks.reverse[i]:
                above[block, 3 + c, r] += bend
            else:
                above[block, r, 3 + c] += bend


@inlined
def _add_gradient(gradient, row, j, p, v):  # type: ignore[no-untyped-def]
    for r in range(6):
        for c in range(6):
            gradient[row, c] += j[p, r, c] * v[WHITE, r]


@inlined
def _add_pair_gradient(relative, poses, i, work, out, row, factor):  # type: ignore[no-untyped-def]
    """Add a multiple of a cost's gradient by both poses of a pair to a row of ``out``, (12,)."""
    _, m, v = work
    _residual(relative, poses, i, m, v)
    _whiten(relative.root, i, v)
    _by_second(m, v)
    first, second = relative.first[i], relative.second[i]
    _by_first(first, second, relative.rotation, i, poses.rotation, m, v)
    for r in range(6):
        v[RESIDUAL, r] = factor * _pull(relative.root, i, r, v)
    for r in range(3):
        on_rotation, on_translation = v[RESIDUAL, r], v[RESIDUAL, 3 + r]
        for c in range(3):
            along = m[TRANSLATION_BY_POSITION, r, c] * on_translation
            out[row, c] += m[ROTATION_BY_FIRST, r, c] * on_rotation
            out[row, c] += m[TRANSLATION_BY_FIRST, r, c] * on_translation
            out[row, 3 + c] -= along
            out[row, 6 + c] += m[ROTATION_BY_SECOND, r, c] * on_rotation
            out[row, 6 + c] += m[TRANSLATION_BY_SECOND, r, c] * on_translation
            out[row, 9 + c] += along


@inlined
def _differ(relative, poses, i, work, out):  # type: ignore[no-untyped-def]
    """Rows of a cost's Hessian by the rotations of both poses of a pair, (6, 12)."""
    j, rotation = work[0], poses.rotation
    for end in range(2):
        pose = relative.second[i] if end else relative.first[i]
        for r in range(3):
            for c in range(3):
                j[1, r, c] = rotation[pose, r, c]
        for axis in range(3):
            row = 3 * end + axis
            p, q = (axis + 1) % 3, (axis + 2) % 3
            for c in range(12):
                out[row, c] = 0.0
            for side in range(2):
                angle = -_DIFFERENCE_ANGLE if side else _DIFFERENCE_ANGLE
                cosine, sine = math.cos(angle), math.sin(angle)
                for r in range(3):
                    rotation[pose, r, p] = cosine * j[1, r, p] + sine * j[1, r, q]
                    rotation[pose, r, q] = cosine * j[1, r, q] - sine * j[1, r, p]
                _add_pair_gradient(relative, poses, i, work, out, row, 0.5 / angle)
            for r in range(3):
                for c in range(3):
                    rotation[pose, r, c] = j[1, r, c]


@inlined
def _subtract_products(relative, poses, i, work, out):  # type: ignore[no-untyped-def]
    """Subtract the product of Jacobians from rows of a Hessian, see `_differ`."""
    j, m, v = work
    _residual(relative, poses, i, m, v)
    _by_second(m, v)
    first, second = relative.first[i], relative.second[i]
    _by_first(first, second, relative.rotation, i, poses.rotation, m, v)
    _whiten_block(relative.root, i, j, 2, m, (ROTATION_BY_FIRST, TRANSLATION_BY_FIRST, -1.0))
    _whiten_block(relative.root, i, j, 3, m, (ROTATION_BY_SECOND, TRANSLATION_BY_SECOND, 1.0))
    for row in range(6):
        for c in range(12):
            for r in range(6):
                out[row, c] -= j[2 + row // 3, r, row % 3] * j[2 + c // 6, r, c % 6]


@entry
def add_full_curvature(relative, blocks, poses, matrix, extra, work):  # type: ignore[no-untyped-def]
    """
    Add the curvature of relative poses: the Hessian less the product of Jacobians.

    Residuals are linear in positions, so the difference involves rotations only. Central
    differences of each residual's gradient, with its two poses rotated, give it. ``extra`` (6,
    12) is scratch, and ``poses.rotation`` is the same at the end.
    """
    row, diagonal, above = matrix.row, matrix.diagonal, matrix.above
    for i in range(relative.first.size):
        a, b, block = relative.first[i], relative.second[i], blocks.block[i]
        if a < 0:
            continue
        _differ(relative, poses, i, work, extra)
        _subtract_products(relative, poses, i, work, extra)
        for r in range(3):
            for c in range(3):
                # symmetric except for the rotation of the body's axes
                diagonal[row[a], r, c] += 0.5 * (extra[r, c] + extra[c, r])
                diagonal[row[b], r, c] += 0.5 * (extra[3 + r, 6 + c] + extra[3 + c, 6 + r])
                diagonal[row[a], r, 3 + c] += extra[r, 3 + c]
                diagonal[row[a], 3 + c, r] += extra[r, 3 + c]
                diagonal[row[b], r, 3 + c] += extra[3 + r, 9 + c]
                diagonal[row[b], 3 + c, r] += extra[3 + r, 9 + c]
                both = 0.5 * (extra[r, 6 + c] + extra[3 + c, r])
                if blocks.reverse[i]:
                    above[block, c, r] += both
                    above[block, 3 + c, r] += extra[r, 9 + c]
                    above[block, c, 3 + r] += extra[3 + c, 3 + r]
                else:
                    above[block, r, c] += both
                    above[block, r, 3 + c] += extra[r, 9 + c]
                    above[block, 3 + r, c] += extra[3 + c, 3 + r]


@entry
def add_sightings(sightings, blocks, poses, matrix, order, cost, work):  # type: ignore[no-untyped-def]
    """
    Costs (n,) of landmarks seen from poses, residuals ``root (R^T (l - p) - z)``, and of order 1
    and above their blocks and gradient.
    """
    root, row, diagonal, above, gradient = (
        sightings.root,
        matrix.row,
        matrix.diagonal,
        matrix.above,
        matrix.gradient,
    )
    j, m, v = work
    for i in range(cost.size):
        a, b = sightings.pose[i], sightings.landmark[i]
        # landmark in the body frame of the pose
        for r in range(3):
            v[STRIDE, r] = 0.0
            for c in range(3):
                v[STRIDE, r] += poses.rotation[a, c, r] * (
                    poses.position[b, c] - poses.position[a, c]
                )
            v[WHITE, r], v[WHITE, 3 + r] = 0.0, 0.0
        # whitened residual and cost
        total = 0.0
        for r in range(3):
            for c in range(r + 1):
                v[WHITE, r] += root[i, r, c] * (v[STRIDE, c] - sightings.measurement[i, c])
            total += v[WHITE, r] * v[WHITE, r]
        cost[i] = 0.5 * total
        if order == 0:
            continue
        # derivatives by the pose and by the landmark
        _cross(m, v[STRIDE, 0], v[STRIDE, 1], v[STRIDE, 2])
        for r in range(6):
            for c in range(6):
                j[0, r, c] = j[1, r, c] = 0.0
        for r in range(3):
            for c in range(3):  # a rotation of the body rotates what it sees the other way
                j[0, r, c] = m[CROSS, r, c]
                j[0, r, 3 + c], j[1, r, 3 + c] = -poses.rotation[a, c, r], poses.rotation[a, c, r]
        # their share of the matrix and of the gradient
        set_product(j, 2, root, i, j, 0)
        set_product(j, 3, root, i, j, 1)
        for p, variable in ((2, a), (3, b)):
            add_transposed_product(diagonal, row[variable], j, p, j, p)
            _add_gradient(gradient, row[variable], j, p, v)
        if blocks.reverse[i]:
            add_transposed_product(above, blocks.block[i], j, 3, j, 2)
        else:
            add_transposed_product(above, blocks.block[i], j, 2, j, 3)


@inlined
def add_position(positions, position, matrix, order, i):  # type: ignore[no-untyped-def]
    """Cost of a measured position; of order 1 and above add its block and gradient."""
    measurement, information = positions.measurement, positions.information
    row, diagonal, gradient = matrix.row, matrix.diagonal, matrix.gradient
    v, total = positions.variable[i], 0.0
    for r in range(3):
        pull = 0.0
        for c in range(3):
            pull += information[i, r, c] * (position[v, c] - measurement[i, c])
            if order > 0:
                diagonal[row[v], 3 + r, 3 + c] += information[i, r, c]
        total += pull * (position[v, r] - measurement[i, r])
        if order > 0:
            gradient[row[v], 3 + r] += pull
    return 0.5 * total


@entry
def add_pairs(pairs, blocks, residual, slope, bend, information, matrix):  # type: ignore[no-untyped-def]
    """
    Blocks and gradient of whitened residuals (n,) of pairs (n, 2), with slopes by the positions of
    both ends, (n, 6).

    ``bend`` is the curvature of a distance: its information across the line, as a share of that
    along the line.
    """
    block, reverse = blocks.block, blocks.reverse
    row, diagonal, above, gradient = matrix.row, matrix.diagonal, matrix.above, matrix.gradient
    for i in range(residual.size):
        j, k = row[pairs[i, 0]], row[pairs[i, 1]]
        along, across = 1.0 - bend[i], bend[i] * information[i]
        for r in range(3):
            a, b = slope[i, r], slope[i, 3 + r]
            gradient[j, 3 + r] += a * residual[i]
            gradient[k, 3 + r] += b * residual[i]
            diagonal[j, 3 + r, 3 + r] += across
            diagonal[k, 3 + r, 3 + r] += across
            above[block[i], 3 + r, 3 + r] -= across
            for c in range(3):
                diagonal[j, 3 + r, 3 + c] += along * a * slope[i, c]
                diagonal[k, 3 + r, 3 + c] += along * b * slope[i, 3 + c]
                if reverse[i]:
                    above[block[i], 3 + r, 3 + c] += along * b * slope[i, c]
                else:
                    above[block[i], 3 + r, 3 + c] += along * a * slope[i, 3 + c]


@kernel
def _bend_way(rotation, step, a, b, square, position):  # type: ignore[no-untyped-def]
    """
    Add to a position after a straight step what the way along an arc has besides: ``b u x d + c u x
    (u x d)``, u the rotation vector in the world.
    """
    c = (1.0 - a) / square if square > _SMALL_ANGLE * _SMALL_ANGLE else (1.0 - square / 20.0) / 6.0
    ux = rotation[0, 0] * step[0] + rotation[0, 1] * step[1] + rotation[0, 2] * step[2]
    uy = rotation[1, 0] * step[0] + rotation[1, 1] * step[1] + rotation[1, 2] * step[2]
    uz = rotation[2, 0] * step[0] + rotation[2, 1] * step[1] + rotation[2, 2] * step[2]
    x, y, z = uy * step[5] - uz * step[4], uz * step[3] - ux * step[5], ux * step[4] - uy * step[3]
    position[0] += b * x + c * (uy * z - uz * y)
    position[1] += b * y + c * (uz * x - ux * z)
    position[2] += b * z + c * (ux * y - uy * x)


@entry
def move(rotation, position, row, step, arc, new_rotation, new_position):  # type: ignore[no-untyped-def]
    """
    Poses after a step (n, 6) in the order of rows: ``R Exp(w), p + d``, or along an arc ``R Exp(w),
    p + R V(w) R^T d``.

    Along arcs, screw motions, what rotates as a whole about some point keeps its shape.
    """
    for i in range(position.shape[0]):
        k = row[i]
        x, y, z = step[k, 0], step[k, 1], step[k, 2]
        t2 = x * x + y * y + z * z
        t = math.sqrt(t2)
        if t < _SMALL_ANGLE:
            a, b = 1.0 - t2 / 6.0 * (1.0 - t2 / 20.0), 0.5 - t2 / 24.0 * (1.0 - t2 / 30.0)
        else:
            a, b = math.sin(t) / t, 2.0 * math.sin(0.5 * t) ** 2 / t2
        for r in range(3):
            new_position[i, r] = position[i, r] + step[k, 3 + r]
        if arc:
            _bend_way(rotation[i], step[k], a, b, t2, new_position[i])
        for r in range(3):
            r0, r1, r2 = rotation[i, r, 0], rotation[i, r, 1], rotation[i, r, 2]
            u0, u1, u2 = r1 * z - r2 * y, r2 * x - r0 * z, r0 * y - r1 * x  # row of R times [w]
            new_rotation[i, r, 0] = r0 + a * u0 + b * (u1 * z - u2 * y)
            new_rotation[i, r, 1] = r1 + a * u1 + b * (u2 * x - u0 * z)
            new_rotation[i, r, 2] = r2 + a * u2 + b * (u0 * y - u1 * x)

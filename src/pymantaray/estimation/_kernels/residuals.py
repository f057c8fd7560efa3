"""
Residuals of poses, and the blocks of the normal equations that they add up to.

A pose moves by ``R Exp(w), p + d``: its rotation in the body's axes, its position in the world's, ``[w, d]`` in a block. A
landmark is a pose that does not turn. Row ``row[i]`` of the matrix is that of variable i; a pair's block is
``above[block]``, in the order of the pair or, where ``turned``, the other way round.
"""

import math

from pymantaray.compile import entry, inlined
from pymantaray.estimation._kernels.cholesky import add_product

_SMALL = 1e-2  # rad; below it series replace closed forms: what they leave out is below 1e-16


@entry
def add_relative(  # type: ignore[no-untyped-def]
    first,
    second,
    turn,
    step,
    root,
    block,
    turned,
    rotation,
    place,
    row,
    order,
    diagonal,
    above,
    gradient,
    cost,
    work,
):
    """
    Costs (n,) of poses seen from others; of order 1 their blocks and gradient as well, of order 2 also their curvature.

    Residuals ``root Log(Z^-1 T1^-1 T2)``; where ``first`` is negative T1 is the world. ``work`` has room for 5 blocks.
    """
    for i in range(first.size):
        _relative_residual(first[i], second[i], turn, step, i, rotation, place, work)
        total = 0.0
        for r in range(6):
            white = 0.0
            for c in range(r + 1):
                white += root[i, r, c] * work[4, 0, c]
            work[4, 1, r] = white
            total += white * white
        cost[i] = 0.5 * total
        if order == 0:
            continue
        _relative_slopes(first[i], second[i], turn, i, rotation, work)
        k = row[second[i]]
        if order == 2 and first[i] >= 0:
            _add_curvature(
                first[i], row[first[i]], turn, root, i, rotation, block[i], turned[i], diagonal, above, work
            )
        _whiten(root, i, work, 3, 1)
        add_product(diagonal, k, 1.0, work, 1, work, 1)
        _add_gradient(gradient, k, work, 1)
        if first[i] >= 0:
            j = row[first[i]]
            _whiten(root, i, work, 2, 0)
            add_product(diagonal, j, 1.0, work, 0, work, 0)
            _add_gradient(gradient, j, work, 0)
            if turned[i]:
                add_product(above, block[i], 1.0, work, 1, work, 0)
            else:
                add_product(above, block[i], 1.0, work, 0, work, 1)


@inlined
def _relative_residual(first, second, turn, step, i, rotation, place, work):  # type: ignore[no-untyped-def]
    """
    Residual in ``work[4, 0]``.

    Beside it Z^T R1^T in ``work[0, :3, :3]``, R1^T (p2 - p1) in ``work[0, 3]``, the coefficients c(t) and c'(t) / t of
    the logarithm in ``work[0, 4]``, translation of the error in ``work[0, 5]``.
    """
    for r in range(3):
        for c in range(3):
            if first < 0:
                work[0, r, c] = turn[i, c, r]
            else:
                work[0, r, c] = (
                    turn[i, 0, r] * rotation[first, c, 0]
                    + turn[i, 1, r] * rotation[first, c, 1]
                    + turn[i, 2, r] * rotation[first, c, 2]
                )
        if first < 0:
            work[0, 3, r] = place[second, r]
        else:
            work[0, 3, r] = (
                rotation[first, 0, r] * (place[second, 0] - place[first, 0])
                + rotation[first, 1, r] * (place[second, 1] - place[first, 1])
                + rotation[first, 2, r] * (place[second, 2] - place[first, 2])
            )
    for r in range(3):
        work[0, 5, r] = (
            turn[i, 0, r] * (work[0, 3, 0] - step[i, 0])
            + turn[i, 1, r] * (work[0, 3, 1] - step[i, 1])
            + turn[i, 2, r] * (work[0, 3, 2] - step[i, 2])
        )
        for c in range(3):  # the error's rotation
            work[1, r, c] = (
                work[0, r, 0] * rotation[second, 0, c]
                + work[0, r, 1] * rotation[second, 1, c]
                + work[0, r, 2] * rotation[second, 2, c]
            )
    _logarithm(work)


@inlined
def _logarithm(work):  # type: ignore[no-untyped-def]
    """Rotation vector of ``work[1]`` and the translation that leads to ``work[0, 5]``, in ``work[4, 0]``."""
    trace = work[1, 0, 0] + work[1, 1, 1] + work[1, 2, 2]
    if trace > 0.0:
        scalar, x = 1.0 + trace, work[1, 2, 1] - work[1, 1, 2]
        y, z = work[1, 0, 2] - work[1, 2, 0], work[1, 1, 0] - work[1, 0, 1]
    else:  # near half a turn: from the largest of the three others
        k = 0
        if work[1, 1, 1] > work[1, k, k]:
            k = 1
        if work[1, 2, 2] > work[1, k, k]:
            k = 2
        a, b = (k + 1) % 3, (k + 2) % 3
        scalar = work[1, b, a] - work[1, a, b]
        work[4, 0, k] = 1.0 + work[1, k, k] - work[1, a, a] - work[1, b, b]
        work[4, 0, a] = work[1, a, k] + work[1, k, a]
        work[4, 0, b] = work[1, b, k] + work[1, k, b]
        x, y, z = work[4, 0, 0], work[4, 0, 1], work[4, 0, 2]
        if scalar < 0.0:
            scalar, x, y, z = -scalar, -x, -y, -z
    size = math.sqrt(x * x + y * y + z * z)
    angle = 2.0 * math.atan2(size, scalar)
    scale = angle / size if size > 1e-12 * scalar else 2.0 / scalar
    x, y, z = scale * x, scale * y, scale * z
    t2 = angle * angle
    if angle < _SMALL:
        bend, slope = 1.0 / 12.0 + t2 / 720.0 + t2 * t2 / 30240.0, 1.0 / 360.0 + t2 / 7560.0
    else:
        cot = 1.0 / math.tan(0.5 * angle)
        sine = math.sin(0.5 * angle)
        bend = (1.0 - 0.5 * angle * cot) / t2
        slope = (-2.0 + 0.5 * angle * cot + 0.25 * t2 / (sine * sine)) / (t2 * t2)
    work[0, 4, 0], work[0, 4, 1] = bend, slope
    work[4, 0, 0], work[4, 0, 1], work[4, 0, 2] = x, y, z
    # V^-1 t = t - w x t / 2 + c w x (w x t)
    t0, t1, t2 = work[0, 5, 0], work[0, 5, 1], work[0, 5, 2]
    u0, u1, u2 = y * t2 - z * t1, z * t0 - x * t2, x * t1 - y * t0
    work[4, 0, 3] = t0 - 0.5 * u0 + bend * (y * u2 - z * u1)
    work[4, 0, 4] = t1 - 0.5 * u1 + bend * (z * u0 - x * u2)
    work[4, 0, 5] = t2 - 0.5 * u2 + bend * (x * u1 - y * u0)


@inlined
def _relative_slopes(first, second, turn, i, rotation, work):  # type: ignore[no-untyped-def]
    """Derivatives of the residual by the first pose in ``work[2]`` and by the second in ``work[3]``."""
    x, y, z = work[4, 0, 0], work[4, 0, 1], work[4, 0, 2]
    t0, t1, t2 = work[0, 5, 0], work[0, 5, 1], work[0, 5, 2]
    bend, slope = work[0, 4, 0], work[0, 4, 1]
    _inverse_right(work, x, y, z, bend)  # in work[1, :3, :3]
    # by w of V^-1 t: [t] / 2 - c ([w x t] + [w] [t]) + c'/t (w x (w x t)) w^T, in work[1, 3:, :3]
    u0, u1, u2 = y * t2 - z * t1, z * t0 - x * t2, x * t1 - y * t0
    v0, v1, v2 = slope * (y * u2 - z * u1), slope * (z * u0 - x * u2), slope * (x * u1 - y * u0)
    along = x * t0 + y * t1 + z * t2  # [w] [t] = t w^T - (w . t) 1
    work[1, 3, 0] = -bend * (t0 * x - along) + v0 * x
    work[1, 3, 1] = -0.5 * t2 + bend * u2 - bend * t0 * y + v0 * y
    work[1, 3, 2] = 0.5 * t1 - bend * u1 - bend * t0 * z + v0 * z
    work[1, 4, 0] = 0.5 * t2 - bend * u2 - bend * t1 * x + v1 * x
    work[1, 4, 1] = -bend * (t1 * y - along) + v1 * y
    work[1, 4, 2] = -0.5 * t0 + bend * u0 - bend * t1 * z + v1 * z
    work[1, 5, 0] = -0.5 * t1 + bend * u1 - bend * t2 * x + v2 * x
    work[1, 5, 1] = 0.5 * t0 - bend * u0 - bend * t2 * y + v2 * y
    work[1, 5, 2] = -bend * (t2 * z - along) + v2 * z
    for r in range(3):
        for c in range(3):
            work[3, r, c] = work[1, r, c]
            work[3, r, 3 + c] = 0.0
            # V^-1 is the transpose of the inverse right Jacobian
            work[3, 3 + r, 3 + c] = (
                work[1, 0, r] * work[0, 0, c] + work[1, 1, r] * work[0, 1, c] + work[1, 2, r] * work[0, 2, c]
            )
            work[3, 3 + r, c] = (
                work[1, 3 + r, 0] * work[1, 0, c]
                + work[1, 3 + r, 1] * work[1, 1, c]
                + work[1, 3 + r, 2] * work[1, 2, c]
            )
    if first < 0:
        return
    a0, a1, a2 = work[0, 3, 0], work[0, 3, 1], work[0, 3, 2]
    for c in range(3):  # R2^T R1, column c, and column c of [a]
        m0, m1, m2 = _column_between(rotation, first, second, c)
        b0 = 0.0 if c == 0 else (-a2 if c == 1 else a1)
        b1 = a2 if c == 0 else (0.0 if c == 1 else -a0)
        b2 = -a1 if c == 0 else (a0 if c == 1 else 0.0)
        s0 = turn[i, 0, 0] * b0 + turn[i, 1, 0] * b1 + turn[i, 2, 0] * b2
        s1 = turn[i, 0, 1] * b0 + turn[i, 1, 1] * b1 + turn[i, 2, 1] * b2
        s2 = turn[i, 0, 2] * b0 + turn[i, 1, 2] * b1 + turn[i, 2, 2] * b2
        for r in range(3):
            work[2, r, c] = -(work[3, r, 0] * m0 + work[3, r, 1] * m1 + work[3, r, 2] * m2)
            work[2, r, 3 + c] = 0.0
            work[2, 3 + r, 3 + c] = -work[3, 3 + r, 3 + c]
            work[2, 3 + r, c] = (
                work[1, 0, r] * s0
                + work[1, 1, r] * s1
                + work[1, 2, r] * s2
                - (work[3, 3 + r, 0] * m0 + work[3, 3 + r, 1] * m1 + work[3, 3 + r, 2] * m2)
            )


@inlined
def _add_curvature(first, j, turn, root, i, rotation, block, turned, diagonal, above, work):  # type: ignore[no-untyped-def]
    """
    Add how the pull on the translation turns with the first pose, the largest part of the curvature.

    The residual's translation is linear in ``R1^T (p2 - p1)``: with its pull q there, ``[q] R1^T`` between turning the first
    pose and moving one against the other.
    """
    for r in range(3):
        work[4, 2, r] = 0.0
        for c in range(3, 6):
            work[4, 2, r] += root[i, c, 3 + r] * work[4, 1, c]
    for r in range(3):
        work[4, 3, r] = (
            work[1, r, 0] * work[4, 2, 0] + work[1, r, 1] * work[4, 2, 1] + work[1, r, 2] * work[4, 2, 2]
        )
    q0 = turn[i, 0, 0] * work[4, 3, 0] + turn[i, 0, 1] * work[4, 3, 1] + turn[i, 0, 2] * work[4, 3, 2]
    q1 = turn[i, 1, 0] * work[4, 3, 0] + turn[i, 1, 1] * work[4, 3, 1] + turn[i, 1, 2] * work[4, 3, 2]
    q2 = turn[i, 2, 0] * work[4, 3, 0] + turn[i, 2, 1] * work[4, 3, 1] + turn[i, 2, 2] * work[4, 3, 2]
    for c in range(3):
        r0, r1, r2 = rotation[first, c, 0], rotation[first, c, 1], rotation[first, c, 2]
        work[4, 4, 0], work[4, 4, 1], work[4, 4, 2] = q1 * r2 - q2 * r1, q2 * r0 - q0 * r2, q0 * r1 - q1 * r0
        for r in range(3):
            diagonal[j, r, 3 + c] -= work[4, 4, r]
            diagonal[j, 3 + c, r] -= work[4, 4, r]
            if turned:
                above[block, 3 + c, r] += work[4, 4, r]
            else:
                above[block, r, 3 + c] += work[4, 4, r]


@inlined
def _column_between(rotation, first, second, c):  # type: ignore[no-untyped-def]
    r0, r1, r2 = rotation[first, 0, c], rotation[first, 1, c], rotation[first, 2, c]
    return (
        rotation[second, 0, 0] * r0 + rotation[second, 1, 0] * r1 + rotation[second, 2, 0] * r2,
        rotation[second, 0, 1] * r0 + rotation[second, 1, 1] * r1 + rotation[second, 2, 1] * r2,
        rotation[second, 0, 2] * r0 + rotation[second, 1, 2] * r1 + rotation[second, 2, 2] * r2,
    )


@inlined
def _inverse_right(work, x, y, z, bend):  # type: ignore[no-untyped-def]
    """Inverse of the right Jacobian, 1 + [w] / 2 + c [w] [w], in ``work[1, :3, :3]``."""
    work[1, 0, 0] = 1.0 - bend * (y * y + z * z)
    work[1, 0, 1] = -0.5 * z + bend * x * y
    work[1, 0, 2] = 0.5 * y + bend * x * z
    work[1, 1, 0] = 0.5 * z + bend * x * y
    work[1, 1, 1] = 1.0 - bend * (x * x + z * z)
    work[1, 1, 2] = -0.5 * x + bend * y * z
    work[1, 2, 0] = -0.5 * y + bend * x * z
    work[1, 2, 1] = 0.5 * x + bend * y * z
    work[1, 2, 2] = 1.0 - bend * (x * x + y * y)


@inlined
def _whiten(root, i, work, p, q):  # type: ignore[no-untyped-def]
    """Multiply a block by the root of an information matrix."""
    for r in range(6):
        a0, a1, a2 = root[i, r, 0], root[i, r, 1], root[i, r, 2]
        a3, a4, a5 = root[i, r, 3], root[i, r, 4], root[i, r, 5]
        for c in range(6):
            work[q, r, c] = (
                a0 * work[p, 0, c]
                + a1 * work[p, 1, c]
                + a2 * work[p, 2, c]
                + a3 * work[p, 3, c]
                + a4 * work[p, 4, c]
                + a5 * work[p, 5, c]
            )


@inlined
def _add_gradient(gradient, k, work, p):  # type: ignore[no-untyped-def]
    for r in range(6):
        for c in range(6):
            gradient[k, c] += work[p, r, c] * work[4, 1, r]


@entry
def add_places(variable, measured, information, place, row, wanted, diagonal, gradient, cost):  # type: ignore[no-untyped-def]
    """Costs (n,) of measured positions, of information (n, 3, 3), and if wanted their blocks and gradient."""
    for i in range(variable.size):
        v, k = variable[i], row[variable[i]]
        total = 0.0
        for r in range(3):
            pull = 0.0
            for c in range(3):
                pull += information[i, r, c] * (place[v, c] - measured[i, c])
                if wanted:
                    diagonal[k, 3 + r, 3 + c] += information[i, r, c]
            total += pull * (place[v, r] - measured[i, r])
            if wanted:
                gradient[k, 3 + r] += pull
        cost[i] = 0.5 * total


@entry
def add_pairs(first, second, residual, slope, block, turned, row, diagonal, above, gradient):  # type: ignore[no-untyped-def]
    """Blocks and gradient of whitened residuals (n,) with slopes by the positions of their first and second end, (n, 6)."""
    for i in range(first.size):
        j, k = row[first[i]], row[second[i]]
        for r in range(3):
            a, b = slope[i, r], slope[i, 3 + r]
            gradient[j, 3 + r] += a * residual[i]
            gradient[k, 3 + r] += b * residual[i]
            for c in range(3):
                diagonal[j, 3 + r, 3 + c] += a * slope[i, c]
                diagonal[k, 3 + r, 3 + c] += b * slope[i, 3 + c]
                if turned[i]:
                    above[block[i], 3 + r, 3 + c] += b * slope[i, c]
                else:
                    above[block[i], 3 + r, 3 + c] += a * slope[i, 3 + c]


@entry
def move(rotation, place, row, step, new_rotation, new_place):  # type: ignore[no-untyped-def]
    """Poses after a step (n, 6) in the order of rows: ``R Exp(w), p + d``."""
    for i in range(place.shape[0]):
        k = row[i]
        x, y, z = step[k, 0], step[k, 1], step[k, 2]
        t2 = x * x + y * y + z * z
        t = math.sqrt(t2)
        if t < _SMALL:
            a, b = 1.0 - t2 / 6.0 * (1.0 - t2 / 20.0), 0.5 - t2 / 24.0 * (1.0 - t2 / 30.0)
        else:
            a, b = math.sin(t) / t, 2.0 * math.sin(0.5 * t) ** 2 / t2
        for r in range(3):
            new_place[i, r] = place[i, r] + step[k, 3 + r]
            r0, r1, r2 = rotation[i, r, 0], rotation[i, r, 1], rotation[i, r, 2]
            u0, u1, u2 = r1 * z - r2 * y, r2 * x - r0 * z, r0 * y - r1 * x  # row of R times [w]
            new_rotation[i, r, 0] = r0 + a * u0 + b * (u1 * z - u2 * y)
            new_rotation[i, r, 1] = r1 + a * u1 + b * (u2 * x - u0 * z)
            new_rotation[i, r, 2] = r2 + a * u2 + b * (u0 * y - u1 * x)

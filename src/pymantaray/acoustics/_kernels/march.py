"""
Integration of sixteen direct rays at a time through SMOOTH sections, each with its own steps: a
queue of the rays of several links.

Equations, formula and error control are those of `step` and `trace`. The sixteen rays share only
the processor's instructions, so a ray does not depend on the others. When a ray reaches the end,
the next ray takes its lane. `trace` traces rays that fail here.
"""

import math

from pymantaray.acoustics._kernels import layout as at
from pymantaray.acoustics._kernels.field import ABOVE_SCALE, BELOW_SCALE, LUT_SIZE
from pymantaray.acoustics._kernels.lanes import (
    WIDTH,
    absolute,
    any_lane,
    blend,
    choose,
    floor,
    gather,
    load,
    mix,
    root,
    store,
    take,
)
from pymantaray.acoustics._kernels.step import (
    E1,
    E3,
    E4,
    E5,
    E6,
    E7,
    FAN_TUBE,
    MIN_WIDTH,
    A,
    C,
    varied,
)
from pymantaray.compile import inlined, kernel, shared
from pymantaray.geometry.boundary_kernels import depth_at

# Rows of the workspace: state, its derivatives at the seven stages of a step, and data of each ray
_SLOPES, _POS, _LENGTH, _GONE, _GROWN, _DONE, _RAY, _RATE, _BEND, _TOL, _EXPECTED = (
    4,
    *range(32, 42),
)
_TOP, _TOP_RATE, _LOW, _LOW_RATE = range(42, 46)
# of the link: its number in the queue, first number and last column of its section, distance of the
# columns and its inverse, source's depth and sound speed, length and its inverse, 1 if steps end at
# the levels, derivative of c_ref / c at the source
_LINK, _STORE, _COLUMNS, _STEP, _PER_STEP, _SOURCE, _C_REF, _SPAN, _PER_SPAN, _LEVELS, _GRADIENT = (
    range(46, 57)
)
# and for rays that leave the plane: 1 if they do, derivative of c_ref / c across the track at the
# source, number of attempts to end in the plane; cross-track offset and slowness, their derivatives
# by the launch angle, and the derivatives of the offsets and slownesses in the plane and across it
# by the cross-track slowness; the same eight at the end of a step, and their derivatives at its
# seven stages; and the derivatives of GONE, of the steepness there and of both extreme offsets by
# the cross-track slowness
_CROSS, _CROSS_GRADIENT, _ATTEMPTS = range(57, 60)
_BESIDE, _NEXT_BESIDE, _BESIDE_SLOPES, _N_BESIDE = 60, 68, 76, 8
_OFFSET, _SIDE, _Y_ANGLE, _Q_ANGLE, _W_Q, _P_Q, _Y_Q, _Q_Q = range(_BESIDE, _BESIDE + _N_BESIDE)
_RATE_Q, _BEND_Q, _TOP_RATE_Q, _LOW_RATE_Q = range(132, 136)
# GOOD of a ray that has not been traced, or that took over the lane of one traced ahead
WAITING, UNDER_WAY = -1.0, -3.0
FIRST_STEP = 60.0  # m
# tolerances; rays that end farther out of the plane and near the receiver are traced again
_MAX_OFFSET = 10.0
# error of the miss of such a ray at most, corrected to first order, in squares of its offset
# divided by its length, and per divergence
_PER_SQUARE = 100.0
MOST_ATTEMPTS = 4
_COME, _FAILED = 1.0, 2.0
# Errors on the path of a ray grow with its divergence, relative to straight rays.
_DIVERGING = 3.0  # divergence above which a ray needs a smaller tolerance
_HOPELESS = 1e3  # divergence above which rays are too weak to be arrivals
# the tolerance decreases by _AMPLIFIED times the divergence, which counts up to _DIVERGENCE_LIMIT
_AMPLIFIED, _DIVERGENCE_LIMIT = 2.0, 30.0
# factor of the tolerance if steps end at the levels: errors are then a fiftieth of their estimate
_AT_LEVELS = 10.0
# distance from the receiver beyond which errors do not matter, in tolerances times divergence
ERRING = 100.0


@kernel
def allowed(tol, growth, to_levels):
    """
    Tolerance of the steps of a ray with an expected divergence ``growth``; to_levels: steps end at
    the levels.
    """
    diverges = _DIVERGING < growth < _HOPELESS
    if to_levels:
        return tol * _AT_LEVELS / min(growth, _AT_LEVELS) if diverges else tol * _AT_LEVELS
    return tol / (_AMPLIFIED * min(growth, _DIVERGENCE_LIMIT)) if diverges else tol


@kernel
def again(miss, tol, growth, expected, to_levels):
    """
    True if a ray near the receiver diverges so strongly that it must be traced again, with the
    tolerance of its divergence.
    """
    if not needs_more(miss, tol, growth, expected):
        return False
    return expected == 0.0 or allowed(tol, growth, to_levels) != allowed(tol, expected, to_levels)


@kernel
def needs_more(miss, tol, growth, expected):
    """True if a ray near the receiver diverges strongly and needs a smaller tolerance."""
    return (
        max(_DIVERGING, 1.5 * expected) <= growth <= _HOPELESS
        and abs(miss) <= ERRING * tol * growth
    )


@kernel
def astray(offset, miss, tol, grown, length):
    """
    True if a ray ends so far out of the plane that its miss may have the wrong sign; grown is its
    divergence.
    """
    error = _PER_SQUARE * offset * offset / length * max(grown, 1.0)
    return abs(offset) > _MAX_OFFSET * tol and abs(miss) < error


@kernel
def traced_alike(one, two):
    """
    True if rays with two expected divergences, whose steps end at the levels, are traced with the
    same steps.
    """
    least, most = min(one, two), max(one, two)
    return least == most or 1.5 * most <= _DIVERGING or _AT_LEVELS <= least <= most < _HOPELESS


@inlined
def _level(s, z):
    """Layers of sixteen rays, and their depths in the layers; as `field.find_level`."""
    i = floor((z - s.depth[0]) * s.lut_scale)
    k, top, below, after = gather(s.lut, 4.0 * choose(i < LUT_SIZE - 1.0, i, LUT_SIZE - 1.0))
    deeper = below < z
    k, top = choose(deeper, k + 1.0, k), choose(deeper, below, top)
    deeper = after < z
    while any_lane(deeper):  # levels closer to each other than the table's entries
        k = choose(deeper, k + 1.0, k)
        top = take(s.depth, k)
        deeper = (take(s.depth, k + 1.0) < z) & (k < s.depth.size - 2.5)
    return k, z - top


@inlined
def _derivative(s, data, rows, at_stage, state, across):
    """
    Write the right-hand side of sixteen rays to the rows of a stage; return (h c)^2 minus its lower
    limit.

    Unless across is None, rays are beside the plane, as far as the rows of the stage say;
    otherwise, Numba omits this.
    """
    w, p, xi, eta = state
    stage, pos = at_stage
    slopes = _SLOPES + 4 * stage
    top, low = s.depth[0], s.depth[s.depth.size - 1]
    z = w + load(rows, _SOURCE)
    inside = choose(z < top, top, z)
    inside = choose(inside < low, inside, low)
    k, x = _level(s, inside)
    t = pos * load(rows, _PER_STEP)
    column, last_column, r_step = floor(t), load(rows, _COLUMNS), load(rows, _STEP)
    column = choose(column < last_column, column, last_column)
    t = t - column
    stride = data.shape[1] * 16
    u = 1.0 - t
    weights = (
        u * u * (1.0 + 2.0 * t),
        u * u * t * r_step,
        t * t * (3.0 - 2.0 * t),
        t * t * u * (-1.0 * r_step),
    )
    index = load(rows, _STORE) + column * float(stride) + 16.0 * k
    a0, a1, a2, a3 = blend(data, index, stride, weights)
    cy, cyz, cyy, squares = 0.0 * x, 0.0 * x, 0.0 * x, p * p
    if across is not None:
        y, q = load(rows, _NEXT_BESIDE), load(rows, _NEXT_BESIDE + 1)
        more, cy, cyz, cyy = _field_beside(mix(data, index + 8.0, stride, (u, t)), x, y)
        a0, a1, a2, a3 = a0 + more[0], a1 + more[1], a2 + more[2], a3 + more[3]
        squares = squares + q * q
    c = a0 + x * (a1 + x * (a2 + x * a3))
    cz = a1 + x * (2.0 * a2 + 3.0 * x * a3)
    czz = 2.0 * a2 + 6.0 * x * a3
    beyond = z - inside
    if any_lane(absolute(beyond) > 0.0):
        c, cz, czz = _extended(beyond, c, cz, czz)
    least, c_ref = 1e-6 * c * c, load(rows, _C_REF)
    square = c_ref * c_ref - c * c * squares
    room = square - least
    hc = root(choose(room > 0.0, square, least))
    inverse = 1.0 / (c * hc)
    ic, ih = hc * inverse, c * c * inverse
    n = c_ref * ic
    nw = -1.0 * n * cz * ic
    nww = n * ic * (2.0 * cz * cz * ic - czz)
    ih3 = ih * ih * ih
    nnw = n * nw
    store(rows, slopes, p * ih)
    store(rows, slopes + 1, nnw * ih)
    if across is None:
        store(rows, slopes + 2, (ih + p * p * ih3) * eta - p * nnw * ih3 * xi)
        along = (nw * nw + n * nww) * ih - nnw * nnw * ih3
        store(rows, slopes + 3, along * xi + nnw * p * ih3 * eta)
    else:
        squared = n * n
        by = cy * ic
        mixed = squared * (3.0 * cz * ic * by - cyz * ic)
        second = squared * (3.0 * by * by - cyy * ic)
        gradient = (nnw, -1.0 * squared * by)
        bends = (nw * nw + n * nww, mixed, second)
        _vary_coupled(rows, stage, (p, q, xi, eta), gradient, bends, (ih, ih3))
    return room


@inlined
def _extended(beyond, c, cz, czz):
    """Sound speed and its derivatives at distances beyond the levels, as in `field`."""
    scale = choose(beyond < 0.0, ABOVE_SCALE, BELOW_SCALE)
    part = beyond / scale
    f = 1.0 / (1.0 + part * part)
    g = root(f)
    bend = choose(absolute(beyond) > 0.0, -3.0 * part * f * f * g * cz / scale, czz)
    return c + beyond * g * cz, f * g * cz, bend


@inlined
def _field_beside(coefficients, x, y):
    """
    Cubic in depth to be added to that of the sound speed at offsets y from the plane, and c_y, c_yz
    and c_yy.

    The coefficients are those of the cubics of c_y and c_yy in the plane.
    """
    b0, b1, b2, b3, e0, e1, e2, e3 = coefficients
    half = 0.5 * y
    more = y * (b0 + half * e0), y * (b1 + half * e1), y * (b2 + half * e2), y * (b3 + half * e3)
    cyy = e0 + x * (e1 + x * (e2 + x * e3))
    cy = b0 + x * (b1 + x * (b2 + x * b3)) + y * cyy
    cyz = b1 + x * (2.0 * b2 + 3.0 * x * b3) + y * (e1 + x * (2.0 * e2 + 3.0 * x * e3))
    return more, cy, cyz, cyy


@inlined
def _vary_coupled(rows, stage, state, gradient, bends, inverses):
    """
    Write the right-hand sides of the offset and slowness across the plane, and of both coupled
    variations.
    """
    p, q, xi, eta = state
    slopes, beside = _SLOPES + 4 * stage, _BESIDE_SLOPES + _N_BESIDE * stage
    store(rows, beside, q * inverses[0])
    store(rows, beside + 1, gradient[1] * inverses[0])
    variation = xi, eta, load(rows, _NEXT_BESIDE + 2), load(rows, _NEXT_BESIDE + 3)
    _vary(rows, (slopes + 2, beside + 2), variation, (p, q), gradient, bends, inverses)
    variation = (
        load(rows, _NEXT_BESIDE + 4),
        load(rows, _NEXT_BESIDE + 5),
        load(rows, _NEXT_BESIDE + 6),
        load(rows, _NEXT_BESIDE + 7),
    )
    _vary(rows, (beside + 4, beside + 6), variation, (p, q), gradient, bends, inverses)


@inlined
def _vary(rows, first_rows, variation, slowness, gradient, bends, inverses):
    """
    Write the right-hand side of a coupled variation: in the plane and across it, to two pairs of
    rows.
    """
    dw, dp, dy, dq = varied(variation, slowness, gradient, bends, inverses)
    store(rows, first_rows[0], dw)
    store(rows, first_rows[0] + 1, dp)
    store(rows, first_rows[1], dy)
    store(rows, first_rows[1] + 1, dq)


@inlined
def _embedded(rows, i):
    """As `step.step_error`, for number i of the state."""
    k = _SLOPES + i
    return absolute(
        E1 * load(rows, k)
        + E3 * load(rows, k + 8)
        + E4 * load(rows, k + 12)
        + E5 * load(rows, k + 16)
        + E6 * load(rows, k + 20)
        + E7 * load(rows, k + 24)
    )


@inlined
def _step(s, data, rows, pos, h, across, state):
    """
    One step of Dormand and Prince; return the new state, and the smallest result of `_derivative`.
    """
    w, p, xi, eta = state
    w1, p1, xi1, eta1, room = w, p, xi, eta, pos + 1.0
    for stage in range(1, 7):
        dw, dp, dxi, deta = 0.0 * w, 0.0 * w, 0.0 * w, 0.0 * w
        for j in range(stage):
            a, k = A[stage, j], _SLOPES + 4 * j
            dw, dp = dw + a * load(rows, k), dp + a * load(rows, k + 1)
            dxi, deta = dxi + a * load(rows, k + 2), deta + a * load(rows, k + 3)
        w1, p1, xi1, eta1 = w + h * dw, p + h * dp, xi + h * dxi, eta + h * deta
        at_stage = stage, pos + C[stage] * h
        if across is not None:
            _move_beside(rows, stage, h)
        here = _derivative(s, data, rows, at_stage, (w1, p1, xi1, eta1), across)
        room = choose(here < room, here, room)
    return w1, p1, xi1, eta1, room


@inlined
def _move_beside(rows, stage, h):
    """Write the numbers of rays that leave the plane at a stage of a step."""
    for i in range(_N_BESIDE):
        change = A[stage, 0] * load(rows, _BESIDE_SLOPES + i)
        for j in range(1, stage):
            change = change + A[stage, j] * load(rows, _BESIDE_SLOPES + _N_BESIDE * j + i)
        store(rows, _NEXT_BESIDE + i, load(rows, _BESIDE + i) + h * change)


@inlined
def _to_level(s, z, down):
    """
    Length of the step of sixteen rays to just beyond the next level; as `trace._to_level`, but a
    level at the ray counts as one layer away.
    """
    last = s.depth.size - 1
    inside = choose(z < s.depth[0], s.depth[0], z)
    inside = choose(inside < s.depth[last], inside, s.depth[last])
    k, x = _level(s, inside)
    thickness = take(s.depth, k + 1.0) - inside + x
    gap = choose(down > 0.0, thickness - x, x)
    gap = choose(gap < 1e-3 * thickness, gap + thickness, gap)
    rate = absolute(down)
    return (gap + 1e-4 * thickness) / choose(rate < 1e-9, 1e-9, rate)


@kernel
def free_lanes(rows):
    """Remove all rays from the lanes."""
    for lane in range(WIDTH):
        rows[_RAY, lane] = -1.0


@kernel
def replace_rays(rows, k, first, last, other):
    """
    Replace rays first to last - 1 of the link in slot k in their lanes by another one (-1: none);
    return True if there are any.
    """
    any_ray = False
    for lane in range(WIDTH):
        if rows[_LINK, lane] == k and first <= rows[_RAY, lane] < last:
            rows[_RAY, lane] = other
            any_ray = True
    return any_ray


@kernel
def _is_awaited(ray):
    """True if a search waits for the ray of a lane; others are traced ahead."""
    return ray >= 0.0 and not at.MAX_AHEAD <= ray < 3 * at.MAX_AHEAD


@kernel
def _launch_next(flights, n_links, rows, lane, following):
    """
    Start the next ray that waits in a lane, with FLIGHT_NEXT or AHEAD_NEXT as following, if there
    is one.
    """
    for k in range(n_links):
        link = flights.links[k]
        if link[at.FLIGHT_LINK] < 0.0:
            continue
        i, last = int(link[following]), link[following + 1]
        while i < last and flights.rays[k, i, at.GOOD] != WAITING:
            i += 1
        link[following] = i + 1
        if i < last:
            node = flights.rays[k, i]
            rows[_LINK, lane], rows[_RAY, lane], rows[_STORE, lane] = k, i, link[at.FLIGHT_STORE]
            rows[_COLUMNS, lane], rows[_STEP, lane] = (
                link[at.FLIGHT_COLUMNS] - 2.0,
                link[at.FLIGHT_STEP],
            )
            rows[_PER_STEP, lane] = 1.0 / link[at.FLIGHT_STEP]
            rows[_SOURCE, lane], rows[_C_REF, lane] = link[at.FLIGHT_ENDS], link[at.FLIGHT_ENDS + 2]
            rows[_SPAN, lane] = link[at.FLIGHT_ENDS + 4]
            rows[_PER_SPAN, lane], rows[_GRADIENT, lane] = (
                1.0 / rows[_SPAN, lane],
                link[at.FLIGHT_GRADIENT],
            )
            rows[_CROSS, lane] = link[at.FLIGHT_CROSS]
            rows[_CROSS_GRADIENT, lane] = link[at.FLIGHT_CROSS_GRADIENT]
            rows[_ATTEMPTS, lane] = 1.0
            _launch(node, node[at.GROWTH], link[at.FLIGHT_LEVELS], rows, lane)
            break


@kernel
def _start(angle, q, rows, lane):
    """Put the initial state of a ray with a cross-track slowness and its derivative into a lane."""
    for row in (at.W, at.XI, _POS, _GONE, _GROWN, _TOP, _TOP_RATE, _LOW, _LOW_RATE):
        rows[row, lane] = 0.0
    p, h, gradient = math.sin(angle), math.cos(angle), rows[_GRADIENT, lane]
    rows[at.P, lane], rows[at.ETA, lane] = p, h
    rows[_SLOPES + at.W, lane], rows[_SLOPES + at.P, lane] = p / h, gradient / h
    rows[_SLOPES + at.XI, lane], rows[_SLOPES + at.ETA, lane] = (
        1.0 / (h * h),
        gradient * p / (h * h),
    )
    if rows[_CROSS, lane] > 0.0:
        for row in range(_BESIDE, _NEXT_BESIDE):
            rows[row, lane] = 0.0
        for row in range(_RATE_Q, _LOW_RATE_Q + 1):
            rows[row, lane] = 0.0
        rows[_SIDE, lane], rows[_Q_Q, lane] = q, 1.0
        along, side = math.sqrt(h * h - q * q), rows[_CROSS_GRADIENT, lane]
        cube = along * along * along
        rows[_SLOPES + at.W, lane], rows[_SLOPES + at.P, lane] = p / along, gradient / along
        rows[_SLOPES + at.XI, lane], rows[_SLOPES + at.ETA, lane] = (
            h / along + p * p * h / cube,
            gradient * p * h / cube,
        )
        slopes = _BESIDE_SLOPES - _BESIDE
        rows[slopes + _OFFSET, lane], rows[slopes + _SIDE, lane] = q / along, side / along
        rows[slopes + _Y_ANGLE, lane], rows[slopes + _Q_ANGLE, lane] = (
            q * p * h / cube,
            side * p * h / cube,
        )
        rows[slopes + _W_Q, lane], rows[slopes + _P_Q, lane] = p * q / cube, gradient * q / cube
        rows[slopes + _Y_Q, lane], rows[slopes + _Q_Q, lane] = (
            1.0 / along + q * q / cube,
            side * q / cube,
        )
    rows[_LENGTH, lane] = min(rows[_SPAN, lane], FIRST_STEP)


@kernel
def _launch(node, growth, to_levels, rows, lane):
    """
    Start a ray with an expected divergence in a lane that has the numbers of its link; steps of a
    diverging ray end at the levels.
    """
    _start(node[at.ANGLE], node[at.CROSS], rows, lane)
    levels = to_levels > 0.0 or growth > 0.0
    rows[_EXPECTED, lane], rows[_LEVELS, lane] = growth, 1.0 if levels else 0.0
    rows[_TOL, lane] = allowed(node[at.TOL], growth, levels) / rows[_SPAN, lane]


@kernel
def _fill(flights, n_links, rows):
    """
    Start rays in the free lanes; return the number of rays in all lanes that searches wait for.

    Such a ray takes the lane of one that is traced ahead if none is free. Level rays keep the
    remaining lanes busy.
    """
    running, used = 0, 0
    for turn in range(3):
        following = at.AHEAD_NEXT if turn == 2 else at.FLIGHT_NEXT
        for lane in range(WIDTH):
            if rows[_RAY, lane] < 0.0 or (turn == 1 and not _is_awaited(rows[_RAY, lane])):
                _launch_next(flights, n_links, rows, lane, following)
    for lane in range(WIDTH):
        if _is_awaited(rows[_RAY, lane]):
            running, used = running + 1, lane
    for lane in range(WIDTH if running > 0 else 0):
        if rows[_RAY, lane] < 0.0:
            for row in range(_LINK, _BESIDE):
                rows[row, lane] = rows[row, used]
            rows[_TOL, lane] = rows[_TOL, used]
            _start(0.0, 0.0, rows, lane)
    return running


@kernel
def _relay(flights, n_links, rows):
    """
    Write finished rays to their nodes, start rays again that need a smaller tolerance, and start
    new rays in the other lanes.

    Returns by how many fewer rays are in the lanes that searches wait for, and the number of links
    without another such ray. A failed ray remains WAITING or UNDER_WAY.
    """
    ended, ready = 0, 0
    for lane in range(WIDTH):
        if rows[_DONE, lane] == 0.0:
            continue
        # an empty lane traces a ray that nobody needs
        if rows[_RAY, lane] < 0.0:
            _start(0.0, 0.0, rows, lane)
            continue
        k = int(rows[_LINK, lane])
        link = flights.links[k]
        node = flights.rays[k, int(rows[_RAY, lane])]
        if rows[_DONE, lane] == _COME:
            # a ray that needs a smaller tolerance starts again
            crosses = rows[_CROSS, lane] > 0.0
            if crosses:
                _end_in_plane(node, rows, lane)
            target = link[at.FLIGHT_ENDS + 1] - link[at.FLIGHT_ENDS]
            miss, grown = rows[at.W, lane] - target, rows[_GROWN, lane] / rows[_SPAN, lane]
            may_repeat = crosses and rows[_ATTEMPTS, lane] < MOST_ATTEMPTS
            if may_repeat and astray(
                rows[_OFFSET, lane], miss, node[at.TOL], grown, rows[_SPAN, lane]
            ):
                rows[_ATTEMPTS, lane] += 1.0
                _launch(node, rows[_EXPECTED, lane], rows[_LEVELS, lane], rows, lane)
                continue
            left, expected = rows[_GONE, lane], rows[_EXPECTED, lane]
            if left == 0.0 and again(miss, node[at.TOL], grown, expected, True):
                _launch(node, grown, 1.0, rows, lane)
                continue
            # a finished ray writes its node
            node[at.MISS], node[at.SLOPE] = miss, rows[at.XI, lane]
            node[at.SLOWNESS], node[at.SLOWNESS_SLOPE] = rows[at.P, lane], rows[at.ETA, lane]
            node[at.GOOD], node[at.CODE], node[at.LEFT] = 1.0, 0.0, left
            node[at.LEFT_RATE], node[at.LEFT_BEND] = rows[_RATE, lane], rows[_BEND, lane]
            node[at.TOP], node[at.TOP_RATE] = rows[_TOP, lane], rows[_TOP_RATE, lane]
            node[at.LOW], node[at.LOW_RATE] = rows[_LOW, lane], rows[_LOW_RATE, lane]
            node[at.GROWTH] = grown
        # the search of the link waits for one ray less
        if _is_awaited(rows[_RAY, lane]):
            link[at.FLIGHT_PENDING] -= 1.0
            ready += 1 if link[at.FLIGHT_PENDING] == 0.0 else 0
            ended += 1
        # the lane takes a waiting ray, else one ahead, else none
        rows[_RAY, lane] = -1.0
        for following in (at.FLIGHT_NEXT, at.AHEAD_NEXT):
            if rows[_RAY, lane] < 0.0:
                _launch_next(flights, n_links, rows, lane, following)
        if rows[_RAY, lane] < 0.0:
            _start(0.0, 0.0, rows, lane)
        ended -= 1 if _is_awaited(rows[_RAY, lane]) else 0
    return ended, ready


@kernel
def _end_in_plane(node, rows, lane):
    """
    Let a ray end in the plane, to first order: change its end and its node's cross-track slowness.

    Its derivatives become those along the rays that end in the plane, as in `beside`.
    """
    change = rows[_OFFSET, lane] / rows[_Y_Q, lane]
    side = -rows[_Y_ANGLE, lane] / rows[_Y_Q, lane]
    node[at.CROSS] -= change
    node[at.SPREAD], node[at.CROSS_SLOPE] = rows[_Y_Q, lane] / rows[_SPAN, lane], side
    rows[at.W, lane] -= change * rows[_W_Q, lane]
    rows[at.P, lane] -= change * rows[_P_Q, lane]
    rows[at.XI, lane] += side * rows[_W_Q, lane]
    rows[at.ETA, lane] += side * rows[_P_Q, lane]
    rows[_RATE, lane] += side * rows[_RATE_Q, lane]
    rows[_BEND, lane] += side * rows[_BEND_Q, lane]
    rows[_TOP_RATE, lane] += side * rows[_TOP_RATE_Q, lane]
    rows[_LOW_RATE, lane] += side * rows[_LOW_RATE_Q, lane]


@kernel
def _under_ice(surface, flights, rows):
    """Remove the mark DONE from rays below varying ice."""
    for lane in range(WIDTH):
        link, r = flights.links[int(rows[_LINK, lane])], rows[_POS, lane]
        north = link[at.FLIGHT_LINE] + r * link[at.FLIGHT_LINE + 2]
        east = link[at.FLIGHT_LINE + 1] + r * link[at.FLIGHT_LINE + 3]
        if rows[_SOURCE, lane] + rows[at.W, lane] >= depth_at(surface, north, east):
            rows[_DONE, lane] = 0.0


@inlined
def _exit(rows, above, state, top, across):
    """
    Record the exit of rays from the water at an offset top (infinite: at their position), as
    `trace`; return the distance to it.
    """
    w, _, xi, _ = state
    dw, dp, dxi = load(rows, _SLOPES), load(rows, _SLOPES + 1), load(rows, _SLOPES + 2)
    back = (top - w) / dw
    back = choose(absolute(back) < math.inf, back, 0.0)
    rise, rate = dw + back * dp, -1.0 * (xi + back * dxi) / dw
    bend = (dxi + dp * rate) / rise
    store(rows, _RATE, choose(above, rate, load(rows, _RATE)))
    store(
        rows,
        _BEND,
        choose(above, choose((rise < 0.0) & (dw < 0.0), bend, math.nan), load(rows, _BEND)),
    )
    if across is not None:
        dw_q = load(rows, _BESIDE_SLOPES + 4)
        rate = -1.0 * (load(rows, _W_Q) + back * dw_q) / dw
        store(rows, _RATE_Q, choose(above, rate, load(rows, _RATE_Q)))
        store(rows, _BEND_Q, choose(above, (dw_q + dp * rate) / rise, load(rows, _BEND_Q)))
    return back


@inlined
def _note_extremes(rows, state, across):
    """
    Update the smallest and the largest offset of sixteen rays on their paths, with the derivatives
    there.
    """
    w, _, xi, _ = state
    top, low = load(rows, _TOP), load(rows, _LOW)
    if across is not None:
        beside = load(rows, _W_Q)
        store(rows, _TOP_RATE_Q, choose(w < top, beside, load(rows, _TOP_RATE_Q)))
        store(rows, _LOW_RATE_Q, choose(w > low, beside, load(rows, _LOW_RATE_Q)))
    store(rows, _TOP_RATE, choose(w < top, xi, load(rows, _TOP_RATE)))
    store(rows, _LOW_RATE, choose(w > low, xi, load(rows, _LOW_RATE)))
    store(rows, _TOP, choose(w < top, w, top))
    store(rows, _LOW, choose(w > low, w, low))


@inlined
def _loaded(rows):
    """State, position, step and other data of sixteen rays."""
    state = load(rows, at.W), load(rows, at.P), load(rows, at.XI), load(rows, at.ETA)
    return state, load(rows, _POS), load(rows, _LENGTH), load(rows, _GONE), load(rows, _GROWN)


@inlined
def _stored(rows, state, pos, h, gone, grown):
    """Store the values of `_loaded`."""
    for i in range(4):
        store(rows, i, state[i])
    store(rows, _POS, pos)
    store(rows, _LENGTH, h)
    store(rows, _GONE, gone)
    store(rows, _GROWN, grown)


@inlined
def _controlled(rows, h, left, room, width, across, levels):
    """
    Masks of steps that are accurate enough and of steps that are too short to continue, and the
    factor of the next length.

    For masks `levels` of rays whose steps end at the levels, the error of the variation, relative
    to the ray's length, counts as in `step.step_error`. Derivatives at the end of an accepted step
    become those at the start of the next.
    """
    error = h * (_embedded(rows, at.W) + left * _embedded(rows, at.P)) + 1e-300
    if any_lane(levels):
        width = choose(width < MIN_WIDTH, MIN_WIDTH, width)
        tube = h * load(rows, _TOL) / (FAN_TUBE * width) * _embedded(rows, at.XI)
        error = error + choose(levels, tube, 0.0)
    most = load(rows, _TOL) * h
    factor = root(root(most / error))
    forward = room > 0.0
    good = forward & (error < most)
    larger, smaller = 0.75 * factor, 0.9 * factor
    larger = choose(larger < 4.0, larger, 4.0)
    smaller = choose(forward & (smaller > 0.2), smaller, 0.2)
    for i in range(4):
        k = _SLOPES + i
        store(rows, k, choose(good, load(rows, k + 24), load(rows, k)))
    if across is not None:
        for k in range(_BESIDE_SLOPES, _BESIDE_SLOPES + _N_BESIDE):
            store(rows, k, choose(good, load(rows, k + 6 * _N_BESIDE), load(rows, k)))
    return good, choose(good, larger, smaller)


@shared
def march(domain, flights, n_links, across, data):
    """
    Trace waiting rays of the first n_links links as `search.shoot` does, until a lane is free and
    no ray of a link is to be traced.

    The other rays remain in their lanes for the next call. Rays that `search.shoot` must trace
    remain WAITING or UNDER_WAY. Lanes that would be free trace rays ahead, which end no call. With
    across, all rays leave the plane; for None, none does, and Numba omits the code for it.
    """
    rows, surface = flights.lanes, domain.surface
    flat = surface.depth.size == 1
    lowest = surface.depth[0, 0] if flat else math.inf
    running, ready = _fill(flights, n_links, rows), 0
    state, pos, h, gone, grown = _loaded(rows)
    while running == WIDTH or (running > 0 and ready == 0):
        # one step of all lanes, and where it is accepted
        length, levels = load(rows, _SPAN), load(rows, _LEVELS) > 0.0
        left = length - pos
        last = left < h * (1.0 + 1e-12)
        h = choose(last, left, h)
        w, p, xi, eta, room = _step(domain, data, rows, pos, h, across, state)
        good, factor = _controlled(
            rows, h, left, room, absolute(xi) * load(rows, _PER_SPAN), across, levels
        )
        failed = h < 1e-9 * length
        # accepted lanes move on
        state = (
            choose(good, w, state[0]),
            choose(good, p, state[1]),
            choose(good, xi, state[2]),
            choose(good, eta, state[3]),
        )
        if across is not None:
            for i in range(_N_BESIDE):
                store(
                    rows,
                    _BESIDE + i,
                    choose(good, load(rows, _NEXT_BESIDE + i), load(rows, _BESIDE + i)),
                )
        pos = choose(good, choose(last, length, pos + h), pos)
        h = h * factor
        # the next step ends at a level; extremes up to here
        source = load(rows, _SOURCE)
        if any_lane(levels):
            ahead = _to_level(domain, state[0] + source, load(rows, _SLOPES))
            h = choose(levels & (ahead < h), ahead, h)
        grown = choose(grown < absolute(state[2]), absolute(state[2]), grown)
        _note_extremes(rows, state, across)
        # rays that leave through the surface
        above = (state[0] < lowest - source) & (gone < 1e-300) & good
        if any_lane(above):
            if not flat:
                _stored(rows, state, pos, h, gone, grown)
                store(rows, _DONE, choose(above, _COME, 0.0))
                _under_ice(surface, flights, rows)
                above = load(rows, _DONE) > 0.0
            back = _exit(rows, above, state, lowest - source, across)
            gone = choose(above, pos + back, gone)
        # lanes with a finished or failed ray take the next one
        done = choose(good & last, _COME, choose(failed, _FAILED, 0.0))
        if any_lane(done > 0.0):
            _stored(rows, state, pos, h, gone, grown)
            store(rows, _DONE, done)
            ended, more = _relay(flights, n_links, rows)
            running, ready = running - ended, ready + more
            state, pos, h, gone, grown = _loaded(rows)

"""
Integration of eight direct rays of a fan at a time through a SMOOTH section, each with its own steps.

Equations, formula and error control are those of `step` and `trace`. The eight rays share only the processor's instructions. When a
ray reaches the end, the next ray takes its lane. `trace` traces rays that fail here.
"""

import math

from pymantaray.acoustics._kernels import layout as at
from pymantaray.acoustics._kernels.boundary import surface_at
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
    root,
    store,
    take,
)
from pymantaray.acoustics._kernels.step import E1, E3, E4, E5, E6, E7, FAN_TUBE, LEAST_WIDTH, A, C
from pymantaray.compile import inlined, kernel

# Rows of the workspace: state, its derivatives at the seven stages of a step, and data of each ray
_SLOPES, _POS, _LENGTH, _GONE, _GROWN, _DONE, _RAY, _NEXT, _RATE, _BEND, _TOL, _EXPECTED = 4, *range(32, 43)
_TOP, _TOP_RATE, _LOW, _LOW_RATE = range(43, 47)
FIRST_STEP = 60.0  # m
_COME, _FAILED = 1.0, 2.0
# Errors on the path of a ray grow with its divergence, relative to straight rays.
_DIVERGING = 3.0  # divergence above which a ray needs a smaller tolerance
_HOPELESS = 1e3  # divergence above which rays are too weak to be arrivals
# the tolerance decreases by _AMPLIFIED times the divergence, which counts up to _DIVERGENCE_LIMIT
_AMPLIFIED, _DIVERGENCE_LIMIT = 2.0, 30.0
_AT_LEVELS = (
    10.0  # factor of the tolerance if steps end at the levels: errors are then a fiftieth of their estimate
)
ERRING = 100.0  # distance from the receiver beyond which errors do not matter, in tolerances times divergence


@kernel
def allowed(tol, growth, to_levels):
    """Tolerance of the steps of a ray with an expected divergence ``growth``; to_levels: steps end at the levels."""
    diverges = _DIVERGING < growth < _HOPELESS
    if to_levels:
        return tol * _AT_LEVELS / min(growth, _AT_LEVELS) if diverges else tol * _AT_LEVELS
    return tol / (_AMPLIFIED * min(growth, _DIVERGENCE_LIMIT)) if diverges else tol


@kernel
def needs_more(miss, tol, growth, expected):
    """True if a ray near the receiver diverges strongly and needs a smaller tolerance."""
    return max(_DIVERGING, 1.5 * expected) <= growth <= _HOPELESS and abs(miss) <= ERRING * tol * growth


@inlined
def _level(s, z):
    """Layers of eight rays, and their depths in the layers; as `field.find_level`."""
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
def _derivative(s, rows, slopes, pos, state, axis):
    """Write the right-hand side of eight rays to the rows from slopes; return (h c)^2 minus its lower limit."""
    w, p, xi, eta = state
    z_source, c_ref = axis
    last = s.depth.size - 1
    top, low = s.depth[0], s.depth[last]
    z = w + z_source
    inside = choose(z < top, top, z)
    inside = choose(inside < low, inside, low)
    k, x = _level(s, inside)
    t = pos * (1.0 / s.r_step)
    column = floor(t)
    column = choose(column < s.n_range - 2.0, column, s.n_range - 2.0)
    t = t - column
    stride = s.data.shape[1] * 16
    u = 1.0 - t
    weights = (
        u * u * (1.0 + 2.0 * t),
        u * u * t * s.r_step,
        t * t * (3.0 - 2.0 * t),
        t * t * u * (-s.r_step),
    )
    a0, a1, a2, a3 = blend(s.data, column * float(stride) + 16.0 * k, stride, weights)
    c = a0 + x * (a1 + x * (a2 + x * a3))
    cz = a1 + x * (2.0 * a2 + 3.0 * x * a3)
    czz = 2.0 * a2 + 6.0 * x * a3
    beyond = z - inside
    if any_lane(absolute(beyond) > 0.0):
        scale = choose(beyond < 0.0, ABOVE_SCALE, BELOW_SCALE)
        q = beyond / scale
        f = 1.0 / (1.0 + q * q)
        g = root(f)
        czz = choose(absolute(beyond) > 0.0, -3.0 * q * f * f * g * cz / scale, czz)
        c = c + beyond * g * cz
        cz = f * g * cz
    least = 1e-6 * c * c
    square = c_ref * c_ref - c * c * (p * p)
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
    store(rows, slopes + 2, (ih + p * p * ih3) * eta - p * nnw * ih3 * xi)
    store(rows, slopes + 3, ((nw * nw + n * nww) * ih - nnw * nnw * ih3) * xi + nnw * p * ih3 * eta)
    return room


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
def _step(s, rows, pos, h, state, first_stage, axis):
    """One step of Dormand and Prince; return the new state, and the smallest result of `_derivative`."""
    w, p, xi, eta = state
    w1, p1, xi1, eta1, room = w, p, xi, eta, pos + 1.0
    for stage in range(first_stage, 7):
        dw, dp, dxi, deta = 0.0 * w, 0.0 * w, 0.0 * w, 0.0 * w
        for j in range(stage):
            a, k = A[stage, j], _SLOPES + 4 * j
            dw, dp = dw + a * load(rows, k), dp + a * load(rows, k + 1)
            dxi, deta = dxi + a * load(rows, k + 2), deta + a * load(rows, k + 3)
        w1, p1, xi1, eta1 = w + h * dw, p + h * dp, xi + h * dxi, eta + h * deta
        here = _derivative(s, rows, _SLOPES + 4 * stage, pos + C[stage] * h, (w1, p1, xi1, eta1), axis)
        room = choose(here < room, here, room)
    return w1, p1, xi1, eta1, room


@inlined
def _to_level(s, z, down):
    """Length of the step of eight rays to just beyond the next level; as `trace._to_level`, but a level at the ray counts as one layer away."""
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
def _launch(rows, lane, fan, n_rays, course):
    """Start the next ray of the fan in a lane, or repeat the first ray after the last; return True for a new ray."""
    ray = int(rows[_NEXT, 0])
    rows[_NEXT, 0] += 1.0
    node = fan[ray if ray < n_rays else 0]
    angle = node[at.ANGLE]
    for row in (at.W, at.XI, _POS, _GONE, _GROWN, _TOP, _TOP_RATE, _LOW, _LOW_RATE):
        rows[row, lane] = 0.0
    rows[at.P, lane], rows[at.ETA, lane] = math.sin(angle), math.cos(angle)
    rows[_LENGTH, lane], rows[_RAY, lane] = min(course.length, FIRST_STEP), ray
    rows[_EXPECTED, lane] = node[at.GROWTH]
    rows[_TOL, lane] = allowed(node[at.TOL], node[at.GROWTH], course.to_levels) / course.length
    return ray < n_rays


@kernel
def _relay(rows, fan, n_rays, course):
    """Write finished and failed rays to their nodes and start new rays in their lanes; return the change of the number of active rays."""
    change = 0
    for lane in range(WIDTH):
        if rows[_DONE, lane] == 0.0:
            continue
        if rows[_RAY, lane] < n_rays:
            node = fan[int(rows[_RAY, lane])]
            node[at.MISS], node[at.SLOPE] = rows[at.W, lane] - course.target, rows[at.XI, lane]
            node[at.SLOWNESS], node[at.SLOWNESS_SLOPE] = rows[at.P, lane], rows[at.ETA, lane]
            node[at.GOOD], node[at.CODE] = 1.0 if rows[_DONE, lane] == _COME else 0.0, 0.0
            node[at.LEFT] = rows[_GONE, lane]
            node[at.LEFT_RATE], node[at.LEFT_BEND] = rows[_RATE, lane], rows[_BEND, lane]
            node[at.TOP], node[at.TOP_RATE] = rows[_TOP, lane], rows[_TOP_RATE, lane]
            node[at.LOW], node[at.LOW_RATE] = rows[_LOW, lane], rows[_LOW_RATE, lane]
            node[at.GROWTH] = rows[_GROWN, lane] / course.length
            more = needs_more(node[at.MISS], node[at.TOL], node[at.GROWTH], rows[_EXPECTED, lane])
            if node[at.LEFT] == 0.0 and more:
                node[at.GOOD] = 0.0
            change -= 1
        if _launch(rows, lane, fan, n_rays, course):
            change += 1
    return change


@kernel
def _under_ice(walls, rows, z_source):
    """Remove the mark DONE from rays below varying ice."""
    for lane in range(WIDTH):
        r = rows[_POS, lane]
        if z_source + rows[at.W, lane] >= surface_at(walls, r, 0.0, r)[0]:
            rows[_DONE, lane] = 0.0


@inlined
def _exit(rows, above, state, top):
    """Record the exit of rays from the water at an offset top (NaN: at their position), as `trace`; return the distance to it."""
    w, _, xi, _ = state
    dw, dp, dxi = load(rows, _SLOPES), load(rows, _SLOPES + 1), load(rows, _SLOPES + 2)
    back = (top - w) / dw
    back = choose(absolute(back) < math.inf, back, 0.0)
    rise, rate = dw + back * dp, -1.0 * (xi + back * dxi) / dw
    bend = (dxi + dp * rate) / rise
    store(rows, _RATE, choose(above, rate, load(rows, _RATE)))
    store(rows, _BEND, choose(above, choose((rise < 0.0) & (dw < 0.0), bend, math.nan), load(rows, _BEND)))
    return back


@inlined
def _note_extremes(rows, state):
    """Update the smallest and the largest offset of eight rays on their paths, with the derivatives there."""
    w, _, xi, _ = state
    top, low = load(rows, _TOP), load(rows, _LOW)
    store(rows, _TOP_RATE, choose(w < top, xi, load(rows, _TOP_RATE)))
    store(rows, _LOW_RATE, choose(w > low, xi, load(rows, _LOW_RATE)))
    store(rows, _TOP, choose(w < top, w, top))
    store(rows, _LOW, choose(w > low, w, low))


@inlined
def _loaded(rows):
    """State, position, step and other data of eight rays."""
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
def _controlled(rows, h, left, room, width, to_levels):
    """
    Masks of steps that are accurate enough and of steps that are too short to continue, and the factor of the next length.

    If steps end at the levels, the error of the variation, relative to the ray's length, counts as in `step.step_error`. Derivatives at
    the end of an accepted step become those at the start of the next.
    """
    error = h * (_embedded(rows, at.W) + left * _embedded(rows, at.P)) + 1e-300
    if to_levels:
        width = choose(width < LEAST_WIDTH, LEAST_WIDTH, width)
        error = error + h * load(rows, _TOL) / (FAN_TUBE * width) * _embedded(rows, at.XI)
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
    return good, choose(good, larger, smaller)


@kernel
def march(s, walls, course, fan, n_rays, rows):
    """Trace rays of a fan from ANGLE, TOL and expected GROWTH into its rows as `search.shoot` does; GOOD is 0 for rays that it must trace."""
    z_source, _, _, c_ref = course.axis
    length = course.length
    flat = walls.surface.depth.size == 1
    lowest = walls.surface.depth[0, 0] if flat else math.inf
    running = 0
    rows[_NEXT, 0] = 0.0
    for lane in range(WIDTH):
        running += 1 if _launch(rows, lane, fan, n_rays, course) else 0
    state, pos, h, gone, grown = _loaded(rows)
    first_stage = 0
    while running > 0:
        left = length - pos
        last = left < h * (1.0 + 1e-12)
        h = choose(last, left, h)
        w, p, xi, eta, room = _step(s, rows, pos, h, state, first_stage, (z_source, c_ref))
        good, factor = _controlled(rows, h, left, room, absolute(xi) * (1.0 / length), course.to_levels)
        failed = h < 1e-9 * length
        state = (
            choose(good, w, state[0]),
            choose(good, p, state[1]),
            choose(good, xi, state[2]),
            choose(good, eta, state[3]),
        )
        pos = choose(good, choose(last, length, pos + h), pos)
        h = h * factor
        if course.to_levels:
            ahead = _to_level(s, state[0] + z_source, load(rows, _SLOPES))
            h = choose(ahead < h, ahead, h)
        grown = choose(grown < absolute(state[2]), absolute(state[2]), grown)
        _note_extremes(rows, state)
        above = (state[0] < lowest - z_source) & (gone < 1e-300) & good
        if any_lane(above):
            if not flat:
                _stored(rows, state, pos, h, gone, grown)
                store(rows, _DONE, choose(above, _COME, 0.0))
                _under_ice(walls, rows, z_source)
                above = load(rows, _DONE) > 0.0
            back = _exit(rows, above, state, lowest - z_source if flat else math.nan)
            gone = choose(above, pos + back, gone)
        done = choose(good & last, _COME, choose(failed, _FAILED, 0.0))
        first_stage = 1
        if any_lane(done > 0.0):
            _stored(rows, state, pos, h, gone, grown)
            store(rows, _DONE, done)
            running += _relay(rows, fan, n_rays, course)
            state, pos, h, gone, grown = _loaded(rows)
            first_stage = 0

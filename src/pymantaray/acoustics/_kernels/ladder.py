"""
Rays of a fan through layered water, each layer computed once for all cycles and reflections.

A ray of one launch angle covers the same range between two depths in every cycle. The levels above
and below the source are the two sides of a ladder, from the source outwards. With the ray parameter
``a = cos(theta) / c`` and the sines s and s' of a ray's angle at both faces of a layer, ``t = h (c
+ c') / (s s' (s + s'))`` gives the range ``a s s' t`` and its derivative ``t`` by a. These loops
over layers have no branches, so the compiler uses vectors. `curves` continues a ray from the last
level before its end.
"""

import math
from collections import namedtuple

from pymantaray.acoustics._kernels import layout as at
from pymantaray.acoustics._kernels.curves import (
    State,
    ahead,
    arrive_on_arc,
    edges,
    fits_curves,
    is_straight,
    launch,
    layer_of,
    monotonic_end,
    note_exit,
    note_turn,
    piece_at,
    sine_at,
    speed_in,
    to_face,
    trace_curves,
    turn_back,
    walk,
)
from pymantaray.acoustics._kernels.trace import fan_ray
from pymantaray.compile import inlined, kernel, out_of_line, shared

# Rows of work.ladder. Levels of both sides: square of c at the source minus that of c, its minimum
# up to here, depth, sound speed. Layers: h (c + c') of LINEAR water, number of its piece. For each
# ray: sines at the levels of a block, range and its derivative by a of the layers, and both from
# the source to each block.
# Sizes: 1 if the ladder can be used, first level and number of layers of each side, level of the
# surface or -1, and first block of each side.
(
    _DROP,
    _LEAST,
    _DEPTH,
    _SPEED,
    _WEIGHT,
    _SINE,
    _RANGE,
    _RATE,
    _TO_BLOCK,
    _RATE_TO_BLOCK,
    _SIZES,
    _PIECE,
) = range(at.N_LADDER)
# Rows of a block of layers of SMOOTH water: as _DROP at both faces, sound speed at the first one,
# thickness, coefficients of the cubic by the share of the layer, squared sine below which a layer
# is too bent, range and its derivative by a for a ray, and 1 if the layer must be divided.
_FIRST, _SECOND, _START, _THICK, _LINE, _SQUARE, _CUBE, _BENT, _LAYER_RANGE, _LAYER_RATE, _ROUGH = (
    range(at.N_LAYER)
)
_BLOCK = at.BLOCK  # layers
_BLOCK_SIZE = at.N_LAYER * _BLOCK
_MOST_CROSSINGS = 64  # of the source's depth; a ray with more of them is traced layer by layer
_LEVEL_LAUNCH = 1e-9  # a ray with a smaller sine is traced layer by layer
_MIN_SINE = 1e-12
_BESIDE = 2e-8  # rad; distance of a node from the angle of a level
_RESOLVED = 1e-4  # rad; a wider interval of a fan has a ray in its middle
_CURVED = -1.0  # instead of the weight of a layer below the levels of LINEAR water
_LAYERS_BEYOND = 2, 14  # without water, and of the extension of `field`
# limits of a layer in one part with four nodes: `curves`
_BEND, _STEEPER = 0.2, 2.0
_NODES = (
    0.06943184420297371,
    0.33000947820757187,
    0.6699905217924281,
    0.9305681557970262,
)
_WEIGHTS = (
    0.17392742256872692,
    0.32607257743127305,
    0.32607257743127305,
    0.17392742256872692,
)

Side = namedtuple("Side", "layers turns total total_rate to_end rate_to_end")
Side.__doc__ = """Part of a ray on one side of the source's depth: number of layers that it crosses,
True if it turns beyond them, and their range and the range to the turning point or boundary, with
their derivatives by a."""


@kernel
def put_ladder(s, walls, course, work):
    """
    Write the levels above and below the source, the extrema between them, and the first layers
    beyond them to work.ladder, if rays of a fan can use them.
    """
    edge, c_ref, z_source = edges(walls, course), course.axis.c_ref, course.axis.z_source
    ladder, sizes, i = work.ladder, work.ladder[_SIZES], 0
    sizes[0], sizes[5], sizes[6], sizes[7] = 0.0, -1.0, 0.0, 0.0
    if course.rule.kind == at.LEGS or not fits_curves(s, walls, course, math.inf, 0.0):
        return
    level_bed = s.kind == at.LINEAR and s.layered != at.DEEPER
    beyond = _LAYERS_BEYOND[0] if level_bed else _LAYERS_BEYOND[1]
    # first the levels above the source, then those below it
    for side in range(2):
        first, k, least = i, layer_of(s, z_source), 0.0
        state = State(z_source, c_ref, 2.0 * side - 1.0, 0.0, 0.0, 0.0)
        while i < ladder.shape[1] - 2:
            # row of a level, with the least drop so far
            z, c = state.depth, state.speed
            ladder[_DEPTH, i], ladder[_SPEED, i] = z, c
            ladder[_DROP, i] = (c_ref - c) * (c_ref + c)
            least = min(least, ladder[_DROP, i])
            ladder[_LEAST, i] = least
            if side == 0 and z == edge[0]:
                sizes[5] = i - first
            # the next layer that does not end at the level
            piece, face = ahead(s, k, state, *edge)
            while face == z and -beyond < k < s.depth.size - 2 + beyond:
                k += -1 if side == 0 else 1
                piece, face = ahead(s, k, state, *edge)
            if face == z or (z == edge[side] and course.rule.kind == at.FORWARD):
                break
            # row of the layer, to its end or to its extremum
            end = monotonic_end(piece, z, face)
            c_end = speed_in(piece, end)[0]
            ladder[_PIECE, i], ladder[_WEIGHT, i] = k, abs(end - z) * (c + c_end)
            if s.kind == at.SMOOTH:
                j, place = (i - first) % _BLOCK, int(sizes[6 + side]) + (i - first) // _BLOCK
                rows = work.layers[place * _BLOCK_SIZE : (place + 1) * _BLOCK_SIZE]
                _put_layer(rows, j, piece, (z, c), (end, c_end), c_ref)
            elif not is_straight(piece):
                ladder[_WEIGHT, i] = _CURVED
            state = State(end, c_end, state.sine, 0.0, 0.0, 0.0)
            i += 1
        sizes[1 + 2 * side], sizes[2 + 2 * side] = first, i - first
        if side == 0:
            sizes[7] = (i - first + _BLOCK - 1) // _BLOCK
        i += 1
    sizes[0] = 1.0


@kernel
def _put_layer(rows, j, piece, start, last, c_ref):
    """Write layer j of a block, between two depths of a piece with their sound speeds."""
    z, c = start
    end, c_end = last
    h = end - z
    _, d1, d2, d3 = speed_in(piece, z)
    rows[_FIRST * _BLOCK + j] = (c_ref - c) * (c_ref + c)
    rows[_SECOND * _BLOCK + j] = (c_ref - c_end) * (c_ref + c_end)
    rows[_START * _BLOCK + j], rows[_THICK * _BLOCK + j] = c, abs(h)
    rows[_LINE * _BLOCK + j], rows[_SQUARE * _BLOCK + j] = d1 * h, 0.5 * d2 * h * h
    rows[_CUBE * _BLOCK + j] = d3 * h * h * h / 6.0
    departure = abs(0.5 * d2 * h * h) + 0.25 * abs(d3 * h * h * h)
    rows[_BENT * _BLOCK + j] = departure / c / _BEND if piece.scale == 0.0 else math.inf


@kernel
def _least_range(height, slowest, fastest):
    """
    Range of a straight ray over a height, as steep as a ray in the slowest water that turns in the
    fastest.
    """
    return height * slowest / math.sqrt((fastest - slowest) * (fastest + slowest))


@kernel
def add_turning_angles(s, lo, hi, link, n, nodes):
    """
    Append to the first n nodes two launch angles beside each angle at which rays turn at a level of
    a layered section.

    The miss is smooth between these angles and may jump at them. Rays that turn beyond the range of
    the receiver do not count. A ray turns only at a level with a higher sound speed than all levels
    between it and the source. Its range there is at least that of a straight ray with the steepest
    angle between them. Returns the number of nodes.
    """
    z, c0 = link.z0, link.c0
    below = min(layer_of(s, z), s.depth.size - 1) + 1
    for step in (-1, 1):
        k = below if step == 1 else below - 1
        other = below - 1 if step == 1 else below
        slowest, fastest, slowest_back = c0, c0, c0
        while 0 <= k < s.depth.size and n < nodes.size - 4:
            c = s.data[0, k, 0]
            slowest = min(slowest, c)
            if c > fastest:
                fastest = c
                while 0 <= other < s.depth.size and s.data[0, other, 0] < c:
                    slowest_back = min(slowest_back, s.data[0, other, 0])
                    other -= step
                reach = _least_range(abs(s.depth[k] - z), slowest, c)
                around = reach
                if 0 <= other < s.depth.size:
                    around += 2.0 * _least_range(abs(s.depth[other] - z), slowest_back, c)
                angle = math.acos(c0 / c)
                if -angle - _BESIDE > lo and (reach if step < 0 else around) < link.horizontal:
                    nodes[n], nodes[n + 1] = -angle - _BESIDE, -angle + _BESIDE
                    n += 2
                if angle + _BESIDE < hi and (reach if step > 0 else around) < link.horizontal:
                    nodes[n], nodes[n + 1] = angle - _BESIDE, angle + _BESIDE
                    n += 2
            k += step
    return n


@kernel
def add_middles(n, nodes):
    """
    Add the middle of each interval of the fan that is wider than _RESOLVED; return the number of
    nodes.

    Beside the angle of a level, the miss may change so fast that it does not show how it changes
    between two levels.
    """
    wide = 0
    for i in range(1, n):
        wide += 1 if nodes[i] - nodes[i - 1] > _RESOLVED else 0
    wide = max(min(wide, 3 * nodes.size // 4 - n), 0)
    last, m = n - 1, n + wide
    n = m
    while m > last + 1:
        m -= 1
        nodes[m] = nodes[last]
        if nodes[last] - nodes[last - 1] > _RESOLVED:
            m -= 1
            nodes[m] = 0.5 * (nodes[last] + nodes[last - 1])
        last -= 1
    return n


@kernel
def _turning_level(least, first, layers, a2, start):
    """Number of layers of a side that a ray crosses before it turns in the next one, or all."""
    if not start + a2 * least[first + layers] < 0.0:
        return layers
    low, high = 0, layers
    while high - low > 1:
        middle = (low + high) // 2
        if start + a2 * least[first + middle] < 0.0:
            high = middle
        else:
            low = middle
    return low


@kernel
def _sweep(s, ladder, first, n, way, left):
    """
    Compute ranges and their derivatives of the first n layers of a side, until a block ends beyond
    the range left.

    Returns the number of layers, their range and its derivative.
    """
    a, start = way.a, way.sine_squared
    drop, weight, sine = ladder[_DROP], ladder[_WEIGHT], ladder[_SINE]
    ranges, rates = ladder[_RANGE], ladder[_RATE]
    a2, total, rate, done = a * a, 0.0, 0.0, 0
    while done < n and total < left:
        block = first + done // _BLOCK
        ladder[_TO_BLOCK, block], ladder[_RATE_TO_BLOCK, block] = total, rate
        begin, size = first + done, min(_BLOCK, n - done)
        for j in range(size + 1):
            sine[j] = math.sqrt(max(start + a2 * drop[begin + j], _MIN_SINE * _MIN_SINE))
        for j in range(size):
            product = sine[j] * sine[j + 1]
            t = weight[begin + j] / (product * (sine[j] + sine[j + 1]))
            rates[begin + j], ranges[begin + j] = t, a * product * t
        for j in range(begin, begin + size):
            if weight[j] == _CURVED:
                ranges[j], rates[j] = _across(s, ladder, j, way)
            total += ranges[j]
            rate += rates[j]
        done += size
    return done, total, rate


@kernel
def _sweep_block(rows, size, way):
    """
    Compute ranges and their derivatives of the layers of a block of SMOOTH water, by quadrature as
    `curves`. The loop has no branches, so the compiler uses vectors.
    """
    a, start, c_ref = way.a, way.sine_squared, way.c_ref
    a2, least = a * a, _MIN_SINE * _MIN_SINE
    for j in range(size):
        low = max(start + a2 * rows[_FIRST * _BLOCK + j], least)
        high = max(start + a2 * rows[_SECOND * _BLOCK + j], least)
        s0, s1, c0 = math.sqrt(low), math.sqrt(high), rows[_START * _BLOCK + j]
        d1, d2, d3 = (
            rows[_LINE * _BLOCK + j],
            rows[_SQUARE * _BLOCK + j],
            rows[_CUBE * _BLOCK + j],
        )
        inverse = 1.0 / (s0 + s1)
        to, by = 0.0, 0.0
        for q in range(4):
            line = s0 + (s1 - s0) * _NODES[q]
            t = _NODES[q] * (s0 + line) * inverse
            c = c0 + t * (d1 + t * (d2 + t * d3))
            square = max(start + a2 * (c_ref - c) * (c_ref + c), least)
            steep = 1.0 / math.sqrt(square)
            part = _WEIGHTS[q] * c * line * steep
            to += part
            by += part * (steep * steep)
        scale = 2.0 * rows[_THICK * _BLOCK + j] * inverse
        rows[_LAYER_RANGE * _BLOCK + j], rows[_LAYER_RATE * _BLOCK + j] = a * scale * to, scale * by
        nearest, farthest = min(low, high), max(low, high)
        steady = 1.0 if farthest < _STEEPER * _STEEPER * nearest else 0.0
        straight = 1.0 if rows[_BENT * _BLOCK + j] < nearest else 0.0
        rows[_ROUGH * _BLOCK + j] = 1.0 - steady * straight


@kernel
def _sweep_curves(s, work, side, n, way, left):
    """As `_sweep`, for the first n layers of a side of SMOOTH water."""
    ladder, total, rate, done = work.ladder, 0.0, 0.0, 0
    first, first_block = int(ladder[_SIZES, 1 + 2 * side]), int(ladder[_SIZES, 6 + side])
    while done < n and total < left:
        block = first + done // _BLOCK
        ladder[_TO_BLOCK, block], ladder[_RATE_TO_BLOCK, block] = total, rate
        begin, size = first + done, min(_BLOCK, n - done)
        place = (first_block + done // _BLOCK) * _BLOCK_SIZE
        rows = work.layers[place : place + _BLOCK_SIZE]
        _sweep_block(rows, size, way)
        for j in range(size):
            r, by = rows[_LAYER_RANGE * _BLOCK + j], rows[_LAYER_RATE * _BLOCK + j]
            if rows[_ROUGH * _BLOCK + j] != 0.0:
                r, by = _across(s, ladder, begin + j, way)
            ladder[_RANGE, begin + j], ladder[_RATE, begin + j] = r, by
            total += r
            rate += by
        done += size
    return done, total, rate


@inlined
def _at_level(ladder, way, level, sign):
    """State of a ray at a level, without its range."""
    c = ladder[_SPEED, level]
    return State(ladder[_DEPTH, level], c, sign * sine_at(way, c), 0.0, 0.0, 0.0)


@kernel
def _across(s, ladder, i, way):
    """Range of a curved layer and its derivative, from parts of the layer."""
    z, end = ladder[_DEPTH, i], ladder[_DEPTH, i + 1]
    piece = piece_at(s, int(ladder[_PIECE, i]))
    state = _at_level(ladder, way, i, 1.0 if end > z else -1.0)
    after, _, _ = to_face(piece, way, state, end)
    return after.range, after.rate


@kernel
def _to_turn(s, course, ladder, side, n, way, y):
    """
    Range of a ray from the last level before its turning depth to this depth, and its derivative.
    """
    level = int(ladder[_SIZES, 1 + 2 * side]) + n
    state = _at_level(ladder, way, level, 2.0 * side - 1.0)
    piece = piece_at(s, int(ladder[_PIECE, level]))
    if s.kind == at.LINEAR and is_straight(piece):
        a, g, size = way.a, abs(piece.c1), abs(state.sine)
        return size / (a * g), -1.0 / (a * a * g * size)
    after, turned, turn = to_face(piece, way, state, ladder[_DEPTH, level + 1])
    if turned:
        note_turn(course, way, turn, 2.0 * side - 1.0, y)
    return after.range, after.rate


@kernel
def _note_top(course, ladder, way, point, n, y):
    """
    Record the exit of a direct ray from the water, if it crosses the surface among n layers.

    point contains the range at the source's depth and its derivative by a.
    """
    top, first = int(ladder[_SIZES, 5]), int(ladder[_SIZES, 1])
    if course.rule.kind != at.OPEN or y[at.GONE] > 0.0 or not 0 < top <= n:
        return
    r, rate = point
    for i in range(first, first + top):
        r += ladder[_RANGE, i]
        rate += ladder[_RATE, i]
    if r < course.length:
        here = _at_level(ladder, way, first + top, -1.0)
        note_exit(way, State(here.depth, here.speed, here.sine, r, rate, 0.0), y)


@kernel
def _layer_of(ladder, first, n, target):
    """Layer of a side at a range from the source, and the range to it and its derivative."""
    block, last = 0, (n - 1) // _BLOCK
    while block < last and ladder[_TO_BLOCK, first + block + 1] < target:
        block += 1
    total, rate = ladder[_TO_BLOCK, first + block], ladder[_RATE_TO_BLOCK, first + block]
    i = block * _BLOCK
    while i < n - 1 and total + ladder[_RANGE, first + i] < target:
        total += ladder[_RANGE, first + i]
        rate += ladder[_RATE, first + i]
        i += 1
    return i, total, rate


@kernel
def _arrive_from(s, walls, course, ladder, way, last, ray):
    """
    Continue a ray from the last level before the end of the course; return True if it arrives, and
    the code of its reflections.

    last contains range and its derivative by a there, the sign of the sine, the level, the layer
    beyond it, and the reflections.
    """
    r, rate, sign, level, layer, reflections = last
    here = _at_level(ladder, way, level, sign)
    here = State(here.depth, here.speed, here.sine, r, rate, 0.0)
    k = int(ladder[_PIECE, layer])
    piece = piece_at(s, k)
    if s.kind == at.LINEAR and is_straight(piece):
        arrive_on_arc(course, piece, way, here, ray)
        return True, reflections.code
    ok, _, _, code = walk(s, walls, course, way, (k, here, reflections), ray)
    return ok, code


@kernel
def _side(s, course, side, way, point, work):
    """
    Compute the part of a ray on one side of the source's depth, which it enters at a point (range
    and its derivative by a); see `Side`.
    """
    r, rate = point
    ladder, y = work.ladder, work.y
    first, layers = int(ladder[_SIZES, 1 + 2 * side]), int(ladder[_SIZES, 2 + 2 * side])
    a, start, left = way.a, way.sine_squared, course.length - r
    full = _turning_level(ladder[_LEAST], first, layers, a * a, start)
    if s.kind == at.SMOOTH:
        n, total, total_rate = _sweep_curves(s, work, side, full, way, left)
    else:
        n, total, total_rate = _sweep(s, ladder, first, full, way, left)
    if side == 0:
        _note_top(course, ladder, way, (r, rate), n, y)
    turns, to_end, rate_to_end = full < layers, total, total_rate
    if turns and n == full and total < left:
        more, more_rate = _to_turn(s, course, ladder, side, n, way, y)
        to_end, rate_to_end = total + more, total_rate + more_rate
    return Side(n, turns, total, total_rate, to_end, rate_to_end)


@kernel
def _arrival(ladder, side, here, point, left):
    """
    Last level before the end of a ray on one side, if it ends there: range there and its derivative
    by a, the sign of the sine, the level and the layer beyond it; a layer of -1 if it does not.
    """
    r, rate = point
    first, sign = int(ladder[_SIZES, 1 + 2 * side]), 2.0 * side - 1.0
    if left <= here.total:  # on the way out
        i, before, rate_before = _layer_of(ladder, first, here.layers, left)
        return r + before, rate + rate_before, sign, first + i, first + i
    if here.turns and left <= 2.0 * here.to_end - here.total:  # about the turning point
        level = first + here.layers
        return r + here.total, rate + here.total_rate, sign, level, level
    if left <= 2.0 * here.to_end:  # on the way back
        i, before, rate_before = _layer_of(ladder, first, here.layers, 2.0 * here.to_end - left)
        before += ladder[_RANGE, first + i]
        rate_before += ladder[_RATE, first + i]
        back, rate_back = (
            r + 2.0 * here.to_end - before,
            rate + 2.0 * here.rate_to_end - rate_before,
        )
        return back, rate_back, -sign, first + i + 1, first + i
    return r, rate, sign, 0, -1


@shared
def trace_ladder(s, walls, course, angle, work):
    """
    Trace a ray of a fan with the ladder of its link; return True if it reaches the end, and the
    code of its reflections.
    """
    out_of_line()
    ladder, ray = work.ladder, fan_ray(work)
    way, state = launch(s, course, angle, ray.y)
    side = 1 if state.sine > 0.0 else 0
    possible = abs(state.sine) > _LEVEL_LAUNCH and ladder[_SIZES, 2 + 2 * side] > 0.0
    r, rate, reflections = 0.0, 0.0, at.Reflections(0, 0, 0)
    here = other = Side(0, False, 0.0, 0.0, 0.0, 0.0)
    for crossing in range(_MOST_CROSSINGS if possible else 0):
        if crossing < 2:
            here = _side(s, course, side, way, (r, rate), work)
        left = course.length - r
        on_the_way_out = left <= here.total or (
            here.turns and left <= 2.0 * here.to_end - here.total
        )
        if not here.turns and not on_the_way_out:
            if course.rule.kind == at.OPEN:
                break
            hit = at.AT_BOTTOM if side == 1 else at.AT_SURFACE
            ok, reflections = turn_back(walls, course.rule, ray, r + here.total, hit, reflections)
            if not ok:
                return False, reflections.code
        last = _arrival(ladder, side, here, (r, rate), left)
        if last[4] >= 0:
            return _arrive_from(s, walls, course, ladder, way, (*last, reflections), ray)
        r += 2.0 * here.to_end
        rate += 2.0 * here.rate_to_end
        side = 1 - side
        here, other = other, here
    ok, _, _, code = trace_curves(s, walls, course, angle, ray)
    return ok, code


@kernel
def has_ladder(work):
    """True if the rays of the fan have a ladder."""
    return work.ladder[_SIZES, 0] > 0.0

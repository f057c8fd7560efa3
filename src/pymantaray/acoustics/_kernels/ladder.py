"""
Rays of a fan through layered water, each layer computed once for all cycles and reflections.

A ray of one launch angle covers the same range between two depths in every cycle. The levels above
and below the source are the two sides of a ladder, from the source outwards. With the ray parameter
``a = cos(theta) / c`` and the sines s and s' of a ray's angle at both faces of a layer, ``t = h (c
+ c') / (s s' (s + s'))`` gives the range ``a s s' t`` and its derivative ``t`` by a. These loops
over layers have no branches, so the compiler uses vectors. The search of the end of a ray is that
of `arcs`, from the last level before it.
"""

import math

from pymantaray.acoustics._kernels import layout as at
from pymantaray.acoustics._kernels.arcs import (
    arrive,
    bounded,
    fits,
    layer_at,
    trace_arcs,
    turn_back,
)
from pymantaray.acoustics._kernels.field import find_level
from pymantaray.acoustics._kernels.trace import fan_ray
from pymantaray.compile import kernel, out_of_line, shared

# Rows of work.ladder. Levels of both sides: square of c at the source minus that of c, its minimum
# up to here, depth, sound speed. Layers: h (c + c'), gradient. For each ray: sines at the levels of
# a block, range and its derivative by a of the layers, and both from the source to each block.
# Sizes: 1 if the ladder can be used, then first level and number of layers of each side.
(
    _DROP,
    _LEAST,
    _DEPTH,
    _SPEED,
    _WEIGHT,
    _GRADIENT,
    _SINE,
    _RANGE,
    _RATE,
    _TO_BLOCK,
    _RATE_TO_BLOCK,
    _SIZES,
) = range(at.N_LADDER)
_BLOCK = 32  # layers
_MOST_CROSSINGS = 64  # of the source's depth; a ray with more of them is traced layer by layer
_LEVEL_LAUNCH = 1e-9  # a ray with a smaller sine is traced layer by layer
_MIN_SINE = 1e-12
_BESIDE = 2e-8  # rad; distance of a node from the angle of a level
_RESOLVED = 1e-4  # rad; a wider interval of a fan has a ray in its middle


@kernel
def _water(walls, course):
    """Depths between which rays stay: the water if they are reflected."""
    if course.rule.kind == at.FORWARD:
        return walls.surface.depth[0, 0], walls.bed.depth[0, 0]
    return -math.inf, math.inf


@kernel
def put_ladder(s, walls, course, work):
    """Write the levels above and below the source to work.ladder, if rays of a fan can use them."""
    ladder, z_source, c_ref = work.ladder, course.axis.z_source, course.axis.c_ref
    sizes = ladder[_SIZES]
    sizes[0] = 0.0
    if not fits(s, walls, course, 0.0):
        return
    top, bottom = _water(walls, course)
    i = 0
    for side in range(2):
        first = i
        k, z, c, least = find_level(s, z_source), z_source, c_ref, 0.0
        while True:
            ladder[_DEPTH, i], ladder[_SPEED, i] = z, c
            ladder[_DROP, i] = (c_ref - c) * (c_ref + c)
            least = min(least, ladder[_DROP, i])
            ladder[_LEAST, i] = least
            inside = z > top if side == 0 else z < bottom
            before = z
            while inside and z == before and -3 < k < s.depth.size + 1:
                z0, z1, c0, c1, g = bounded(layer_at(s, k), top, bottom)
                z, c = (z0, c0) if side == 0 else (z1, c1)
                ladder[_GRADIENT, i] = g
                k += -1 if side == 0 else 1
            if z == before:
                break
            ladder[_WEIGHT, i] = abs(z - before) * (ladder[_SPEED, i] + c)
            i += 1
        sizes[1 + 2 * side], sizes[2 + 2 * side] = first, i - first
        i += 1
    sizes[0] = 1.0


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
    below = find_level(s, z) + 1
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
def _sweep(ladder, first, n, a, start, left):
    """
    Compute ranges and their derivatives of the first n layers of a side, until a block ends beyond
    the range left.

    Returns the number of layers, their range and its derivative.
    """
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
        for j in range(size):
            total += ranges[begin + j]
            rate += rates[begin + j]
        done += size
    return done, total, rate


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
def _arrive_from(course, ladder, way, point, level, layer, ray):
    """
    Write the state of a ray at the end of the course, from the last level before it.

    point contains range and its derivative by a there, and the sign of the sine.
    """
    r, rate, sign = point
    z, c = ladder[_DEPTH, level], ladder[_SPEED, level]
    sine = sign * math.sqrt(
        max(way.sine_squared + way.a * way.a * ladder[_DROP, level], _MIN_SINE**2)
    )
    dcos = way.da * c
    here = at.ArcPoint(z, c, sine, way.a * c)
    rates = at.ArcRates(-(way.a * c) * dcos / sine, dcos, way.da * rate)
    arrive(course, here, rates, way, ladder[_GRADIENT, layer], (r, 0.0, 0), ray)


@shared
def trace_ladder(s, walls, course, angle, work):
    """
    Trace a ray of a fan with the ladder of its link; return True if it reaches the end, and the
    code of its reflections.
    """
    out_of_line()
    ladder, y, ray, length = work.ladder, work.y, fan_ray(work), course.length
    sizes, c_ref = ladder[_SIZES], course.axis.c_ref
    sine, cosine = math.sin(angle), math.cos(angle)
    way = at.Snell(cosine / c_ref, -sine / c_ref, sine * sine, c_ref)
    a = way.a
    side = 1 if sine > 0.0 else 0
    y[at.GONE], y[at.GONE_RATE], y[at.GONE_BEND], y[at.GROWN] = 0.0, math.nan, math.nan, 0.0
    possible = abs(sine) > _LEVEL_LAUNCH and sizes[2 + 2 * side] > 0.0
    r, rate, reflections = 0.0, 0.0, at.Reflections(0, 0, 0)
    # of the side before: layers, their range and derivative, those to the turning point or
    # boundary, True if it turns
    n, turns, total, total_rate, to_end, rate_to_end = 0, False, 0.0, 0.0, 0.0, 0.0
    n1, turns1, total1, total_rate1, to_end1, rate_to_end1 = 0, False, 0.0, 0.0, 0.0, 0.0
    for crossing in range(_MOST_CROSSINGS if possible else 0):
        first, layers = int(sizes[1 + 2 * side]), int(sizes[2 + 2 * side])
        sign, left = 2.0 * side - 1.0, length - r
        if crossing < 2:
            full = _turning_level(ladder[_LEAST], first, layers, a * a, way.sine_squared)
            n, total, total_rate = _sweep(ladder, first, full, a, way.sine_squared, left)
            turns, to_end, rate_to_end = full < layers, total, total_rate
            if turns and n == full:
                steep = math.sqrt(
                    max(way.sine_squared + a * a * ladder[_DROP, first + n], _MIN_SINE * _MIN_SINE)
                )
                g = abs(ladder[_GRADIENT, first + n])
                to_end = total + steep / (a * g)
                rate_to_end = total_rate - 1.0 / (a * a * g * steep)
        if left <= total:  # on the way out
            i, before, rate_before = _layer_of(ladder, first, n, left)
            point = r + before, rate + rate_before, sign
            _arrive_from(course, ladder, way, point, first + i, first + i, ray)
            return True, reflections.code
        if turns and left <= 2.0 * to_end - total:  # on the arc about the turning point
            point = r + total, rate + total_rate, sign
            _arrive_from(course, ladder, way, point, first + n, first + n, ray)
            return True, reflections.code
        if not turns:
            if course.rule.kind == at.OPEN:
                break
            hit = at.AT_BOTTOM if side == 1 else at.AT_SURFACE
            ok, reflections = turn_back(walls, course.rule, ray, r + total, hit, reflections)
            if not ok:
                return False, reflections.code
        if left <= 2.0 * to_end:  # on the way back
            i, before, rate_before = _layer_of(ladder, first, n, 2.0 * to_end - left)
            before += ladder[_RANGE, first + i]
            rate_before += ladder[_RATE, first + i]
            point = r + 2.0 * to_end - before, rate + 2.0 * rate_to_end - rate_before, -sign
            _arrive_from(course, ladder, way, point, first + i + 1, first + i, ray)
            return True, reflections.code
        r += 2.0 * to_end
        rate += 2.0 * rate_to_end
        side = 1 - side
        n, n1, turns, turns1 = n1, n, turns1, turns
        total, total1, total_rate, total_rate1 = total1, total, total_rate1, total_rate
        to_end, to_end1, rate_to_end, rate_to_end1 = to_end1, to_end, rate_to_end1, rate_to_end
    ok, _, _, code = trace_arcs(s, walls, course, angle, ray)
    return ok, code


@kernel
def has_ladder(work):
    """True if the rays of the fan have a ladder."""
    return work.ladder[_SIZES, 0] > 0.0

"""
Rays in horizontally uniform water under a rough surface: skips from tables, and the surface
followed step by step.

The water has levels with a constant gradient of sound speed between them. Above a deck, the depth
that the surface does not reach, a ray is stepped along the range and reflected where it meets the
surface. Below the deck its range and time until it comes back are functions of its angle at the
deck alone; they are tabulated once for all links and surfaces. Only the last skip, in which the
receiver is, is followed level by level. The surface has a depth and a slope at equally spaced
ranges.
"""

import math
from collections import namedtuple

from pymantaray.acoustics._kernels.layout import MAX_STEPS
from pymantaray.compile import entry, kernel

SkipWater = namedtuple("SkipWater", "depth speed deck zone bed table step")
SkipWater.__doc__ = """Levels [m, m/s], the index of the level at the deck, spacing of the levels
above it [m], depth of the bed [m], and the table of skips by angle at the deck: range [m], time
[s], turning points, reflections at the bed; its spacing [rad]."""
SkipLink = namedtuple("SkipLink", "start end length surface slope spacing most_surface most_bottom")
SkipLink.__doc__ = """Depths of the ends [m], range [m], depth and slope of the surface, their
spacing [m], most reflections."""
RANGE, TIME, TURNS, BEDS = range(4)  # rows of a table
ANGLE, MISS, TRAVEL, END_ANGLE, SURFACES, BOTTOMS, TURNED, RATE, N_RAY = range(
    9
)  # columns of a ray
FAILED = -1.0  # surface reflections of a ray that does not arrive
_STEEPEST = 1.53  # rad; a steeper ray is dropped
_FLAT = 1e-12
_STEP = 0.5  # of the spacing of the surface
_THIN = 0.25  # of the depth of the deck
_ITERATIONS = 40
_ON_TARGET = 1e-4  # m
_DIFFERENCE = 1e-6  # rad; for the derivative of the miss


@kernel
def _speed_above(water, z):
    """Sound speed and its gradient above the deck."""
    k = min(max(int(z / water.zone), 0), water.deck)
    g = (water.speed[k + 1] - water.speed[k]) / (water.depth[k + 1] - water.depth[k])
    return water.speed[k] + g * (z - water.depth[k]), g


@kernel
def _surface_at(link, r):
    """Depth and slope of the surface, a cubic Hermite polynomial between its points."""
    u = min(max(r / link.spacing, 0.0), link.surface.size - 1.000001)
    i = int(u)
    t = u - i
    h = link.spacing
    f0, f1, d0, d1 = link.surface[i], link.surface[i + 1], link.slope[i] * h, link.slope[i + 1] * h
    a, b = 2.0 * (f0 - f1) + d0 + d1, 3.0 * (f1 - f0) - 2.0 * d0 - d1
    return f0 + t * (d0 + t * (b + t * a)), (d0 + t * (2.0 * b + t * 3.0 * a)) / h


@kernel
def _arc_time(g, dr, dz, c0, c1):
    """Time along an arc between two points with a constant gradient."""
    half = 0.5 * math.hypot(dr, dz) / math.sqrt(c0 * c1)
    x = abs(g) * half
    return 2.0 * half if x < 1e-8 else 2.0 * math.asinh(x) / abs(g)


@kernel
def _below(water, k, z, sine, a, left, most_bottom):
    """
    Follow a ray below the deck until a range or back to the deck.

    Returns True if it has reached the range, the rest of the range, level, depth, sine, time,
    turning points and reflections at the bed (-1 if too many).
    """
    depth, speed = water.depth, water.speed
    t, turns, beds = 0.0, 0, 0
    g = (speed[k + 1] - speed[k]) / (depth[k + 1] - depth[k])
    c = speed[k] + g * (z - depth[k])
    for _ in range(MAX_STEPS):
        g = (speed[k + 1] - speed[k]) / (depth[k + 1] - depth[k])
        down = sine > 0.0 or (sine == 0.0 and g < 0.0)
        target = k + 1 if down else k
        cos, cos1 = a * c, a * speed[target]
        if cos1 >= 1.0 or abs(g * (depth[target] - z)) < 0.0:  # turns within the layer
            dr = 2.0 * sine / (a * g)
            if dr >= left:
                break
            t += _arc_time(g, dr, 0.0, c, c)
            left -= dr
            sine = -sine
            turns += 1
            continue
        s1 = math.sqrt((1.0 - cos1) * (1.0 + cos1))
        if not down:
            s1 = -s1
        dz = depth[target] - z
        total = sine + s1
        dr = dz * (cos + cos1) / total if abs(total) > _FLAT else left + 1.0
        if dr >= left:
            break
        t += _arc_time(g, dr, dz, c, speed[target])
        left -= dr
        z, c, sine = depth[target], speed[target], s1
        if down:
            k += 1
            if k == depth.size - 1:
                beds += 1
                if beds > most_bottom:
                    return False, left, k, z, sine, t, turns, -1
                k -= 1
                sine = -sine
        else:
            if k == water.deck:
                return False, left, k, z, sine, t, turns, beds
            k -= 1
    cos = a * c
    s1 = max(min(sine - a * g * left, 1.0), -1.0)
    cos1 = math.sqrt((1.0 - s1) * (1.0 + s1))
    dz = left * (sine + s1) / (cos + cos1)
    t += _arc_time(g, left, dz, c, c + g * dz)
    if sine * s1 < 0.0:
        turns += 1
    return True, 0.0, k, z + dz, s1, t, turns, beds


@kernel
def _above(water, link, r, z, angle):
    """Follow a ray above the deck until it leaves downwards or reaches the receiver's range.

    Returns range, depth, angle, time and reflections at the surface (-1 if the ray is too steep).
    """
    t, bounces = 0.0, 0
    bottom = water.depth[water.deck]
    for _ in range(MAX_STEPS):
        c, g = _speed_above(water, z)
        slope = math.tan(angle)
        bend = -g / c * (1.0 + slope * slope)
        step = min(_STEP * link.spacing, _THIN * bottom / max(abs(slope), 1e-6), link.length - r)
        at_receiver = step >= link.length - r
        z1 = z + step * (slope + 0.5 * step * bend)
        leaves = z1 >= bottom and slope + step * bend > 0.0
        if leaves:
            at_receiver = False
            lo, hi = 0.0, step
            for _ in range(_ITERATIONS):
                step -= (z + step * (slope + 0.5 * step * bend) - bottom) / max(
                    slope + step * bend, 1e-9
                )
                step = min(max(step, lo), hi)
                if abs(z + step * (slope + 0.5 * step * bend) - bottom) < 1e-10:
                    break
            z1 = bottom
        top, _ = _surface_at(link, r + step)
        hits = z1 < top
        if hits:
            at_receiver, leaves = False, False
            lo, hi = 0.0, step
            for _ in range(_ITERATIONS):
                x = 0.5 * (lo + hi)
                top, rise = _surface_at(link, r + x)
                if z + x * (slope + 0.5 * x * bend) < top:
                    hi = x
                else:
                    lo = x
                if hi - lo < 1e-9:
                    break
            step = lo
            z1 = z + step * (slope + 0.5 * step * bend)
        t += math.hypot(step, z1 - z) / (c + 0.5 * g * (z1 - z))
        r, z = r + step, z1
        angle = math.atan(slope + step * bend)
        if hits:
            _, rise = _surface_at(link, r)
            angle = 2.0 * math.atan(rise) - angle
            bounces += 1
            if abs(angle) > _STEEPEST or bounces > link.most_surface:
                return r, z, angle, t, -1
        if leaves or at_receiver:
            break
    return r, z, angle, t, bounces


@kernel
def _jump(water, angle):
    """
    Range, time, turning points and reflections at the bed of a skip by its angle at the deck; range
    infinite beyond the table.

    Cubic between the entries where four of them have the same turning points and reflections, else
    linear.
    """
    u = angle / water.step
    i = int(u)
    table = water.table
    n = table.shape[1]
    if i < 1 or i > n - 3:
        return math.inf, 0.0, 0.0, 0.0
    for j in range(i - 1, i + 3):
        if (
            table[TURNS, j] != table[TURNS, i]
            or table[BEDS, j] != table[BEDS, i]
            or math.isinf(table[RANGE, j])
        ):
            return math.inf, 0.0, 0.0, 0.0
    x = u - i
    w0 = -x * (x - 1.0) * (x - 2.0) / 6.0
    w1 = (x + 1.0) * (x - 1.0) * (x - 2.0) / 2.0
    w2 = -(x + 1.0) * x * (x - 2.0) / 2.0
    w3 = (x + 1.0) * x * (x - 1.0) / 6.0
    r = (
        w0 * table[RANGE, i - 1]
        + w1 * table[RANGE, i]
        + w2 * table[RANGE, i + 1]
        + w3 * table[RANGE, i + 2]
    )
    t = (
        w0 * table[TIME, i - 1]
        + w1 * table[TIME, i]
        + w2 * table[TIME, i + 1]
        + w3 * table[TIME, i + 2]
    )
    return r, t, table[TURNS, i], table[BEDS, i]


@entry
def fill_table(water, most_bottom):
    """
    Fill the table of skips of water; the range of a ray with too many reflections at the bed is
    infinite.
    """
    c = water.speed[water.deck]
    for i in range(water.table.shape[1]):
        angle = max(i, 1e-3) * water.step
        _, left, _, _, _, t, turns, beds = _below(
            water,
            water.deck,
            water.depth[water.deck],
            math.sin(angle),
            math.cos(angle) / c,
            1e9,
            most_bottom,
        )
        water.table[RANGE, i] = 1e9 - left if beds >= 0 else math.inf
        water.table[TIME, i], water.table[TURNS, i], water.table[BEDS, i] = t, turns, beds


@kernel
def _level(water, z):
    """Index of the level above a depth."""
    lo, hi = 0, water.depth.size - 1
    while hi - lo > 1:
        mid = (lo + hi) // 2
        if z < water.depth[mid]:
            hi = mid
        else:
            lo = mid
    return lo


@kernel
def _upper_part(water, link, point, t, surfaces):
    """
    Follow a ray above the deck from point (range, depth, angle); return its range, depth, angle,
    time, and reflections (-1 if too many).
    """
    r, z, angle, more, hit = _above(water, link, point[0], point[1], point[2])
    surfaces += hit
    return r, z, angle, t + more, surfaces if hit >= 0 and surfaces <= link.most_surface else -1


@kernel
def _launch(water, link, angle, ray):
    """Follow a ray from the source to the receiver's range."""
    ray[ANGLE], ray[SURFACES], ray[MISS] = angle, FAILED, 0.0
    r, z, t = 0.0, link.start, 0.0
    surfaces, beds, turns = 0, 0, 0
    deck_depth, deck_speed = water.depth[water.deck], water.speed[water.deck]
    k = _level(water, z)
    g = (water.speed[k + 1] - water.speed[k]) / (water.depth[k + 1] - water.depth[k])
    a = math.cos(angle) / (water.speed[k] + g * (z - water.depth[k]))
    sine = math.sin(angle)
    inside = z < deck_depth
    if z == deck_depth and sine < 0.0:
        inside = True
    for _ in range(link.most_surface + link.most_bottom + 3):
        if not inside:
            done, left, k, z, sine, more, turned, hit = _below(
                water, k, z, sine, a, link.length - r, link.most_bottom - beds
            )
            if hit < 0:
                return
            t, turns, beds, r = t + more, turns + turned, beds + hit, link.length - left
            if done:
                angle = math.atan2(sine, math.sqrt((1.0 - sine) * (1.0 + sine)))
                break
            angle = math.atan2(sine, math.sqrt((1.0 - sine) * (1.0 + sine)))
        r, z, angle, t, surfaces = _upper_part(water, link, (r, z, angle), t, surfaces)
        if surfaces < 0:
            return
        if r < link.length - 1e-9:
            skip, more, turned, hit = _jump(water, angle)
            if r + skip < link.length and beds + hit <= link.most_bottom:
                r, t, turns, beds = r + skip, t + more, turns + int(turned), beds + int(hit)
                r, z, angle, t, surfaces = _upper_part(
                    water, link, (r, deck_depth, -angle), t, surfaces
                )
                if surfaces < 0:
                    return
        if r >= link.length - 1e-9:
            break
        inside, z, k = False, deck_depth, water.deck
        sine, a = math.sin(angle), math.cos(angle) / deck_speed
    else:
        return
    ray[MISS], ray[TRAVEL], ray[END_ANGLE] = z - link.end, t, angle
    ray[SURFACES], ray[BOTTOMS], ray[TURNED] = surfaces, beds, turns


@kernel
def _same(a, b):
    """True if two rays arrive with the same reflections."""
    return a[SURFACES] == b[SURFACES] and a[BOTTOMS] == b[BOTTOMS] and a[SURFACES] > 0.0


@kernel
def _copy(a, b):
    for i in range(N_RAY):
        b[i] = a[i]


@kernel
def _refine(water, link, a, b, weak, rows, count, work):
    """
    Append the ray between two rays on either side of the receiver, unless it is too weak; return
    the number of rows.
    """
    if count >= rows.shape[0]:
        return count
    middle = work[2]
    for i in range(_ITERATIONS):
        share = 0.5 if i % 3 == 2 else a[MISS] / (a[MISS] - b[MISS])
        _launch(water, link, a[ANGLE] + share * (b[ANGLE] - a[ANGLE]), middle)
        if not _same(a, middle):
            return count
        if abs(middle[MISS]) < _ON_TARGET or b[ANGLE] - a[ANGLE] < 1e-12:
            break
        _copy(middle, a if (a[MISS] > 0.0) == (middle[MISS] > 0.0) else b)
    if abs(middle[MISS]) > 1e-2:
        return count
    _launch(water, link, middle[ANGLE] + _DIFFERENCE, a)
    _launch(water, link, middle[ANGLE] - _DIFFERENCE, b)
    if not (_same(a, middle) and _same(b, middle)):
        return count
    middle[RATE] = 0.5 * (a[MISS] - b[MISS]) / _DIFFERENCE
    if abs(middle[RATE]) > weak:
        return count
    _copy(middle, rows[count])
    return count + 1


@entry
def find_skips(water, link, fan, weak, rows, work):
    """
    Find the rays of a link with at least one reflection at the surface.

    fan has the steepest angles up and down, the spacing and the least spacing [rad]; weak is the
    largest slope of the miss [m/rad]. rows (n, N_RAY) receives the rays, work (60, N_RAY) is room.
    Returns the number of rays.
    """
    up, down, spacing, least = fan
    count = 0
    left, right = work[0], work[1]
    _launch(water, link, up, left)
    n = int(math.ceil((down - up) / spacing))
    top = 3  # of a stack of rays to the right of the present one
    for i in range(1, n + 1):
        _launch(water, link, up + (down - up) * i / n, work[top])
        depth = 1
        while depth > 0:
            _copy(work[top + depth - 1], right)
            same = _same(left, right)
            alive = left[SURFACES] > 0.0 or right[SURFACES] > 0.0
            h = right[ANGLE] - left[ANGLE]
            split = alive and h > least and depth < work.shape[0] - top - 1
            if split and same:
                split = _needs_more(left, right, h, weak)
            if split:
                _launch(water, link, 0.5 * (left[ANGLE] + right[ANGLE]), work[top + depth])
                depth += 1
                continue
            if same and left[MISS] * right[MISS] <= 0.0 and left[MISS] != right[MISS]:
                _copy(right, work[top + depth])
                count = _refine(water, link, left, right, weak, rows, count, work)
                _copy(work[top + depth], right)
            _copy(right, left)
            depth -= 1
    return count


@kernel
def _needs_more(a, b, h, weak):
    """
    True if an interval of rays with the same reflections may hide more rays than the signs of the
    misses show.
    """
    nearest = min(abs(a[MISS]), abs(b[MISS]))
    return nearest < weak * h or abs(a[END_ANGLE] - b[END_ANGLE]) > 0.02

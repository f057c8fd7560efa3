"""
Rays in horizontally uniform water under a rough surface: skips from tables, and the surface
followed piece by piece.

The water has levels with a constant gradient of sound speed between them. Above a deck, the depth
that the surface does not reach, a ray is a parabola from level to level and from piece to piece of
the surface, and is reflected where it meets the surface. Below the deck its range and time until it
comes back are functions of its angle at the deck alone; they are tabulated once for all links. Only
the last skip, in which the receiver is, is followed level by level. The surface consists of cubic
polynomials of equal length.
"""

import math
from collections import namedtuple

from pymantaray.acoustics._kernels.layout import MAX_STEPS
from pymantaray.compile import entry, kernel

SkipWater = namedtuple("SkipWater", "depth speed deck zone bed table step")
SkipWater.__doc__ = """Levels [m, m/s], the index of the level at the deck, spacing of the levels
above it [m], depth of the bed [m], and the table of skips by angle at the deck: range [m], time
[s], turning points, reflections at the bed; its spacing [rad]."""
SkipLink = namedtuple("SkipLink", "start end length pieces spacing most_surface most_bottom")
SkipLink.__doc__ = """Depths of the ends [m], range [m], pieces of the surface (n, 5): coefficients
of the depth by the range from the piece's start, and the greatest depth; their length [m], most
reflections."""
RANGE, TIME, TURNS, BEDS = range(4)  # rows of a table
ANGLE, MISS, TRAVEL, END_ANGLE, SURFACES, BOTTOMS, TURNED, RATE, N_RAY = range(
    9
)  # columns of a ray
FAILED = -1.0  # surface reflections of a ray that does not arrive
DEEPEST = 4  # column of a piece of the surface
_STEEPEST_SLOPE = math.tan(1.53)  # a steeper ray is dropped after its reflection
_FLAT = 1e-12
_FAR = 1e9  # m
_ON_SURFACE = 1e-9  # m
_SHORT_ARC = 0.03  # gradient times half the time, below which the time is a series
_ITERATIONS = 40
_ON_TARGET = 1e-4  # m
_DIFFERENCE = 1e-6  # rad; for the derivative of the miss


@kernel
def _first_root(d, end):
    """
    First zero in (0, end] of a cubic polynomial with coefficients d, not negative at 0; -1 if there
    is none.

    Bernstein coefficients tell whether an interval has no zero or one; others are halved.
    """
    lo, hi = 0.0, end
    for _ in range(_ITERATIONS):
        w = hi - lo
        e1 = w * (d[1] + lo * (2.0 * d[2] + lo * 3.0 * d[3]))
        e2 = w * w * (d[2] + 3.0 * lo * d[3])
        b0 = d[0] + lo * (d[1] + lo * (d[2] + lo * d[3]))
        b1 = b0 + e1 / 3.0
        b2 = b1 + (e1 + e2) / 3.0
        b3 = b0 + e1 + e2 + w * w * w * d[3]
        if b0 < -_ON_SURFACE or (b0 <= 0.0 and b1 <= 0.0):
            return lo
        if b1 >= 0.0 and b2 >= 0.0 and b3 >= 0.0:
            if hi >= end:
                return -1.0
            lo, hi = hi, end
        elif w < _ON_SURFACE or (b3 < 0.0 and not (b1 < 0.0 and b2 > 0.0)):
            break
        else:
            hi = lo + 0.5 * w
    x = hi
    for _ in range(_ITERATIONS):
        value = d[0] + x * (d[1] + x * (d[2] + x * d[3]))
        if value < 0.0:
            hi = x
        else:
            lo = x
        rate = d[1] + x * (2.0 * d[2] + x * 3.0 * d[3])
        step = value / rate if rate != 0.0 else math.inf
        if abs(step) < 1e-12:
            break
        x -= step
        if not lo < x < hi:
            x = 0.5 * (lo + hi)
    return x


@kernel
def _to_face(up, down, slope, bend):
    """Range at which a parabola leaves a layer whose faces are so far above and below it."""
    if slope < 0.0 or (slope == 0.0 and bend < 0.0):
        square = slope * slope - 2.0 * bend * up
        if square >= 0.0:
            total = math.sqrt(square) - slope
            return 2.0 * up / total if total > 0.0 else 0.0
        return (math.sqrt(slope * slope + 2.0 * bend * down) - slope) / bend
    square = slope * slope + 2.0 * bend * down
    if square >= 0.0:
        total = math.sqrt(square) + slope
        if total > 0.0:
            return 2.0 * down / total
        return math.inf if bend == 0.0 else 0.0
    return -(math.sqrt(slope * slope - 2.0 * bend * up) + slope) / bend


@kernel
def _meets(link, i, x, z, slope, bend, step):
    """
    Range to the surface along a parabola from x within piece i of the surface, -1 if a step does
    not meet it.
    """
    piece = link.pieces[i]
    highest = min(z, z + step * (slope + 0.5 * step * bend))
    if slope < 0.0 < slope + step * bend:
        highest = z - 0.5 * slope * slope / bend
    if highest > piece[DEEPEST]:
        return -1.0
    rise = piece[1] + x * (2.0 * piece[2] + x * 3.0 * piece[3])
    gap = (
        z - (piece[0] + x * (piece[1] + x * (piece[2] + x * piece[3]))),
        slope - rise,
        0.5 * bend - piece[2] - 3.0 * x * piece[3],
        -piece[3],
    )
    return _first_root(gap, step)


@kernel
def _arc_time(g, dr, dz, c0, c1):
    """Time along an arc between two points with a constant gradient."""
    half = 0.5 * math.sqrt((dr * dr + dz * dz) / (c0 * c1))
    x = abs(g) * half
    if x < _SHORT_ARC:
        square = x * x
        return 2.0 * half * (1.0 - square * (1.0 / 6.0 - square * (0.075 - square * 15.0 / 336.0)))
    return 2.0 * math.asinh(x) / abs(g)


@kernel
def _below(water, k, z, sine, a, left, most_bottom, timed):
    """
    Follow a ray below the deck until a range or back to the deck.

    Returns True if it has reached the range, the rest of the range, level, depth, sine, time,
    turning points and reflections at the bed (-1 if too many).
    """
    depth, speed = water.depth, water.speed
    t, turns, beds = 0.0, 0, 0
    g = (speed[k + 1] - speed[k]) / (depth[k + 1] - depth[k])
    c = speed[k] + g * (z - depth[k])
    cos = a * c
    down = sine > 0.0 or (sine == 0.0 and g < 0.0)
    for _ in range(MAX_STEPS):
        target = k + 1 if down else k
        cos1 = a * speed[target]
        if cos1 >= 1.0:  # turns within the layer
            g = (speed[k + 1] - speed[k]) / (depth[k + 1] - depth[k])
            dr = 2.0 * sine / (a * g)
            if dr >= left:
                break
            if timed:
                t += _arc_time(g, dr, 0.0, c, c)
            left -= dr
            sine = -sine
            down = not down
            turns += 1
            continue
        # crosses the layer
        s1 = math.sqrt((1.0 - cos1) * (1.0 + cos1))
        if not down:
            s1 = -s1
        dz = depth[target] - z
        total = sine + s1
        dr = dz * (cos + cos1) / total if abs(total) > _FLAT else left + 1.0
        if dr >= left:
            break
        if timed:
            g = (speed[k + 1] - speed[k]) / (depth[k + 1] - depth[k])
            t += _arc_time(g, dr, dz, c, speed[target])
        left -= dr
        z, c, cos, sine = depth[target], speed[target], cos1, s1
        # next layer, reflection at the bed, or end at the deck
        if down:
            k += 1
            if k == depth.size - 1:
                beds += 1
                if beds > most_bottom:
                    return False, left, k, z, sine, t, turns, -1
                k -= 1
                sine = -sine
                down = False
        else:
            if k == water.deck:
                return False, left, k, z, sine, t, turns, beds
            k -= 1
    # the rest of the range, within the layer
    g = (speed[k + 1] - speed[k]) / (depth[k + 1] - depth[k])
    s1 = max(min(sine - a * g * left, 1.0), -1.0)
    cos1 = math.sqrt((1.0 - s1) * (1.0 + s1))
    dz = left * (sine + s1) / (cos + cos1)
    if timed:
        t += _arc_time(g, left, dz, c, c + g * dz)
    if sine * s1 < 0.0:
        turns += 1
    return True, 0.0, k, z + dz, s1, t, turns, beds


@kernel
def _reflected(link, i, x, slope):
    """Slope of a ray after its reflection at the surface; infinite if the ray is too steep."""
    piece = link.pieces[i]
    m = piece[1] + x * (2.0 * piece[2] + x * 3.0 * piece[3])
    along = 1.0 + 2.0 * slope * m - m * m
    down = 2.0 * m - slope * (1.0 - m * m)
    return down / along if abs(down) < _STEEPEST_SLOPE * along else math.inf


@kernel
def _above(water, link, r, z, slope, timed):
    """
    Follow a ray above the deck until it leaves downwards or reaches the receiver's range.

    Steps end at levels and between pieces of the surface. Returns range, depth, slope, time and
    reflections at the surface (-1 if the ray is too steep).
    """
    t, bounces = 0.0, 0
    k = min(int(z / water.zone), water.deck - 1)
    if slope < 0.0 and k > 0 and z <= water.depth[k]:
        k -= 1
    last = link.pieces.shape[0] - 1
    i = min(int(r / link.spacing), last)
    for _ in range(MAX_STEPS):
        # the ray's parabola in the layer
        g = (water.speed[k + 1] - water.speed[k]) / (water.depth[k + 1] - water.depth[k])
        c = water.speed[k] + g * (z - water.depth[k])
        bend = -g / c * (1.0 + slope * slope)
        # step to a level, to the end of a piece, or to the receiver
        up = z - water.depth[k] if k > 0 else _FAR
        face = _to_face(up, water.depth[k + 1] - z, slope, bend)
        beyond = (i + 1) * link.spacing - r if i < last else math.inf
        step = min(face, beyond, link.length - r)
        hit = _meets(link, i, r - i * link.spacing, z, slope, bend, step)
        # move along the step, or to the surface
        x = step if hit < 0.0 else hit
        dz = x * (slope + 0.5 * x * bend)
        if timed:
            t += _arc_time(g, x, dz, c, c + g * dz)
        z += dz
        slope += x * bend
        # reflection at the surface
        if hit >= 0.0:
            r += x
            bounces += 1
            slope = _reflected(link, i, r - i * link.spacing, slope)
            if math.isinf(slope) or bounces > link.most_surface:
                return r, z, slope, t, -1
            continue
        if step >= link.length - r:
            return link.length, z, slope, t, bounces
        # the next piece, and the next layer
        r = (i + 1) * link.spacing if step >= beyond else r + step
        if step >= beyond:
            i += 1
        if step >= face:
            down = slope > 0.0 or (slope == 0.0 and bend > 0.0)
            k += 1 if down else -1
            z = water.depth[k if down else k + 1]
            if k == water.deck:
                break
            k = max(k, 0)
    return r, z, slope, t, bounces


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
    fastest = c
    for k in range(water.deck, water.speed.size):
        fastest = max(fastest, water.speed[k])
    for i in range(water.table.shape[1]):
        angle = max(i, 1e-3) * water.step
        a = math.cos(angle) / c
        if most_bottom == 0 and a * fastest < 1.0:  # no ray turns above the bed
            water.table[RANGE, i], water.table[BEDS, i] = math.inf, -1.0
            continue
        _, left, _, _, _, t, turns, beds = _below(
            water, water.deck, water.depth[water.deck], math.sin(angle), a, _FAR, most_bottom, True
        )
        water.table[RANGE, i] = _FAR - left if beds >= 0 else math.inf
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
def _upper_part(water, link, point, surfaces, timed):
    """
    Follow a ray above the deck from point (range, depth, slope, time); return its range, depth,
    slope, time, and reflections (-1 if too many).
    """
    r, z, slope, more, hit = _above(water, link, point[0], point[1], point[2], timed)
    surfaces += hit
    t = point[3] + more
    return r, z, slope, t, surfaces if hit >= 0 and surfaces <= link.most_surface else -1


@kernel
def _launch(water, link, angle, ray, timed):
    """Follow a ray from the source to the receiver's range, without its time unless it is timed."""
    ray[ANGLE], ray[SURFACES], ray[MISS] = angle, FAILED, 0.0
    r, z, t = 0.0, link.start, 0.0
    surfaces, beds, turns = 0, 0, 0
    deck_depth, deck_speed = water.depth[water.deck], water.speed[water.deck]
    k = _level(water, z)
    g = (water.speed[k + 1] - water.speed[k]) / (water.depth[k + 1] - water.depth[k])
    sine, slope = math.sin(angle), math.tan(angle)
    a = math.cos(angle) / (water.speed[k] + g * (z - water.depth[k]))
    inside = z < deck_depth or (z == deck_depth and sine < 0.0)
    for _ in range(link.most_surface + link.most_bottom + 3):
        # below the deck
        if not inside:
            done, left, k, z, sine, more, turned, hit = _below(
                water, k, z, sine, a, link.length - r, link.most_bottom - beds, timed
            )
            if hit < 0:
                return
            t, turns, beds, r = t + more, turns + turned, beds + hit, link.length - left
            slope = sine / math.sqrt((1.0 - sine) * (1.0 + sine))
            if done:
                break
        # above the deck
        r, z, slope, t, surfaces = _upper_part(water, link, (r, z, slope, t), surfaces, timed)
        if surfaces < 0:
            return
        # a whole skip by the table, and the part above the deck again
        if r < link.length - 1e-9:
            skip, more, turned, hit = _jump(water, math.atan(slope))
            if r + skip < link.length and beds + hit <= link.most_bottom:
                r, t, turns, beds = r + skip, t + more, turns + int(turned), beds + int(hit)
                r, z, slope, t, surfaces = _upper_part(
                    water, link, (r, deck_depth, -slope, t), surfaces, timed
                )
                if surfaces < 0:
                    return
        if r >= link.length - 1e-9:
            break
        # the next part below the deck, without the table
        inside, z, k = False, deck_depth, water.deck
        cosine = 1.0 / math.sqrt(1.0 + slope * slope)
        sine, a = slope * cosine, cosine / deck_speed
    else:
        return
    ray[MISS], ray[TRAVEL], ray[END_ANGLE] = z - link.end, t, math.atan(slope)
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
        _launch(water, link, a[ANGLE] + share * (b[ANGLE] - a[ANGLE]), middle, False)
        if not _same(a, middle):
            return count
        if abs(middle[MISS]) < _ON_TARGET or b[ANGLE] - a[ANGLE] < 1e-12:
            break
        _copy(middle, a if (a[MISS] > 0.0) == (middle[MISS] > 0.0) else b)
    if abs(middle[MISS]) > 1e-2:
        return count
    _launch(water, link, middle[ANGLE] + _DIFFERENCE, a, False)
    _launch(water, link, middle[ANGLE] - _DIFFERENCE, b, False)
    if not (_same(a, middle) and _same(b, middle)):
        return count
    middle[RATE] = 0.5 * (a[MISS] - b[MISS]) / _DIFFERENCE
    if abs(middle[RATE]) > weak:
        return count
    rate = middle[RATE]
    _launch(water, link, middle[ANGLE], rows[count], True)
    rows[count, RATE] = rate
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
    _launch(water, link, up, left, False)
    n = int(math.ceil((down - up) / spacing))
    top = 3  # of a stack of rays to the right of the present one
    for i in range(1, n + 1):
        _launch(water, link, up + (down - up) * i / n, work[top], False)
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
                _launch(water, link, 0.5 * (left[ANGLE] + right[ANGLE]), work[top + depth], False)
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

"""
Rays through horizontally uniform water, by quadrature over depth or, in layers with a constant
gradient of sound speed, in closed form.

With the ray parameter ``a = cos(theta) / c`` and the sine ``s = sqrt(1 - a^2 c^2)`` of a ray's
angle, the range between two depths is the integral of ``a c / s``, its derivative by a at fixed
depths that of ``c / s^3``, and the travel time that of ``s / c``, plus a times the range. Along a
part between the sines s0 and s1 the variable is u in ``s = s0 + (s1 - s0) u``: the depth is then
quadratic in u, and the integrands are almost constant, even if s0 or s1 is zero. A part is halved
until the sound speed in it is almost linear. About a turning depth, the depth is ``z_turn - D
v^2``, and the derivative of the range from there is ``-1 / (a^2 c' s)`` plus the integral of ``c''
/ (a c')^2 / s``, by parts. Nothing is divided by a small number that does not cancel.
"""

import math
from collections import namedtuple

from pymantaray.acoustics._kernels import layout as at
from pymantaray.acoustics._kernels.boundary import ON_SURFACE, append_code, landed
from pymantaray.acoustics._kernels.field import ABOVE_SCALE, BELOW_SCALE, find_level
from pymantaray.compile import inlined, kernel, out_of_line, shared

_MIN_SINE = 1e-12
_VERTICAL = 1e-200  # least cosine of the angle of a ray, so that ratios to it are defined
# rad; a flatter ray through SMOOTH water is integrated: about a sound-speed maximum, differences of
# the sound speed have no digits
_LEVEL = 1e-7
_MAX_PARTS = 100_000
_BEYOND_ALL = 1e9  # m; depth beyond all rays
_PIECES_BEYOND = 40  # of the extension beyond the levels, each twice as thick as the one before
_BEYOND = 0.2  # change of the sound speed beyond the levels of LINEAR water, as a share of it
_SAME_DEPTH = 1e-9  # m
# Largest departure of the squared sine from a straight line in a part, as a share of it; of the
# gradient about a turning depth
_BEND, _TURN_BEND = 0.08, 0.15
_NEAR_TURN = 2.0  # ratio of the sines of a part beyond which it is near a turning depth
_MAX_HALVINGS = 80
_NEWTON = 1e-8  # share of a part; a smaller change is the last one, because errors are squared
_THINNEST = 1e-7  # m; a thinner part is not halved
_LONG = 500.0  # m; longer parts of a path get intermediate nodes
_NODES = (
    0.046910077030668,
    0.23076534494715845,
    0.5,
    0.7692346550528415,
    0.953089922969332,
)
_WEIGHTS = (
    0.11846344252809454,
    0.23931433524968324,
    0.28444444444444444,
    0.23931433524968324,
    0.11846344252809454,
)

Piece = namedtuple("Piece", "top low origin c0 c1 c2 c3 scale")
Piece.__doc__ = """Sound speed between two depths: a cubic of the depth below the origin, or, with a
scale, the extension of `field` beyond the levels. [m, m/s]"""

State = namedtuple("State", "depth speed sine range rate action")
State.__doc__ = """State of a ray: depth, sound speed, sine (positive down), range, its derivative
by a at this depth, and the integral of s / c over depth."""

Turn = namedtuple("Turn", "depth height gradient bend third speed scale place smooth")
Turn.__doc__ = """Turning depth, its distance from the far end of a part, derivatives of the sound
speed there in the direction from this end, sound speed, scale of the extension or 0, distance from
its edge, negative if a ray turns towards the edge, and False if the part is too high for `to_turn`.
In the extension, third is the size of the slope at the edge. [m, m/s]"""


Leg = namedtuple("Leg", "end speed sine near turns turn first last start")
Leg.__doc__ = """Next part of a ray in a piece: depth, sound speed and size of the sine at its end,
True if it is described from a turning depth, and if it turns there and returns to its start, the
`Turn`, the places v of both ends, and `finite_part` at the first one."""

Point = namedtuple("Point", "state gradient term sine_rate density")
Point.__doc__ = """Point of a `Leg`: state with the finite part of its rate, gradient of the sound
speed, and range per share of the leg. The derivative of the depth by a at fixed range is
``-(rate s + term) / (a c)``, that of the sine ``sine_rate + a gradient rate``."""


@kernel
def fits_curves(s, walls, course, angle, q0):
    """
    True if a ray can be traced layer by layer: layered water, not along a chord, no cross-track
    slowness, and flat boundaries if it reflects.
    """
    kind, level = course.rule.kind, course.axis.sb == 0.0
    flat = walls.bed.depth.size == 1 and walls.surface.depth.size == 1 and walls.held < 0.0
    bounded = (kind == at.OPEN and level) or (kind != at.OPEN and flat)
    possible = s.kind == at.LINEAR or not level or abs(angle) > _LEVEL
    return (
        s.layered != at.VARYING
        and possible
        and bounded
        and not course.cross
        and abs(q0) < _MIN_SINE
    )


@inlined
def _linear_piece(s, k):
    """
    Piece of a layer of LINEAR water.

    Beyond the levels, where no water is, the gradient continues until the sound speed has changed
    by a fifth; beyond, it is constant.
    """
    n = s.depth.size
    i = min(max(k, 0), n - 2)
    top, low, c, c_low = s.depth[i], s.depth[i + 1], s.data[0, i, 0], s.data[0, i + 1, 0]
    g = (c_low - c) / (low - top)
    if k == i:
        return Piece(top, low, top, c, g, 0.0, 0.0, 0.0)
    sign, edge, near = (-1.0, top, c) if k < 0 else (1.0, low, c_low)
    reach = min(_BEYOND * near / max(abs(g), 1e-9), _BEYOND_ALL)
    first, second = edge, edge + sign * reach
    if k < -1 or k > n - 1:
        first, second, near, g = second, second + sign * _BEYOND_ALL, near + sign * reach * g, 0.0
    top, low = min(first, second), max(first, second)
    return Piece(top, low, first, near, g, 0.0, 0.0, 0.0)


@inlined
def piece_at(s, k):
    """Piece of a layer; layers beyond the levels are those of the extension."""
    n = s.depth.size
    if s.kind == at.LINEAR and (k < n - 1 or s.layered != at.DEEPER):
        return _linear_piece(s, k)
    if 0 <= k < n - 1:
        d = s.data[0, k]
        return Piece(s.depth[k], s.depth[k + 1], s.depth[k], d[0], d[1], d[2], d[3], 0.0)
    if k < 0:
        d, z = s.data[0, 0], s.depth[0]
        first = ABOVE_SCALE * (2.0 ** (-1 - k) - 1.0)
        return Piece(z - 2.0 * first - ABOVE_SCALE, z - first, z, d[0], d[1], 0.0, 0.0, ABOVE_SCALE)
    d, z = s.data[0, n - 2], s.depth[n - 1]
    x = z - s.depth[n - 2]
    c, cz = d[0] + x * (d[1] + x * (d[2] + x * d[3])), d[1] + x * (2.0 * d[2] + 3.0 * x * d[3])
    if s.kind == at.LINEAR:
        c, cz = s.data[0, n - 1, 0], (s.data[0, n - 1, 0] - d[0]) / x
    first = BELOW_SCALE * (2.0 ** (k - n + 1) - 1.0)
    return Piece(z + first, z + 2.0 * first + BELOW_SCALE, z, c, cz, 0.0, 0.0, BELOW_SCALE)


@kernel
def layer_of(s, z):
    """Layer that contains a depth; as `find_level`, but also beyond the levels."""
    k = find_level(s, z)
    while z > piece_at(s, k).low:
        k += 1
    while z < piece_at(s, k).top:
        k -= 1
    return k


@inlined
def speed_in(piece, z):
    """Sound speed in a piece and its three derivatives by depth."""
    x = z - piece.origin
    if piece.scale == 0.0:
        c1, c2, c3 = piece.c1, piece.c2, piece.c3
        return (
            piece.c0 + x * (c1 + x * (c2 + x * c3)),
            c1 + x * (2.0 * c2 + 3.0 * x * c3),
            2.0 * c2 + 6.0 * x * c3,
            6.0 * c3,
        )
    q = x / piece.scale
    f = 1.0 / (1.0 + q * q)
    g = piece.c1 * math.sqrt(f)
    bend = -3.0 * f * f * g / piece.scale
    return piece.c0 + x * g, f * g, bend * q, bend * (1.0 - 5.0 * q * q * f) / piece.scale


@inlined
def sine_at(way, c):
    """Size of the sine of a ray's angle where the sound speed is c; tiny beyond a turning depth."""
    square = way.sine_squared + way.a * way.a * ((way.c_ref - c) * (way.c_ref + c))
    return math.sqrt(max(square, _MIN_SINE * _MIN_SINE))


@inlined
def is_straight(piece):
    """True if the gradient of the sound speed is constant in a piece."""
    return piece.c2 == 0.0 and piece.c3 == 0.0 and piece.scale == 0.0


@inlined
def monotonic_end(piece, z, face):
    """Depth of the first extremum of the sound speed between a depth and a face, or the face."""
    square = piece.c2 * piece.c2 - 3.0 * piece.c1 * piece.c3
    if piece.scale != 0.0 or not square > 0.0:
        return face
    q = -(piece.c2 + math.copysign(math.sqrt(square), piece.c2))
    first = q / (3.0 * piece.c3) if piece.c3 != 0.0 else math.inf
    second = piece.c1 / q if q != 0.0 else math.inf
    sign = 1.0 if face > z else -1.0
    for root in (first, second):
        e = piece.origin + root
        if (e - z) * sign > _SAME_DEPTH and (face - e) * sign > _SAME_DEPTH:
            face = e
    return face


@inlined
def is_bent(piece, way, part, z1):
    """True if the sound speed is too far from a line between the ends of a part."""
    z0, s0 = part
    c1, c = speed_in(piece, z1)[0], speed_in(piece, 0.5 * (z0 + z1))[0]
    s1, s = sine_at(way, c1), sine_at(way, c)
    h, both = abs(z1 - z0), s0 * s0 + s1 * s1
    odd = way.a * abs(piece.c3) * h * h * h
    return abs(2.0 * s * s - both) + odd > _BEND * both and h > _THINNEST


@inlined
def _arc_time(g, dr, dz, c0, c1):
    """Travel time between two points of water with a constant gradient, along an arc."""
    half = 0.5 * math.hypot(dr, dz) / math.sqrt(c0 * c1)
    return 2.0 * (math.asinh(g * half) / g if g != 0.0 else half)


@inlined
def part_to(piece, way, state, end, s1):
    """
    State of a ray at a depth of a monotonic piece where the size of its sine is s1, without a
    turning depth before it.
    """
    z0, c0, s0, c1 = state.depth, state.speed, abs(state.sine), speed_in(piece, end)[0]
    total = s0 + s1
    if is_straight(piece):
        rate = abs(end - z0) * (c0 + c1) / (s0 * s1 * total)
        r = way.a * s0 * s1 * rate
        action = _arc_time(piece.c1, r, end - z0, c0, c1) - way.a * r
    else:
        r, rate, action = 0.0, (c0 * s1 + c1 * s0) / (s0 * s1 * total), 0.0
        for i in range(5):
            line = s0 + (s1 - s0) * _NODES[i]
            t = _NODES[i] * (s0 + line) / total
            c = speed_in(piece, z0 + (end - z0) * t)[0]
            s = sine_at(way, c)
            ratio = line / s
            r += _WEIGHTS[i] * c * ratio
            action += _WEIGHTS[i] * line * s / c
            rate += _WEIGHTS[i] * (c * ratio**3 - c0 - t * (c1 - c0)) / (line * line)
        scale = 2.0 * abs(end - z0) / total
        r, rate, action = way.a * scale * r, scale * rate, scale * action
    sine = math.copysign(s1, state.sine)
    return State(end, c1, sine, state.range + r, state.rate + rate, state.action + action)


@inlined
def _rise(piece, z, c, sign, x):
    """Change of the sound speed over a distance x from a depth with sound speed c, and its rate."""
    _, cz, czz, czzz = speed_in(piece, z)
    if piece.scale == 0.0:
        return (
            x * (sign * cz + x * (0.5 * czz + sign * x * czzz / 6.0)),
            sign * cz + x * (czz + 0.5 * sign * x * czzz),
        )
    there, rate, _, _ = speed_in(piece, z + sign * x)
    return there - c, sign * rate


@kernel
def _height(piece, way, z, c, sine, most):
    """
    Distance from a depth to the turning depth by a safeguarded Newton method, infinite if it is
    more than most (with the sign of its direction); the cubic of the piece continues beyond it.
    """
    sign = 1.0 if most > 0.0 else -1.0
    # of the sound speed up to the turning depth; without a difference of large numbers
    wanted = sine * sine / (way.a * way.a * (1.0 / way.a + c))
    low, high = 0.0, abs(most)
    if _rise(piece, z, c, sign, high)[0] < wanted:
        return math.inf
    slope = _rise(piece, z, c, sign, 0.0)[1]
    x = wanted / slope if slope > 0.0 else high
    for _ in range(60):
        if not low <= x <= high:
            x = 0.5 * (low + high)
        rise, rate = _rise(piece, z, c, sign, x)
        low, high = (x, high) if rise < wanted else (low, x)
        change = (wanted - rise) / rate if rate != 0.0 else math.inf
        if abs(change) <= 1e-14 * x:
            break
        x += change
    return min(max(x, low), high)


@inlined
def _turn(piece, way, z, height, sign):
    """Turning depth at a distance from a depth, in the direction of a sign."""
    z_turn = z + sign * height
    _, gradient, bend, third = speed_in(piece, z_turn)
    gradient, third, place = sign * gradient, sign * third, 0.0
    change = abs(0.5 * bend * height) + abs(third) * height * height / 6.0
    if piece.scale != 0.0:
        place = (z_turn - piece.origin) * sign
        third = abs(piece.c1)
        far = speed_in(piece, z)[1]
        change = 0.5 * abs(sign * far - gradient)
    smooth = gradient > 0.0 and (change < _TURN_BEND * gradient or height < _THINNEST)
    return Turn(z_turn, height, gradient, bend, third, 1.0 / way.a, piece.scale, place, smooth)


@inlined
def _below_turn(turn, x):
    """
    Mean gradient between a distance x from a turning depth and this depth, gradient and second
    derivative there.
    """
    if turn.scale == 0.0:
        return (
            turn.gradient - x * (0.5 * turn.bend - x * turn.third / 6.0),
            turn.gradient - x * (turn.bend - 0.5 * x * turn.third),
            turn.bend - x * turn.third,
        )
    p, q, scale = abs(turn.place), abs(turn.place - x), turn.scale
    at_p, at_q = 1.0 + (p / scale) ** 2, 1.0 + (q / scale) ** 2
    root = math.sqrt(at_q)
    here = turn.third / (at_q * root)
    outward = 1.0 if turn.place > 0.0 else -1.0
    mean = turn.third * (p + q) / (at_p * at_q * (p / math.sqrt(at_p) + q / root))
    return mean, here, -3.0 * outward * q * here / (at_q * scale * scale)


@inlined
def turn_ahead(piece, way, state, end):
    """Turning depth of a ray before the end of a monotonic part."""
    sign = 1.0 if end > state.depth else -1.0
    most = end - state.depth
    height = _height(piece, way, state.depth, state.speed, abs(state.sine), most)
    height = min(height, abs(most))
    return _turn(piece, way, state.depth, height, sign)


@inlined
def turn_beside(piece, way, state, end):
    """
    Turning depth near a part of a ray, behind its start or beyond its end, and the places v of
    both.
    """
    z, size, c1 = state.depth, abs(state.sine), speed_in(piece, end)[0]
    s1, h = sine_at(way, c1), end - z
    if s1 < size:
        near = _height(piece, way, end, c1, s1, h)
        turn = _turn(piece, way, z, abs(h) + near, 1.0 if h > 0.0 else -1.0)
        return turn, 1.0, math.sqrt(near / (abs(h) + near))
    near = _height(piece, way, z, state.speed, size, -h)
    turn = _turn(piece, way, end, abs(h) + near, -1.0 if h > 0.0 else 1.0)
    return turn, -math.sqrt(near / (abs(h) + near)), -1.0


@inlined
def to_turn(way, turn, v):
    """
    Range, integral by parts of its derivative by a, and integral of s / c, from the depth at v to
    the turning depth; all have the sign of v.
    """
    height, c_turn = turn.height, turn.speed
    r, rate, action = 0.0, 0.0, 0.0
    for i in range(5):
        square = (v * _NODES[i]) ** 2
        x = height * square
        slope, here, bend = _below_turn(turn, x)
        c = c_turn - x * slope
        root = math.sqrt(max(height * slope * (c_turn + c), 1e-300))
        r += _WEIGHTS[i] * c / root
        rate += _WEIGHTS[i] * bend / (here * here * root)
        action += _WEIGHTS[i] * square * root / c
    scale = 2.0 * height * v
    return scale * r, scale * rate / way.a**3, way.a * scale * action


@inlined
def on_turn(way, turn, v):
    """
    Distance from the turning depth, sound speed, sine, gradient towards the turning depth, and
    range per v, at v; the sine is negative beyond the turning point.
    """
    x = turn.height * v * v
    slope, here, _ = _below_turn(turn, x)
    c = turn.speed - x * slope
    root = math.sqrt(max(turn.height * slope * (turn.speed + c), 1e-300))
    return x, c, way.a * v * root, here, 2.0 * turn.height * c / root


@inlined
def finite_part(way, turn, v, sine):
    """
    As `to_turn`, with the derivative of the whole range by a at a fixed depth at v.

    sine is the size of the sine there as the neighbouring part uses it: large terms then cancel.
    """
    r, rate, action = to_turn(way, turn, v)
    gradient = _below_turn(turn, turn.height * v * v)[1]
    return r, rate - math.copysign(1.0 / (way.a * way.a * gradient * sine), v), action


@inlined
def next_leg(piece, way, state, face):
    """Next part of a ray towards a face of its piece."""
    z, size = state.depth, abs(state.sine)
    end = monotonic_end(piece, z, face)
    fastest = speed_in(piece, end)[0]
    square = way.sine_squared + way.a * way.a * ((way.c_ref - fastest) * (way.c_ref + fastest))
    turns, near = square < 0.0 and fastest > state.speed, False
    turn, first, last = Turn(z, 0.0, 0.0, 0.0, 0.0, state.speed, 0.0, 0.0, False), 1.0, -1.0
    for _ in range(_MAX_HALVINGS):
        if turns:
            turn = turn_ahead(piece, way, state, end)
            near = turn.smooth
            if near:
                break
            turns, end = False, z + 0.5 * (turn.depth - z)
            continue
        if is_straight(piece):
            break
        s1 = sine_at(way, speed_in(piece, end)[0])
        if max(size, s1) > _NEAR_TURN * min(size, s1):
            turn, first, last = turn_beside(piece, way, state, end)
            near = turn.smooth
            if near:
                break
        elif not is_bent(piece, way, (z, size), end):
            break
        end = 0.5 * (z + end)
    start = finite_part(way, turn, first, size) if near else (0.0, 0.0, 0.0)
    if near and turns:
        return Leg(z, state.speed, size, True, True, turn, 1.0, -1.0, start)
    c = speed_in(piece, end)[0]
    return Leg(end, c, sine_at(way, c), near, False, turn, first, last, start)


@kernel
def point_on(piece, way, state, leg, share):
    """Point of a leg at a share of it: of the range between its places, or about so."""
    if leg.near:
        turn, sign = leg.turn, math.copysign(1.0, state.sine * leg.first)
        v = leg.first + (leg.last - leg.first) * share
        r, by_parts, action = to_turn(way, turn, v)
        x, c, sine, gradient, density = on_turn(way, turn, v)
        here = State(
            turn.depth - sign * x,
            c,
            sign * sine,
            state.range + leg.start[0] - r,
            state.rate + leg.start[1] - by_parts,
            state.action + leg.start[2] - action,
        )
        term = sign / (way.a * way.a * gradient)
        per_share = density * (leg.first - leg.last)
        return Point(here, sign * gradient, term, here.sine / way.a, per_share)
    size = abs(state.sine)
    line = size + (leg.sine - size) * share
    z = state.depth + (leg.end - state.depth) * share * (size + line) / (size + leg.sine)
    c, gradient, _, _ = speed_in(piece, z)
    here = part_to(piece, way, state, z, sine_at(way, c))
    per_share = 2.0 * abs(leg.end - state.depth) / (size + leg.sine)
    density = way.a * c * line / abs(here.sine) * per_share
    return Point(here, gradient, 0.0, -way.a * c * c / here.sine, density)


@inlined
def _point_on_arc(piece, way, state, distance):
    """Point of a ray at a distance in a layer with a constant gradient of the sound speed."""
    z, c, sine, r, rate, action = state
    a, g = way.a, piece.c1
    end_sine = sine - a * g * distance
    cosine = math.sqrt(max((1.0 - end_sine) * (1.0 + end_sine), _MIN_SINE))
    dz = distance * (sine + end_sine) / (a * c + cosine)
    action += _arc_time(g, distance, dz, c, c + g * dz) - a * distance
    here = State(z + dz, c + g * dz, end_sine, r + distance, rate, action)
    return Point(here, g, distance / (a * sine), -a * c * c / sine - g * distance, 1.0)


@kernel
def end_of(piece, way, state, leg):
    """State of a ray at the end of a leg."""
    if not leg.near:
        return part_to(piece, way, state, leg.end, leg.sine)
    point = point_on(piece, way, state, leg, 1.0)
    here, sine = point.state, math.copysign(leg.sine, -state.sine if leg.turns else state.sine)
    rate = here.rate + point.term / sine
    return State(leg.end, leg.speed, sine, here.range, rate, here.action)


@inlined
def divergence(way, state):
    """Derivative of a ray's depth by the launch angle at fixed range."""
    return -state.rate * way.da * state.sine / (way.a * state.speed)


@kernel
def to_face(piece, way, state, face):
    """
    State of a ray at a face of a piece, or at its turning depth before it with the finite part of
    the rate; also return True if it turns, and the turning depth.
    """
    leg = next_leg(piece, way, state, face)
    for _ in range(_MAX_PARTS):
        if leg.turns:
            return point_on(piece, way, state, leg, 0.5).state, True, leg.turn
        state = end_of(piece, way, state, leg)
        if state.depth == face:
            break
        leg = next_leg(piece, way, state, face)
    return state, False, leg.turn


@kernel
def _end_within(length, piece, way, state, leg, beyond):
    """
    Point at the end of a ray's course within a leg, and the share of the leg there; beyond is the
    range at the end of the leg.
    """
    share = (length - state.range) / (beyond - state.range)
    if is_straight(piece):
        return _point_on_arc(piece, way, state, length - state.range), share
    point = point_on(piece, way, state, leg, share)
    for _ in range(10):
        change = (point.state.range - length) / point.density
        share = min(max(share - change, 0.0), 1.0)
        point = point_on(piece, way, state, leg, share)
        if abs(change) < _NEWTON:
            break
    return point, share


@kernel
def _arrive(course, way, point, ray):
    """Write the state of a ray at the end of its course to ray.y; return a `State` there."""
    length = course.length
    here, y, c_ref, a = point.state, ray.y, way.c_ref, way.a
    c, sine, cz = here.speed, here.sine, point.gradient
    dz = -way.da * (here.rate * sine + point.term) / (a * c)
    dsine = way.da * (point.sine_rate + a * cz * here.rate)
    y[at.W], y[at.P], y[at.XI] = here.depth - course.axis.z_source, c_ref * sine / c, dz
    y[at.ETA] = c_ref * (dsine - sine * cz * dz / c) / c
    y[at.TAU] = c_ref * (a * length + here.action)
    y[at.GROWN] = max(y[at.GROWN], abs(dz))
    if y[at.W] < y[at.HIGHEST]:
        y[at.HIGHEST], y[at.HIGHEST_RATE] = y[at.W], dz
    elif y[at.W] > y[at.LOWEST]:
        y[at.LOWEST], y[at.LOWEST_RATE] = y[at.W], dz
    if ray.K.shape[1] != at.N_FAN:
        y[at.DY_DQ] = length / (c_ref * a)
        y[at.Y], y[at.Q], y[at.Y_ANGLE], y[at.W_Q] = 0.0, 0.0, 0.0, 0.0
    return State(here.depth, c, sine, length, 0.0, here.action)


@kernel
def arrive_on_arc(course, piece, way, state, ray):
    """Write the state of a ray that ends in a layer with a constant gradient to ray.y."""
    _arrive(course, way, _point_on_arc(piece, way, state, course.length - state.range), ray)


@kernel
def _arrive_at_depth(way, state, ray):
    """Write the state of a ray at the end of its last leg to ray.y."""
    y, c_ref = ray.y, way.c_ref
    forward = 1.0 if state.sine < 0.0 else -1.0
    y[at.W], y[at.XI] = forward * state.range, forward * state.rate * way.da
    y[at.P], y[at.ETA] = forward * c_ref * way.a, forward * c_ref * way.da
    y[at.TAU] = c_ref * (way.a * state.range + state.action)
    y[at.GROWN] = max(y[at.GROWN], abs(y[at.XI]))
    if ray.K.shape[1] != at.N_FAN:
        y[at.DY_DQ] = state.range / (c_ref * way.a)


@kernel
def note_turn(course, way, turn, sign, y):
    """Update the extreme depths of a ray with a turning depth and its derivative."""
    w = turn.depth - course.axis.z_source
    rate = -sign * way.da / (way.a * way.a * turn.gradient)
    y[at.GROWN] = max(y[at.GROWN], abs(rate))
    if sign < 0.0 and w < y[at.HIGHEST]:
        y[at.HIGHEST], y[at.HIGHEST_RATE] = w, rate
    elif sign > 0.0 and w > y[at.LOWEST]:
        y[at.LOWEST], y[at.LOWEST_RATE] = w, rate


@kernel
def note_exit(way, state, y):
    """Record the exit of a direct ray from the water at the surface, if it is the first one."""
    if y[at.GONE] == 0.0:
        y[at.GONE] = max(state.range, 1e-9)
        y[at.GONE_RATE] = state.rate * way.da
        y[at.GONE_BEND] = -way.da / (way.a * state.sine * state.sine)


@kernel
def _put(row, way, state, boundary):
    """Write a node of a path."""
    c_ref = way.c_ref
    row[at.TIME] = c_ref * (way.a * state.range + state.action)
    row[at.RANGE], row[at.DEPTH], row[at.SIDE] = state.range, state.depth, 0.0
    row[at.P_RANGE], row[at.P_DEPTH] = way.a * c_ref, c_ref * state.sine / state.speed
    row[at.P_SIDE], row[at.BOUNDARY] = 0.0, boundary


@kernel
def _fill(path, count, piece, way, state, leg, last):
    """
    Record nodes of a long leg up to a state at a share of it, last; return the last row in use.
    """
    after, share = last
    n = min(2 * int((after.range - state.range) / _LONG), path.shape[0] - 3 - count)
    for i in range(1, n + 1):
        count += 1
        part = i / (n + 1.0)
        if is_straight(piece):
            point = _point_on_arc(piece, way, state, part * (after.range - state.range))
        else:
            point = point_on(piece, way, state, leg, part * share)
        _put(path[count], way, point.state, at.IN_WATER)
    return count


@inlined
def edges(walls, course):
    """
    Depths of the surface and of the deepest point of a ray; direct rays cross a varying surface.
    """
    top = walls.surface.depth[0, 0] if walls.surface.depth.size == 1 else -_BEYOND_ALL
    return top, walls.bed.depth[0, 0] if course.rule.kind != at.OPEN else _BEYOND_ALL


@inlined
def ahead(s, k, state, top, bottom):
    """Piece of layer k, and the depth of its next face ahead of a ray, the surface or the bed."""
    piece = piece_at(s, k)
    if state.sine > 0.0:
        return piece, min(piece.low, bottom)
    return piece, max(piece.top, top) if state.depth > top else piece.top


@kernel
def turn_back(walls, rule, ray, r, hit, reflections):
    """
    Count a reflection; return True if the ray continues, and its reflections at both boundaries
    with their code.
    """
    surface, bottom, code = reflections
    surface += 1 if hit == at.AT_SURFACE else 0
    bottom += 1 if hit == at.AT_BOTTOM else 0
    too_many = surface > rule.max_surface or bottom > rule.max_bottom
    if too_many and ray.K.shape[1] == at.N_FAN and ray.y[at.GONE] == 0.0:
        ray.y[at.GONE] = r
    if surface > rule.max_surface + rule.spare or bottom > rule.max_bottom + rule.spare:
        return False, at.Reflections(surface, bottom, code)
    mark = landed(walls, r, 0.0, bottom) + 2 if hit == at.AT_BOTTOM else ON_SURFACE
    return True, at.Reflections(surface, bottom, append_code(code, mark))


@shared
def trace_curves(s, walls, course, angle, ray):
    """Trace a ray as `trace.trace` does, if `fits_curves` is True."""
    out_of_line()
    z = course.axis.z_source
    way, state = launch(s, course, angle, ray.y)
    top, bottom = edges(walls, course)
    outward = (z <= top and state.sine < 0.0) or (z >= bottom and state.sine > 0.0)
    if course.rule.kind != at.OPEN and outward:
        return False, 0, 0, 0
    return walk(s, walls, course, way, (layer_of(s, z), state, at.Reflections(0, 0, 0)), ray)


@kernel
def launch(s, course, angle, y):
    """Constants and state of a ray at the source; a level ray bends towards lower sound speeds."""
    z, cb, sb, c_ref = course.axis
    sine = sb * math.cos(angle) + cb * math.sin(angle)
    cosine = cb * math.cos(angle) - sb * math.sin(angle)
    cosine = math.copysign(max(abs(cosine), _VERTICAL), cosine)
    for i in range(at.N_STATE):
        y[i] = 0.0
    if abs(sine) < _MIN_SINE:
        falls = speed_in(piece_at(s, layer_of(s, z)), z)[1] < 0.0
        sine = _MIN_SINE if falls else -_MIN_SINE
    way = at.Snell(cosine / c_ref, -sine / c_ref, sine * sine, c_ref)
    return way, State(z, c_ref, sine, 0.0, 0.0, 0.0)


@kernel
def walk(s, walls, course, way, start, ray):
    """Continue a ray to the end of its course from start: layer, state and reflections there."""
    k, state, reflections = start
    y, path, edge, rule = ray.y, ray.path, edges(walls, course), course.rule
    legs = rule.kind == at.LEGS
    full = ray.K.shape[1] == at.N_FULL
    room = path.shape[0] - 3 if full else -1
    count, turns, xi, ok = 0, 0, 0.0, True
    if room > 0:
        _put(path[0], way, state, at.IN_WATER)
    for _ in range(_MAX_PARTS):
        if not ok or 0 < room < count + 1:
            break
        # the next face ahead, or the end depth of the last leg
        down, z = state.sine > 0.0, state.depth
        piece, face = ahead(s, k, state, *edge)
        if legs and reflections.surface + reflections.bottom == rule.legs - 1:
            if z == rule.end_depth:
                _arrive_at_depth(way, state, ray)
                return True, count, turns, reflections.code
            face = min(face, rule.end_depth) if down else max(face, rule.end_depth)
        if not (face > z if down else face < z):
            k += 1 if down else -1
            ok = -_PIECES_BEYOND < k < s.depth.size + _PIECES_BEYOND
            continue
        # one leg to the face, or to the end of the course before it
        leg, before, share = next_leg(piece, way, state, face), state, 1.0
        state = end_of(piece, way, before, leg)
        ended = not (legs or state.range < course.length)
        if ended:
            point, share = _end_within(course.length, piece, way, before, leg, state.range)
            state = _arrive(course, way, point, ray)
        if room > 0:
            count = _fill(path, count, piece, way, before, leg, (state, share)) + 1
        if before.sine * state.sine < 0.0:
            ok = not legs
            turns += 1
            note_turn(course, way, leg.turn, 1.0 if down else -1.0, y)
        old, xi = xi, y[at.XI] if ended else divergence(way, state)
        y[at.GROWN] = max(y[at.GROWN], abs(xi))
        y[at.CAUSTICS_PASSED] += 1.0 if full and old * xi < 0.0 else 0.0
        # reflection at the surface or the bed
        hit = at.IN_WATER
        if not ended and state.sine < 0.0 and state.depth == edge[0] and z > edge[0]:
            hit = at.AT_SURFACE
            if rule.kind == at.OPEN:
                note_exit(way, state, y)
                hit = at.IN_WATER
        elif not ended and state.sine > 0.0 and state.depth == edge[1]:
            hit = at.AT_BOTTOM
        if hit != at.IN_WATER:
            if room > 0:  # a reflection has two nodes
                _put(path[count], way, state, hit)
                count += 1
            state, xi = turned_back(state), -xi
            ok, reflections = turn_back(walls, rule, ray, state.range, hit, reflections)
        if room > 0:
            _put(path[count], way, state, hit)
        if ended:  # a ray along a sound-speed maximum of SMOOTH water has no digits
            ok = s.kind == at.LINEAR or abs(state.sine) > 2.0 * _MIN_SINE
            return ok, count, turns, reflections.code
    return False, count, turns, reflections.code


@inlined
def turned_back(state):
    """State of a ray after its reflection."""
    return State(state.depth, state.speed, -state.sine, state.range, state.rate, state.action)

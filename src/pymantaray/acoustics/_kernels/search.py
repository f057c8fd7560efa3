"""All launch angles whose rays meet the receiver: an adaptive fan.

A fan of rays gives the miss ``F`` and its derivative by the launch angle. Between neighbours F is a cubic
Hermite polynomial, judged against a ray in the middle wherever a root is possible; intervals are halved
until each holds one root, none, or is narrower than the resolution. Pairs of roots about an extremum of
F (a caustic) show by the signs of the derivatives; rays that go through several cycles between neighbours show by
the slowness at the receiver, whose cubic is then not resolved. Where rays diverge their own errors grow with them: such
a ray is traced again, more finely, if it comes near the receiver.
"""

import math

import numpy as np

from pymantaray.acoustics._kernels.cubic import cubic
from pymantaray.acoustics._kernels.trace import GONE, GROWN, ON_SURFACE, OPEN, append_code, trace
from pymantaray.compile import kernel

# columns of a ray of a fan: launch angle, miss and its slope, slowness and its slope, whether it came, which reflections;
# scratch: error of the cubic about it, where it left the water or had too many reflections (0: nowhere), tolerance, how far it diverged on its way
ANGLE, MISS, SLOPE, SLOWNESS, TURN, GOOD, CODE, DEFECT, LEFT, TOL, GROWTH = range(11)
N_NODE = 11
N_BRACKET = 7  # of these an end of a bracket has the first
MAX_ROOTS = 256
MAX_STACK = 128
MAX_RAYS = 20_000
MAX_RAYS_INTERVAL = 1000
_RESOLVED = 0.3  # of the vertical slowness: defect of its cubic up to which its cycles are taken as resolved
_NARROW = 5e-5  # rad; between two weak rays so near to each other none is looked for
_BOUND = 4.0 / 27.0  # a cubic Hermite departs from its chord by at most this times each end's slope defect;
_WHOLE, _HALVED = 4.0, 1.5  # safety of it in an interval of the first fan, and in half of one
# Where rays diverge, measured by straight ones, the errors made on their way grow with them
_DIVERGING = 3.0  # from here on a ray is traced anew with a tolerance that allows for it,
_HOPELESS = 1e3  # up to here: weaker ones are no arrivals
_AMPLIFIED, _MOST = (
    10.0,
    100.0,
)  # the tolerance is smaller by the first times the divergence, or times the second
_ERRING = 500.0  # times tolerance and divergence away from the receiver, errors do not matter
_APART = 0.25  # of the link: rays that left the water so far from each other did so at other cycles,
_WINDOW = 2e-5  # rad; and between them may be a window of rays that did not, if not narrower than this


@kernel
def shoot(s, floor, rule, angle, target, length, axis, tol, growth, node, work):
    """Trace a ray of a fan into a node, so that it ends within tol of where it should; growth is the divergence to expect.

    Slopes are derivatives by the launch angle. For a receiver on a boundary a reflection there is unfolded: rays that were
    reflected just before they reach it miss it on the other side, so that the miss changes sign at the receiver.
    """
    grown = 0.0
    while True:
        allowed = tol / (_AMPLIFIED * min(growth, _MOST)) if _DIVERGING < growth < _HOPELESS else tol
        ok, _, _, _, _, code = trace(
            s, floor, rule, angle, 0.0, length, axis, allowed, work.y, work.K_fan, work.ynew, work.no_path
        )
        grown = work.y[GROWN] / length
        gone = rule.kind == OPEN and work.y[GONE] > 0.0
        far = gone or grown > _HOPELESS or abs(work.y[0] - target) > _ERRING * tol * grown
        if grown < max(_DIVERGING, 1.5 * growth) or far:
            break
        growth = grown
    node[ANGLE], node[MISS], node[SLOPE] = angle, work.y[0] - target, work.y[2]
    node[SLOWNESS], node[TURN] = work.y[1], work.y[3]
    node[GOOD], node[CODE] = 1.0 if ok else 0.0, code
    node[LEFT], node[TOL], node[GROWTH] = work.y[GONE], tol, grown
    if rule.fold != 0 and (code % 1024 // 32 if rule.fold == ON_SURFACE else code % 32) % 2 == 1:
        for i in (MISS, SLOPE, SLOWNESS, TURN):
            node[i] = -node[i]


@kernel
def _same_code(a, b, fold):
    """Whether the miss is smooth between two rays: the same reflections, or one more where the receiver is."""
    if a[CODE] == b[CODE]:
        return True
    return fold != 0 and (
        append_code(int(a[CODE]), fold) == b[CODE] or append_code(int(b[CODE]), fold) == a[CODE]
    )


@kernel
def _too_many(node, rule):
    """Whether a ray was lost or reflected more often than is asked for."""
    counts = int(node[CODE]) % 1024
    return node[GOOD] == 0.0 or counts // 32 > rule.max_surface or counts % 32 > rule.max_bottom


@kernel
def fewer_bounces(bracket):
    """Which of a bracket's rays has fewer reflections."""
    return 0 if int(bracket[0, CODE]) % 1024 <= int(bracket[1, CODE]) % 1024 else 1


@kernel
def _far(node, h):
    """Whether a miss cannot vanish within h, also where its derivative grows like an inverse root."""
    return node[GOOD] == 0.0 or abs(node[MISS]) > 3.0 * abs(node[SLOPE]) * h


@kernel
def _oscillates(a, b, h):
    """Whether the slowness at the receiver's plane varies between two rays by more than its slopes show.

    Rays that go through several cycles between neighbours may both be at the top of one, where the miss is flat.
    """
    rise = b[SLOWNESS] - a[SLOWNESS]
    defect = max(abs(h * a[TURN] - rise), abs(h * b[TURN] - rise))
    return defect > _RESOLVED * max(abs(math.sin(a[ANGLE])), abs(math.sin(b[ANGLE])), 0.02)


@kernel
def _window(a, b, length):
    """Whether two rays left so far apart that between them may be some that did not: that turn once more before."""
    return a[LEFT] * b[LEFT] > 0.0 and abs(a[LEFT] - b[LEFT]) > _APART * length


@kernel
def _points_across(end, rule, overhang):
    """Whether a reflected ray at an edge of its cells would meet the receiver beyond it, were they larger.

    Out of the plane, where slopes across it lead the ray, it may be within the edge.
    """
    if _too_many(end, rule) or int(end[CODE]) % 32 == 0:
        return False
    beyond = -end[MISS] / end[SLOPE]
    return 0.0 < beyond < overhang or overhang < beyond < 0.0


@kernel
def copy_ray(source, target):
    """Copy as many columns of a ray as there is room for."""
    for i in range(target.shape[0]):
        target[i] = source[i]


@kernel
def find_brackets(
    s, floor, rule, n_nodes, target, length, axis, tol, fine, min_width, trust, steep, weak, overhang, work
):
    """Brackets of all roots of the miss between the first and the last of work.nodes.

    Where rays are reflected, only roots of rays that were: the miss is smooth between rays of
    one code; across a change of code it may bend or jump, and its slopes are believed beyond the angle steep and in
    intervals narrower than trust. Where it comes as near to zero as the tolerance is large, or changes sign without
    getting smooth, rays are traced anew with the tolerance fine. Rays at a change of code that would meet the receiver less
    than overhang beyond it are brackets without width. Slopes above weak are those of rays too weak to be looked for.
    Between rays that all have too many reflections, but got them far apart, rays with fewer are looked for in
    intervals wider than trust. work.brackets receives the rays at both ends. Returns their number, the smallest
    miss met, the rays traced and whether the budget sufficed.
    """
    fan, st, brackets = work.fan, work.stack, work.brackets
    walls = rule.kind != OPEN
    margin = np.inf
    rays = n_nodes
    for i in range(n_nodes):
        shoot(s, floor, rule, work.nodes[i], target, length, axis, tol, 0.0, fan[i], work)
        fan[i, DEFECT] = 0.0
        if fan[i, GOOD] > 0.0:
            margin = min(margin, abs(fan[i, MISS]))
    for i in range(1, n_nodes - 1):
        a, m, b = fan[i - 1], fan[i], fan[i + 1]
        if a[GOOD] * m[GOOD] * b[GOOD] > 0.0 and a[CODE] == m[CODE] == b[CODE]:
            m[DEFECT] = 2.0 * _defect(a, m, b)
    n_found = 0
    complete = True
    left, right = 0, n_nodes - 2
    while left <= right:  # the steepest interval first: towards the axis rays may be without number
        if abs(work.nodes[left]) >= abs(work.nodes[right + 1]):
            i = left
            left += 1
        else:
            i = right
            right -= 1
        top = 0
        copy_ray(fan[i], st[0, 0])
        copy_ray(fan[i + 1], st[0, 1])
        st[0, 0, DEFECT] = max(fan[i, DEFECT], fan[i + 1, DEFECT])
        budget = rays + MAX_RAYS_INTERVAL
        room = n_found + MAX_ROOTS // 4
        outwards = fan[i, ANGLE] + fan[i + 1, ANGLE] > 0.0
        width = fan[i + 1, ANGLE] - fan[i, ANGLE]
        while top >= 0:
            a, b, m = st[top, 0], st[top, 1], work.node
            fa, fb = a[MISS], b[MISS]
            e, tol_here = a[DEFECT], max(a[TOL], b[TOL])
            h = b[ANGLE] - a[ANGLE]
            alive = a[GOOD] > 0.0 and b[GOOD] > 0.0
            same = alive and _same_code(a, b, rule.fold)
            top -= 1
            if walls and same and a[CODE] * b[CODE] == 0.0:  # direct
                continue
            lost = a[GOOD] + b[GOOD] == 0.0 or (walls and _too_many(a, rule) and _too_many(b, rule))
            if lost:
                if not walls or h < trust or not _window(a, b, length):
                    continue
                same = False
            elif walls and not same:
                believed = h < trust or min(abs(a[ANGLE]), abs(b[ANGLE])) > steep
                if h < min_width or (believed and _far(a, h) and _far(b, h)):
                    for i_end in range(2):
                        if overhang > 0.0 and n_found < min(brackets.shape[0], room):
                            end = st[top + 1, i_end]
                            if _points_across(end, rule, overhang if i_end == 0 else -overhang):
                                copy_ray(end, brackets[n_found, 0])
                                copy_ray(end, brackets[n_found, 1])
                                n_found += 1
                    continue
            elif alive:
                rise = fb - fa
                ea = h * a[SLOPE] - rise
                eb = h * b[SLOPE] - rise
                monotonic = (
                    a[SLOPE] * rise > 0.0
                    and b[SLOPE] * rise > 0.0
                    and max(abs(ea), abs(eb)) < 1.5 * abs(rise)
                    and e < 0.05 * abs(rise)
                    and not _oscillates(a, b, h)
                )
                if fa == 0.0 or fa * fb < 0.0:
                    if monotonic or h < min_width:
                        if n_found < min(brackets.shape[0], room):
                            copy_ray(a, brackets[n_found, 0])
                            copy_ray(b, brackets[n_found, 1])
                            n_found += 1
                        else:
                            complete = False
                        continue
                else:
                    nearest = min(abs(fa), abs(fb))
                    reach = (_WHOLE if h == width else _HALVED) * _BOUND * (abs(ea) + abs(eb)) + e
                    window = s.n_range > 1 and h > _WINDOW and _window(a, b, length)
                    # Next to an end that is nearer to zero than the tolerance all others would be halved without end;
                    # on which side of zero that end is, only the fine tolerance tells.
                    sure = tol_here <= fine or nearest > 4.0 * tol_here
                    even = sure and monotonic and max(abs(ea), abs(eb)) < 0.5 * abs(rise)
                    clear = even or (nearest > reach + tol_here and not _oscillates(a, b, h))
                    clear = clear and not window
                    if h < min_width or clear:
                        continue
            elif h < min_width:
                continue
            doubtful = fa * fb < 0.0 and h < _NARROW  # rays part so fast that the fan's tolerance shows
            if same and tol_here > fine and (doubtful or min(abs(fa), abs(fb)) < 4.0 * tol_here):
                for end in (a, b):
                    if end[TOL] > fine:
                        shoot(s, floor, rule, end[ANGLE], target, length, axis, fine, end[GROWTH], end, work)
                        rays += 1
                a[DEFECT] = e
                top += 1
                continue
            if same and h < _NARROW and min(abs(a[SLOPE]), abs(b[SLOPE])) > weak:
                continue
            if rays >= budget or rays >= MAX_RAYS or top + 3 >= st.shape[0]:
                complete = (
                    complete and walls and not same and h < _NARROW
                )  # an edge between reflections is no ray
                continue
            growth = min(a[GROWTH], b[GROWTH]) if a[LEFT] * b[LEFT] == 0.0 else 0.0
            shoot(
                s, floor, rule, 0.5 * (a[ANGLE] + b[ANGLE]), target, length, axis, tol_here, growth, m, work
            )
            rays += 1
            if m[GOOD] > 0.0:
                margin = min(margin, abs(m[MISS]))
            if m[GOOD] > 0.0 and same and _same_code(a, m, rule.fold) and _same_code(m, b, rule.fold):
                e = 4.0 * _defect(a, m, b)
            elif walls:
                e = 1e30  # not known: judge the halves by their own middles
            # the steeper half goes on top: towards a sound-speed minimum's axis rays may be without number
            top += 1
            if outwards:
                copy_ray(b, st[top + 1, 1])
                copy_ray(m, st[top + 1, 0])
                copy_ray(m, b)
            else:
                copy_ray(a, st[top + 1, 0])
                copy_ray(m, st[top + 1, 1])
                copy_ray(m, a)
            for half in range(2):
                st[top + half, 0, DEFECT] = e
            top += 1
    return n_found, margin, rays, complete


@kernel
def _defect(a, m, b):
    """Greatest departure of the cubic over the wider part of [a, b], from that of the ray between: a quartic's."""
    h = b[ANGLE] - a[ANGLE]
    t = (m[ANGLE] - a[ANGLE]) / h
    found = abs(m[MISS] - cubic(t, h, a[MISS], a[SLOPE], b[MISS], b[SLOPE]))
    shape = max((t * (1.0 - t)) ** 2, 1e-4)
    return found / 16.0 / shape * max(t, 1.0 - t) ** 4

"""All launch angles whose rays meet the receiver: an adaptive fan.

A fan of rays gives the miss ``F`` and its derivative by the launch angle. Between neighbours F is a cubic
Hermite polynomial, judged against a ray in the middle wherever a root is possible; intervals are halved
until each holds one root, none, or is narrower than the resolution. Pairs of roots about an extremum of
F (a caustic) show by the signs of the derivatives; rays that go through several cycles between neighbours show by
the slowness at the receiver, whose cubic is then not resolved.
"""

import math

import numpy as np

from pymantaray.acoustics._kernels.compile import kernel
from pymantaray.acoustics._kernels.cubic import cubic
from pymantaray.acoustics._kernels.trace import ON_SURFACE, OPEN, append_code, trace

# columns of a ray of a fan; DEFECT is scratch: of the cubic about it, or of the interval that it starts or ends
ANGLE, MISS, SLOPE, SLOWNESS, TURN, GOOD, CODE, DEFECT = 0, 1, 2, 3, 4, 5, 6, 7
N_NODE = 8
MAX_ROOTS = 256
MAX_STACK = 128
MAX_RAYS = 20_000
MAX_RAYS_INTERVAL = 1000
_RESOLVED = 0.3  # of the vertical slowness: defect of its cubic up to which its cycles are taken as resolved
_NARROW = 5e-5  # rad; between two weak rays so near to each other none is looked for
_BOUND = 4.0 / 27.0  # a cubic Hermite departs from its chord by at most this times each end's slope defect


@kernel
def shoot(s, floor, rule, angle, target, length, axis, tol, node, work):
    """Trace a ray of a fan into a node: angle, miss at the receiver's plane, its slope, slowness, its slope, ok, code.

    Slopes are derivatives by the launch angle. For a receiver on a boundary a reflection there is unfolded: rays that were
    reflected just before they reach it miss it on the other side, so that the miss changes sign at the receiver.
    """
    ok, _, _, _, _, code = trace(
        s, floor, rule, angle, 0.0, length, axis, tol, work.y, work.K_fan, work.ynew, work.no_path
    )
    node[ANGLE], node[MISS], node[SLOPE] = angle, work.y[0] - target, work.y[2]
    node[SLOWNESS], node[TURN] = work.y[1], work.y[3]
    node[GOOD], node[CODE] = 1.0 if ok else 0.0, code
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
def _copy(source, target):
    for i in range(N_NODE):
        target[i] = source[i]


@kernel
def find_brackets(
    s, floor, rule, n_nodes, target, length, axis, tol, fine, min_width, trust, steep, weak, work
):
    """Brackets of all roots of the miss between the first and the last of work.nodes.

    Where rays are reflected, only roots of rays that were: the miss is smooth between rays of
    one code; across a change of code it may bend or jump, and its slopes are believed beyond the angle steep and in
    intervals narrower than trust. Where it comes as near to zero as the tolerance is large, or changes sign without
    getting smooth, rays are traced anew with the tolerance fine. Slopes above weak are those of rays too weak to be looked for. work.brackets receives the rays at both ends. Returns their number, the smallest
    miss met, the rays traced and whether the budget sufficed.
    """
    fan, st, brackets = work.fan, work.stack, work.brackets
    walls = rule.kind != OPEN
    margin = np.inf
    rays = n_nodes
    for i in range(n_nodes):
        shoot(s, floor, rule, work.nodes[i], target, length, axis, tol, fan[i], work)
        fan[i, DEFECT] = 0.0
        if fan[i, GOOD] > 0.0:
            margin = min(margin, abs(fan[i, MISS]))
    for i in range(1, n_nodes - 1):
        a, m, b = fan[i - 1], fan[i], fan[i + 1]
        if a[GOOD] * m[GOOD] * b[GOOD] > 0.0 and a[CODE] == m[CODE] == b[CODE]:
            m[DEFECT] = _defect(a, m, b) / 8.0
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
        _copy(fan[i], st[0, 0])
        _copy(fan[i + 1], st[0, 1])
        st[0, 0, DEFECT] = max(fan[i, DEFECT], fan[i + 1, DEFECT])
        st[0, 1, DEFECT] = tol
        budget = rays + MAX_RAYS_INTERVAL
        room = n_found + MAX_ROOTS // 4
        outwards = fan[i, ANGLE] + fan[i + 1, ANGLE] > 0.0
        while top >= 0:
            a, b, m = st[top, 0], st[top, 1], work.node
            fa, fb = a[MISS], b[MISS]
            e, tol_here = a[DEFECT], b[DEFECT]
            h = b[ANGLE] - a[ANGLE]
            alive = a[GOOD] > 0.0 and b[GOOD] > 0.0
            same = alive and _same_code(a, b, rule.fold)
            top -= 1
            if a[GOOD] + b[GOOD] == 0.0 or (walls and same and a[CODE] * b[CODE] == 0.0):  # lost, or direct
                continue
            if walls and _too_many(a, rule) and _too_many(b, rule):
                continue
            if walls and not same:
                believed = h < trust or min(abs(a[ANGLE]), abs(b[ANGLE])) > steep
                if h < min_width or (believed and _far(a, h) and _far(b, h)):
                    continue
            elif alive:
                rise = fb - fa
                ea = h * a[SLOPE] - rise
                eb = h * b[SLOPE] - rise
                if fa == 0.0 or fa * fb < 0.0:
                    single = (
                        a[SLOPE] * rise > 0.0
                        and b[SLOPE] * rise > 0.0
                        and max(abs(ea), abs(eb)) < 1.5 * abs(rise)
                        and not _oscillates(a, b, h)
                    )
                    if (single and e < 0.05 * abs(rise)) or h < min_width:
                        if n_found < min(brackets.shape[0], room):
                            _copy(a, brackets[n_found, 0])
                            _copy(b, brackets[n_found, 1])
                            n_found += 1
                        else:
                            complete = False
                        continue
                else:
                    nearest = min(abs(fa), abs(fb))
                    reach = 1.5 * _BOUND * (abs(ea) + abs(eb)) + e
                    if h < min_width or (nearest > reach + tol_here and not _oscillates(a, b, h)):
                        continue
            elif h < min_width:
                continue
            doubtful = fa * fb < 0.0 and h < _NARROW  # rays part so fast that the fan's tolerance shows
            if same and tol_here > fine and (doubtful or min(abs(fa), abs(fb)) < 4.0 * tol_here):
                for end in (a, b):
                    shoot(s, floor, rule, end[ANGLE], target, length, axis, fine, end, work)
                a[DEFECT], b[DEFECT] = e, fine
                rays += 2
                top += 1
                continue
            if same and h < _NARROW and min(abs(a[SLOPE]), abs(b[SLOPE])) > weak:
                continue
            if rays >= budget or rays >= MAX_RAYS or top + 3 >= st.shape[0]:
                complete = (
                    complete and walls and not same and h < _NARROW
                )  # an edge between reflections is no ray
                continue
            shoot(s, floor, rule, 0.5 * (a[ANGLE] + b[ANGLE]), target, length, axis, tol_here, m, work)
            rays += 1
            if m[GOOD] > 0.0:
                margin = min(margin, abs(m[MISS]))
            if m[GOOD] > 0.0 and same and _same_code(a, m, rule.fold) and _same_code(m, b, rule.fold):
                e = _defect(a, m, b) / 4.0
            elif walls:
                e = 1e30  # not known: judge the halves by their own middles
            # the steeper half goes on top: towards a sound-speed minimum's axis rays may be without number
            top += 1
            if outwards:
                _copy(b, st[top + 1, 1])
                _copy(m, st[top + 1, 0])
                _copy(m, b)
            else:
                _copy(a, st[top + 1, 0])
                _copy(m, st[top + 1, 1])
                _copy(m, a)
            for half in range(2):
                st[top + half, 0, DEFECT], st[top + half, 1, DEFECT] = e, tol_here
            top += 1
    return n_found, margin, rays, complete


@kernel
def _defect(a, m, b):
    """Distance of a ray's miss from the cubic between two others."""
    h = b[ANGLE] - a[ANGLE]
    t = (m[ANGLE] - a[ANGLE]) / h
    return abs(m[MISS] - cubic(t, h, a[MISS], a[SLOPE], b[MISS], b[SLOPE]))

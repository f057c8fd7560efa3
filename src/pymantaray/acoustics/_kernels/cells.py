"""Reflected rays cell by cell: Newton's method over given cells of the sea bed, each continued beyond its edges.

The bed's slope jumps at the edges of its cells, and with it the end of a ray: Newton's method stops there, and a ray over
cells that no ray in the plane of the link meets is not begun at all. Over given cells, continued, the end is a smooth
function of the launch. A candidate is a row of cells and a launch. One whose ray is reflected beyond an edge leads to the
cells that are there, and a ray that is found to the neighbours of its cells that are near enough to reflect another.
"""

import math

from pymantaray.acoustics._kernels.boundary import (
    AT_BOTTOM,
    BOUNDARY,
    HELD,
    LANDED,
    P_DEPTH,
    RANGE,
    SIDE,
    TIME,
    TRIED,
    floor_at,
    hold,
)
from pymantaray.acoustics._kernels.refine import cubic_angle
from pymantaray.acoustics._kernels.refine_bounced import newton
from pymantaray.acoustics._kernels.search import ANGLE, CODE, MISS, SLOPE, fewer_bounces
from pymantaray.acoustics._kernels.trace import MOST_BOUNCES, trace
from pymantaray.compile import kernel

# columns of a candidate after its cells: launch angle, cross-track slowness, reflections at both boundaries, generation
_M, _Q, _COUNTS, _GENERATION = MOST_BOUNCES + 1, MOST_BOUNCES + 2, MOST_BOUNCES + 3, MOST_BOUNCES + 4
N_CANDIDATE = MOST_BOUNCES + 5
MAX_CANDIDATES = 96
KNOWN, _FAILED = 99, -1  # generations of a ray that is found and of a candidate that led to none
_MOST_GENERATIONS = 4  # of candidates that lead to others
_ALIKE, _ALIKE_FAILED = 0.1, 0.02  # rad; candidates of the same cells launched so near to each other are one
_REACH = 4.0  # times the shift of a reflection that another slope of the bed causes, were the bed flat else
_BACK = 1e-6  # rad; an edge is where the search's tolerance puts it
_STEEPER = 0.01  # rad


@kernel
def _find(candidates, n, cells, m, counts):
    """Row of the candidate of so many reflections in a row of cells, launched alike; -1 where there is none."""
    for i in range(n):
        alike = _ALIKE if candidates[i, _GENERATION] != _FAILED else _ALIKE_FAILED
        if candidates[i, _COUNTS] == counts and abs(candidates[i, _M] - m) < alike:
            same = True
            for j in range(counts % 32):
                same = same and candidates[i, j] == cells[j]
            if same:
                return i
    return -1


@kernel
def add_candidate(candidates, n, cells, m, q, counts, generation):
    """Append a candidate unless it is there or there is no room; return their number."""
    if n >= candidates.shape[0] or _MOST_GENERATIONS < generation < KNOWN or counts % 32 == 0:
        return n
    if _find(candidates, n, cells, m, counts) >= 0:
        return n
    for j in range(counts % 32):
        candidates[n, j] = cells[j]
    candidates[n, _M], candidates[n, _Q] = m, q
    candidates[n, _COUNTS], candidates[n, _GENERATION] = counts, generation
    return n + 1


@kernel
def candidate(candidates, i):
    """Reflections of a candidate, and its generation."""
    return int(candidates[i, _COUNTS]), int(candidates[i, _GENERATION])


@kernel
def add_of_bracket(s, floor, rule, bracket, candidates, n, aim, work):
    """Append the cells of a bracket's ray; one without width is a ray at an edge of its cells."""
    inner = fewer_bounces(bracket)
    code = int(bracket[inner, CODE])
    angle = bracket[inner, ANGLE]
    if bracket[0, ANGLE] == bracket[1, ANGLE]:
        start = angle - bracket[inner, MISS] / bracket[inner, SLOPE]
        back = math.copysign(_BACK, angle - start)
    else:
        start = cubic_angle(bracket[0], bracket[1], 0.0)
        angle, back = start, 0.0
    for _ in range(3):
        _, _, _, _, _, found = trace(
            s,
            floor,
            rule,
            angle,
            0.0,
            aim.length,
            aim.axis,
            aim.tol,
            work.y,
            work.K_fan,
            work.ynew,
            work.no_path,
        )
        if found == code:
            return add_candidate(candidates, n, floor.cells[LANDED], start, 0.0, code % 1024, 0)
        if back == 0.0:
            angle = bracket[inner, ANGLE]
        else:
            angle += back
            back *= 10.0
    return n


@kernel
def add_neighbours(floor, candidates, n, m, q, counts, generation, steps, work):
    """Append the cells of the ray in work.path, one of them exchanged for a neighbour within reach."""
    path, cells = work.path, floor.cells
    n_e = floor.east.size
    bed = hold(floor, 0.0)
    for j in range(counts % 32):
        cells[TRIED, j] = cells[LANDED, j]
    bounce, i = 0, 0
    while bounce < counts % 32 and i < steps:
        i += 1
        if path[i, BOUNDARY] != AT_BOTTOM:
            continue
        own = int(cells[LANDED, bounce])
        r, y = path[i, RANGE], path[i, SIDE]
        north, east = floor.n0 + r * floor.un - y * floor.ue, floor.e0 + r * floor.ue + y * floor.un
        before, after = path[i, TIME], path[steps, TIME] - path[i, TIME]
        lever = before * after / (before + after) / max(abs(path[i, P_DEPTH]), 0.1)
        cells[HELD, 0] = own
        _, f_r, f_y, _, _ = floor_at(bed, r, y, r)
        for k in range(9):
            i_n, i_e = own // n_e + k // 3 - 1, own % n_e + k % 3 - 1
            inside = 0 <= i_n < max(floor.north.size - 1, 1) and 0 <= i_e < max(n_e - 1, 1)
            if k == 4 or not inside:
                continue
            gap = 0.0
            if k // 3 != 1:
                gap = abs(floor.north[i_n + (1 if k // 3 == 0 else 0)] - north)
            if k % 3 != 1:
                gap = max(gap, abs(floor.east[i_e + (1 if k % 3 == 0 else 0)] - east))
            cells[HELD, 0] = i_n * n_e + i_e
            _, g_r, g_y, _, _ = floor_at(bed, r, y, r)
            if gap < _REACH * lever * math.hypot(g_r - f_r, g_y - f_y):
                cells[TRIED, bounce] = cells[HELD, 0]
                n = add_candidate(candidates, n, cells[TRIED], m, q, counts, generation)
                cells[TRIED, bounce] = own
        bounce += 1
        i += 1  # a reflection takes two rows
    return n


@kernel
def follow(s, floor, rule, candidates, i, n, bracket, aim, work):
    """Newton's method over the cells of candidate i, then over the sea bed as it is.

    Returns the number of candidates, ok, launch angle, cross-track slowness, steps and turning points.
    """
    counts, generation = candidate(candidates, i)
    n_b = counts % 32
    for j in range(floor.cells.shape[1]):
        floor.cells[HELD, j] = candidates[i, j] if j < n_b else -1.0
    m, q = candidates[i, _M], candidates[i, _Q]
    candidates[i, _GENERATION] = _FAILED
    ok, jacobian, steps, turns, code = False, (0.0, 0.0, 0.0, 0.0), 0, 0, 0
    for attempt in range(5):
        ok, m, q, jacobian, steps, turns, code = newton(
            s,
            hold(floor, 0.0),
            rule,
            m,
            q,
            (0.0, 0.0, 0.0, 0.0),
            12,
            counts,
            False,
            bracket,
            False,
            aim,
            work,
        )
        if code % 1024 == counts or code % 32 != n_b:
            break
        # it turns just below the surface, or is reflected there once too often
        m += math.copysign(_STEEPER * 2.0**attempt, m if code % 1024 < counts else -m)
    if code % 1024 != counts:
        return n, False, m, q, steps, turns
    same = True
    for j in range(n_b):
        same = same and floor.cells[LANDED, j] == floor.cells[HELD, j]
    if not same:
        there = _find(candidates, n, floor.cells[LANDED], m, counts)
        if there < 0:
            n = add_candidate(candidates, n, floor.cells[LANDED], m, q, counts, generation + 1)
        elif candidates[there, _GENERATION] != KNOWN:  # cells that lead to each other, round a corner
            n = add_neighbours(floor, candidates, n, m, q, counts, generation + 1, steps, work)
        return n, False, m, q, steps, turns
    if ok:
        ok, m, q, _, steps, turns, _ = newton(
            s, floor, rule, m, q, jacobian, 6, code, True, bracket, False, aim, work
        )
    if ok:
        candidates[i, _GENERATION] = KNOWN
    return n, ok, m, q, steps, turns

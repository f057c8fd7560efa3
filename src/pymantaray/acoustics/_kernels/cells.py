"""Reflected rays cell by cell: Newton's method over given cells of the sea bed, each continued beyond its edges.

The bed's slope jumps at the edges of its cells, and with it the end of a ray: Newton's method stops there, and a ray over
cells that no ray in the plane of the link meets is not begun at all. Over given cells, continued, the end is a smooth
function of the launch. A candidate is a row of cells and a launch. One whose ray is reflected beyond an edge leads to the
cells that are there, and a ray that is found to the neighbours of its cells that are near enough to reflect another.
"""

import math

from pymantaray.acoustics._kernels import layout as at
from pymantaray.acoustics._kernels.boundary import bed_at, hold, place_at
from pymantaray.acoustics._kernels.refine import Launch, Trial, cubic_angle, newton
from pymantaray.acoustics._kernels.search import fewer_bounces
from pymantaray.acoustics._kernels.trace import fan_ray, trace
from pymantaray.compile import kernel

KNOWN, _FAILED = 99, -1  # generations of a ray that is found and of a candidate that led to none
_MOST_GENERATIONS = 4  # of candidates that lead to others
_ALIKE, _ALIKE_FAILED = 0.1, 0.02  # rad; candidates of the same cells launched so near to each other are one
_SHIFT_MARGIN = 4.0  # times the shift of a reflection by another slope of the bed, within which a neighbouring cell is tried
_BACK = 1e-6  # rad; an edge is where the search's tolerance puts it
_STEEPER = 0.01  # rad


@kernel
def _find(candidates, n, cells, m, counts):
    """Row of the candidate of so many reflections in a row of cells, launched alike; -1 where there is none."""
    for i in range(n):
        alike = _ALIKE if candidates[i, at.CANDIDATE_GENERATION] != _FAILED else _ALIKE_FAILED
        if (
            candidates[i, at.CANDIDATE_COUNTS] == counts
            and abs(candidates[i, at.CANDIDATE_ANGLE] - m) < alike
        ):
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
    candidates[n, at.CANDIDATE_ANGLE], candidates[n, at.CANDIDATE_Q] = m, q
    candidates[n, at.CANDIDATE_COUNTS], candidates[n, at.CANDIDATE_GENERATION] = counts, generation
    return n + 1


@kernel
def candidate(candidates, i):
    """Reflections of a candidate, and its generation."""
    return int(candidates[i, at.CANDIDATE_COUNTS]), int(candidates[i, at.CANDIDATE_GENERATION])


@kernel
def add_of_bracket(s, walls, course, bracket, n, tol, work):
    """Append the cells of a bracket's ray; one without width is a ray at an edge of its cells."""
    inner = fewer_bounces(bracket)
    code = int(bracket[inner, at.CODE])
    angle = bracket[inner, at.ANGLE]
    if bracket[0, at.ANGLE] == bracket[1, at.ANGLE]:
        start = angle - bracket[inner, at.MISS] / bracket[inner, at.SLOPE]
        back = math.copysign(_BACK, angle - start)
    else:
        start = cubic_angle(bracket[0], bracket[1], 0.0)
        angle, back = start, 0.0
    for _ in range(3):
        _, _, _, code_there = trace(s, walls, course, angle, 0.0, tol, fan_ray(work))
        if code_there == code:
            return add_candidate(work.candidates, n, walls.cells[at.LANDED], start, 0.0, code % 1024, 0)
        if back == 0.0:
            angle = bracket[inner, at.ANGLE]
        else:
            angle += back
            back *= 10.0
    return n


@kernel
def add_neighbours(walls, n, launch, counts, generation, work):
    """Append the cells of the ray in work.path, one of them exchanged for a neighbour within reach."""
    path, cells, grid, candidates, steps = work.path, walls.cells, walls.bed, work.candidates, launch.steps
    n_e = grid.east.size
    bed = hold(walls, 0.0)
    for j in range(counts % 32):
        cells[at.TRIED, j] = cells[at.LANDED, j]
    bounce, i = 0, 0
    while bounce < counts % 32 and i < steps:
        i += 1
        if path[i, at.BOUNDARY] != at.AT_BOTTOM:
            continue
        own = int(cells[at.LANDED, bounce])
        r, y = path[i, at.RANGE], path[i, at.SIDE]
        north, east = place_at(walls.line, r, y)
        before, after = path[i, at.TIME], path[steps, at.TIME] - path[i, at.TIME]
        lever = before * after / (before + after) / max(abs(path[i, at.P_DEPTH]), 0.1)
        cells[at.HELD, 0] = own
        _, f_r, f_y, _, _ = bed_at(bed, r, y, r)
        for k in range(9):
            i_n, i_e = own // n_e + k // 3 - 1, own % n_e + k % 3 - 1
            inside = 0 <= i_n < max(grid.north.size - 1, 1) and 0 <= i_e < max(n_e - 1, 1)
            if k == 4 or not inside:
                continue
            gap = 0.0
            if k // 3 != 1:
                gap = abs(grid.north[i_n + (1 if k // 3 == 0 else 0)] - north)
            if k % 3 != 1:
                gap = max(gap, abs(grid.east[i_e + (1 if k % 3 == 0 else 0)] - east))
            cells[at.HELD, 0] = i_n * n_e + i_e
            _, g_r, g_y, _, _ = bed_at(bed, r, y, r)
            if gap < _SHIFT_MARGIN * lever * math.hypot(g_r - f_r, g_y - f_y):
                cells[at.TRIED, bounce] = cells[at.HELD, 0]
                n = add_candidate(candidates, n, cells[at.TRIED], launch.angle, launch.q, counts, generation)
                cells[at.TRIED, bounce] = own
        bounce += 1
        i += 1  # a reflection takes two rows
    return n


@kernel
def follow(s, walls, course, place, bracket, accuracy, work):
    """Newton's method over the cells of a candidate, then over the sea bed as it is.

    place is the number of the candidate, and of all. Returns the number of candidates then, and the ray.
    """
    candidates, (i, n) = work.candidates, place
    counts, generation = candidate(candidates, i)
    n_b = counts % 32
    for j in range(walls.cells.shape[1]):
        walls.cells[at.HELD, j] = candidates[i, j] if j < n_b else -1.0
    m, q = candidates[i, at.CANDIDATE_ANGLE], candidates[i, at.CANDIDATE_Q]
    candidates[i, at.CANDIDATE_GENERATION] = _FAILED
    none = (0.0, 0.0, 0.0, 0.0)
    held = hold(walls, 0.0)
    launch, jacobian, code = newton(
        s, held, course, Trial(m, q, none, 12, counts, False), bracket, False, accuracy, work
    )
    for attempt in range(4):
        if code % 1024 == counts or code % 32 != n_b:
            break
        # it turns just below the surface, or is reflected there once too often
        m, q = launch.angle, launch.q
        m += math.copysign(_STEEPER * 2.0**attempt, m if code % 1024 < counts else -m)
        launch, jacobian, code = newton(
            s, held, course, Trial(m, q, none, 12, counts, False), bracket, False, accuracy, work
        )
    m, q = launch.angle, launch.q
    lost = Launch(False, m, q, launch.steps, launch.turns)
    if code % 1024 != counts:
        return n, lost
    same = True
    for j in range(n_b):
        same = same and walls.cells[at.LANDED, j] == walls.cells[at.HELD, j]
    if not same:
        there = _find(candidates, n, walls.cells[at.LANDED], m, counts)
        if there < 0:
            n = add_candidate(candidates, n, walls.cells[at.LANDED], m, q, counts, generation + 1)
        elif (
            candidates[there, at.CANDIDATE_GENERATION] != KNOWN
        ):  # cells that lead to each other, round a corner
            n = add_neighbours(walls, n, launch, counts, generation + 1, work)
        return n, lost
    if not launch.ok:
        return n, lost
    launch, _, _ = newton(
        s, walls, course, Trial(m, q, jacobian, 6, code, True), bracket, False, accuracy, work
    )
    if launch.ok:
        candidates[i, at.CANDIDATE_GENERATION] = KNOWN
    return n, launch

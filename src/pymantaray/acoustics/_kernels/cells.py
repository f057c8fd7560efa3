"""
Reflected rays for given cells of the sea bed: Newton's method over cells that are extended beyond
their edges.

At the edges of cells, the slope of the bed is discontinuous, and so is the end of a ray. Newton's
method stops there, and it does not start for cells that no ray in the plane of the link meets. Over
given, extended cells, the end of a ray is a smooth function of the launch. A candidate is a
sequence of cells and a launch. If its ray is reflected beyond an edge, the cells there become a new
candidate. If it is an eigenray, neighbours of its cells that are close enough to reflect another
ray become candidates.
"""

import math

from pymantaray.acoustics._kernels import layout as at
from pymantaray.acoustics._kernels.boundary import bed_at, hold, place_at
from pymantaray.acoustics._kernels.refine import Launch, Trial, cubic_angle, newton
from pymantaray.acoustics._kernels.search import fewer_bounces
from pymantaray.acoustics._kernels.trace import fan_ray, trace
from pymantaray.compile import kernel

KNOWN, _FAILED = 99, -1  # generations of an eigenray and of a candidate without a result
_MAX_GENERATIONS = 4  # maximum number of generations of candidates
_ALIKE, _ALIKE_FAILED = (
    0.1,
    0.02,
)  # rad; candidates with the same cells and closer launches count as one
# in shifts of a reflection by another slope of the bed: distance within which a neighbouring cell
# is tried
_SHIFT_MARGIN = 4.0
_BACK = 1e-6  # rad; the tolerance of the search limits the accuracy of an edge
_STEEPER = 0.01  # rad


@kernel
def _find(candidates, n, cells, m, counts):
    """
    Row of the candidate with m reflections in these cells and the same launch; -1 without one.
    """
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
    """Append a candidate unless it exists or there is no room; return the number of candidates."""
    if n >= candidates.shape[0] or _MAX_GENERATIONS < generation < KNOWN or counts % 32 == 0:
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
    """Numbers of reflections of a candidate, and its generation."""
    return int(candidates[i, at.CANDIDATE_COUNTS]), int(candidates[i, at.CANDIDATE_GENERATION])


@kernel
def add_of_bracket(s, walls, course, bracket, n, tol, work):
    """
    Append the cells of a bracket's ray; a bracket without width is a ray at an edge of its cells.
    """
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
            return add_candidate(
                work.candidates, n, walls.cells[at.LANDED], start, 0.0, code % 1024, 0
            )
        if back == 0.0:
            angle = bracket[inner, at.ANGLE]
        else:
            angle += back
            back *= 10.0
    return n


@kernel
def add_neighbours(walls, n, launch, counts, generation, work):
    """
    Append the cells of the ray in work.path, with one of them replaced by a neighbour within reach.
    """
    path, cells, grid, candidates, steps = (
        work.path,
        walls.cells,
        walls.bed,
        work.candidates,
        launch.steps,
    )
    n_e = grid.east.size
    bed = hold(walls, 0.0)
    # start from the cells of the ray
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
        # lever: shift of the reflection by a change of the bed's slope
        before, after = path[i, at.TIME], path[steps, at.TIME] - path[i, at.TIME]
        lever = before * after / (before + after) / max(abs(path[i, at.P_DEPTH]), 0.1)
        cells[at.HELD, 0] = own
        _, f_r, f_y, _, _ = bed_at(bed, r, y, r)
        # neighbours within the shift by their slope
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
                n = add_candidate(
                    candidates, n, cells[at.TRIED], launch.angle, launch.q, counts, generation
                )
                cells[at.TRIED, bounce] = own
        bounce += 1
        i += 1  # a reflection has two rows
    return n


@kernel
def solve_candidate(s, walls, course, numbers, bracket, accuracy, work):
    """
    Solve for the ray of a candidate by Newton's method over its cells, then over the actual sea
    bed.

    numbers contains the number of the candidate and the number of all candidates. Returns the new
    number of candidates, and the ray.
    """
    candidates, (i, n) = work.candidates, numbers
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
        # it turns just below the surface, or has one reflection too many there
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
        ):  # cells around a corner that produce each other
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

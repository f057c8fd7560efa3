"""
Links in the queue of `march`: their rows, their parts of the workspaces, and their rays that are
traced ahead.

Few links leave most lanes idle. These lanes trace rays that a search will probably need next. When
a search asks for rays, it first takes those of the table that were traced in the same way. Its
order and its results remain the same.
"""

import math

from pymantaray.acoustics._kernels import layout as at
from pymantaray.acoustics._kernels.field import column_count, cubic, find_level, smooth_full
from pymantaray.acoustics._kernels.layout import Baseline, FieldSection, Link, Progress, Walls, Work
from pymantaray.acoustics._kernels.march import (
    ERRING,
    UNDER_WAY,
    WAITING,
    free_lanes,
    replace_rays,
    traced_alike,
)
from pymantaray.acoustics._kernels.search import HALVE, LEFT_OUT, copy_ray, first_row
from pymantaray.compile import kernel


@kernel
def share_store(domain, source, receiver, work, flights):
    """
    Empty the queue; return the number of columns that the section of a link may have, and the
    number of links with room for them.
    """
    longest = 0.0
    for i in range(source.shape[0]):
        longest = max(
            longest, math.hypot(receiver[i, 0] - source[i, 0], receiver[i, 1] - source[i, 1])
        )
    most = work.store.shape[0]
    columns = column_count(domain, longest, most)
    flights.links[:, at.FLIGHT_LINK] = -1.0
    free_lanes(flights.lanes)
    return columns, min(flights.links.shape[0], most // columns)


@kernel
def own_work(work, flights, k, columns):
    """Workspaces of the link in slot k of the queue."""
    return Work(
        work.y,
        work.K,
        work.K_fan,
        work.K_space,
        work.ynew,
        work.no_path,
        work.path,
        work.breaks,
        flights.wall_breaks[k],
        work.cells,
        work.candidates,
        work.small,
        work.acc,
        work.store[k * columns : (k + 1) * columns],
        work.cuts,
        work.extremes,
        work.ladder,
        work.layers,
        flights.nodes[k],
        flights.rays[k],
        flights.stack[k],
        flights.halves[k],
        flights.kinds[k],
        flights.brackets[k],
        work.rows,
    )


@kernel
def put_flight(section, slot, progress, cross, work, flights):
    """
    Put link i into slot k of the queue; the rays of its fan wait. With cross, they leave the
    plane.
    """
    s, walls, link = section
    i, k = slot
    row = flights.links[k]
    row[at.FLIGHT_LINK], row[at.FLIGHT_COLUMNS], row[at.FLIGHT_STEP] = i, s.n_range, s.r_step
    row[at.FLIGHT_STORE], row[at.FLIGHT_BREAKS] = k * work.store.size, walls.n_breaks
    row[at.FLIGHT_LEVELS] = 0.0
    c, cz, _, _, _, _, cy, _, _, _ = smooth_full(s, find_level(s, link.z0), 0.0, link.z0)
    row[at.FLIGHT_GRADIENT], row[at.FLIGHT_CROSS_GRADIENT] = -cz / c, -cy / c
    row[at.FLIGHT_CROSS] = 1.0 if cross else 0.0
    for j in range(4):
        row[at.FLIGHT_LINE + j] = walls.line[j]
    for j in range(8):
        row[at.FLIGHT_ENDS + j] = link[j]
    row[at.AHEAD_FIRST] = row[at.AHEAD_LAST] = at.MAX_AHEAD
    first = first_row(work)
    put_progress(k, first, first + int(progress.right) + 2, progress, work, flights)


@kernel
def put_progress(k, first, last, progress, work, flights):
    """
    Put the progress of the search in slot k into its row, and the range of rows with rays that
    wait; choose the next rays ahead.
    """
    row, pending = flights.links[k], 0.0
    for i in range(first, last):
        if work.rays[i, at.GOOD] == WAITING:
            _take_ahead(row, k, i, flights)
            pending += 1.0 if work.rays[i, at.GOOD] < 0.0 else 0.0
    row[at.FLIGHT_FIRST], row[at.FLIGHT_NEXT], row[at.FLIGHT_LAST] = first, first, last
    row[at.FLIGHT_PENDING] = pending
    for j in range(9):
        row[at.FLIGHT_PROGRESS + j] = progress[j]
    room = at.MAX_AHEAD
    for link in flights.links:
        room -= (
            4 + int(link[at.FLIGHT_PENDING]) if link[at.FLIGHT_LINK] >= 0.0 else 0
        )  # none in a full queue
    old = int(row[at.AHEAD_FIRST])
    new = 3 * at.MAX_AHEAD - old
    end = new if row[at.FLIGHT_CROSS] > 0.0 else _look_ahead(progress, new, new + room, work)
    for i in range(new, end):
        _take_ahead(row, k, i, flights)
    replace_rays(flights.lanes, k, old, old + at.MAX_AHEAD, -1.0)
    row[at.AHEAD_FIRST], row[at.AHEAD_NEXT], row[at.AHEAD_LAST] = new, new, end


@kernel
def _take_ahead(row, k, i, flights):
    """
    Complete ray i of the link in slot k if it was traced ahead, or let it take over the lane.
    """
    rays, ray = flights.rays[k], flights.rays[k, i]
    for j in range(int(row[at.AHEAD_FIRST]), int(row[at.AHEAD_LAST])):
        alike = rays[j, at.ANGLE] == ray[at.ANGLE] and rays[j, at.TOL] == ray[at.TOL]
        if alike and traced_alike(rays[j, at.DEFECT], ray[at.GROWTH]):
            defect = ray[at.DEFECT]
            if rays[j, at.GOOD] > 0.0:
                copy_ray(rays[j], ray)
                ray[at.DEFECT] = defect
            elif replace_rays(flights.lanes, k, j, j + 1, i):
                ray[at.GOOD] = UNDER_WAY


@kernel
def _look_ahead(progress, first, last, work):
    """
    Put rays that the search may need next into rows from first to at most last - 1; return the last
    one used + 1.

    They are the rays of the first fan that are left out, or the middles of both halves of the
    waiting intervals, then of their quarters.
    """
    n, fan = first, first_row(work)
    for i in range(fan, fan + int(progress.right) + 1 if progress.asked < 0.0 else fan):
        if n < last and work.rays[i, at.GOOD] == LEFT_OUT:
            copy_ray(work.rays[i], work.rays[n])
            work.rays[n, at.GOOD] = WAITING
            n += 1
    for level in range(2):
        for i in range(int(progress.asked)):
            depth = level + 1 if work.kinds[i] == HALVE else level
            for j in range(min(1 << depth, last - n)):
                _put_middle(i, depth, j, work.rays[n], work)
                n += 1
    return n


@kernel
def _put_middle(i, depth, j, ray, work):
    """
    Put the middle of part j of the 2^depth parts of a waiting interval into a ray of the table,
    with the expected divergence also as DEFECT.
    """
    a, b, tol = work.halves[i, 0], work.halves[i, 1], work.rays[2 * i, at.TOL]
    lo, hi = a[at.ANGLE], b[at.ANGLE]
    fraction = (j + 0.5) / (1 << depth)
    miss = cubic(fraction, hi - lo, a[at.MISS], a[at.SLOPE], b[at.MISS], b[at.SLOPE])
    growth = min(a[at.GROWTH], b[at.GROWTH]) if a[at.LEFT] * b[at.LEFT] == 0.0 else 0.0
    growth = growth if abs(miss) <= ERRING * tol * growth else 0.0
    for _ in range(depth):  # as the search halves it, for the same digits
        middle = 0.5 * (lo + hi)
        lo, hi, fraction = (
            (lo, middle, 2.0 * fraction) if fraction < 0.5 else (middle, hi, 2.0 * fraction - 1.0)
        )
    ray[at.ANGLE], ray[at.TOL], ray[at.GOOD] = 0.5 * (lo + hi), tol, WAITING
    ray[at.GROWTH], ray[at.DEFECT], ray[at.CROSS] = (
        growth,
        growth,
        0.0,
    )  # rays traced ahead remain in the plane


@kernel
def progress_of(row):
    """Progress of the search in a link's row."""
    p = row[at.FLIGHT_PROGRESS :]
    return Progress(p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8])


@kernel
def section_of(domain, row, work):
    """Section, boundaries and ends of the link in a row of the queue."""
    line, ends = row[at.FLIGHT_LINE :], row[at.FLIGHT_ENDS :]
    s = FieldSection(
        domain.kind,
        int(row[at.FLIGHT_COLUMNS]),
        0.0,
        row[at.FLIGHT_STEP],
        work.breaks,
        domain.depth,
        domain.lut,
        domain.lut_scale,
        work.store,
        domain.layered,
        domain.ladder,
    )
    baseline = Baseline(line[0], line[1], line[2], line[3])
    n_breaks = int(row[at.FLIGHT_BREAKS])
    walls = Walls(
        domain.bed, domain.surface, baseline, work.wall_breaks, n_breaks, 1.0, work.cells, -1.0
    )
    return s, walls, Link(ends[0], ends[1], ends[2], ends[3], ends[4], ends[5], ends[6], ends[7])

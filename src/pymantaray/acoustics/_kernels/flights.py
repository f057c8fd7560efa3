"""Links in the queue of `march`: their rows, and their parts of the workspaces."""

import math

from pymantaray.acoustics._kernels import layout as at
from pymantaray.acoustics._kernels.field import column_count, find_level, smooth_planar
from pymantaray.acoustics._kernels.layout import Baseline, FieldSection, Link, Progress, Walls, Work
from pymantaray.acoustics._kernels.march import WAITING, free_lanes
from pymantaray.acoustics._kernels.search import first_row
from pymantaray.compile import kernel


@kernel
def share_store(domain, source, receiver, work, flights):
    """Empty the queue; return the number of columns that the section of a link may have, and the number of links with room for them."""
    longest = 0.0
    for i in range(source.shape[0]):
        longest = max(longest, math.hypot(receiver[i, 0] - source[i, 0], receiver[i, 1] - source[i, 1]))
    most = work.store.shape[0]
    columns = column_count(domain, longest, most)
    flights.links[:, at.FLIGHT_LINK] = -1.0
    free_lanes(flights.lanes)
    return columns, min(flights.links.shape[0], most // columns)


@kernel
def own_work(work, flights, k, columns):
    """Workspaces of the link in place k of the queue."""
    return Work(
        work.y,
        work.K,
        work.K_fan,
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
        flights.nodes[k],
        flights.rays[k],
        flights.stack[k],
        flights.halves[k],
        flights.kinds[k],
        flights.brackets[k],
        work.rows,
    )


@kernel
def put_flight(section, place, progress, work, flights):
    """Put link i into place k of the queue; the rays of its fan wait."""
    s, walls, link = section
    i, k = place
    row = flights.links[k]
    row[at.FLIGHT_LINK], row[at.FLIGHT_COLUMNS], row[at.FLIGHT_STEP] = i, s.n_range, s.r_step
    row[at.FLIGHT_STORE], row[at.FLIGHT_BREAKS] = k * work.store.size, walls.n_breaks
    row[at.FLIGHT_LEVELS] = 0.0
    c, cz, _ = smooth_planar(s, find_level(s, link.z0), 0.0, link.z0)
    row[at.FLIGHT_GRADIENT] = -cz / c
    for j in range(4):
        row[at.FLIGHT_LINE + j] = walls.line[j]
    for j in range(8):
        row[at.FLIGHT_ENDS + j] = link[j]
    first = first_row(work)
    put_progress(row, first, first + int(progress.right) + 2, progress, work)


@kernel
def put_progress(row, first, last, progress, work):
    """Put the progress of a search into a link's row, and the range of rows with rays that wait."""
    pending = 0.0
    for i in range(first, last):
        pending += 1.0 if work.rays[i, at.GOOD] == WAITING else 0.0
    row[at.FLIGHT_FIRST], row[at.FLIGHT_NEXT], row[at.FLIGHT_LAST] = first, first, last
    row[at.FLIGHT_PENDING] = pending
    for j in range(8):
        row[at.FLIGHT_PROGRESS + j] = progress[j]


@kernel
def progress_of(row):
    """Progress of the search in a link's row."""
    p = row[at.FLIGHT_PROGRESS :]
    return Progress(p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7])


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
    )
    baseline = Baseline(line[0], line[1], line[2], line[3])
    n_breaks = int(row[at.FLIGHT_BREAKS])
    walls = Walls(domain.bed, domain.surface, baseline, work.wall_breaks, n_breaks, 1.0, work.cells, -1.0)
    return s, walls, Link(ends[0], ends[1], ends[2], ends[3], ends[4], ends[5], ends[6], ends[7])

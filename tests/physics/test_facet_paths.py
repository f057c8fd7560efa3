"""
Uniform water over twisted facets: every stationary path over every sequence of cells, by Newton's
method on its length.

An independent solver of another kind: no fan and no ray. Reflections at the flat surface are
unfolded; those at the bed are points of bilinear cells, and a ray is where the length of the path
is stationary (Fermat), each point lies in its cell and no leg leaves the water.
"""

import itertools
from typing import NamedTuple

import numpy as np
import pytest
from factories import inner_links, twisted
from scipy.interpolate import RegularGridInterpolator

from pymantaray.acoustics import find_eigenrays
from pymantaray.acoustics._kernels.layout import workspace
from pymantaray.acoustics._kernels.link import prepare
from pymantaray.acoustics._kernels.trace import fan_ray, legs_course, trace
from pymantaray.compile import entry

C = 1500.0

ORDERS = ("b", "sb", "bs", "sbs", "bb", "bsb", "sbb", "bbs", "sbsb", "bsbs", "sbbs")
STARTS = {
    1: ((0.5,), (0.3,), (0.7,)),
    2: ((0.25, 0.75), (0.33, 0.67), (0.4, 0.6), (0.2, 0.6), (0.4, 0.8), (0.1, 0.55), (0.45, 0.9)),
}
REACH = 2600.0  # m; cells whose centres are nearer to the chord are tried
WEAKEST = 14.5  # dB; half a decibel short of the solver's cut-off


def twisted_medium(noise=60.0, depth=900.0, seed=7):
    """Slopes of 0.1 where the noise is of 60 m."""
    gaps = (1700, 800, 1400, 2200, 1500, 900, 1900, 1200, 1600)
    return twisted(np.array([0.0, 4000.0]), bed=depth, noise=noise, seed=seed, gaps=gaps)


def draw_links(n, seed):
    return inner_links(n, seed, east=(2.5e3, 9.5e3))


class Facets:
    """The bilinear bed of a medium, each cell continued beyond its edges."""

    def __init__(self, medium):
        self.north, self.east, self.bed = medium.north, medium.east, medium.bed.depth
        self.depth_at = RegularGridInterpolator(
            (self.north, self.east), self.bed, bounds_error=False, fill_value=1e9
        )
        i, j = (
            k.ravel()
            for k in np.meshgrid(
                *(np.arange(a.size - 1) for a in (self.north, self.east)), indexing="ij"
            )
        )
        self.cells = np.column_stack([i, j])
        self.low = np.column_stack([self.north[i], self.east[j]])
        self.high = np.column_stack([self.north[i + 1], self.east[j + 1]])

    def patch(self, cell, place):
        """Depth of cells, its gradient and its mixed second derivative, at places (n, 2)."""
        (i, j), size = self.cells[cell].T, self.high[cell] - self.low[cell]
        u, v = ((place - self.low[cell]) / size).T
        b = self.bed
        by_u, by_v = b[i + 1, j] - b[i, j], b[i, j + 1] - b[i, j]
        twist = b[i + 1, j + 1] - b[i, j] - by_u - by_v
        slope = np.column_stack([by_u + twist * v, by_v + twist * u]) / size
        return b[i, j] + by_u * u + by_v * v + twist * u * v, slope, twist / size.prod(axis=1)


class Found(NamedTuple):
    """One stationary path of a link."""

    surface: int
    bottom: int
    travel_time: float
    direction: np.ndarray
    spreading_db: float


def unfolded(order):
    """Sign of each leg's start in depth: -1 where the leg meets the surface on its way."""
    signs = [1.0]
    for bounce in order:
        if bounce == "s":
            signs[-1] = -1.0
        else:
            signs.append(1.0)
    return signs


def stationary(facets, x, cells, source, receiver, signs, steps):
    """Newton's method on path lengths: places (n, k, 2), lengths and largest slopes."""
    n, k = cells.shape
    for step in range(steps + 1):
        depth, slope, twist = zip(
            *(facets.patch(cells[:, m], x[:, m]) for m in range(k)), strict=True
        )
        points = [
            np.tile(source, (n, 1)),
            *(np.column_stack([x[:, m], depth[m]]) for m in range(k)),
            np.tile(receiver, (n, 1)),
        ]
        length, g, h = np.zeros(n), np.zeros((n, 2 * k)), np.zeros((n, 2 * k, 2 * k))
        for leg, sign in enumerate(signs):
            way = points[leg + 1] - points[leg] * [1.0, 1.0, sign]
            far = np.linalg.norm(way, axis=1)
            unit = way / far[:, None]
            across = (np.eye(3) - unit[:, :, None] * unit[:, None]) / far[:, None, None]
            by_x = np.zeros((n, 3, 2 * k))
            for m, weight, vertical in ((leg - 1, -1.0, -sign), (leg, 1.0, 1.0)):
                if 0 <= m < k:
                    at = slice(2 * m, 2 * m + 2)
                    by_x[:, :2, at] += weight * np.eye(2)
                    by_x[:, 2, at] += vertical * slope[m]
                    bend = vertical * unit[:, 2] * twist[m]
                    h[:, 2 * m, 2 * m + 1] += bend
                    h[:, 2 * m + 1, 2 * m] += bend
            length += far
            g += np.einsum("ni,nij->nj", unit, by_x)
            h += np.einsum("nia,nij,njb->nab", by_x, across, by_x)
        if step < steps:
            move = -np.linalg.solve(h + 1e-14 * np.eye(2 * k), g[..., None])[..., 0]
            move *= np.minimum(1.0, 1500.0 / np.maximum(np.abs(move).max(axis=1), 1e-9))[:, None]
            x = np.clip(x + move.reshape(n, k, 2), -3e4, 5e4)
    return x, length, np.abs(g).max(axis=1)


def stays_in_water(facets, points, signs):
    t = np.linspace(0.0, 1.0, 400)[1:-1, None]
    for a, b, sign in zip(points[:-1], points[1:], signs, strict=True):
        along = a * [1.0, 1.0, sign] + t * (b - a * [1.0, 1.0, sign])
        if sign > 0.0 and along[:, 2].min() < -1e-5:
            return False
        if (facets.depth_at(along[:, :2]) - np.abs(along[:, 2])).min() < -1e-5:
            return False
    return True


def spreading_db(facets, x, cells, source, receiver, signs, points):
    """
    Level of the ray tube against that of a straight ray of the chord's length, by differences of
    launch directions.
    """

    def launch(target):
        moved = stationary(facets, x[None], cells[None], source, target, signs, 8)[0][:, 0]
        first = np.append(moved[0], facets.patch(cells[:1], moved)[0]) - source * [
            1.0,
            1.0,
            signs[0],
        ]
        first[2] *= signs[0]
        return first / np.linalg.norm(first)

    last = receiver - points[-2] * [1.0, 1.0, signs[-1]]
    sideways = np.linalg.svd(last[None] / np.linalg.norm(last))[2][1:]
    turned = [launch(receiver + 0.5 * e) - launch(receiver - 0.5 * e) for e in sideways]
    tube = np.linalg.norm(np.cross(*turned))
    return launch(receiver), -10.0 * np.log10(tube * np.sum((receiver - source) ** 2) + 1e-300)


def all_paths(facets, source, receiver):
    """Every path with up to two reflections at either boundary, one at the bed at least."""
    a, b = source[:2], receiver[:2]
    centre = 0.5 * (facets.low + facets.high)
    share = np.clip((centre - a) @ (b - a) / np.sum((b - a) ** 2), 0.0, 1.0)
    near = np.flatnonzero(np.linalg.norm(centre - a - share[:, None] * (b - a), axis=1) < REACH)
    out = []
    for order in ORDERS:
        k, signs = order.count("b"), unfolded(order)
        sequences = np.array(list(itertools.product(near, repeat=k)))
        guesses = [centre[sequences]]
        for fractions in STARTS[k]:
            on_chord = a + np.array(fractions)[:, None] * (b - a)
            guesses.append(
                np.clip(on_chord, facets.low[sequences] + 1.0, facets.high[sequences] - 1.0)
            )
        cells = np.tile(sequences, (len(guesses), 1))
        with np.errstate(all="ignore"):
            x, length, slope = stationary(
                facets, np.concatenate(guesses), cells, source, receiver, signs, 25
            )
        inside = ((x >= facets.low[cells] - 1e-6) & (x <= facets.high[cells] + 1e-6)).all(
            axis=(1, 2)
        )
        seen = set()
        for row in np.flatnonzero(inside & (slope < 1e-8)):
            key = (*cells[row], *np.round(x[row]).ravel())
            if key in seen:
                continue
            seen.add(key)
            bed = [
                np.append(x[row, m], facets.patch(cells[row, m : m + 1], x[row, m : m + 1])[0])
                for m in range(k)
            ]
            points = [source, *bed, receiver]
            if stays_in_water(facets, points, signs):
                direction, db = spreading_db(
                    facets, x[row], cells[row], source, receiver, signs, points
                )
                out.append(Found(order.count("s"), k, length[row] / C, direction, db))
    return out


def compare(medium, source, receiver):
    """Rays that the solver misses and invents from either end, and the number that there are."""
    facets = Facets(medium)
    ways = []
    for ends in ((source, receiver), (receiver, source)):
        arrivals = find_eigenrays(medium, *ends, 2, 2, canonical=False)
        turned = ends[0] is receiver
        ways.append(
            (arrivals, C * (-arrivals.receiver_slowness if turned else arrivals.source_slowness))
        )
    missed, invented, count = [], [], 0
    for link, (a, b) in enumerate(zip(source, receiver, strict=True)):
        paths = all_paths(facets, a, b)
        count += sum(path.spreading_db < WEAKEST for path in paths)
        for way, (arrivals, direction) in enumerate(ways):
            left = set(
                np.flatnonzero((arrivals.link == link) & (arrivals.bottom_bounces > 0)).tolist()
            )
            for path in paths:
                same = [
                    row
                    for row in left
                    if (arrivals.surface_bounces[row], arrivals.bottom_bounces[row])
                    == (path.surface, path.bottom)
                    and abs(arrivals.travel_time[row] - path.travel_time) < 1e-7
                    and np.abs(direction[row] - path.direction).max() < 1e-5
                ]
                if same:
                    left.remove(same[0])
                elif path.spreading_db < WEAKEST:
                    missed.append((way, link, *path))
            invented += sorted((way, link, row) for row in left)
    return missed, invented, count


@pytest.mark.slow
def test_rays_that_no_ray_in_the_plane_of_the_link_leads_to():
    """
    Reflected within metres of a corner, over cells that the plane does not meet, or after cells
    that lead in circles.
    """
    ends = [np.vstack(part) for part in zip(pick(8, [98, 110]), pick(18, [70]), strict=True)]
    missed, invented, count = compare(twisted_medium(), *ends)
    assert count > 15
    assert not missed
    assert not invented


@entry
def steps_in_depth(domain, source, receiver, angle, work):
    """Steps of a ray followed leg by leg in depth, down and up again."""
    s, walls, link = prepare(domain, source, receiver, work)
    course = legs_course(link, (0, 1), True, 300.0, 3e3)
    return trace(s, walls, course, angle, 0.0, 0.03, fan_ray(work))[1]


@pytest.mark.slow
def test_rays_in_depth_end_where_they_are_too_flat():
    """Reflected almost level they took as many steps as there are, a tenth of a second a ray."""
    medium = twisted_medium(150.0, 1000.0, 9)
    source, receiver = (end[89] for end in draw_links(100, 28))
    domain, work = medium.domain(), workspace(medium.depth.size)
    taken = [
        steps_in_depth(domain, source, receiver, angle, work)
        for angle in np.linspace(-1.3, 1.3, 400)
    ]
    assert max(taken) < 1000


def pick(seed, links):
    source, receiver = draw_links(120, seed)
    return source[links], receiver[links]


@pytest.mark.slow
@pytest.mark.parametrize(("links", "bed", "least", "limit"), [
    ((5, 8), (), 18, 0),
    # known limit over slopes of a fifth, not met here: one of 584 with 100 links, from one end
    ((5, 28), (150.0, 1000.0, 9), 15, 0),
])  # fmt: skip
def test_every_ray_is_found_and_none_invented(links, bed, least, limit):
    missed, invented, count = compare(twisted_medium(*bed), *draw_links(*links))
    assert count > least
    assert len(missed) <= limit, f"{len(missed)} of {count}"
    assert not invented

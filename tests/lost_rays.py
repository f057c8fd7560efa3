"""
Rays that the solver loses, by comparison with fans or with its own search from the other end, and
the media in which they are counted.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from section_fan import Rays

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.ocean import open_ocean, to_local

GULF_STREAM = Path(__file__).parents[2] / "shared/data/hycom/hycom_glby_930_2019030712_t003_ts3z.nc"
TIME, LEVEL = 2e-6, 2.0  # s, dB; a ray of both
SAME_TIME = 3e-8  # s; one ray at any level, because levels are uncertain at a caustic
ONE_RAY = 5e-6  # rad; the solver keeps one of two rays this near to each other, at a caustic
WEAKEST = 14.5  # dB; weaker rays may be beyond the cut-off of 15 dB or not
IN_PLANE = 0.5  # m; rays of a fan in three dimensions that end farther from the plane do not end
N_RAYS = 131_072  # of a fan
WIDEST = 0.35  # rad
FARTHEST = 30e3  # m


class Links(NamedTuple):
    """Both ends (n, 3) of links."""

    source: NDArray[np.float64]
    receiver: NDArray[np.float64]

    @property
    def distance(self):
        return np.hypot(*(self.receiver - self.source)[:, :2].T)

    def exchanged(self):
        return Links(self.receiver, self.source)


class Look(NamedTuple):
    """
    Tolerances of time [s] and level [dB], and half width [rad] and number of rays of the finer fan.
    """

    time: float
    level: float
    half_width: float
    n_rays: int = 401


SECTION = Look(
    3e-4, 4.0, 1e-3, 1001
)  # of rays in the vertical section, whose angles change by up to 5e-4 rad
SPACE = Look(3e-6, 2.5, 4.0 * 2.0 * WIDEST / N_RAYS)  # of rays in three dimensions


class Lost(NamedTuple):
    """
    A ray that a search did not find; dropout: it found no other, first: it found only later ones.
    """

    link: int
    angle: float
    time: float
    level: float
    dropout: bool
    first: bool


class Fan(NamedTuple):
    """
    Source (3) [m], azimuth [rad], receivers (n, 2) by range and depth [m], rays of the brute-force
    fan.
    """

    source: NDArray[np.float64]
    azimuth: float
    receivers: NDArray[np.float64]
    rays: Rays

    @property
    def strong(self):
        """Rays that are arrivals and do not touch a boundary."""
        return is_strong(self.rays)

    @property
    def links(self):
        return Links(*ends(self.source, self.azimuth, self.receivers))


def several_extrema(seed):
    """A thermocline with four warm or cold filaments whose depth and strength vary horizontally."""
    rng = np.random.default_rng(seed)
    depth = np.concatenate(
        [
            np.arange(0.0, 200.0, 10.0),
            np.arange(200.0, 600.0, 25.0),
            np.arange(600.0, 1600.0, 100.0),
            [2e3, 3e3],
        ]
    )
    axis = np.linspace(-35e3, 35e3, 15)
    north, east = np.meshgrid(axis, axis, indexing="ij")
    profile = 1490.0 + 0.016 * depth + rng.uniform(5.0, 30.0) * np.exp(-depth / 300.0)
    speed = np.tile(profile, (15, 15, 1))
    for middle in rng.uniform(30.0, 350.0, 4):
        k = rng.uniform(-1.0, 1.0, 2) * 2.0 * np.pi / 40e3
        phase, width = rng.uniform(0.0, 2.0 * np.pi, 2), rng.uniform(15.0, 50.0)
        lies = middle + rng.uniform(5.0, 40.0) * np.sin(k[0] * north + k[1] * east + phase[0])
        rise = rng.choice([-1.0, 1.0]) * rng.uniform(2.0, 8.0)
        rise *= 1.0 + 0.5 * np.cos(k[1] * north - k[0] * east + phase[1])
        speed += rise[..., None] * np.exp(-(((depth - lies[..., None]) / width) ** 2))
    return Medium.from_grid(axis, axis, depth, speed, bathymetry=2800.0)


def gulf_stream():
    return Medium.from_dataset(to_local(open_ocean(GULF_STREAM, currents="rest")))


def random_links(medium, number, seed, shortest=1e3, farthest=FARTHEST) -> Links:
    """Links anywhere over deep enough water, with both ends in the upper 200, 500 or 1,000 m."""
    rng, links = np.random.default_rng(seed), []
    while len(links) < number:
        source, receiver = _drawn(rng, medium, rng.uniform(shortest, farthest))
        depths = rng.uniform(3.0, rng.choice([200.0, 500.0, 1000.0]), 2)
        if _over_water(medium, source, receiver, depths.max() + 10.0):
            links.append([[*source, depths[0]], [*receiver, depths[1]]])
    return Links(*np.moveaxis(np.array(links), 1, 0))


def random_fans(fan, number, first=0, n_rays=N_RAYS, farthest=FARTHEST) -> Iterator[Fan]:
    """
    Fans number first, first + 1, ... of a seeded series, 480 links of 1 km and more each, ends in
    the upper 500 m.
    """
    rng, done = np.random.default_rng(7), 0
    while done < first + number:
        source, far = _drawn(rng, fan.medium, farthest)
        if not _over_water(fan.medium, source, far, 800.0):
            continue
        distance = np.tile(15.0 * np.rint(rng.uniform(1e3, farthest, 40) / 15.0), 12)
        receivers = np.column_stack([distance, rng.uniform(3.0, 500.0, 480)])
        depth = rng.uniform(3.0, 400.0)
        done += 1
        if done > first:
            source, azimuth = np.array([*source, depth]), np.arctan2(*(far - source)[::-1])
            angles = np.linspace(-WIDEST, WIDEST, n_rays)
            yield Fan(source, azimuth, receivers, fan.eigenrays(source, azimuth, receivers, angles))


def _drawn(rng, medium, distance):
    """Two places at a distance [m], one of them in the domain of a medium."""
    low, high = ([axis[k] for axis in (medium.north, medium.east)] for k in (0, -1))
    source, azimuth = rng.uniform(low, high), rng.uniform(0.0, 2.0 * np.pi)
    return source, source + distance * np.array([np.cos(azimuth), np.sin(azimuth)])


def _over_water(medium, source, receiver, depth):
    """True if all of a line is in the domain of a medium, over water of at least a depth [m]."""
    along = source + np.linspace(0.0, 1.0, 15)[:, None] * (receiver - source)
    inside = [
        axis[0] <= x <= axis[-1]
        for axis, x in zip((medium.north, medium.east), receiver, strict=True)
    ]
    return all(inside) and medium.bottom_depth(along).min() >= depth


def ends(source, azimuth, receivers):
    """Both ends of all links of a fan."""
    along = receivers[:, :1] * np.array([np.cos(azimuth), np.sin(azimuth)])
    return np.tile(source, (len(receivers), 1)), np.column_stack(
        [source[:2] + along, receivers[:, 1]]
    )


def found_rays(arrivals) -> Rays:
    """Arrivals as rays of a fan."""
    n = arrivals.link.size
    columns = arrivals.link, arrivals.launch_angle, arrivals.travel_time, arrivals.spreading_db
    return Rays(*columns, np.full(n, np.nan), np.zeros(n, dtype=bool))


def rays_of(table) -> Rays:
    """Rays of a table of `fans_on_gpu`, without those that did not end in the plane."""
    link, *columns, grazing, _ = table[np.abs(table[:, 6]) < IN_PLANE].T
    return Rays(link.astype(int), *columns, grazing > 0.0)


def selected(rays, rows) -> Rays:
    return Rays(*(column[rows] for column in rays))


def is_strong(rays):
    """True for rays that are arrivals beyond doubt and do not touch a boundary."""
    return (rays.spreading < WEAKEST) & ~rays.grazing


def without_partner(times, levels, other_times, other_levels, time=TIME, level=LEVEL):
    """Rays that have no partner of their own among other rays, the strongest first."""
    free, alone = list(range(len(other_times))), []
    for i in np.argsort(levels):
        apart = [abs(times[i] - other_times[j]) for j in free]
        alike = [abs(levels[i] - other_levels[j]) < level for j in free]
        near = [
            (dt, j)
            for dt, j, same in zip(apart, free, alike, strict=True)
            if dt < SAME_TIME or (dt < time and same)
        ]
        if near:
            free.remove(min(near)[1])
        else:
            alone.append(i)
    return alone


def missing(rays, found, time=TIME, level=LEVEL) -> list[int]:
    """Indices of strong rays that have no partner of their own among found rays of their link."""
    strong, rows = is_strong(rays), []
    for link in np.unique(rays.link[strong]):
        mine, theirs = np.flatnonzero(strong & (rays.link == link)), found.link == link
        others = found.time[theirs], found.spreading[theirs]
        alone = without_partner(rays.time[mine], rays.spreading[mine], *others, time, level)
        rows += list(mine[alone])
    return rows


def lost_rays(rays, found) -> list[Lost]:
    """Strong rays that are not among found rays."""
    lost = []
    for i in missing(rays, found):
        theirs = found.time[found.link == rays.link[i]]
        first = theirs.size > 0 and rays.time[i] < theirs.min() - SAME_TIME
        columns = int(rays.link[i]), rays.angle[i], rays.time[i], rays.spreading[i]
        lost.append(Lost(*columns, theirs.size == 0, bool(first)))
    return lost


def rays_near(fan, source, receiver, angle, look=SECTION) -> Rays:
    """
    Rays of a `SectionFan` near a launch angle in three dimensions, one of those that count as one
    ray.
    """
    away = receiver[:2] - source[:2]
    place, azimuth = np.array([np.hypot(*away), receiver[2]]), np.arctan2(*away[::-1])
    near = fan.near(source, azimuth, place, angle, look.half_width, 8.0, look.n_rays)
    order = np.argsort(near.angle)
    return selected(near, order[np.diff(near.angle[order], prepend=-np.inf) > ONE_RAY])


def lost_after_a_second_look(fan, links, rays, found, look=SECTION) -> list[Lost]:
    """
    Strong rays that two finer fans in three dimensions find near rays of another fan, and that are
    not among found rays.
    """
    lost = {}
    for i in missing(rays, found, look.time, look.level):
        link = rays.link[i]
        ends = links.source[link], links.receiver[link]
        for ray in _lost_near(fan, ends, link, rays.angle[i], found, look):
            closer = look._replace(half_width=look.half_width / 10.0)
            for x in _lost_near(fan, ends, link, ray.angle, found, closer):
                lost[x.link, round(x.time, 6), round(x.level, 1)] = x
    return [lost[key] for key in sorted(lost)]


def _lost_near(fan, ends, link, angle, found, look) -> list[Lost]:
    """Strong rays of a finer fan near a launch angle that are not among found rays."""
    near = rays_near(fan, *ends, angle, look)
    return lost_rays(near._replace(link=np.full(near.angle.size, link)), found)


def lost_of_a_fan(fan, links: Fan) -> list[Lost]:
    """Strong rays near those of a fan that the solver does not find."""
    found = found_rays(find_eigenrays(fan.medium, *links.links))
    return lost_after_a_second_look(fan, links.links, links.rays, found)

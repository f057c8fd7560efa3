"""Rays that the solver loses, by comparison with `section_fan.SectionFan`, and the media in which they are counted."""

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
ONE_RAY = 5e-6  # rad; the solver keeps one of two rays this near to each other, at a caustic
WEAKEST = 15.0  # dB; weaker rays are no arrivals


class Fan(NamedTuple):
    """Source (3) [m], azimuth [rad], receivers (n, 2) by range and depth [m], rays of the brute-force fan."""

    source: NDArray[np.float64]
    azimuth: float
    receivers: NDArray[np.float64]
    rays: Rays

    @property
    def strong(self):
        """Rays that are arrivals and do not touch a boundary."""
        return (self.rays.spreading < WEAKEST) & ~self.rays.grazing


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


def random_fans(fan, number, first=0, n_rays=100_000) -> Iterator[Fan]:
    """Fans number first, first + 1, ... of a seeded series, 480 links of 1 to 12 km each, ends in the upper 500 m."""
    rng, done = np.random.default_rng(7), 0
    while done < first + number:
        source, azimuth = rng.uniform([-15e3, -15e3, 3.0], [15e3, 15e3, 400.0]), rng.uniform(0.0, 2.0 * np.pi)
        far = source[:2] + 12e3 * np.array([np.cos(azimuth), np.sin(azimuth)])
        if fan.medium.bottom_depth([source[:2], far]).min() < 800.0:
            continue
        distance = np.tile(15.0 * np.rint(rng.uniform(1e3, 12e3, 40) / 15.0), 12)
        receivers = np.column_stack([distance, rng.uniform(3.0, 500.0, 480)])
        done += 1
        if done > first:
            angles = np.linspace(-0.35, 0.35, n_rays)
            yield Fan(source, azimuth, receivers, fan.eigenrays(source, azimuth, receivers, angles))


def ends(source, azimuth, receivers):
    """Both ends of all links of a fan."""
    along = receivers[:, :1] * np.array([np.cos(azimuth), np.sin(azimuth)])
    return np.tile(source, (len(receivers), 1)), np.column_stack([source[:2] + along, receivers[:, 1]])


def without_partner(times, levels, other_times, other_levels, time, level):
    """Rays that have no partner of their own among other rays, the strongest first."""
    free, alone = list(range(len(other_times))), []
    for i in np.argsort(levels):
        near = [
            j
            for j in free
            if abs(times[i] - other_times[j]) < time and abs(levels[i] - other_levels[j]) < level
        ]
        if near:
            free.remove(min(near, key=lambda j: abs(times[i] - other_times[j])))
        else:
            alone.append(i)
    return alone


def lost_rays(fan, links):
    """Link, time and level of rays within 15 dB that the fan finds in three dimensions and the solver does not.

    Only rays whose time in the plane no arrival has are looked for off it.
    """
    source, azimuth, receivers, rays = links
    found = find_eigenrays(fan.medium, *ends(source, azimuth, receivers))
    lost = set()
    strong = links.strong
    for link in np.unique(rays.link[strong]):
        mine, theirs = np.flatnonzero(strong & (rays.link == link)), found.link == link
        times, levels = found.travel_time[theirs], found.spreading_db[theirs]
        for i in without_partner(rays.time[mine], rays.spreading[mine], times, levels, 3e-4, 4.0):
            near = fan.near(source, azimuth, receivers[link], rays.angle[mine[i]])
            order = np.argsort(near.angle)
            apart = order[np.diff(near.angle[order], prepend=-np.inf) > ONE_RAY]
            sure = apart[(near.spreading[apart] < WEAKEST) & ~near.grazing[apart]]
            alone = without_partner(near.time[sure], near.spreading[sure], times, levels, TIME, LEVEL)
            lost |= {
                (int(link), round(near.time[sure][j], 6), round(near.spreading[sure][j], 1)) for j in alone
            }
    return sorted(lost)

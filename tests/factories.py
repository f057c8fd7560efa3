"""Small oceans, media, fleets and studies that tests of several folders are made of."""

import os
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import Phase, settings

from pymantaray.acoustics import Medium
from pymantaray.estimation import GraphValues, dead_reckon
from pymantaray.geometry.se3 import (
    matrix_from_quaternion,
    quaternion_from_matrix,
    se3_exp,
    so3_exp,
    so3_log,
)
from pymantaray.jobs.pool import Pool
from pymantaray.records import (
    Arrivals,
    Estimates,
    Measurements,
    RangingTruth,
    RayStatus,
    Trajectories,
)
from pymantaray.sensing import Landmark, OneWay, PingSchedule, ReceptionOptions, measure_ranges

TINY = tomllib.loads("""
conditions = ["odometry", "no-ranges", "straight", "refracted", "straight-all"]

[study]
name = "tiny"
realizations = 2

[ocean]
source = "synthetic:beaufort"
centre_lat = 74.5
centre_lon = -140.0
half_extent_north = 15000.0
half_extent_east = 15000.0

[mission]
duration_h = 4.0
physics_step_s = 1.0
ping_interval_h = 1.0

[fleet.floats]
hold_depth_h = 0.5
hold_surface_h = 0.25

[[fleet.vehicles]]
name = "A"
kind = "station"
north = 0.0
east = 0.0

[[fleet.vehicles]]
name = "B"
kind = "float"
north = 2000.0
east = -1000.0
target_depth = 300.0

[[fleet.vehicles]]
name = "C"
kind = "waypoints"
north = -1000.0
east = 500.0
depth = 40.0
speed = 1.0
points = [[1500.0, 500.0, 60.0], [1500.0, 3000.0, 20.0]]

[[fleet.vehicles]]
name = "D"
kind = "twist"
north = 1000.0
east = 3000.0
depth = 80.0
twist = [0.0, 0.0, 0.001, 0.5, 0.0, 0.0]

[[landmarks]]
name = "L0"
north = 4000.0
east = 4000.0
depth = 500.0

[[landmarks]]
name = "L1"
north = -4000.0
east = 3000.0
depth = 900.0
""")


def changed(tree, sections):
    """Tree with the keys of these sections, rows of a list by number; None takes a key away."""
    for key, value in sections.items():
        place = int(key) if isinstance(tree, list) else key
        if isinstance(value, dict):
            changed(tree[place] if isinstance(tree, list) else tree.setdefault(key, {}), value)
        elif value is None:
            del tree[place]
        else:
            tree[place] = value
    return tree


QUICK = settings(phases=[Phase.explicit, Phase.generate])
"""A failure is not shrunk: some links an example take minutes."""
PERIOD = 200.0


@dataclass(frozen=True)
class Fleet:
    """Truth and what is measured of it."""

    position: np.ndarray
    quaternion: np.ndarray
    noise_free: Measurements
    noisy: Measurements

    @property
    def start(self):
        """True poses, as `solve_conditions` takes them."""
        return self.position, self.quaternion

    @property
    def truth(self):
        """True poses as values of a graph; landmarks where the noisy survey has them."""
        return values_at(self.noisy, *self.start)

    @property
    def reckoned(self):
        """The same by dead reckoning."""
        return values_at(self.noisy, *dead_reckon(self.noisy))


def values_at(o, position, quaternion):
    """Values of the graph of measurements."""
    return GraphValues(position.reshape(-1, 3), quaternion.reshape(-1, 4), o.landmark_position)


def without(graph, *kinds):
    """A graph less all factors of some kinds."""
    return graph.with_factors(**{kind: graph[kind][:0] for kind in kinds})


def far_from(fleet, seed=0):
    """A start half a kilometre and a radian away from the truth."""
    rng = np.random.default_rng(seed)
    turn = so3_exp(rng.normal(0, 1.0, (*fleet.quaternion.shape[:2], 3)))
    turned = matrix_from_quaternion(fleet.quaternion) @ turn
    return fleet.position + rng.normal(0, 500.0, fleet.position.shape), quaternion_from_matrix(
        turned
    )


def make_fleet(
    seed=0,
    *,
    n_vehicles=3,
    n_times=30,
    turn=0.3,
    n_landmarks=0,
    range_error=0.0,
    dropouts=0.0,
    gnss_every=0,
):
    """Build a fleet; `turn` is the sigma of each body's rotation per step [rad]."""
    rng = np.random.default_rng(seed)
    n_edges = n_times - 1
    start = rng.uniform(-2000, 2000, (n_vehicles, 1, 3)) + np.array([0, 0, 3000])
    velocity = rng.normal(0, 0.2, (n_vehicles, 1, 3)) + np.cumsum(
        rng.normal(0, 0.02, (n_vehicles, n_edges, 3)), axis=1
    )
    position = np.concatenate([start, start + np.cumsum(velocity * PERIOD, axis=1)], axis=1)
    rotation = np.empty((n_vehicles, n_times, 3, 3))
    rotation[:, 0] = so3_exp(rng.normal(0, 1.0, (n_vehicles, 3)))
    for k in range(n_edges):
        rotation[:, k + 1] = rotation[:, k] @ so3_exp(rng.normal(0, turn, (n_vehicles, 3)))
    step = np.swapaxes(rotation[:, :-1], 2, 3) @ rotation[:, 1:]
    moved = np.einsum("atji,atj->ati", rotation[:, :-1], np.diff(position, axis=1))
    # the same sigma on all axes, of the size of the motion: ranges of this fleet are hard to fit
    # from some starts
    turned, way = (np.linalg.norm(v, axis=-1, keepdims=True) for v in (so3_log(step), moved))
    odometry_sigma = np.concatenate(
        [
            np.repeat(np.hypot(1e-6 * turned, 5e-7 * PERIOD), 3, axis=2),
            np.repeat(np.hypot(0.05 * way, 0.0125 * PERIOD), 2, axis=2),
            np.hypot(0.001 * way, 0.0125 * PERIOD),
        ],
        axis=2,
    )
    landmark = rng.uniform(-2000, 2000, (n_landmarks, 3)) + np.array([0, 0, 3000])
    fixes = np.arange(0, n_times, gnss_every) if gnss_every else np.arange(0)
    gnss_vehicle, gnss_sample = (
        np.repeat(np.arange(n_vehicles), fixes.size),
        np.tile(fixes, n_vehicles),
    )
    n = n_vehicles + n_landmarks
    pairs = [(i, j) for i in range(n) for j in range(n) if i != j and min(i, j) < n_vehicles]
    pairs = np.array(pairs, dtype=int).reshape(-1, 2)
    epochs = np.arange(5, n_times, 5)
    transmitter, receiver = np.tile(pairs, (epochs.size, 1)).T
    sample = np.repeat(epochs, len(pairs))
    where = np.concatenate([position, np.repeat(landmark[:, None], n_times, axis=1)], axis=0)
    distance = np.linalg.norm(where[transmitter, sample] - where[receiver, sample], axis=1)
    status = np.where(rng.random(sample.size) < dropouts, RayStatus.SHADOW, RayStatus.OK)
    c = 1450.0 + 0.01 * where[transmitter, sample, 2]
    time = (distance + range_error) / c
    truth = trajectories(
        position, time=np.arange(n_times) * PERIOD, quaternion=quaternion_from_matrix(rotation)
    )
    measured = measure(
        truth,
        landmark,
        (gnss_vehicle, gnss_sample),
        (transmitter, receiver, sample),
        odometry_rotation=quaternion_from_matrix(step),
        odometry_translation=moved,
        odometry_sigma=odometry_sigma,
        landmark_sigma=np.full(n_landmarks, 0.5),
        first_sigma=np.tile([1e-3] * 3 + [0.1] * 3, (n_vehicles, 1)),
        range_status=status,
        transmitter_sound_speed=c,
        straight_range=distance,
        refracted_range=np.where(status == RayStatus.OK, c * time, np.nan),
    )
    return Fleet(position, truth.quaternion, measured, add_noise(measured, seed + 1000))


def add_noise(o, seed):
    """Draw every measurement from exactly the distribution that the graph believes in."""
    rng = np.random.default_rng(seed)
    jump = se3_exp(o.odometry_sigma * rng.standard_normal(o.odometry_sigma.shape))
    step = matrix_from_quaternion(o.odometry_rotation)
    first = se3_exp(o.first_sigma * rng.standard_normal(o.first_sigma.shape))
    first_rotation = matrix_from_quaternion(o.first_quaternion)
    range_noise = o.range_sigma * rng.standard_normal(o.range_sigma.shape)
    return replace(
        o,
        odometry_rotation=quaternion_from_matrix(step @ jump[0]),
        odometry_translation=o.odometry_translation + np.einsum("atij,atj->ati", step, jump[1]),
        depth=o.depth + o.depth_sigma[:, None] * rng.standard_normal(o.depth.shape),
        gnss_position=o.gnss_position
        + o.gnss_sigma[:, None] * rng.standard_normal(o.gnss_position.shape),
        landmark_position=o.landmark_position
        + o.landmark_sigma[:, None] * rng.standard_normal(o.landmark_position.shape),
        first_position=o.first_position + np.einsum("aij,aj->ai", first_rotation, first[1]),
        first_quaternion=quaternion_from_matrix(first_rotation @ first[0]),
        straight_range=o.straight_range + range_noise,
        refracted_range=o.refracted_range + range_noise,
    )


def trajectories(position, *, names=None, roles=None, time=None, quaternion=None):
    """
    Truth of shape (vehicles, times, 3): a station and floats called A, B, ..., level and awake
    unless said otherwise.
    """
    n, n_times, _ = position.shape
    return Trajectories(
        name=np.array(list("ABCDEFGHIJKMNOPQRSTUVWXYZ"[:n]) if names is None else names),
        role=np.array(["station", *["float"] * (n - 1)] if roles is None else roles),
        time=200.0 * np.arange(n_times) if time is None else time,
        position=position,
        quaternion=np.broadcast_to([1.0, 0, 0, 0], (n, n_times, 4))
        if quaternion is None
        else quaternion,
        status=np.zeros((n, n_times)),
    )


def measure(truth, landmarks, fixes, attempts, **columns):
    """
    Measurements without noise by a fleet, less those of odometry and of ranges: fixes and attempts
    are given.
    """
    n, (vehicle, sample) = len(truth.name), fixes
    return Measurements(
        name=truth.name,
        time=truth.time,
        depth=truth.position[..., 2],
        depth_sigma=np.full(n, 0.01),
        gnss_vehicle=vehicle,
        gnss_sample=sample,
        gnss_position=truth.position[vehicle, sample],
        gnss_sigma=np.full(len(vehicle), 0.1),
        landmark_name=np.array([f"L{i}" for i in range(len(landmarks))], dtype=str),
        landmark_position=landmarks,
        first_position=truth.position[:, 0],
        first_quaternion=truth.quaternion[:, 0],
        **dict(zip(("range_transmitter", "range_receiver", "range_sample"), attempts, strict=True)),
        range_sigma=np.ones(len(attempts[0])),
        **columns,
    )


def estimates(truth, position, conditions=("straight", "refracted"), *, quaternion=None):
    """Healthy estimates of shape (conditions, realizations, vehicles, times, 3)."""
    shape = position.shape[:2]
    return Estimates(
        condition=np.array(conditions),
        realization=np.arange(shape[1]),
        name=truth.name,
        time=truth.time,
        landmark_name=np.array([], dtype=str),
        position=position,
        quaternion=np.broadcast_to(truth.quaternion, (*position.shape[:-1], 4))
        if quaternion is None
        else quaternion,
        landmark_position=np.zeros((*shape, 0, 3)),
        solve_status=np.zeros(shape),
        iterations=np.full(shape, 4),
        initial_cost=np.full(shape, 2.0),
        final_cost=np.ones(shape),
        expected_cost=np.ones(shape),
        gradient_norm=np.zeros(shape),
        gated_links=np.zeros(shape),
    )


def ranges(truth, rng, attempts, *, status=None, landmarks=()):
    """
    Measurements without noise and their truth for attempts (transmitter, receiver, sample), a row
    each.

    Chords and rays have travel times of their own, rays being faster; landmarks L0, L1, ... are
    where they are given.
    """
    n, n_times = truth.position.shape[:2]
    marks = np.array(landmarks, dtype=float).reshape(-1, 3)
    who, to, sample = np.array(attempts, dtype=int).reshape(-1, 3).T
    place = np.concatenate([truth.position, np.repeat(marks[:, None], n_times, axis=1)])
    distance = np.linalg.norm(place[who, sample] - place[to, sample], axis=-1)
    status = np.full(who.size, RayStatus.OK) if status is None else np.array(status)
    speed = 1440.0 + 0.017 * place[who, sample, 2]
    chord = distance / rng.uniform(1440.0, 1460.0, who.size)
    time = np.where(status == RayStatus.OK, chord - rng.exponential(1e-3, who.size), np.nan)
    measurements = measure(
        truth,
        marks,
        np.argwhere(truth.position[..., 2] < 1.0).T,
        (who, to, sample),
        odometry_rotation=np.tile([1.0, 0.0, 0.0, 0.0], (n, n_times - 1, 1)),
        odometry_translation=np.diff(truth.position, axis=1),
        odometry_sigma=np.ones((n, n_times - 1, 6)),
        landmark_sigma=np.full(len(marks), 0.1),
        first_sigma=np.ones((n, 6)),
        range_status=status,
        transmitter_sound_speed=speed,
        straight_range=distance,
        refracted_range=speed * time,
    )
    return measurements, RangingTruth(
        distance=distance, sound_speed=speed, travel_time=time, chord_travel_time=chord
    )


def python(code, *arguments, environment=None, **options):
    """Run code in a process of its own; what it printed and said is text."""
    command = [sys.executable, "-c", code, *map(str, arguments)]
    options = {
        "env": os.environ | (environment or {}),
        "capture_output": True,
        "text": True,
    } | options
    return subprocess.run(command, check=False, **options)


def wait_for(condition, seconds=600.0):
    """Wait until a condition holds; so long only where it never will."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def assert_same(one, other, *, but=()):
    """Two records are equal in every column, but for some."""
    for f in fields(one):
        if f.name not in but:
            np.testing.assert_array_equal(
                getattr(one, f.name), getattr(other, f.name), err_msg=f.name
            )


def names_in(folder):
    """Names of what is in a folder, in order."""
    return sorted(path.name for path in folder.iterdir())


def make_arrivals(link, status=(RayStatus.OK,), **columns):
    """Arrivals of the links given by row; columns that are not given are zero, travel times too."""
    sizes = {"arrival": len(link), "n_links": len(status), "axis": 3}
    zeros = {
        f.name: np.zeros([sizes[name] for name in f.metadata["dims"]])
        for f in fields(Arrivals)
        if "dims" in f.metadata
    }
    return Arrivals(**zeros | {"link": link, "status": status} | columns)


HIDDEN = Landmark("L1", (4000.0, 0.0, 250.0))


def ridged(crest=150.0, *, speed=1450.0, gradient=0.0, bottom=1000.0):
    """
    Water in which a ridge across the north axis at 2 km hides `HIDDEN` from the south, but not from
    a bounce above.
    """
    north, east, depth = (
        np.array([-5e3, 1.9e3, 2e3, 2.1e3, 8e3]),
        np.array([-5e3, 5e3]),
        np.array([0.0, 4e3]),
    )
    bathymetry = np.full((5, 2), bottom)
    bathymetry[2] = crest
    return Medium.from_grid(
        north,
        east,
        depth,
        np.broadcast_to(speed + gradient * depth, (5, 2, 2)),
        bathymetry=bathymetry,
        interpolation="linear",
    )


def range_fleet(
    truth, landmarks, medium, *, currents=None, timing=None, progress=None, **reception
):
    """Ranges every 800 s; all else is what the receivers listen for."""
    return measure_ranges(
        truth,
        landmarks,
        medium,
        PingSchedule(800.0),
        ReceptionOptions(**reception),
        currents=currents,
        timing=timing or OneWay(),
        progress=progress,
    )


GAPS = (1500, 900, 1200, 2200, 1700, 800, 1900, 1300, 1500)


def twisted(
    depth, speed=None, *, bed=900.0, noise=60.0, seed=41, gaps=GAPS, interpolation="smooth"
):
    """
    Cells of 0.8 to 2.2 km, none of them plane, on a slope, under water of 1500 m/s or a profile
    that a front crosses.
    """
    north = np.cumsum([0.0, *gaps])
    east = np.linspace(0.0, 12e3, 9)
    relief = noise * np.random.default_rng(seed).uniform(-1.0, 1.0, (north.size, east.size))
    c = np.full((north.size, east.size, depth.size), 1500.0)
    if speed is not None:
        c[:] = speed
        c += 4.0 * np.tanh((north[:, None, None] - 6e3) / 3e3) * np.exp(-depth / 400.0)
        c += 2.0 * np.sin(east[:, None] / 4e3) * np.exp(-depth / 300.0)
    bathymetry = bed + 0.03 * north[:, None] - 0.015 * east + relief
    return Medium.from_grid(
        north, east, depth, c, bathymetry=bathymetry, interpolation=interpolation
    )


def inner_links(n, seed, *, top=20.0, east=(2e3, 10e3)):
    """Pairs in the inner part of the twisted medium, up to 5 km apart, above its shallowest bed."""
    rng = np.random.default_rng(seed)
    source = rng.uniform((3e3, east[0], top), (10e3, east[1], 650.0), (n, 3))
    bearing, distance = rng.uniform(0.0, 2.0 * np.pi, n), rng.uniform(200.0, 5e3, n)
    step = distance[:, None] * np.column_stack([np.cos(bearing), np.sin(bearing)])
    receiver = np.column_stack([source[:, :2] + step, rng.uniform(top, 650.0, n)])
    inside = ((receiver[:, :2] > 500.0) & (receiver[:, :2] < (12.5e3, 11.5e3))).all(axis=1)
    return source[inside], receiver[inside]


ARCTIC_DEPTH = np.array(
    [0, 5, 10, 20, 30, 45, 60, 80, 100, 130, 160, 200, 300, 400, 600, 800, 1000, 1500, 2500, 4000.0]
)


DUCT_DEPTH = np.array([0.0, 2, 5, 10, 20, 40, 60, 100, 150, 250, 400, 700, 1200, 2000, 3000, 4000])
DUCT = 1440.0 + 0.016 * DUCT_DEPTH + 8.0 * np.exp(-(((DUCT_DEPTH - 60) / 25.0) ** 2))


def arctic(depth):
    """Arctic-like: a cold cap, a warm layer at 60 m over a duct at 130 m, then pressure."""
    return (
        1438.0
        + 0.016 * depth
        + 9.0 * np.exp(-(((depth - 60.0) / 25.0) ** 2))
        + 20.0 / (1.0 + np.exp(-(depth - 280.0) / 60.0))
    )


@cache
def make_front(interpolation="smooth"):
    """A front in the north and an eddy over a sloping sea bed."""
    north, east = np.linspace(0.0, 40_000.0, 17), np.linspace(0.0, 30_000.0, 13)
    n, e, z = np.meshgrid(north, east, ARCTIC_DEPTH, indexing="ij")
    c = arctic(z) + 6.0 * np.tanh((n - 20_000.0) / 8000.0) * np.exp(-z / 400.0)
    c += 5.0 * np.exp(-((n - 15e3) ** 2 + (e - 18e3) ** 2) / 9e3**2 - ((z - 150.0) / 120.0) ** 2)
    bottom = 3000.0 - 0.01 * n[..., 0]
    return Medium.from_grid(
        north, east, ARCTIC_DEPTH, c, bathymetry=bottom, interpolation=interpolation
    )


def front_links(n, seed):
    """Pairs about the front, from the surface to 2 km, many on levels."""
    rng = np.random.default_rng(seed)
    ends = []
    for _ in range(2):
        depth = rng.choice([0.5, 60.0, 130.0, 250.0, 500.0, 1250.0, 2000.0], n)
        ends.append(
            np.column_stack([rng.uniform(14e3, 24e3, n), rng.uniform(10e3, 20e3, n), depth])
        )
    return ends


def over_time(times, oceans):
    """Oceans at their instants as one data set."""
    fields = {
        name: (("time", *oceans[0][name].dims), np.stack([ocean[name].values for ocean in oceans]))
        for name in ("current_north", "current_east")
    }
    return oceans[0].assign(fields).assign_coords(time=np.asarray(times, dtype=float))


def pool_here(work, *_):
    """In place of `open_pool`: a pool that does tasks in this process, one after the other."""
    return Pool(lambda: work)


@contextmanager
def small_disk(folder: Path, size: str) -> Iterator[Callable[[str], None]]:
    """
    A folder as a file system of its own, of a size as ``256k``; gives what sets its options anew,
    as ``size=8m`` or ``ro``.

    A test is skipped where none can be mounted.
    """
    folder.mkdir(exist_ok=True)

    def mount(*words: str) -> bool:
        try:
            return (
                subprocess.run(
                    ["mount", *words, folder], capture_output=True, check=False
                ).returncode
                == 0
            )
        except OSError:
            return False

    def remount(options: str) -> None:
        assert mount("-o", f"remount,{options}")

    if not mount("-t", "tmpfs", "-o", f"size={size}", "tmpfs"):
        pytest.skip("no small file system can be mounted here")
    try:
        yield remount
    finally:
        subprocess.run(["umount", "-l", folder], check=True)

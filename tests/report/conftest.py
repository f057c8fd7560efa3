"""A made-up run on disk: the records of a small study, without an ocean model, rays or a solver."""

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib.colors import to_hex
from matplotlib.patches import StepPatch

from pymantaray.records import (
    Estimates,
    Measurements,
    RangingTruth,
    RayStatus,
    SolveStatus,
    Trajectories,
    write_netcdf,
)
from pymantaray.study import load_study, open_run, store, study_toml

CONDITIONS = ("odometry", "straight", "refracted")
N_TIME, PERIOD = 121, 600.0


@dataclass(frozen=True)
class Made:
    """What a made-up run is made of."""

    names: tuple[str, ...] = ("A", "B", "C", "D")
    landmarks: tuple[str, ...] = ()
    pings: int = 6
    lost: float = 0.1  # share of ranges that drop out
    realizations: int = 3
    conditions: tuple[str, ...] = CONDITIONS
    failed: tuple[tuple[int, int], ...] = ()  # (condition, realization) without an estimate
    title: str = "Test Sea (synthetic)"
    synthetic: int = 1
    description: str = "made up"
    rays: bool = True


def make_run(folder: Path, made: Made = Made()) -> Path:
    rng = np.random.default_rng(5)
    folder.mkdir(parents=True, exist_ok=True)
    config = load_study("quick")
    study = config.study.model_copy(
        update={"realizations": made.realizations, "description": made.description}
    )
    source = ("synthetic:beaufort",) if made.synthetic else ("somewhere.nc",)
    ocean = config.ocean.model_copy(update={"source": source})
    config = config.model_copy(update={"study": study, "ocean": ocean})
    (folder / store.CONFIG).write_text(study_toml(config), encoding="utf-8")
    manifest = {"format": 2, "study": "quick", "versions": {"numpy": "<2>"}, "seconds": {"rays": 1.5}}
    store.write_json(manifest, folder / store.MANIFEST)
    _write_ocean(folder, made)
    truth = make_truth(made, rng)
    truth.save(folder / store.TRUTH)
    measurements, ranging_truth = make_measurements(made, truth, rng)
    measurements.save(folder / store.MEASUREMENTS)
    ranging_truth.save(folder / store.RANGING_TRUTH)
    make_estimates(made, truth, rng).save(folder / store.ESTIMATES)
    return folder


def make_truth(made, rng):
    n = len(made.names)
    time = PERIOD * np.arange(N_TIME)
    position = np.zeros((n, N_TIME, 3))
    position[..., :2] = rng.uniform(-5e3, 5e3, (n, 1, 2)) + 0.05 * time[:, None]
    target = np.linspace(0.0, 2000.0, n)[:, None]
    position[..., 2] = 0.5 + np.clip(target * np.sin(2 * np.pi * time / 4e4), 0.0, None)
    quaternion = np.zeros((n, N_TIME, 4))
    quaternion[..., 0] = 1.0
    return Trajectories(
        name=np.array(made.names),
        role=np.array(["station", *["float"] * (n - 1)]),
        time=time,
        position=position,
        quaternion=quaternion,
        status=np.zeros((n, N_TIME), dtype=int),
    )


def make_measurements(made, truth, rng):
    n, m = len(made.names), len(made.landmarks)
    samples = np.linspace(N_TIME // 6, N_TIME - 1, made.pings).astype(int) if made.pings else []
    pairs = [(i, j, s) for s in samples for i in range(n) for j in range(n + m) if i != j]
    who, to, sample = np.array(pairs, dtype=int).reshape(-1, 3).T
    marks = rng.uniform(-3e3, 3e3, (m, 3)) * [1.0, 1.0, 0.0] + [0.0, 0.0, 900.0]
    place = np.concatenate([truth.position, np.repeat(marks[:, None], N_TIME, axis=1)])
    straight = np.linalg.norm(place[who, sample] - place[to, sample], axis=-1)
    speed = 1440.0 + 0.017 * place[who, sample, 2]
    chord = straight / (1450.0 + rng.normal(0.0, 5.0, straight.size))
    bent = chord - 1e-3 * rng.random(straight.size) * (straight / 5e3) ** 3
    lost = rng.random(straight.size) < made.lost
    status = np.where(lost, rng.choice([1, 2, 3, 4, 5], straight.size), int(RayStatus.OK))
    surface = np.argwhere(truth.position[..., 2] < 1.0)
    measurements = Measurements(
        name=truth.name,
        time=truth.time,
        odometry_rotation=np.zeros((n, N_TIME - 1, 4)),
        odometry_translation=np.zeros((n, N_TIME - 1, 3)),
        odometry_sigma=np.ones((n, N_TIME - 1, 6)),
        depth=truth.position[..., 2],
        depth_sigma=np.full(n, 0.01),
        gnss_agent=surface[:, 0],
        gnss_sample=surface[:, 1],
        gnss_position=truth.position[tuple(surface.T)],
        gnss_sigma=np.full(len(surface), 0.1),
        landmark_name=np.array(made.landmarks, dtype=str),
        landmark_position=marks,
        landmark_sigma=np.full(m, 0.1),
        first_position=truth.position[:, 0],
        first_quaternion=truth.quaternion[:, 0],
        first_sigma=np.ones((n, 6)),
        range_transmitter=who,
        range_receiver=to,
        range_sample=sample,
        range_status=status,
        transmitter_sound_speed=speed,
        straight_range=straight,
        refracted_range=np.where(lost, np.nan, speed * bent),
        range_sigma=np.ones(straight.size),
    )
    bent = np.where(lost, np.nan, bent)
    return measurements, RangingTruth(
        distance=straight, sound_speed=speed, travel_time=bent, chord_travel_time=chord
    )


def make_estimates(made, truth, rng):
    shape = (len(made.conditions), made.realizations, len(made.names), N_TIME)
    scale = np.array([50.0, 3.0, 9.0, 2.0, 40.0])[: shape[0], None, None, None, None]
    position = truth.position + scale * rng.standard_normal((*shape, 3))
    status = np.zeros(shape[:2], dtype=int)
    for c, r in made.failed:
        status[c, r] = SolveStatus.FAILED
        position[c, r] = np.nan
    cost = np.full(shape[:2], 10.0)
    return Estimates(
        condition=np.array(made.conditions),
        realization=np.arange(made.realizations),
        name=truth.name,
        time=truth.time,
        landmark_name=np.array(made.landmarks, dtype=str),
        position=position,
        quaternion=np.broadcast_to(truth.quaternion, (*shape, 4)),
        landmark_position=np.zeros((*shape[:2], len(made.landmarks), 3)),
        solve_status=status,
        iterations=np.full(shape[:2], 4),
        initial_cost=cost * 3,
        final_cost=cost,
        expected_cost=cost,
        gradient_norm=cost * 1e-6,
    )


def make_profile(made=Made()):
    depth = np.array([0.0, 50.0, 100.0, 300.0, 1000.0, 3000.0, 5000.0])
    mean = np.where(depth < 4000.0, 1440.0 + 0.017 * depth, np.nan)
    return xr.Dataset(
        {
            "mean": ("depth", mean),
            "min": ("depth", mean - 3.0),
            "max": ("depth", mean + 5.0),
            "count": ("depth", np.where(depth < 4000.0, 9, 0)),
        },
        coords={"depth": depth},
        attrs={"title": made.title, "source": "test", "synthetic": made.synthetic},
    )


def make_rays(n_arriving=1):
    x, z = np.linspace(0.0, 6000.0, 61), np.linspace(0.0, 1500.0, 51)
    s = np.linspace(0.0, 1.0, 41)
    fan = np.stack([np.full(41, np.nan) if k == 0 else 100.0 + k * 300.0 * s for k in range(3)])
    sag = 40.0 * np.arange(1, n_arriving + 1)[:, None] * np.sin(np.pi * s)
    direct = 100.0 + 700.0 * s + sag
    depth = np.concatenate([direct, fan])
    return xr.Dataset(
        {
            "sound_speed": (("range", "depth"), np.broadcast_to(1440.0 + 0.017 * z, (61, 51))),
            "sea_floor_depth": ("range", 1300.0 + 100.0 * np.cos(x / 800.0)),
            "ray_range": (("ray", "point"), np.broadcast_to(6000.0 * s, depth.shape)),
            "ray_depth": (("ray", "point"), depth),
            "ray_arrives": ("ray", np.r_[np.ones(n_arriving), np.zeros(3)].astype("i1")),
            "chord_range": ("end", [0.0, 6000.0]),
            "chord_depth": ("end", [100.0, 800.0]),
        },
        coords={"range": x, "depth": z},
        attrs={"source": "A", "receiver": "B", "time_h": 8.0},
    )


def _write_ocean(folder, made):
    attrs = {
        "title": made.title,
        "source": "test",
        "synthetic": made.synthetic,
        "time": "2014-07-15T12:00:00",
    }
    write_netcdf(xr.Dataset(attrs=attrs), folder / store.OCEAN)
    write_netcdf(make_profile(made), folder / store.PROFILE)
    region = pd.DataFrame(
        {made.title: ["74.5", "no" if not made.synthetic else "yes", "test"]},
        index=["centre [deg N]", "made up", "source"],
    )
    region.index.name = "property"
    region.to_csv(folder / store.REGION)
    if made.rays:
        write_netcdf(make_rays(), folder / store.RAY_PICTURE)


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory):
    return make_run(tmp_path_factory.mktemp("report") / "run")


@pytest.fixture(scope="session")
def run(run_folder):
    return open_run(run_folder)


@pytest.fixture(scope="session")
def fakes():
    """The makers above, for tests that need another study."""
    return SimpleNamespace(
        Made=Made,
        run=make_run,
        truth=make_truth,
        measurements=make_measurements,
        estimates=make_estimates,
        profile=make_profile,
        rays=make_rays,
    )


@pytest.fixture(scope="session")
def made():
    return Made(landmarks=("L0", "L1"), lost=0.3)


@pytest.fixture(scope="session")
def truth(made):
    return make_truth(made, np.random.default_rng(1))


@pytest.fixture(scope="session")
def measurements(made, truth):
    return make_measurements(made, truth, np.random.default_rng(2))[0]


@pytest.fixture
def ranging_truth(made, truth):
    return make_measurements(made, truth, np.random.default_rng(2))[1]


def texts(figure):
    return " | ".join(t.get_text() for t in figure.findobj(lambda a: hasattr(a, "get_text")))


def vertical_lines(axes):
    return {line.get_color(): line.get_xdata()[0] for line in axes.lines if len(set(line.get_xdata())) == 1}


def steps(axes):
    """Counts, edges of the filled histogram of a panel."""
    patch = next(p for p in axes.patches if isinstance(p, StepPatch))
    return patch.get_data().values, patch.get_data().edges


def markers(axes, colour):
    return [line for line in axes.lines if to_hex(line.get_color()) == to_hex(colour)]


def draw(figure):
    """Rendering warns of what does not fit; warnings are errors in the tests."""
    figure.canvas.draw()
    return figure


@pytest.fixture(scope="session")
def look():
    """Ways to read a figure back."""
    return SimpleNamespace(
        texts=texts, vertical_lines=vertical_lines, steps=steps, markers=markers, draw=draw
    )

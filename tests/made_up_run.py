"""A made-up run on disk: the records of a small study, without an ocean model, rays or a solver."""

from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import factories
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib.colors import to_hex
from matplotlib.patches import StepPatch

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.config import load_study, study_toml
from pymantaray.jobs import run_folder as names
from pymantaray.records import RayStatus, SolveStatus, write_netcdf
from pymantaray.sensing import Links

N_TIME, PERIOD = 121, 600.0


@dataclass(frozen=True)
class Made:
    """What a made-up run is made of."""

    names: tuple[str, ...] = ("A", "B", "C", "D")
    landmarks: int = 0
    pings: int = 6
    lost: float = 0.1  # share of ranges that drop out
    realizations: int = 3
    conditions: tuple[str, ...] = ("odometry", "straight", "refracted")
    failed: tuple[tuple[int, int], ...] = ()  # (condition, realization) without an estimate
    title: str = "Test Sea (synthetic)"
    synthetic: int = 1
    description: str = "made up"
    rays: bool = True
    seed: int = 20140715
    scale: float = 1.0  # of position errors

    def records(self, seed=5):
        """Truth, measurements without noise, their truth, estimates."""
        rng, n = np.random.default_rng(seed), len(self.names)
        time = PERIOD * np.arange(N_TIME)
        position = np.zeros((n, N_TIME, 3))
        position[..., :2] = rng.uniform(-5e3, 5e3, (n, 1, 2)) + 0.05 * time[:, None]
        target = np.linspace(0.0, 2000.0, n)[:, None]
        position[..., 2] = 0.5 + np.clip(target * np.sin(2 * np.pi * time / 4e4), 0.0, None)
        truth = factories.trajectories(position, names=self.names, time=time)
        samples = np.linspace(N_TIME // 6, N_TIME - 1, self.pings).astype(int) if self.pings else []
        marks = rng.uniform(-3e3, 3e3, (self.landmarks, 3)) * [1.0, 1.0, 0.0] + [0.0, 0.0, 900.0]
        attempts = [
            (i, j, s)
            for s in samples
            for i in range(n)
            for j in range(n + self.landmarks)
            if i != j
        ]
        lost = rng.random(len(attempts)) < self.lost
        status = np.where(lost, rng.choice([1, 2, 3, 4, 5], len(attempts)), int(RayStatus.OK))
        ranges = factories.ranges(truth, rng, attempts, status=status, landmarks=marks)
        shape = (len(self.conditions), self.realizations, *position.shape)
        scale = (
            self.scale * np.resize([50.0, 3.0, 9.0, 2.0, 40.0], shape[0])[:, None, None, None, None]
        )
        solved = factories.estimates(
            truth, position + scale * rng.standard_normal(shape), self.conditions
        )
        status, position = np.array(solved.solve_status), np.array(solved.position)
        for place in self.failed:
            status[place], position[place] = SolveStatus.FAILED, np.nan
        return truth, *ranges, replace(solved, solve_status=status, position=position)

    def write(self, folder: Path) -> Path:
        """Write the run's folder."""
        folder.mkdir(parents=True, exist_ok=True)
        config = load_study("quick")
        study = {"realizations": self.realizations, "description": self.description}
        study["seed"] = self.seed
        source = ("synthetic:beaufort",) if self.synthetic else ("somewhere.nc",)
        changes = {
            "study": config.study.model_copy(update=study),
            "ocean": config.ocean.model_copy(update={"source": source}),
        }
        (folder / names.CONFIG).write_text(
            study_toml(config.model_copy(update=changes)), encoding="utf-8"
        )
        files = (names.TRUTH, names.MEASUREMENTS, names.RANGING_TRUTH, names.ESTIMATES)
        for name, record in zip(files, self.records(), strict=True):
            record.save(folder / name)
        nobody, nowhere = np.empty(0, dtype=int), np.empty((0, 3))
        Links(sample=nobody, first=nobody, second=nobody).save(folder / names.LINKS)
        water = Medium.from_profile([0.0, 4000.0], [1440.0, 1508.0], bottom_depth=4000.0)
        find_eigenrays(water, nowhere, nowhere).save(folder / names.ARRIVALS)
        attrs = {"title": self.title, "source": "test", "synthetic": self.synthetic}
        write_netcdf(
            make_water().assign_attrs(attrs | {"time": "2014-07-15T12:00:00"}), folder / names.OCEAN
        )
        write_netcdf(make_profile().assign_attrs(attrs), folder / names.PROFILE)
        region = {
            "centre [deg N]": "74.5",
            "made up": "yes" if self.synthetic else "no",
            "source": "test",
        }
        pd.Series(region, name=self.title).rename_axis("property").to_csv(folder / names.REGION)
        if self.rays:
            write_netcdf(make_rays(), folder / names.RAY_PICTURE)
        versions = {"numpy": "<2>"}
        manifest = {"study": "quick", "versions": versions, "seconds": {"rays": 1.5}}
        names.write_manifest(manifest, folder)
        return folder


def make_profile():
    depth = np.array([0.0, 50.0, 100.0, 300.0, 1000.0, 3000.0, 5000.0])
    mean = np.where(depth < 4000.0, 1440.0 + 0.017 * depth, np.nan)
    columns = {
        "mean": mean,
        "min": mean - 3.0,
        "max": mean + 5.0,
        "count": np.where(depth < 4000.0, 9, 0),
    }
    return xr.Dataset(
        {name: ("depth", values) for name, values in columns.items()}, coords={"depth": depth}
    )


def make_water():
    horizontal, depth = (
        np.linspace(-3e4, 3e4, 4),
        np.array([0.0, 50.0, 100.0, 300.0, 1000.0, 3000.0, 5000.0]),
    )
    speed = np.broadcast_to(1440.0 + 0.017 * depth, (4, 4, 7))
    return xr.Dataset(
        {
            "sound_speed": (("north", "east", "depth"), speed),
            "sea_floor_depth": (("north", "east"), np.full((4, 4), 4000.0)),
        },
        coords={"north": horizontal, "east": horizontal, "depth": depth},
    )


def make_rays(n_arriving=1):
    x, z = np.linspace(0.0, 6000.0, 61), np.linspace(0.0, 1500.0, 51)
    s = np.linspace(0.0, 1.0, 41)
    fan = np.stack([np.full(41, np.nan) if k == 0 else 100.0 + k * 300.0 * s for k in range(3)])
    sag = 40.0 * np.arange(1, n_arriving + 1)[:, None] * np.sin(np.pi * s)
    depth = np.concatenate([100.0 + 700.0 * s + sag, fan])
    return xr.Dataset(
        {
            "sound_speed": (("range", "depth"), np.broadcast_to(1440.0 + 0.017 * z, (61, 51))),
            "sea_floor_depth": ("range", 1300.0 + 100.0 * np.cos(x / 800.0)),
            "ray_range": (("ray", "point"), np.broadcast_to(6000.0 * s, depth.shape)),
            "ray_depth": (("ray", "point"), depth),
            "ray_arrives": ("ray", np.r_[np.ones(n_arriving), np.zeros(3)].astype("i1")),
            "ray_surface_bounces": ("ray", np.zeros(n_arriving + 3, "i2")),
            "ray_bottom_bounces": ("ray", np.zeros(n_arriving + 3, "i2")),
            "chord_range": ("end", [0.0, 6000.0]),
            "chord_depth": ("end", [100.0, 800.0]),
        },
        coords={"range": x, "depth": z},
        attrs={"source": "A", "receiver": "B", "time_h": 8.0},
    )


@pytest.fixture(scope="session")
def made_run():
    """`Made`, for tests that need another study."""
    return Made


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory):
    return Made().write(tmp_path_factory.mktemp("report") / "run")


@pytest.fixture(scope="session")
def run(run_folder):
    from pymantaray.apps.study import open_run

    return open_run(run_folder)


@pytest.fixture(scope="session")
def records():
    """Truth, measurements and their truth of a fleet with landmarks."""
    truth, measurements, ranging_truth, _ = Made(landmarks=2, lost=0.3).records(1)
    return SimpleNamespace(truth=truth, measurements=measurements, ranging_truth=ranging_truth)


@pytest.fixture(scope="session")
def water():
    return SimpleNamespace(profile=make_profile(), rays=make_rays)


HOURS = [24.0, 48.0, 72.0, 84.0]
SURE, GOOD, FAR = [0.99, 1.0, 1.01, 1.0], [1.02, 0.98, 1.3, 1.0], [150.0, 900.0, 400.0, 1200.0]


def consistency_rows(ratios, few=()):
    """
    Ratios by condition and statistic at `HOURS`; bounds of 0.9 to 1.1, wider for conditions of few
    solves.
    """
    rows = [
        (*key, *row) for key, values in ratios.items() for row in zip(HOURS, values, strict=True)
    ]
    table = pd.DataFrame(rows, columns=["condition", "statistic", "time_h", "ratio"])
    reach = np.where(table["condition"].isin(few), 0.15, 0.1)
    inside = (table["ratio"] - 1.0).abs() <= reach
    freedom = np.where(table["condition"].isin(few), 440, 550)
    return table.assign(
        degrees_of_freedom=freedom, low=1.0 - reach, high=1.0 + reach, inside=inside
    )


def unknown_rows(condition, names, prior, sigma, error):
    columns = {"unknown": names, "prior_sigma": prior, "sigma": sigma, "rms_error": error}
    return pd.DataFrame({"condition": condition, **columns})


@pytest.fixture(scope="session")
def tables():
    """
    Of three conditions: one that knows itself, one that errs once, one that is far off; of modes
    and of clocks.
    """
    ratios = {
        ("odometry", "horizontal"): SURE,
        ("straight", "horizontal"): GOOD,
        ("straight", "ranges"): SURE,
        ("refracted", "horizontal"): FAR,
        ("refracted", "ranges"): [2e3, 3e3, 2e3, 4e3],
    }
    clocks = [f"clock {what} {c}" for what in ("offset", "skew") for c in "ABCDE"]
    sigma, error = np.linspace(1e-5, 1e-3, 10), np.linspace(2e-5, 1e-3, 10)
    modes = unknown_rows("modes", ["mode 1", "mode 2"], 2.0, [0.2, 2.0], [0.1, 1.0])
    return SimpleNamespace(
        consistency=consistency_rows(ratios, few=("refracted",)),
        errors=pd.DataFrame(
            {
                "condition": ["odometry", "straight", "refracted", "lost"],
                "rmse_m": [80.0, 12.0, 130.5, np.nan],
            }
        ),
        at_pings=pd.DataFrame(
            {
                "condition": ["straight", "refracted", "odometry", "lost"],
                "rmse_m": [0.75, 25.5, 120.0, np.nan],
                "bound_rmse_m": [0.5, 0.5, 110.0, 0.5],
            }
        ),
        unknowns=pd.concat([modes, unknown_rows("clocks", clocks, 1e-3, sigma, error)]),
        consistency_rows=consistency_rows,
    )


@pytest.fixture(scope="session")
def made_replay():
    """Forty events of two nodes, every other one after a bounce; residuals count them."""
    from pymantaray.apps.replay import DetectionRule, Replay

    n = np.arange(40)
    events = pd.DataFrame(
        {
            "time_s": 45.0 * n,
            "source": np.where(n % 2, "B", "A"),
            "receiver": np.where(n % 2, "A", "B"),
            "pair": "A and B",
            "source_depth_m": 30.0,
            "receiver_depth_m": 150.0,
            "measured_s": 2.0 + 1e-3 * n,
            "sigma_s": np.nan,
            "distance_m": 3e3,
            "bearing_deg": np.where(n % 2, 180.0, 0.0),
            "chord_s": 2.0,
            "status": "ok",
            "predicted_s": 2.0,
            "surface_bounces": n % 2,
            "bottom_bounces": 0,
            "near_limit": False,
            "residual_s": 1e-3 * n,
            "residual_m": 1.5 * n,
        }
    ).astype({"surface_bounces": "Int64", "bottom_bounces": "Int64"})
    candidates = pd.DataFrame({"event": n, "travel_time_s": 2.0, "loss_db": 70.0})
    return Replay(events, DetectionRule.parse("first"), 60.0, 1, candidates)


def texts(figure):
    return " | ".join(t.get_text() for t in figure.findobj(lambda a: hasattr(a, "get_text")))


def vertical_lines(axes):
    return {
        line.get_color(): line.get_xdata()[0]
        for line in axes.lines
        if len(set(line.get_xdata())) == 1
    }


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

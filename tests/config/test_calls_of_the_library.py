"""What configurations with many keys give the functions of the library that make their water."""

import datetime as dt
import inspect
from importlib import import_module
from types import FunctionType

import numpy as np
import pytest

from pymantaray.config.door.beliefs import Beliefs
from pymantaray.config.door.ocean import build_mission_ocean, open_start
from pymantaray.config.door.range_models import BUILDERS
from pymantaray.config.door.water import configuration_of, open_water
from pymantaray.config.estimators import ConditionSection
from pymantaray.geometry.roughness import Roughness
from pymantaray.ocean import open_ocean

BUILD = ("ocean", "uniform", "water", "beliefs", "range_models", "sound")
PLAIN = (bool, int, float, str, dt.datetime, np.datetime64, Roughness)


def plain(value):
    """Numbers and texts as they are, and the types of all other objects."""
    if isinstance(value, tuple | list) and len(value) < 9:
        return [plain(item) for item in value]
    return value if value is None or isinstance(value, PLAIN) else type(value).__name__


@pytest.fixture
def calls(monkeypatch):
    """Calls of the library's functions from `config.door` in their order, with arguments."""
    made = []

    def recorded(function, name):
        signature = inspect.signature(function)

        def call(*arguments, **options):
            given = signature.bind(*arguments, **options).arguments
            made.append({"function": name} | {key: plain(value) for key, value in given.items()})
            return function(*arguments, **options)

        return call

    for name in BUILD:
        module = import_module(f"pymantaray.config.door.{name}")
        for key, thing in list(vars(module).items()):
            home = getattr(thing, "__module__", None) or ""
            own = home.startswith("pymantaray.config") or not home.startswith("pymantaray.")
            if isinstance(thing, FunctionType) and not own:
                monkeypatch.setattr(module, key, recorded(thing, f"{name}: {key}"))
    return made


TIDE = {"amplitude": 5.0, "period_h": 6.0, "wavelength": 4e4}


@pytest.mark.parametrize("change", [{"time_varying": True}, {"internal_tide": TIDE}])
def test_of_an_ocean_with_a_sea_floor_and_ice(calls, tiny, tmp_path, change, as_stored):
    floor = open_ocean("synthetic:beaufort")["water_temp"][0] * 0.0 + 900.0
    floor.attrs = {"standard_name": "sea_floor_depth_below_geoid", "units": "m"}
    floor.drop_vars(["time", "depth"]).rename("deptho").to_netcdf(tmp_path / "floor.nc")
    config = tiny(
        ocean={
            "time": "2014-07-16T00:00:00",
            "half_extent_north": 6e3,
            "half_extent_east": 7e3,
            "equation": "unesco",
            "currents": "required",
            "bathymetry": str(tmp_path / "floor.nc"),
            "bathymetry_crs": "EPSG:4326",
            "ice": 2.0,
            "ice_slope_deg": 3.0,
            "ice_length": 30.0,
        }
        | change
    )
    assert build_mission_ocean(config).open().region.shape[1] == 1
    as_stored(calls)


@pytest.mark.parametrize("change", [{"thin": 0.05}, {"smooth": 12.0}], ids=str)
def test_of_a_profile_with_every_option(calls, tmp_path, change, as_stored):
    rows = [f"{z},{-1.0 + z / 200.0},{30.0 + z / 100.0}" for z in range(0, 400, 5)]
    (tmp_path / "cast.csv").write_text("\n".join(["depth,temperature,salinity", *rows]) + "\n")
    open_water(
        tmp_path / "cast.csv",
        bathymetry=700.0,
        ice=2.0,
        ice_slope_deg=3.0,
        ice_length=30.0,
        centre=(78.1, 3.2),
        half_extent=(4e3, 5e3),
        equation="del-grosso",
        repair_freezing=True,
        interpolation="linear",
        max_surface_bounces=1,
        earth="sphere",
        time="2020-03-01T00:00:00",
        **change,
    )
    as_stored(calls)


def test_of_a_profile_on_a_grid(calls, tmp_path, as_stored):
    (tmp_path / "cast.csv").write_text("depth,temperature,salinity\n0,-1,30\n90,1,31\n300,0,34\n")
    options = {"bathymetry": 350.0, "centre": (78.1, 3.2), "half_extent": (4e3, 5e3)}
    options |= {"equation": "del-grosso", "time": "2020-03-01T00:00:00"}
    open_start(configuration_of(tmp_path / "cast.csv", options).ocean)
    as_stored(calls)


KINDS = (
    {"kind": "exact"},
    {"kind": "mean"},
    {"kind": "cast", "north": 500.0, "east": -900.0, "bias_sigma": 0.3, "noise_sigma": 0.1},
    {"kind": "offset", "depth": [100.0, 300.0], "sound_speed": [0.5, -1.0]},
    {"kind": "perturbed", "rms": 1.0, "horizontal_scale": 2e4, "down_to": 300.0},
    {"kind": "other-day", "days_earlier": 2.0},
    {"kind": "numerics", "every_level": 2, "equation": "unesco", "interpolation": "linear"},
)


@pytest.fixture(scope="module")
def flown(fly_tiny):
    return fly_tiny(ocean={"half_extent_north": 12e3}, mission={"duration_h": 1.0})[1]


@pytest.mark.parametrize("belief", KINDS, ids=lambda belief: belief["kind"])
def test_of_each_belief(calls, flown, belief, as_stored):
    model = {"kind": "eigenray", "belief": belief}
    section = ConditionSection.model_validate({"name": "own", "range_model": model})
    beliefs = Beliefs(flown)
    BUILDERS["eigenray"](section.range_model, beliefs, 1)
    beliefs.covariance(0.7, 15e3, 250.0)
    as_stored(calls)


def test_of_a_cast_that_is_believed(calls, flown, tmp_path, as_stored):
    (tmp_path / "cast.csv").write_text("depth,temperature,salinity\n0,-1,28\n90,1,31\n600,0,34\n")
    belief = {"kind": "file", "source": str(tmp_path / "cast.csv")}
    model = {"kind": "eigenray", "belief": belief}
    section = ConditionSection.model_validate({"name": "own", "range_model": model})
    BUILDERS["eigenray"](section.range_model, Beliefs(flown), 1)
    as_stored(calls)

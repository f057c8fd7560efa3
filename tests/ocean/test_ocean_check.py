"""
Each defect put into a healthy ocean is findings, named and placed; a healthy one gives no finding.
"""

import numpy as np
import pytest
import xarray as xr

from pymantaray.errors import OceanError
from pymantaray.fleet import StationKeeping, Vehicle
from pymantaray.fleet.simulation import fleet_refusals
from pymantaray.geometry.grid import linear_interpolator
from pymantaray.ocean import check_ocean, to_local, validate_ocean

POINT = (5, 11, 23)


@pytest.fixture
def healthy(fram_strait):
    """A window of the Fram Strait that claims to be real; its own copy."""
    part = fram_strait.isel(lat=slice(20, 50), lon=slice(90, 150)).copy(deep=True)
    part.attrs["synthetic"] = 0
    return part


def kinds(findings):
    return [f.what for f in findings]


def test_a_healthy_ocean_gives_no_finding(healthy, as_stored):
    findings = check_ocean(healthy)
    assert [str(f) for f in findings] == []
    assert findings.ok
    assert findings.named("nothing of the kind") is None
    as_stored(findings)


def test_real_files_have_nothing_wrong(gulf_stream_files, as_stored):
    findings = check_ocean(gulf_stream_files)
    assert findings.ok
    inversions = findings.named("density inversions")
    assert "1347 of 16345 pairs" in inversions.value
    assert "8 and 10 m" in inversions.value
    as_stored(findings)


def spoil(ocean, where, **values):
    for name, value in values.items():
        ocean[name].values[where] = value
    return ocean


def mask(ocean, where):
    return spoil(ocean, where, **dict.fromkeys(ocean.data_vars, np.nan))


def axis(ocean, name, values, **attrs):
    return ocean.assign_coords({name: (name, np.asarray(values), ocean[name].attrs | attrs)})


def kelvin(ocean):
    return ocean.assign(water_temp=(ocean["water_temp"] + 273.15).assign_attrs(units="K"))


SOUTHWARD = slice(None, None, -1)
WRONG = {  # how, and the finding or how it begins
    "no salinity": (lambda o: o.drop_vars("salinity"),
                    "variable missing (salinity): no such variable"),
    "no latitude": (lambda o: o.drop_vars("lat"), "axis missing (lat): no such coordinate"),
    "no time": (lambda o: o.drop_vars("time"), "axis missing (time): no such coordinate"),
    "time axis": (lambda o: o.expand_dims("time"), "axis (time): 1 of datetime64"),
    "time a number": (lambda o: o.assign_coords(time=3.0), "axis (time): 1 of float64"),
    "depth from 5 m": (lambda o: axis(o, "depth", o["depth"] + 5.0), "axis (depth): starts at 5 m"),
    "depth upward": (lambda o: axis(o, "depth", -o["depth"]),
                     "axis not monotone (depth): 39 of 39"),
    "depth in cm": (lambda o: axis(o, "depth", 100 * o["depth"], units="cm"),
                    "units (depth): cm; allowed m;"),
    "latitude falls": (lambda o: o.isel(lat=SOUTHWARD), "axis not monotone (lat): 29 of 29"),
    "beyond the pole": (lambda o: axis(o, "lat", o["lat"] + 12.0),
              "axis (lat): 89.32 to 90.48; allowed -90 to 90"),
    "round the Earth": (lambda o: axis(o, "lon", np.linspace(-180, 180, 60)),
                        "axis (lon): spans 360 degrees"),
    "too narrow": (lambda o: o.isel(lon=slice(0, 3)), "axis too short (lon): 3 points"),
    "transposed": (lambda o: o.transpose("lat", "lon", "depth"), "dimensions (water_v): ('lat',"),
    "text": (lambda o: o.assign(water_u=o["water_u"].astype(str)), "type (water_u): <U"),
    "kelvin": (kelvin, "units (water_temp): K; allowed degC;"),
    "too much salt": (lambda o: spoil(o, POINT, salinity=400.0), "values (salinity): 1 of "),
    "infinite": (lambda o: spoil(o, POINT, water_u=np.inf),
                 "not finite (water_u): 1 infinite values"),
    "all land": (lambda o: mask(o, ...), "no valid value (water_v): all missing"),
    "hole": (
        lambda o: spoil(o, POINT, salinity=np.nan),
        ("NaN islands (salinity 77.76 N, 0.4 W, 10 m): 1 points are missing either in it or in"
        " water_temp"),
    ),
    "bubble": (
        lambda o: mask(o, POINT),
        "NaN islands (water_temp 77.76 N, 0.4 W, 12 m): 32 wet points are below a dry one",
    ),
    "no title": (lambda o: o.drop_attrs(deep=False).assign_attrs(synthetic=1),
                 "attributes missing: title, source"),
    "perhaps": (lambda o: o.assign_attrs(synthetic="perhaps"), "attribute (synthetic): 'perhaps'"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_the_first_finding_is_the_error_of_the_schema(healthy, name, as_stored):
    change, finding = WRONG[name]
    ocean = change(healthy)
    findings = check_ocean(ocean)
    assert any(str(f).startswith(f"wrong: {finding}") for f in findings), [str(f) for f in findings]
    assert not findings.ok
    assert all(len(str(finding).splitlines()) == 1 for finding in findings)
    with pytest.raises(OceanError) as caught:
        validate_ocean(ocean)
    assert str(caught.value) == f"ocean: {str(findings.wrong[0]).removeprefix('wrong: ')}"
    as_stored(findings)


def test_everything_is_listed_not_only_the_first(healthy, as_stored):
    ocean = spoil(healthy, POINT, salinity=400.0).isel(lat=SOUTHWARD).drop_vars("water_v")
    del ocean.attrs["title"]
    assert kinds(check_ocean(ocean)) == [
        "axis not monotone",
        "values",
        "variable missing",
        "attributes missing",
    ]
    as_stored(ocean)


def test_unreadable_files_are_reported_in_full_in_their_units(healthy, tmp_path, as_stored):
    """
    Temperature in K and currents in cm/s are no fault; a salt spike and a gale in the water are.
    """
    steps = healthy.expand_dims("time").transpose("time", "depth", "lat", "lon")
    for name, factor, offset, unit in (
        ("water_temp", 1, 273.15, "K"),
        ("water_u", 100, 0, "cm s-1"),
    ):
        steps[name] = (factor * steps[name] + offset).assign_attrs(
            healthy[name].attrs | {"units": unit}
        )
    steps.to_netcdf(tmp_path / "good.nc")
    assert check_ocean(tmp_path / "good.nc").ok
    spoil(steps, (0, *POINT), salinity=400.0, water_u=9900.0).to_netcdf(tmp_path / "bad.nc")
    findings = check_ocean(tmp_path / "bad.nc")
    assert [(f.what, f.where) for f in findings] == [("values", "salinity"), ("values", "water_u")]
    assert findings.wrong[1].value.endswith("to 99")
    assert kinds(check_ocean(tmp_path / "missing.nc").wrong) == ["cannot be opened"]
    as_stored(findings)


def test_sound_speed_outside_the_sea_s_is_wrong(healthy, as_stored):
    findings = check_ocean(spoil(healthy, (36, 11, 23), water_temp=45.0, salinity=50.0))
    speed = findings.named("sound speed")
    assert speed in findings.wrong
    assert speed.value.startswith("1 of ")
    assert "2500 m" in speed.where
    assert "1400 to 1600 m/s" in speed.allowed
    as_stored(findings)


def lone_pit(ocean):
    """Everything dry below level 30 but one column."""
    column = {n: ocean[n].values[30:, 7, 9].copy() for n in ocean.data_vars}
    return spoil(mask(ocean, slice(30, None)), (slice(30, None), 7, 9), **column)


def carried_up(ocean):
    return spoil(ocean, 0, **{n: ocean[n].values[1] for n in ("water_temp", "salinity")})


DOUBTFUL = {
    "density inversions": lambda o: spoil(o, (20, 4, 4), salinity=30.0),
    "below freezing": lambda o: spoil(o, (5, 11, 23), salinity=10.0, water_temp=-0.7),
    "isolated wet points": lone_pit,
    "land of one point": lambda o: mask(o, (slice(None), 8, 8)),
    "spikes": lambda o: spoil(o, (10, 4, 4), water_temp=8.0),
    "jumps between neighbours": lambda o: spoil(
        o, (10, slice(None), slice(30, None)), water_temp=16.0
    ),
    "jumps between levels": lambda o: spoil(o, (3, 4, 4), water_temp=20.0),
    "few levels": lambda o: o.isel(depth=[0, 5, 10, 23, 33]),
    "first level carried up": carried_up,
    "currents at rest": lambda o: o.assign({n: 0.0 * o[n] for n in ("water_u", "water_v")}),
    "made up": lambda o: o.assign_attrs(synthetic=1),
    "changed": lambda o: o.assign_attrs(
        history="read\nextended below 1000 m by the deepest sample"
    ),
    "coarse grid": lambda o: o.isel(lat=slice(None, None, 4), lon=slice(None, None, 4)),
}


@pytest.mark.parametrize("what", DOUBTFUL)
def test_what_is_doubtful_is_found(healthy, what, as_stored):
    findings = check_ocean(DOUBTFUL[what](healthy))
    assert what in kinds(findings.doubtful), [str(f) for f in findings]
    assert findings.ok, [str(f) for f in findings.wrong]
    as_stored(findings)


def test_inversions_are_counted_placed_and_measured(healthy, as_stored):
    """
    Salinity lower by d in one point: density falls by about 0.79 d there against the level above.
    """
    fall = float(healthy["salinity"].values[19, 4, 4]) - 30.0
    finding = check_ocean(spoil(healthy, (20, 4, 4), salinity=30.0)).named("density inversions")
    assert finding.value.startswith("1 of ")
    assert "between {:g} and {:g} m".format(*healthy["depth"].values[19:21]) in finding.value
    size = float(finding.value.split("the largest ")[1].split(" kg")[0])
    assert size == pytest.approx(0.79 * fall, rel=0.1)
    as_stored(finding)


def test_water_below_its_freezing_point_is_measured(healthy, as_stored):
    """
    A salinity of 24.2 freezes at -1.312 degC at the surface (gsw), 0.00075 K lower a metre down.
    """
    depth = float(healthy["depth"].values[5])
    finding = check_ocean(spoil(healthy, POINT, salinity=24.2, water_temp=-1.5)).named(
        "below freezing"
    )
    assert finding.value.startswith("water below its freezing point at 1 points")
    size = float(finding.value.split("the largest ")[1].split(" K")[0])
    assert size == pytest.approx(0.188 - 0.00075 * depth, abs=0.002)
    assert "salinity or temperature is too low" in str(finding)
    assert check_ocean(spoil(healthy, POINT, water_temp=-1.33)).named("below freezing") is None
    as_stored(finding)


def test_the_domain_and_the_fleet_must_fit(healthy, as_stored):
    assert check_ocean(healthy, half_extent=(40e3, 30e3)).ok
    for options in ({"half_extent": (400e3, 30e3)}, {"centre": (10.0, 0.0)}):
        assert kinds(check_ocean(healthy, **options).wrong) == ["coverage"]
    fleet = {
        "A": np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 500.0]]),
        "on the edge": np.array([[40e3 + 5e-7, 0.0, 0.5]]),  # but for rounding
        "B": np.array([[50e3, 0.0, 0.5]]),
        "C": np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 4_500.0]]),
        "D": np.array([[0.0, 0.0, 4_500.0]]),
    }
    findings = check_ocean(healthy, half_extent=(40e3, 30e3), fleet=fleet)
    assert [(f.severity, f.what, f.where) for f in findings] == [
        ("wrong", "coverage", "vehicle B"),
        ("wrong", "sea bed above the vehicle", "vehicle C"),
        ("wrong", "sea bed above the vehicle", "vehicle D"),
    ]
    fleet["E"] = np.array([[0.0, 0.0, 0.5], [50e3, 0.0, 0.5]])
    findings = check_ocean(
        healthy, half_extent=(40e3, 30e3), fleet=fleet, existing_trajectories=True
    )
    assert [(f.severity, f.where) for f in findings] == [
        ("wrong", "vehicle B"),  # no pose of it in the ocean
        ("doubtful", "vehicle C"),
        ("doubtful", "vehicle D"),
        ("doubtful", "vehicle E"),
    ]
    as_stored(findings)


@pytest.mark.parametrize("own_floor", [False, True])
def test_the_check_refuses_whom_the_simulation_refuses(fram_strait, own_floor, as_stored):
    """
    Both ask the bed on the domain's grid; between nodes of this ocean, 13 km apart, it is up to 240
    m from the ocean's own.
    """
    rng = np.random.default_rng(17)
    coarse = fram_strait.isel(lat=slice(20, 50, 3), lon=slice(40, 100, 3))
    half, floor = (25e3, 20e3), None
    if own_floor:
        lat, lon = (np.linspace(*coarse[axis].values[[0, -1]], 240) for axis in ("lat", "lon"))
        rough = rng.uniform(1500.0, 2500.0, (lat.size, lon.size))
        floor = xr.DataArray(rough, {"lat": lat, "lon": lon}, ("lat", "lon"))
    local = to_local(coarse, half_extent=half, sea_floor=floor)
    axes = local["sea_floor_depth"].dims
    bed = linear_interpolator(
        [local[name].values for name in axes], local["sea_floor_depth"].values
    )
    plan, vehicles = {}, []
    for n, (north, east) in enumerate(rng.uniform(-1.0, 1.0, (60, 2)) * half):
        deep = bed([north, east]).item() + rng.choice([-1.0, -1e-3, 0.0, 1e-3, 1.0])
        plan[f"V{n}"] = np.array([[north, east, deep]])
        vehicles.append(Vehicle(f"V{n}", plan[f"V{n}"][0], StationKeeping(deep)))
    refused = [str(error).split("'")[1] for error in fleet_refusals(vehicles, local, 0.1)]
    assert 10 < len(refused) < 50
    findings = check_ocean(coarse, half_extent=half, fleet=plan, sea_floor=floor)
    assert [f.where.removeprefix("vehicle ") for f in findings.wrong] == refused
    as_stored(findings)


def test_a_finer_sea_floor_decides_for_the_fleet(healthy):
    lat, lon = np.arange(76.9, 79.0, 0.01), np.arange(-4.0, 4.0, 0.02)
    shoal = xr.DataArray(
        np.full((lat.size, lon.size), 300.0), {"lat": lat, "lon": lon}, ("lat", "lon")
    )
    domain = {
        "half_extent": (40e3, 30e3),
        "fleet": {"A": np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 500.0]])},
    }
    findings = check_ocean(healthy, **domain, sea_floor=shoal)
    assert kinds(findings) == ["sea bed above the vehicle"]
    small = check_ocean(healthy, **domain, sea_floor=shoal.isel(lat=slice(100, 110)))
    assert kinds(small.wrong) == ["sea floor"]


def test_the_projection_s_error_is_that_of_the_domain_s_corner(beaufort_sea, as_stored):
    every = slice(None, None, 5)
    shallow = beaufort_sea.isel(depth=slice(0, 4), lat=every, lon=every)
    findings = check_ocean(shallow)
    assert findings.named("projection error") is None, "0.0007 at the corners of the paper's region"
    finding = check_ocean(shallow.assign_coords(lon=2.0 * shallow["lon"] + 140.0)).named(
        "projection error"
    )
    share = float(finding.value.split("up to ")[1].split(" m")[0])
    assert 1.0 < share < 4.0  # m in 1 km: (half-width 560 km / 2 R) squared is 1.9e-3
    as_stored(findings)


def test_a_data_set_of_a_model_is_checked_as_it_is_opened(healthy):
    raw = healthy.transpose("lon", "depth", "lat").isel(lat=SOUTHWARD)
    raw.attrs = {"source": "a model"}
    findings = check_ocean(raw)
    assert findings.ok
    assert findings.named("made up") is None
    refusal = check_ocean(raw.drop_vars("salinity"))
    assert kinds(refusal.wrong) == ["cannot be opened"]

"""Each defect put into a healthy ocean is findings, named and placed; a healthy one gives no finding."""

import dataclasses

import numpy as np
import pytest
import xarray as xr

from pymantaray.errors import OceanError
from pymantaray.ocean import check_ocean, synthetic_ocean, validate_ocean


@pytest.fixture
def healthy(fram_strait):
    """A window of the Fram Strait that claims to be real; its own copy."""
    part = fram_strait.isel(lat=slice(20, 50), lon=slice(90, 150)).copy(deep=True)
    part.attrs["synthetic"] = 0
    return part


def kinds(findings, severity):
    return [f.what for f in findings if f.severity == severity]


def test_a_healthy_ocean_gives_no_finding(healthy):
    findings = check_ocean(healthy)
    assert [str(f) for f in findings] == []
    assert findings.ok


def test_real_files_have_nothing_wrong(gulf_stream_files):
    findings = check_ocean(gulf_stream_files)
    assert findings.ok
    inversions = findings.named("density inversions")
    assert "1345 of 16345 pairs" in inversions.value
    assert "8 and 10 m" in inversions.value


def spoil(ocean, name, value, where):
    ocean[name].values[where] = value
    return ocean


POINT = (5, 11, 23)
WRONG = {
    "units of temperature": (
        lambda o: o.assign(water_temp=(o["water_temp"] + 273.15).assign_attrs(units="K")),
        {("units", "water_temp"), ("values", "water_temp")},
    ),
    "falling latitude": (lambda o: o.isel(lat=slice(None, None, -1)), {("axis not monotone", "lat")}),
    "depth does not start at 0": (lambda o: o.isel(depth=slice(1, None)), {("axis", "depth")}),
    "depth in centimetres": (
        lambda o: o.assign_coords(depth=(100.0 * o["depth"]).assign_attrs(units="cm")),
        {("units", "depth")},
    ),
    "no salinity": (lambda o: o.drop_vars("salinity"), {("variable missing", "salinity")}),
    "hole in salinity": (
        lambda o: spoil(o, "salinity", np.nan, POINT),
        {("NaN islands", "salinity 77.76 N, 0.4 W, 10 m")},
    ),
    "bubble": (
        lambda o: [spoil(o, n, np.nan, POINT) for n in o.data_vars][-1],
        {("NaN islands", "water_temp 77.76 N, 0.4 W, 12 m")},
    ),
    "two times": (
        lambda o: o.drop_vars("time").assign_coords(
            time=("time", np.array(["2020-01-01", "2020-01-02"], "M8[ns]"))
        ),
        {("axis", "time")},
    ),
    "infinite": (lambda o: spoil(o, "water_u", np.inf, POINT), {("not finite", "water_u")}),
    "transposed": (
        lambda o: o.transpose("lat", "lon", "depth"),
        {("dimensions", n) for n in ("water_temp", "salinity", "water_u", "water_v")},
    ),
    "no title": (lambda o: o.assign_attrs(synthetic=2), {("attribute", "synthetic")}),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_found_and_agrees_with_the_schema(healthy, name):
    change, expected = WRONG[name]
    ocean = change(healthy)
    findings = check_ocean(ocean)
    here = {(f.what, f.where) for f in findings.wrong}
    assert expected <= here, [str(f) for f in findings]
    assert not findings.ok
    for finding in findings:
        assert "\n" not in str(finding)
    if not name.startswith(("units", "depth in")):  # the schema does not read units
        with pytest.raises(OceanError):
            validate_ocean(ocean)


def test_everything_is_listed_not_only_the_first(healthy):
    ocean = healthy.isel(lat=slice(None, None, -1)).drop_vars("water_v")
    ocean["salinity"].values[3, 4, 5] = 400.0
    del ocean.attrs["title"]
    findings = check_ocean(ocean)
    assert {f.what for f in findings} == {
        "axis not monotone",
        "variable missing",
        "values",
        "attributes missing",
    }


def test_files_that_do_not_open_are_told_in_full_and_in_the_reader_s_units(healthy, tmp_path):
    """Temperature in K and currents in cm/s are no fault; a salt spike and a gale in the water are."""
    steps = healthy.expand_dims("time").transpose("time", "depth", "lat", "lon")
    steps = steps.assign(water_temp=steps["water_temp"] + 273.15)
    for name in ("water_u", "water_v"):
        steps[name] = (100.0 * steps[name]).assign_attrs(healthy[name].attrs | {"units": "cm s-1"})
    steps["water_temp"].attrs = healthy["water_temp"].attrs | {"units": "K"}
    steps.to_netcdf(tmp_path / "good.nc")
    assert check_ocean(tmp_path / "good.nc").ok
    steps["salinity"].values[0, 3, 4, 5] = 400.0
    steps["water_u"].values[0, 3, 4, 5] = 9900.0
    steps.to_netcdf(tmp_path / "bad.nc")
    findings = check_ocean(tmp_path / "bad.nc")
    assert [(f.what, f.where) for f in findings] == [("values", "salinity"), ("values", "water_u")]
    assert findings.wrong[1].value.endswith("to 99")
    assert kinds(check_ocean(tmp_path / "missing.nc"), "wrong") == ["cannot be opened"]


def test_sound_speed_outside_the_sea_s_is_wrong(healthy):
    ocean = spoil(healthy, "water_temp", 45.0, (36, 11, 23))
    ocean = spoil(ocean, "salinity", 50.0, (36, 11, 23))
    findings = check_ocean(ocean)
    speed = next(f for f in findings.wrong if f.what == "sound speed")
    assert speed.value.startswith("1 of ")
    assert "2500 m" in speed.where
    assert "1400 to 1600 m/s" in speed.allowed


def level_with(ocean, depth_index, change):
    for name in ("water_temp", "salinity"):
        ocean[name].values[depth_index] = change(ocean[name].values, depth_index)
    return ocean


def mask(ocean, where):
    for name in ocean.data_vars:
        ocean[name].values[where] = np.nan
    return ocean


def lone_pit(ocean):
    """Everything dry below level 30 but one column."""
    kept = {n: ocean[n].values[30:, 7, 9].copy() for n in ocean.data_vars}
    mask(ocean, slice(30, None))
    for name, column in kept.items():
        ocean[name].values[30:, 7, 9] = column
    return ocean


DOUBTFUL = {
    "density inversions": lambda o: spoil(o, "salinity", 30.0, (20, 4, 4)),
    "isolated wet points": lone_pit,
    "land of one point": lambda o: mask(o, (slice(None), 8, 8)),
    "spikes": lambda o: spoil(o, "water_temp", 8.0, (10, 4, 4)),
    "jumps between neighbours": lambda o: spoil(o, "water_temp", 16.0, (10, slice(None), slice(30, None))),
    "jumps between levels": lambda o: spoil(o, "water_temp", 20.0, (3, 4, 4)),
    "few levels": lambda o: o.isel(depth=[0, 5, 10, 23, 33]),
    "first level carried up": lambda o: level_with(o, 0, lambda values, k: values[k + 1]),
    "currents at rest": lambda o: o.assign({n: 0.0 * o[n] for n in ("water_u", "water_v")}),
    "made up": lambda o: o.assign_attrs(synthetic=1),
    "changed": lambda o: o.assign_attrs(history="read\nextended below 1000 m by the deepest sample"),
    "coarse grid": lambda o: o.isel(lat=slice(None, None, 4), lon=slice(None, None, 4)),
}


@pytest.mark.parametrize("what", DOUBTFUL)
def test_what_is_doubtful_is_found(healthy, what):
    findings = check_ocean(DOUBTFUL[what](healthy))
    assert what in kinds(findings, "doubtful"), [str(f) for f in findings]
    assert findings.ok, [str(f) for f in findings.wrong]


def test_inversions_are_counted_placed_and_measured(healthy):
    """Salinity lower by d in one point: density falls by about 0.79 d there against the level above."""
    above = float(healthy["salinity"].values[19, 4, 4])
    below = float(healthy["salinity"].values[20, 4, 4])
    ocean = spoil(healthy, "salinity", 30.0, (20, 4, 4))
    finding = check_ocean(ocean).named("density inversions")
    assert finding.value.startswith("1 of ")
    assert "between 100 and 125 m" in finding.value or "between 90 and 100 m" in finding.value
    size = float(finding.value.split("the largest ")[1].split(" kg")[0])
    assert size == pytest.approx(0.79 * (above - 30.0), rel=0.1), below


def test_the_domain_and_the_fleet_must_fit(healthy):
    assert check_ocean(healthy, half_extent=(40e3, 30e3)).ok
    large = check_ocean(healthy, half_extent=(400e3, 30e3)).wrong
    assert [f.what for f in large] == ["coverage"]
    assert "km fits" in large[0].allowed
    away = check_ocean(healthy, centre=(10.0, 0.0)).wrong
    assert [f.what for f in away] == ["coverage"]
    fleet = {
        "A": np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 500.0]]),
        "B": np.array([[50e3, 0.0, 0.5]]),
        "C": np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 4_500.0]]),
        "D": np.array([[0.0, 0.0, 4_500.0]]),
    }
    findings = check_ocean(healthy, half_extent=(40e3, 30e3), fleet=fleet)
    assert {(f.what, f.where) for f in findings.wrong} == {
        ("coverage", "vehicle B"),
        ("sea bed above the vehicle", "vehicle D"),
    }
    assert {(f.what, f.where) for f in findings.doubtful} == {("sea bed above the vehicle", "vehicle C")}


def test_a_finer_sea_floor_decides_for_the_fleet(healthy):
    lat, lon = np.arange(76.9, 79.0, 0.01), np.arange(-4.0, 4.0, 0.02)
    shoal = xr.DataArray(
        np.full((lat.size, lon.size), 300.0), coords={"lat": lat, "lon": lon}, dims=("lat", "lon")
    )
    plan = {"A": np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 500.0]])}
    plan["on the edge"] = np.array([[40e3 + 5e-7, 0.0, 0.5]])  # but for rounding
    findings = check_ocean(healthy, half_extent=(40e3, 30e3), fleet=plan, sea_floor=shoal)
    assert kinds(findings, "doubtful") == ["sea bed above the vehicle"]
    small = shoal.isel(lat=slice(100, 110))
    assert kinds(check_ocean(healthy, half_extent=(40e3, 30e3), sea_floor=small), "wrong") == ["sea floor"]


def test_the_projection_s_error_is_that_of_the_domain_s_corner():
    whole = synthetic_ocean("beaufort")
    assert check_ocean(whole).named("projection error") is None, "0.0007 at the corners of the paper's region"
    wide = whole.assign_coords(lon=-140.0 + 2.0 * (whole["lon"] + 140.0))
    finding = check_ocean(wide).named("projection error")
    share = float(finding.value.split("up to ")[1].split(" m")[0])
    assert 1.0 < share < 4.0  # m in 1 km: (half-width 560 km / 2 R) squared is 1.9e-3


def test_findings_are_values():
    finding = check_ocean("/nowhere.nc").wrong[0]
    with pytest.raises(dataclasses.FrozenInstanceError):
        finding.what = "else"
    assert check_ocean("/nowhere.nc").named("nothing of the kind") is None

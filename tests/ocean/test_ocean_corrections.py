"""
Oceans corrected by casts: the closed forms of one and two, the limits, and the duct that the grid
lacks.
"""

import re
from dataclasses import replace

import numpy as np
import pytest

from pymantaray.errors import OceanError
from pymantaray.geometry import LocalFrame
from pymantaray.ocean import validate_ocean
from pymantaray.ocean.casts import Cast, cast_ocean, read_cast
from pymantaray.ocean.corrections import INVERSION, column_at, correct_with_casts
from pymantaray.ocean.seawater import density_fall, sound_speed
from pymantaray.ocean.synthetic import HYCOM_DEPTHS

LEVELS = np.array([0.0, 20.0, 50.0, 100.0, 200.0, 400.0])
DAY = 86_400.0


@pytest.fixture(scope="module")
def background(closed_form_ocean):
    return closed_form_ocean(
        74.5,
        -140.0,
        temperature=lambda z, lat, lon: 1.0 - 0.005 * z + 0.1 * (lat - 74.5) + 0.02 * (lon + 140.0),
        salinity=lambda z, _lat, _lon: 30.0 + 0.01 * z,
        floor=lambda lat, _lon: 300.0 + 200.0 * (lat > 74.5),
        n=(41, 61),
        depth=LEVELS,
    )


def cast_at(lat, lon, warmer, saltier=0.0, *, deepest=400.0, name="c", time="2020-01-01"):
    """
    A cast that is the background at its place plus constants; sampled at the edges of the levels'
    cells.
    """
    z = np.linspace(0.0, deepest, 2001)
    t = 1.0 - 0.005 * z + 0.1 * (lat - 74.5) + 0.02 * (lon + 140.0)
    return Cast(name, lat, lon, np.datetime64(time), z, t + warmer, 30.0 + 0.01 * z + saltier)


def increment(ocean, corrected, name="water_temp"):
    return corrected[name].values - ocean[name].values


def own_difference(ocean, cast):
    """
    Of a cast from the background at each level: the constant plus what averaging over uneven cells
    adds.
    """
    return np.stack(cast.cell_means(LEVELS), axis=-1) - column_at(
        ocean, cast.lat, cast.lon, cast.name
    )


def squared_distance(ocean, cast):
    frame = LocalFrame(74.5, -140.0)
    north, east = frame.to_local(ocean["lat"].values[:, None], ocean["lon"].values[None])
    n, e = frame.to_local(cast.lat, cast.lon)
    return (north - n) ** 2, (east - e) ** 2


@pytest.mark.parametrize("noise_ratio", [1e-9, 0.25, 1e12], ids=["exact", "noisy", "worthless"])
def test_one_cast_is_the_closed_form(background, noise_ratio, as_stored):
    off = 0.0 if noise_ratio < 1e-6 else 0.013  # degrees, from a grid point
    cast = cast_at(
        float(background["lat"][28]) + off, float(background["lon"][33]) + off, 0.5, -0.2
    )
    corrected = correct_with_casts(
        background, [cast], horizontal_scale=(20e3, 30e3), noise_ratio=noise_ratio
    )
    north, east = squared_distance(background, cast)
    weight = np.exp(-0.5 * (north / 20e3**2 + east / 30e3**2)) / (1.0 + noise_ratio)
    d = own_difference(background, cast)
    assert abs(d[1, 0] - 0.5) < 0.2  # the constant dominates
    for k, name in enumerate(("water_temp", "salinity")):
        change = increment(background, corrected, name)
        expected = np.where(np.isfinite(change), d[:, k, None, None] * weight, np.nan)
        np.testing.assert_allclose(change, expected, rtol=0, atol=1e-12)
        if not off:  # the field passes through the cast
            column = corrected[name].values[:, 28, 33]
            np.testing.assert_allclose(column, cast.cell_means(LEVELS)[k], rtol=0, atol=1e-8)
    for name in ("water_u", "water_v"):
        np.testing.assert_array_equal(corrected[name], background[name])
    as_stored(cast)


@pytest.mark.parametrize("apart", [0.2, 0.0], ids=["apart", "at one place"])
def test_two_casts_are_the_closed_form(background, apart, as_stored):
    casts = [
        cast_at(74.6, -140.1, 0.5, name="a"),
        cast_at(74.6 + 0.3 * apart, -140.1 + apart, -0.3, name="b"),
    ]
    L, r = 25e3, 0.1
    corrected = correct_with_casts(background, casts, horizontal_scale=L, noise_ratio=r)
    squares = [sum(squared_distance(background, c)) for c in casts]
    frame = LocalFrame(74.5, -140.0)
    x = np.array([frame.to_local(c.lat, c.lon) for c in casts])
    rho = np.exp(-0.5 * np.sum((x[0] - x[1]) ** 2) / L**2)
    da, db = (own_difference(background, c)[:, 0, None, None] for c in casts)
    ga, gb = (np.exp(-0.5 * s / L**2) for s in squares)
    det = (1.0 + r) ** 2 - rho**2
    expected = (ga * ((1.0 + r) * da - rho * db) + gb * ((1.0 + r) * db - rho * da)) / det
    change = increment(background, corrected)
    wet = np.isfinite(change)
    np.testing.assert_allclose(
        change[wet], np.broadcast_to(expected, change.shape)[wet], rtol=0, atol=1e-12
    )
    as_stored(corrected)


def test_below_the_deepest_sample_the_difference_decays(background, as_stored):
    cast = cast_at(74.6, -140.0, 0.5, deepest=100.0)
    corrected = correct_with_casts(background, [cast], horizontal_scale=50e3, vertical_scale=150.0)
    i, j = np.argmin(np.abs(background["lat"].values - 74.6)), 30
    found = increment(background, corrected)[:, i, j]
    expected = found[3] * np.exp(-0.5 * (np.array([100.0, 300.0]) / 150.0) ** 2)
    np.testing.assert_allclose(found[4:], expected, rtol=1e-12)
    as_stored(cast)


def test_a_cast_of_another_day_counts_less(background):
    options = {"horizontal_scale": 20e3, "time_scale": 2.0 * DAY}
    today, then = (
        increment(
            background,
            correct_with_casts(background, [cast_at(74.6, -140.0, 0.5, time=t)], **options),
        )
        for t in ("2020-01-01", "2020-01-04")
    )
    wet = np.isfinite(today)
    np.testing.assert_allclose(
        then[wet], np.exp(-0.5 * (3.0 / 2.0) ** 2) * today[wet], rtol=1e-12, atol=1e-15
    )


def test_inversions_are_counted_and_told(background):
    assert not (density_fall(background) > INVERSION).any()
    light = cast_at(74.6, -140.0, 0.0, -8.0, deepest=400.0)
    upper = replace(
        light, salinity=light.salinity + np.where(light.depth < 30.0, 16.0, 8.0)
    )  # salty cap
    corrected = correct_with_casts(background, [upper], horizontal_scale=10e3)
    count = int(np.count_nonzero(density_fall(corrected) > INVERSION))
    assert count > 3
    assert re.search(
        rf"^{count} new density inversions .* due to the casts \(0 before\)",
        corrected.attrs["history"],
        re.MULTILINE,
    )
    validate_ocean(corrected)


GOOD = {"casts": [cast_at(74.6, -140.0, 0.5)], "horizontal_scale": 1e4}


@pytest.mark.parametrize(("change", "message"), [
    ({"casts": [cast_at(80.0, -140.0, 0.5)]}, "cast c: 80 N, 140 W is outside the ocean"),
    ({"casts": [cast_at(74.5, -140.0, 0.5)], "land": True},
     "is on land in the ocean; remove the cast"),
    ({"casts": []}, "no cast; give"),
    ({"horizontal_scale": 0.0}, "horizontal_scale is 0; it must be positive"),
    ({"noise_ratio": -1.0}, "noise_ratio is -1; it must be positive"),
    ({"vertical_scale": 0.0}, "vertical_scale is 0; it must be positive"),
    ({"casts": [replace(GOOD["casts"][0], time=np.datetime64("NaT", "us"))], "time_scale": DAY},
     "its time is unknown"),
])  # fmt: skip
def test_casts_that_cannot_be_used_are_refused(background, change, message):
    options = GOOD | change
    if options.pop("land", False):
        background = background.where(background["lat"] > 74.7).assign_attrs(background.attrs)
    with pytest.raises(OceanError, match=message):
        correct_with_casts(background, **options)


def speed_at(ocean, cast):
    """Sound speed of an ocean below a cast's place, at the ocean's levels."""
    t, s = column_at(ocean, cast.lat, cast.lon, cast.name).T
    return sound_speed(t, s, ocean["depth"].values, cast.lat, cast.lon)


def duct(ocean, cast):
    """
    Depth and speed of the warm layer's maximum below a cast's place, and of the minimum beneath it.
    """
    z, c = ocean["depth"].values, speed_at(ocean, cast)
    warm, cold = (z >= 40.0) & (z <= 70.0), (z >= 90.0) & (z <= 160.0)
    return z[warm][c[warm].argmax()], c[warm].max(), z[cold][c[cold].argmin()], c[cold].min()


def assert_duct(ocean, cast):
    """As the casts of July 2014 have it."""
    where_warm, warm, where_cold, cold = duct(ocean, cast)
    assert 1444.0 < warm < 1447.0
    assert 45.0 <= where_warm <= 60.0
    assert 100.0 <= where_cold <= 150.0
    assert 3.0 < warm - cold < 4.5


@pytest.fixture
def real_casts(shared_data):
    return [
        read_cast(shared_data / "casts" / f"beaufort_axctd_20140724_{n}N140W.csv") for n in (74, 75)
    ]


def test_the_casts_sharpen_the_warm_layer_of_the_beaufort_sea(real_casts, beaufort_sea, as_stored):
    corrected = correct_with_casts(
        beaufort_sea, real_casts, horizontal_scale=30e3, noise_ratio=0.01
    )
    z = beaufort_sea["depth"].values
    upper = z <= 300.0
    for cast in real_casts:
        truth = sound_speed(*cast.cell_means(z), z, cast.lat, cast.lon)
        before, after = (
            np.abs(speed_at(o, cast) - truth)[upper] for o in (beaufort_sea, corrected)
        )
        assert before.max() > 0.5
        assert after[1:].max() < 0.1
        assert_duct(corrected, cast)
    change = corrected["water_temp"] - beaufort_sea["water_temp"]
    assert float(np.abs(change).interp(lat=74.5, lon=-148.0).max()) < 1e-9
    assert "0 new density inversions" in corrected.attrs["history"]
    as_stored(cast)


def test_the_warm_layer_that_hycom_lacks_is_put_back(shared_data, real_casts, as_stored):
    """HYCOM's own column, carried to the casts' place: no duct before, the casts' duct after."""
    point = read_cast(next((shared_data / "hycom").glob("*point_ncss.csv")))
    there = replace(point, lat=74.5, lon=-140.0, time=np.datetime64("2014-07-24"))
    levels = [z for z in HYCOM_DEPTHS if z <= 3000.0]
    hycom = cast_ocean(there, bathymetry=3000.0, half_extent=(120e3, 120e3), levels=levels)
    _, warm, _, cold = duct(hycom, real_casts[0])
    assert warm < 1442.5
    assert warm - cold < 1.0
    options = {"horizontal_scale": 50e3, "noise_ratio": 0.01, "vertical_scale": 300.0}
    corrected = correct_with_casts(hycom, real_casts, **options)
    for cast in real_casts:
        assert_duct(corrected, cast)
    as_stored(cast)

"""
Rough ice in studies, for existing trajectories and in the service: the same ice everywhere, other
ice in other draws.
"""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from pymantaray.acoustics import BoundarySurface, Medium, find_eigenrays
from pymantaray.apps.ranges import measure
from pymantaray.apps.service import RangingService
from pymantaray.errors import StudyError
from pymantaray.geometry.roughness import Roughness
from pymantaray.records import RayStatus
from pymantaray.sensing import PingList
from pymantaray.sensing.draws import RangingDraws

DEPTH = np.array([0.0, 40.0, 55.0, 60.0, 65.0, 80.0, 100.0, 150.0, 300.0, 1000.0, 2700.0])
SPEED = np.array(
    [1436.0, 1436.6, 1440.0, 1443.0, 1440.0, 1437.5, 1437.6, 1445.0, 1455.0, 1465.0, 1490.0]
)
BOUNCES = {"max_surface_bounces": 3}
ROUGH = {"ice_slope_deg": 0.5, "ice_length": 20.0}


@pytest.fixture(scope="module")
def sea(tmp_path_factory):
    """Section [ocean] with a cast, and a file with ice that is 1 m thicker."""
    folder = tmp_path_factory.mktemp("sea")
    pd.DataFrame({"depth": DEPTH, "sound_speed": SPEED}).to_csv(folder / "cast.csv", index=False)
    lat, lon = np.linspace(74.0, 75.0, 41), np.linspace(-142.0, -138.0, 41)
    draft = (
        ("lat", "lon"),
        np.full((41, 41), 2.5),
        {"standard_name": "sea_ice_draft", "units": "m"},
    )
    axes = {
        "lat": ("lat", lat, {"standard_name": "latitude", "units": "degrees_north"}),
        "lon": ("lon", lon, {"standard_name": "longitude", "units": "degrees_east"}),
    }
    xr.Dataset({"ice": draft}, coords=axes).to_netcdf(folder / "ice.nc")
    ocean = {
        "source": str(folder / "cast.csv"),
        "bathymetry": 2700.0,
        "ice": 1.5,
        "currents": "rest",
    }
    return ocean, str(folder / "ice.nc")


@pytest.fixture(scope="module")
def fly_under(sea, fly_tiny):
    """Mission of one hour with one ping under ice, and its run."""

    def fly(arrival="direct", **ice):
        acoustics = BOUNCES | {"arrival": arrival}
        return fly_tiny(ocean=sea[0] | ice, mission={"duration_h": 1.0}, acoustics=acoustics)

    return fly


@pytest.fixture(scope="module")
def rough(fly_under):
    return fly_under(**ROUGH)


def times_of(flown):
    return flown[1].ranging_truth.travel_time


def places_of(flown):
    """Positions of both ends of each range. [m]"""
    truth, m = flown[0].truth, flown[0].measurements
    marks = np.broadcast_to(
        m.landmark_position[:, None], (m.landmark_name.size, truth.time.size, 3)
    )
    everyone = np.concatenate([truth.position, marks])
    return tuple(everyone[who, m.range_sample] for who in (m.range_transmitter, m.range_receiver))


def test_ranges_of_a_study_are_first_arrivals_under_its_draw_of_ice(rough, as_stored):
    """The medium is built here by hand."""
    source, receiver = places_of(rough)
    ice = BoundarySurface(1.5, roughness=Roughness(np.radians(0.5), 20.0, draw=0))
    medium = Medium.from_profile(DEPTH, SPEED, bottom_depth=2700.0, ice_draft=ice)
    arrivals = find_eigenrays(medium, source, receiver, 3)
    assert np.count_nonzero(arrivals.surface_bounces) >= 3
    np.testing.assert_allclose(times_of(rough), arrivals.first().travel_time, rtol=1e-9)
    as_stored({"arrivals": rough[0].arrivals, "picture": rough[0].picture})


def test_another_draw_is_other_ice_and_the_same_draw_the_same(rough, fly_under):
    again, other, smooth = fly_under(**ROUGH), fly_under(**ROUGH, ice_draw=1), fly_under()
    np.testing.assert_array_equal(times_of(again), times_of(rough))
    for flown in (other, smooth):
        apart = np.abs(times_of(flown) - times_of(rough))
        assert (np.isnan(apart) | (apart > 1e-7)).any()
        assert (apart == 0.0).any(), "direct arrivals do not meet the ice"
    np.testing.assert_array_equal(other[0].truth.position, rough[0].truth.position)


def test_a_realization_has_the_ranges_of_its_draw(tiny_run):
    """The second draw is a millisecond later, and its first attempt is not heard."""
    noise, truth, status = (
        tiny_run.noise,
        tiny_run.ranging_truth,
        tiny_run.measurements.range_status,
    )
    two = {
        name: np.tile(getattr(truth, name), (2, 1))
        for name in ("travel_time", "near_cutoff", "departure_angle", "arrival_angle")
    }
    two["travel_time"][1] += 1e-3
    lost = np.tile(status, (2, 1))
    first = np.flatnonzero(status == RayStatus.OK)[0]
    lost[1, first] = RayStatus.SHADOW
    own = noise._replace(
        draws=RangingDraws(range_status=lost, probability=np.ones(lost.shape), **two)
    )
    assert own.ranging_truth_in(None) is truth
    np.testing.assert_array_equal(own.ranging_truth_in(1).travel_time, two["travel_time"][1])
    for realization in (0, 1):
        found, plain = (source.noisy(realization) for source in (own, noise))
        np.testing.assert_array_equal(found.range_status, lost[realization])
        later = own.ranging_truth_in(realization).refracted_range - truth.refracted_range
        heard = found.range_status == RayStatus.OK
        moved = (found.refracted_range - plain.refracted_range)[heard]
        np.testing.assert_allclose(moved, later[heard], rtol=0, atol=1e-6)
    faint = np.ones(lost.shape)
    faint[1] = 0.0
    modem = own._replace(probability=faint[0], draws=replace(own.draws, probability=faint))
    np.testing.assert_array_equal(modem.noisy(0).range_status, lost[0])
    assert not (modem.noisy(1).range_status == RayStatus.OK).any()


@pytest.mark.slow
def test_a_file_of_ice_may_be_rough(rough, fly_under, sea):
    filed, thick = fly_under(**ROUGH, ice=sea[1]), fly_under(**ROUGH, ice=2.5)
    np.testing.assert_allclose(times_of(filed), times_of(thick), rtol=1e-9)
    assert (np.abs(times_of(filed) - times_of(rough)) > 1e-6).any()


@pytest.mark.slow
def test_service_and_existing_trajectories_have_the_ice_of_the_study(rough, sea):
    options = {
        "centre_lat": 74.5,
        "centre_lon": -140.0,
        "half_extent_north": 15e3,
        "half_extent_east": 15e3,
    }
    service = RangingService(sea[0]["source"], **ROUGH, **BOUNCES, ice=1.5, bathymetry=2700.0)
    source, receiver = places_of(rough)
    times = [
        service.ping(0.0, a, [b]).travel_time[0] for a, b in zip(source, receiver, strict=True)
    ]
    np.testing.assert_allclose(times, times_of(rough), rtol=1e-9)
    ranges = measure(rough[0].truth, sea[0] | ROUGH | options, 3600.0, acoustics=BOUNCES)
    own, m = ranges.ranging_truth.travel_time, rough[0].measurements
    vehicles = np.maximum(m.range_transmitter, m.range_receiver) < rough[0].truth.name.size
    assert np.isfinite(own).sum() > 5
    np.testing.assert_allclose(np.sort(own), np.sort(times_of(rough)[vehicles]), rtol=1e-9)


@pytest.mark.slow
def test_each_realization_has_the_ice_of_its_number(fly_under):
    each = fly_under("first", **ROUGH, ice_draw="each")[1]
    assert each.config.study.realizations == 2
    for realization in range(2):
        alone = fly_under("first", **ROUGH, ice_draw=realization)[1]
        own, other = each.noisy_measurements(realization), alone.noisy_measurements(realization)
        for name in ("range_status", "refracted_range", "straight_range", "depth"):
            np.testing.assert_array_equal(getattr(own, name), getattr(other, name))
        true = each.ranging_truth_in(realization)
        np.testing.assert_array_equal(true.travel_time, alone.ranging_truth.travel_time)
        np.testing.assert_array_equal(true.arrival_angle, alone.ranging_truth.arrival_angle)
        assert each.ocean_in(realization).sea_ice_draft.attrs == alone.ocean.sea_ice_draft.attrs
    times = [each.ranging_truth_in(k).travel_time for k in range(2)]
    assert not np.array_equal(*times, equal_nan=True)
    rows = each.tables["ranging_draws"].frame
    assert rows["realization"].tolist() == [0, 1]
    assert rows["mean_m"].iloc[0] != rows["mean_m"].iloc[1]


def test_each_draw_of_the_ice_has_the_pings_of_a_list(sea):
    """A is heard 5 minutes after the start, once for each draw."""
    north = {"A": 0.0, "B": 1500.0}
    poses = pd.DataFrame([(t, k, n) for k, n in north.items() for t in (0.0, 600.0)])
    poses.columns = ["time", "vehicle", "north"]
    steps = []
    run = measure(
        poses.assign(east=0.0, depth=90.0),
        sea[0] | ROUGH | {"ice_draw": "each", "centre_lat": 74.5, "centre_lon": -140.0},
        PingList((300.0,), ("A",)),
        study={"realizations": 2},
        progress=lambda *step: steps.append(step),
    )
    assert [step[1:] for step in steps if step[0] == "rays"] == [(0, 1), (1, 2), (2, 2)]
    times = [run.ranging_truth_in(k).travel_time for k in range(2)]
    np.testing.assert_array_equal(times[0], run.ranging_truth.travel_time)
    np.testing.assert_allclose(times, 1500.0 / 1437.5, rtol=1e-3)
    assert np.shape(times) == (2, 1)
    assert run.tables["ranging_draws"].frame["realization"].tolist() == [0, 1]


@pytest.mark.slow
def test_estimates_under_the_ice_of_realizations_ignore_workers(run_tiny, sea):
    sections = {"mission": {"duration_h": 1.0}, "acoustics": BOUNCES | {"arrival": "first"}}
    ocean = sea[0] | ROUGH
    one, two, frozen = (
        run_tiny(workers, ocean=ocean | {"ice_draw": draw}, **sections)
        for workers, draw in ((1, "each"), (2, "each"), (1, 1))
    )
    np.testing.assert_array_equal(one.estimates.position, two.estimates.position)
    refracted = one.estimates.condition.tolist().index("refracted")
    of_draw = frozen.estimates.position[refracted, 1]
    np.testing.assert_array_equal(one.estimates.position[refracted, 1], of_draw)
    assert (one.estimates.position[refracted, 0] != frozen.estimates.position[refracted, 0]).any()


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        ({"ocean": {"ice_slope_deg": None, "ice_draw": "each"}}, "the ice is smooth"),
        ({"ocean": ROUGH | {"ice_draw": "all"}}, "ice_draw"),
        (
            {
                "ocean": ROUGH | {"ice_draw": "each"},
                "ranging": {"mistaken": "first-detected", "below_strongest_db": 12.0},
            },
            "same ice in all realizations",
        ),
    ],
)
def test_a_draw_for_each_realization_needs_rough_ice_and_no_mistakes(sections, words, sea, tiny):
    ocean = {k: v for k, v in (sea[0] | sections["ocean"]).items() if v is not None}
    with pytest.raises(StudyError, match=words):
        tiny(**sections | {"ocean": ocean})

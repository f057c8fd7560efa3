"""
Ranges ping by ping: those of the solver and of a study to the last digit, from any thread, process
or frame.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields

import numpy as np
import pytest
from factories import assert_same
from oracles import cf_errors
from refusals import refused

from pymantaray.acoustics import Currents, Medium, Sonar, find_eigenrays
from pymantaray.acoustics._kernels.link import solve_links
from pymantaray.acoustics._kernels.paths import trace_arrivals
from pymantaray.apps.service import RangingService
from pymantaray.config import load_sound
from pymantaray.errors import AcousticsError, MantaRayError, ServiceError, WaterError
from pymantaray.geometry import LocalFrame
from pymantaray.ocean import open_ocean, to_local
from pymantaray.records import RayStatus
from pymantaray.records.writing import write_netcdf
from pymantaray.sensing import Detector, ReceptionOptions, TwoWay
from pymantaray.sensing.timing import velocities

STILL = Medium.from_profile(
    [0.0, 2000.0], [1500.0, 1500.0], bottom_depth=2000.0, interpolation="linear"
)
MISSIONS = {
    "as the paper": {},
    "carried by currents, there and back": {
        "acoustics": {"currents": True},
        "ranging": {"timing": "two-way", "turn_around_s": 5.0},
    },
    "reflected and heard by a sonar": {
        "acoustics": {"max_surface_bounces": 1, "surface_loss": "coherent", "arrival": "strongest"},
        "detection": {
            "source_level_db": 165.0,
            "frequency_hz": 25e3,
            "bandwidth_hz": 4e3,
            "wind_speed": 8.0,
        },
    },
}


def same_pings(one, other):
    """Two pings are equal, arrivals and all."""
    assert_same(one, other, but=["arrivals", "receptions"])
    assert_same(one.arrivals, other.arrivals)
    assert_same(one.receptions, other.receptions)


def test_a_ping_is_what_the_solver_finds(service, medium, links, as_stored):
    source, receivers = links(300)
    ping = service.ping(12.5, source, receivers)
    as_stored(ping)
    first = find_eigenrays(medium, np.tile(source, (300, 1)), receivers).first()
    assert set(ping.status) >= {RayStatus.OK, RayStatus.OUTSIDE, RayStatus.SHADOW}
    np.testing.assert_array_equal(ping.status, first.status)
    np.testing.assert_array_equal(ping.travel_time, first.travel_time)
    np.testing.assert_array_equal(ping.arrival_time, 12.5 + first.travel_time)
    np.testing.assert_array_equal(
        ping.refracted_range, first.source_sound_speed * first.travel_time
    )
    np.testing.assert_array_equal(ping.straight_range, np.linalg.norm(receivers - source, axis=1))
    assert np.isnan(ping.level_db).all()
    assert np.isnan(ping.probability).all()


@pytest.mark.parametrize("sections", MISSIONS.values(), ids=MISSIONS)
def test_ping_by_ping_is_what_a_study_measures(fly, sections):
    check_against_study(fly(**sections))


@pytest.mark.slow
def test_ping_by_ping_in_water_that_varies_is_what_a_study_measures(varying, in_varying):
    check_against_study(varying, in_varying)
    assert np.isin([RayStatus.OK, RayStatus.SCATTERED], varying[3].status).all()


def check_against_study(flight, service=None):
    config, truth, landmarks, ranging = flight
    table, two_way = ranging.attempts, config.ranging.timing == "two-way"
    fixed = np.array([mark.position for mark in landmarks])
    speed = velocities(truth, np.arange(truth.time.size))
    measured = 0
    service = service or RangingService(config)
    for sample in np.unique(table.sample):
        place = np.concatenate([truth.position[:, sample], fixed])
        velocity = np.concatenate([speed[:, sample], np.zeros_like(fixed)])
        for transmitter in range(truth.name.size):
            rows = np.flatnonzero((table.sample == sample) & (table.transmitter == transmitter))
            to = table.receiver[rows]
            moving = (
                {"source_velocity": velocity[transmitter], "receiver_velocities": velocity[to]}
                if two_way
                else {}
            )
            ping = service.ping(truth.time[sample], place[transmitter], place[to], **moving)
            np.testing.assert_array_equal(ping.status, ranging.status[rows])
            np.testing.assert_array_equal(ping.travel_time, ranging.truth.travel_time[rows])
            np.testing.assert_array_equal(ping.refracted_range, ranging.truth.refracted_range[rows])
            if ranging.probability is not None:
                np.testing.assert_allclose(ping.probability, ranging.probability[rows], rtol=1e-12)
                np.testing.assert_array_equal(np.isnan(ping.level_db), np.isnan(ping.travel_time))
            measured += np.count_nonzero(ping.status == RayStatus.OK)
    assert measured > 0.5 * ranging.status.size


def test_currents_part_there_and_back_by_twice_the_way_along_them():
    speed, distance = 0.6, 3000.0
    service = RangingService(STILL, currents=Currents.uniform(speed, 0.0))
    here, there = np.array([0.0, 0.0, 500.0]), np.array([distance, 0.0, 500.0])
    forth, back = (
        service.ping(0.0, a, [b]).travel_time[0] for a, b in ((here, there), (there, here))
    )
    assert back - forth == pytest.approx(2.0 * speed * distance / 1500.0**2, rel=1e-6)
    across = service.ping(0.0, here, [(0.0, distance, 500.0)]).travel_time[0]
    assert across == pytest.approx(distance / 1500.0, rel=1e-9)


def test_a_round_trip_ends_where_the_moving_ends_meet_the_sound(as_stored):
    """Both on one line, the source in pursuit: the exchange solved by hand, up to (v / c)²."""
    v_source, v_receiver, distance, wait, c = 2.0, -1.5, 1200.0, 4.0, 1500.0
    service = RangingService(STILL, timing=TwoWay(turn_around=wait))
    ping = service.ping(
        100.0,
        (0.0, 0.0, 500.0),
        [(distance, 0.0, 500.0)],
        source_velocity=(v_source, 0.0, 0.0),
        receiver_velocities=[(v_receiver, 0.0, 0.0)],
    )
    out = distance / (c - v_receiver)
    left = distance + v_receiver * (out + wait) - v_source * (out + wait)
    back = left / (c + v_source)
    second_order = ((v_source - v_receiver) / c) ** 2 * (wait + distance / c)
    assert ping.travel_time[0] == pytest.approx((out + back) / 2.0, rel=0.0, abs=second_order)
    assert ping.arrival_time[0] == pytest.approx(
        100.0 + out + wait + back, rel=0.0, abs=2.0 * second_order
    )
    still = service.ping(100.0, (0.0, 0.0, 500.0), [(distance, 0.0, 500.0)])
    assert still.travel_time[0] == pytest.approx(distance / c, rel=1e-9)
    as_stored([ping, still])


def test_a_level_is_that_of_the_source_less_the_spherical_spreading():
    sonar = Sonar(
        source_level_db=180.0, frequency_hz=10e3, bandwidth_hz=2e3, noise=40.0, spread_db=0.0
    )
    service = RangingService(STILL, reception=ReceptionOptions(detector=Detector(sonar)))
    distance = np.array([100.0, 1000.0])
    ping = service.ping(0.0, (0.0, 0.0, 500.0), [(d, 0.0, 500.0) for d in distance])
    np.testing.assert_allclose(ping.level_db, 180.0 - 20.0 * np.log10(distance), atol=1e-3)
    np.testing.assert_array_equal(ping.probability, [1.0, 1.0])


@pytest.mark.slow
def test_threads_and_processes_answer_as_one_thread_does(medium, loud, links):
    pings = [(float(seed), *links(4, seed)) for seed in range(6)]
    serial = [loud.ping(*ping) for ping in pings]
    with ThreadPoolExecutor(4) as pool:
        for one, other in zip(serial, pool.map(lambda ping: loud.ping(*ping), pings), strict=True):
            same_pings(one, other)
    water = loud.water
    with (
        RangingService(
            medium, reception=water.reception, timing=water.timing, workers=2
        ) as service,
        ThreadPoolExecutor(2) as pool,
    ):
        for one, other in zip(
            serial, pool.map(lambda ping: service.ping(*ping), pings), strict=True
        ):
            same_pings(one, other)


@pytest.mark.slow
def test_a_service_that_varies_works_in_processes(varying, in_varying):
    config, truth, *_ = varying
    place = truth.position[:, 0]
    with RangingService(config, workers=1) as service:
        same_pings(
            service.ping(4000.0, place[0], place[1:]), in_varying.ping(4000.0, place[0], place[1:])
        )


def test_nothing_is_compiled_after_construction(medium, links):
    reception = ReceptionOptions(
        max_surface_bounces=1, detector=Detector(Sonar(180.0, 20e3, 4e3, 50.0))
    )
    service = RangingService(medium, reception=reception, currents=Currents.uniform(0.2, 0.1))
    compiled = [list(entry.signatures) for entry in (solve_links, trace_arrivals)]
    service.ping(0.0, *links(25))
    service.ping(0.0, *links(1))
    assert [list(entry.signatures) for entry in (solve_links, trace_arrivals)] == compiled


def test_geographic_positions_equal_local_ones(fly, as_stored):
    config, truth, *_ = fly(ranging={"timing": "two-way", "turn_around_s": 10.0})
    service, frame = RangingService(config), LocalFrame(74.5, -140.0)
    place, speed = truth.position[:, 5], velocities(truth, np.array([5]))[:, 0]
    lat, lon = frame.to_geodetic(place[:, 0], place[:, 1])
    globe = np.stack([lat, lon, place[:, 2]], axis=1)
    turn = -frame.convergence(lat, lon)  # of the axes, as seen from true north
    north = speed[:, 0] * np.cos(turn) - speed[:, 1] * np.sin(turn)
    east = speed[:, 0] * np.sin(turn) + speed[:, 1] * np.cos(turn)
    true = np.stack([north, east, speed[:, 2]], axis=1)
    local = service.ping(
        0.0, place[0], place[1:], source_velocity=speed[0], receiver_velocities=speed[1:]
    )
    ping = service.ping(
        0.0,
        globe[0],
        globe[1:],
        source_velocity=true[0],
        receiver_velocities=true[1:],
        geographic=True,
    )
    np.testing.assert_array_equal(ping.status, local.status)
    np.testing.assert_allclose(ping.travel_time, local.travel_time, rtol=0.0, atol=1e-11)
    as_stored(ping)


def test_a_file_an_open_ocean_and_a_configuration_are_the_same_water(tmp_path, links):
    ocean, file = (
        open_ocean("synthetic:beaufort", window=(74.2, 74.8, -141.0, -139.0)),
        tmp_path / "sea.nc",
    )
    write_netcdf(ocean, file)
    config = tmp_path / "sea.toml"
    config.write_text('[ocean]\nsource = "sea.nc"\n')
    source, receivers = links(10)
    one = RangingService(ocean).ping(0.0, source, receivers)
    assert (one.status == RayStatus.OK).any()
    for other in (str(file), [file], to_local(ocean), load_sound(config)):
        same_pings(RangingService(other).ping(0.0, source, receivers), one)


@pytest.mark.slow
def test_water_of_an_interval_is_that_at_its_beginning(varying, in_varying):
    config, truth, *_ = varying
    place = truth.position[:, 0]
    coarse = RangingService(config, water_interval=600.0)
    begin, later = (
        in_varying.ping(time, place[0], place[1:]).travel_time for time in (3600.0, 4199.0)
    )
    np.testing.assert_array_equal(coarse.ping(4199.0, place[0], place[1:]).travel_time, begin)
    assert not np.array_equal(later, begin, equal_nan=True)
    line = r"time is 22000 s; it must be 0 to 10800 s after 2014-07-15T00:00:00 UTC"
    for service in (in_varying, coarse):
        refused(WaterError, line, service.ping, 22e3, place[0], place[1:])
    line = "geographic positions: latitudes are 95 to 95; they must be -90 to 90"
    refused(
        WaterError,
        line,
        in_varying.ping,
        0.0,
        (95.0, 0.0, 5.0),
        [(74.5, -140.0, 5.0)],
        geographic=True,
    )


def test_nobody_hears_a_ping_to_nobody(service):
    ping = service.ping(0.0, (0.0, 0.0, 50.0), [])
    assert all(getattr(ping, f.name).size == 0 for f in fields(ping) if "dims" in f.metadata)


def test_a_ping_goes_into_a_data_set_as_cf_has_it(loud, links, tmp_path):
    data = loud.ping(0.0, *links(7)).to_dataset()
    assert dict(data.sizes) == {"receiver": 7}
    assert data["status"].attrs["flag_meanings"].split()[:2] == ["OK", "SHADOW"]
    write_netcdf(data, tmp_path / "ping.nc")
    assert not cf_errors([tmp_path / "ping.nc"])


A = (0.0, 0.0, 50.0)


@pytest.mark.parametrize(
    ("error", "line", "arguments", "options"),
    [
        (ServiceError, "time is nan; it must be a finite number", (np.nan, A, [A]), {}),
        (AcousticsError, r"source has shape \(1, 2\); it must be", (0.0, A[:2], [A]), {}),
        (
            AcousticsError,
            "receivers: 1 coordinates are not finite",
            (0.0, A, [(0.0, np.inf, 5.0)]),
            {},
        ),
        (ServiceError, "source: 2 positions; a ping has one source", (0.0, [A, A], [A]), {}),
        (ServiceError, "velocity: one-way timing", (0.0, A, [A]), {"source_velocity": A}),
        (WaterError, "this water has no geographic position", (0.0, A, [A]), {"geographic": True}),
    ],
)
def test_a_ping_that_cannot_be_is_refused_in_one_line(service, error, line, arguments, options):
    refused(error, line, service.ping, *arguments, **options)


def test_velocities_are_one_for_each(loud):
    line = "receiver_velocities: 1 velocities for 2 positions"
    refused(ServiceError, line, loud.ping, 0.0, A, [A, A], receiver_velocities=[A])


def test_options_that_cannot_be_are_refused_in_one_line(medium):
    refused(
        ServiceError, "workers is -1; allowed are 0 and more", RangingService, medium, workers=-1
    )
    refused(ServiceError, "water_interval is -1 s", RangingService, medium, water_interval=-1.0)
    refused(MantaRayError, "sea.toml: no such file", RangingService, "sea.toml")


def test_the_frame_of_a_study_is_about_its_trajectories(tmp_path):
    (tmp_path / "glider.csv").write_text(
        "time,vehicle,latitude,longitude,depth\n0,G,74.2,-141.0,50\n3600,G,74.22,-140.9,80\n"
    )
    file = tmp_path / "study.toml"
    file.write_text(
        'conditions = []\n[study]\nname = "s"\n[ocean]\nsource ='
        ' "synthetic:beaufort"\nhalf_extent_north = 9e3\n'
        "half_extent_east = 9e3\n[mission]\nping_interval_h = 1.0\n[fleet]\ntrajectories ="
        ' "glider.csv"\n'
    )
    frame = RangingService(load_sound(file)).water.frame
    assert (frame.latitude_deg, frame.longitude_deg) == pytest.approx((74.21, -140.95), abs=1e-9)

"""How vehicles stop, that they do not act on each other, and what is refused before they start."""

import re

import numpy as np
import pytest

from pymantaray.errors import FleetError
from pymantaray.fleet import ConstantTwist, Drifting, FloatCycle, StationKeeping, Vehicle, Waypoints
from pymantaray.fleet.simulation import fleet_refusals
from pymantaray.records import VehicleStatus

BOX, FLOOR = 5000.0, 1000.0  # m; half the side and the depth of the domain that conftest builds
TRIANGLE = np.array([(500.0, 0, 100.0), (500.0, 500.0, 150.0), (0, 500.0, 60.0)])


def floating(name="B", north=0.0, depth=0.5, **cycle):
    return Vehicle(name, (north, 0.0, depth), FloatCycle(**({"target_depth": 100.0} | cycle)))


def assert_stopped(truth, row, status, last_active):
    np.testing.assert_array_equal(truth.status[row, : last_active + 1], VehicleStatus.ACTIVE)
    np.testing.assert_array_equal(truth.status[row, last_active + 1 :], status)
    stopped = truth.position[row, last_active + 1 :]
    np.testing.assert_array_equal(stopped, np.broadcast_to(stopped[0], stopped.shape))


@pytest.mark.parametrize(
    ("way", "uniform"),
    [("north", (1.0, 0)), ("south", (-1.0, 0)), ("east", (0, 1.0)), ("west", (0, -1.0))],
)
def test_vehicle_that_leaves_the_ocean_stays_at_its_edge(run, make_float, make_ocean, way, uniform):
    truth = run(
        make_float(),
        make_float("C", start_delay=500.0),
        water=make_ocean(uniform=uniform),
        duration=6000.0,
    )
    assert_stopped(truth, 0, VehicleStatus.LEFT_DOMAIN, int(BOX / 50.0))
    np.testing.assert_allclose(
        truth.position[0, -1, :2], BOX * np.array(uniform), rtol=0, atol=0.5 + 1e-6
    )
    assert np.abs(truth.position[0, -1, :2]).max() <= BOX


def test_float_that_sinks_onto_a_slope_grounds_and_the_others_go_on(run, make_float, make_ocean):
    """Depth 0.5 + t / 2 meets a floor at 1000 - t / 5, since the drift north is t."""
    water = make_ocean(uniform=(1.0, 0.0), slope=0.2)
    deep = make_float(target_depth=900.0, hold_depth_time=1e6)
    truth = run(deep, make_float("C", target_depth=50.0), water=water, duration=4500.0)
    when = (FLOOR - 0.5) / 0.7
    assert_stopped(truth, 0, VehicleStatus.GROUNDED, int(when / 50.0))
    assert truth.position[0, -1, 0] == pytest.approx(when, rel=0, abs=0.5)
    assert truth.position[0, -1, 2] == pytest.approx(0.5 + 0.5 * when, rel=0, abs=0.25)
    assert (truth.status[1] == VehicleStatus.ACTIVE).all()
    np.testing.assert_allclose(truth.position[1, -1, 0], 4500.0, rtol=0, atol=1e-7)


@pytest.mark.parametrize(
    ("below", "lies"), [(-1e-3, True), (0.0, True), (9e-7, True), (1.1e-6, False), (1e-3, False)]
)
def test_a_vehicle_lies_on_the_bed_to_a_micrometre_and_not_beneath(
    run, make_float, make_ocean, below, lies
):
    """
    A bed of 1000 m between nodes is 999.9999999999999 m by rounding; nobody is told that 1000 m is
    below 1000 m.
    """
    water = make_ocean(uniform=(0.1, 0.03))
    north, depth = 333.3, FLOOR + below
    station = Vehicle("S", (north, 0.1, depth), StationKeeping(depth))
    drifter = Vehicle("D", (north, 0.1, depth), Drifting(depth))
    deep = make_float("F", target_depth=depth, north=north)
    if lies:
        truth = run(station, drifter, deep, water=water, duration=400.0)
        assert (truth.status == VehicleStatus.ACTIVE).all()
        return
    for vehicle in (station, drifter, deep):
        with pytest.raises(FleetError) as caught:
            run(vehicle, water=water)
        own, floor = re.search(
            r"is (\S+) m deep, below the sea floor at (\S+) m ", str(caught.value)
        ).groups()
        assert float(own) > float(floor), caught.value
        (refusal,) = fleet_refusals([vehicle], water, 0.5)
        assert str(refusal) == str(caught.value)


def test_swimmer_and_twist_ground_on_a_wall(run, make_ocean):
    """A ridge between the way points, 100 m below the surface, stops both before its crest."""
    water = make_ocean()
    water["sea_floor_depth"][7, :] = 100.0  # at north 2000 m; the grid's spacing is 1000 m
    twist = Vehicle("T", (0, 0, 550.0), ConstantTwist((0, 0, 0, 1.0, 0, 0)))
    swimmer = Vehicle("W", (0, 0, 550.0), Waypoints([(4000.0, 0, 550.0)], 1.0, 0.1), heading=1.0)
    truth = run(twist, swimmer, water=water)
    for row, last in enumerate([1500, np.nan]):
        first = np.flatnonzero(truth.status[row])[0]
        assert_stopped(truth, row, VehicleStatus.GROUNDED, first - 1)
        assert truth.position[row, -1, 0] == pytest.approx(1500.0, rel=0, abs=2.0)
        assert truth.position[row, -1, 0] <= 1500.0
        if np.isfinite(last):
            assert first == last / 50 + 1
        turned = truth.quaternion[row, first:]
        np.testing.assert_array_equal(turned, np.broadcast_to(turned[0], turned.shape))


def test_path_depends_on_nothing_but_the_vehicle_itself(run, make_float, make_ocean):
    water = make_ocean(rotation=1e-4, uniform=(0.1, 0.0), shear=1e-4)
    fleet = [
        make_float("B", 100.0, 0.0),
        make_float("C", -200.0, 50.0, target_depth=300.0),
        Vehicle("W", (0, 0, 50.0), Waypoints(TRIANGLE, 1.0, 0.1, loop=True)),
        Vehicle("T", (0, 0, 500.0), ConstantTwist((0.01, 0, 0.02, 1, 0, 0))),
        Vehicle("A", (0, 0, 0.5), StationKeeping(0.5)),
    ]
    together, reverse = run(*fleet, water=water), run(*fleet[::-1], water=water)
    assert list(together.role) == ["float", "float", "waypoints", "twist", "station"]
    for row, vehicle in enumerate(fleet):
        alone = run(vehicle, water=water)
        for truth, k in ((together, row), (reverse, len(fleet) - 1 - row)):
            assert truth.name[k] == vehicle.name
            np.testing.assert_array_equal(truth.position[k], alone.position[0])
            np.testing.assert_array_equal(truth.quaternion[k], alone.quaternion[0])


TIMES = {
    "sampling_period is 50.2 s, 100.4 times physics_step .* change one of them": (
        {"sampling_period": 50.2}
    ),
    "duration is 1010 s, 20.2 times sampling_period .* integer multiple": {"duration": 1010.0},
    "duration is 25 s, 0.5 times sampling_period": {"duration": 25.0},
    "physics_step is 0 s; it must be finite and positive": {"physics_step": 0.0},
    "duration is nan s; it must be finite and positive": {"duration": np.nan},
    "sampling_period is 1e.300 s, inf times": {"physics_step": 1e-300, "sampling_period": 1e300},
    r"1 vehicles x 1e\+13 samples x 114 bytes are 1.06e\+06 GiB of memory; this machine has": (
        {"duration": 5e14}
    ),
}  # fmt: skip
FLEETS = {
    "fleet: no vehicles; give at least one": [],
    "vehicle 'B': two vehicles have this name; rename one": (
        [floating("B"), floating("C"), floating("B")]
    ),
    "vehicle 'B': the start position is at north 6000, .* -5000 to 5000 .*; move it": (
        [floating(north=6000.0)]
    ),
    "vehicle 'B': the start position is 1200 m deep, below the sea floor at 1000 m .*; use": (
        [floating(depth=1200.0)]
    ),
    "vehicle 'B': target_depth is 2500 m deep, below the sea floor at 1000 m .*; use": (
        [floating(target_depth=2500.0)]
    ),
    "vehicle 'W': waypoint 1 is at north 0, east 9000 m, outside the ocean": [
        Vehicle("W", (0, 0, 5), Waypoints([(0, 0, 9), (0, 9e3, 9)], 1, 0.1))
    ],
    "vehicle 'W': physics_step is 0.5 s; it must be at most 0.2 s, .* miss a waypoint": [
        Vehicle("W", (0, 0, 5), Waypoints([(0, 0, 9)], 100.0, 100.0))
    ],
}  # fmt: skip
OCEANS = {
    "the data set has no current_east; a local data set must have": lambda o: o.drop_vars(
        "current_east"
    ),
    "missing values; none are": lambda o: o.assign(
        current_north=o.current_north.where(o.depth < 500)
    ),
    "axis 'east' has 1 value;": lambda o: o.isel(east=[0]),
    "sea_floor_depth has dimensions": lambda o: o.assign(
        sea_floor_depth=o.sea_floor_depth.isel(east=0)
    ),
}


@pytest.mark.parametrize("message", [*TIMES, *FLEETS, *OCEANS])
def test_what_cannot_be_simulated_is_refused_in_one_line(run, make_ocean, message):
    water = OCEANS.get(message, lambda o: o)(make_ocean())
    with pytest.raises(FleetError, match=message) as error:
        run(*FLEETS.get(message, [floating()]), water=water, **TIMES.get(message, {}))
    assert "\n" not in str(error.value)

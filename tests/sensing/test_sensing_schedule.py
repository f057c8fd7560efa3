"""Who pings when, and the fixed points that listen."""

import numpy as np
import pytest
from refusals import refused

from pymantaray.errors import SensingError
from pymantaray.sensing import Landmark, PingList, PingSchedule, SlotSchedule
from pymantaray.sensing.schedule import attempts

WEEK = np.arange(3025) * 200.0  # s; the paper's samples


def test_paper_has_42_epochs_and_4620_attempts():
    epochs = PingSchedule(4 * 3600.0).samples(WEEK)
    np.testing.assert_array_equal(WEEK[epochs], 4 * 3600.0 * np.arange(1, 43))
    assert attempts(11, 0, epochs).sample.size == 4620


@pytest.mark.parametrize(("n_vehicles", "n_landmarks"), [(1, 0), (1, 2), (2, 0), (3, 2), (11, 0)])
def test_every_ordered_pair_once_an_epoch_and_every_landmark_heard(n_vehicles, n_landmarks):
    epochs = np.array([5, 9])
    table = attempts(n_vehicles, n_landmarks, epochs)
    expected = [
        (k, i, j)
        for k in epochs
        for i in range(n_vehicles)
        for j in range(n_vehicles + n_landmarks)
        if i != j
    ]
    assert list(zip(*table, strict=True)) == expected


def test_an_interval_that_does_not_divide_the_mission_stops_early():
    np.testing.assert_array_equal(PingSchedule(400.0).samples(np.arange(6) * 200.0), [2, 4])


@pytest.mark.parametrize("period", [0.1, 0.3, 1 / 3])
def test_rounding_of_the_times_loses_no_epoch(period):
    time = np.arange(1001) * period
    np.testing.assert_array_equal(PingSchedule(10 * period).samples(time), np.arange(10, 1001, 10))


IMPOSSIBLE = {
    "interval is 300 s: the ping at 300 s is not at a sample time; samples are every 200 s: ping"
    " at": lambda: ping(300.0),
    "interval is 1e.06 s, the mission lasts 604800 s; .*: ping earlier or lengthen": (
        lambda: ping(1e6)
    ),
    "interval is 0 s; it must be finite and positive": lambda: ping(0.0),
    "interval is nan s": lambda: ping(np.nan),
    "no vehicle or landmark is called 'C'; allowed: A, B, L": lambda: pings("C"),
    "L listens to itself; remove it": lambda: pings("L", "L"),
    "M listens to L, both landmarks; one has to be a vehicle": lambda: pings("L", "A", "M"),
    "Landmark: the name is empty": lambda: Landmark("", (0, 0, 1)),
    r"landmark 'L': position: shape is \(2,\); it must be \(3,\)": lambda: Landmark("L", (0, 0)),
    "landmark 'L': position: 1 of 3 values are not finite": lambda: Landmark("L", (0, 0, np.nan)),
    "landmark 'L': depth is -4 m; .*: place it in the water": lambda: Landmark("L", (0, 0, -4.0)),
}  # fmt: skip


def pings(transmitter, *receivers):
    return PingList((200.0,), (transmitter,), (receivers,)).attempts(WEEK, ["A", "B"], ["L", "M"])


def ping(interval):
    return PingSchedule(interval).samples(WEEK)


@pytest.mark.parametrize("message", IMPOSSIBLE)
def test_impossible_schedules_and_landmarks_are_refused_in_one_line(message):
    refused(SensingError, message, IMPOSSIBLE[message])


def test_landmarks_ping_to_vehicles_in_slots_and_lists():
    time, who = np.arange(5) * 60.0, (["A", "B"], ["L", "M"])
    slots = SlotSchedule(("A", "L"), slot=60.0).attempts(time, *who)
    expected = [(k, 0, j) for k in (0, 2, 4) for j in (1, 2, 3)] + [
        (k, 2, j) for k in (1, 3) for j in (0, 1)
    ]
    assert list(zip(*slots, strict=True)) == sorted(expected)
    to_all = PingList((60.0, 120.0), ("M", "B")).attempts(time, *who)
    assert list(zip(*to_all, strict=True)) == [
        (1, 3, 0),
        (1, 3, 1),
        (2, 1, 0),
        (2, 1, 2),
        (2, 1, 3),
    ]
    some = PingList((60.0, 120.0), ("M", "L"), ((), ("B",))).attempts(time, *who)
    assert list(zip(*some, strict=True)) == [(1, 3, 0), (1, 3, 1), (2, 2, 1)]


@pytest.mark.parametrize("names", ["A", "LL"])
def test_names_are_shared_by_no_two_participants(names, make_measurements):
    landmarks = [Landmark(name, (0, 0, k)) for k, name in enumerate(names)]
    with pytest.raises(
        SensingError, match=f"landmark {names[0]!r}: the name is taken .* rename one"
    ):
        make_measurements(landmarks=landmarks)

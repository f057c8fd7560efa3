"""Rows of positions that no vehicle can have had are left out; plausible tracks do not change."""

import numpy as np
import pytest
from refusals import refused

from pymantaray.errors import RecordError
from pymantaray.records.position_rows import (
    FASTEST_PLATFORM,
    PositionRows,
    impossible_positions,
    is_no_fix,
    middle_longitude,
    missing_fixes,
    order_of_times,
    repeated_note,
    repeated_rows,
)

TIME = 10.0 * np.arange(40.0)
LINE = np.arange(2, 42)
NORTH = np.column_stack([1.5 * TIME, np.zeros(40)])
M_PER_DEGREE = np.array([111_120.0, 79_200.0])  # at 44.5 N


def degrees(north_east):
    return np.array([44.5, -125.1]) + north_east / M_PER_DEGREE


def changed(position, rows, value):
    out = position.copy()
    out[rows] = value
    return out


@pytest.mark.parametrize("rows", [[0], [39], [20], [20, 21], [5, 15, 25], [11, 12, 13]])
@pytest.mark.parametrize("metres", [1e3, 1e4, 1e5, 5e6])
def test_gross_positions_are_found_wherever_they_are(rows, metres):
    wrong = NORTH.copy()
    wrong[rows, 1] += metres
    reasons, jumps = impossible_positions(TIME, wrong, geographic=False)
    assert sorted(reasons) == rows
    assert not jumps
    mixed = np.random.default_rng(0).permutation(40)
    reasons, _ = impossible_positions(TIME[mixed], wrong[mixed], geographic=False)
    assert sorted(mixed[list(reasons)].tolist()) == rows


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ([0.0, 0.0], "position 0, 0 is no fix"),
        ([1e-5, -1e-5], "position 1e-05, -1e-05 is no fix"),
        ([999.0, 999.0], "position is 999, 999; latitude must be -90 to 90"),
        ([125.1, 44.5], "they may be exchanged"),
        ([44.5, 125.1], "km away from that 10 s before"),
        ([-44.5, -125.1], "km away from that 10 s before"),
        ([0.0, -125.1], "km away from that 10 s before"),
    ],
)
def test_a_position_without_a_fix_is_left_out_with_its_line(value, words):
    rows = PositionRows("log.csv", RecordError)
    keep = rows.possible(TIME, changed(degrees(NORTH), 7, value), LINE, geographic=True, who="A")
    assert np.flatnonzero(~keep).tolist() == [7]
    (note,) = rows.notes
    assert note.startswith("log.csv: 1 line left out, impossible position: line 9: A: position ")
    assert words in note


def rest_then_transit():
    north = np.where(TIME < 200.0, 0.0, 8.0 * (TIME - 200.0))
    return TIME, np.column_stack([north, 0.3 * np.sin(TIME)])


GOOD = {
    "a vehicle": (TIME, NORTH),
    "a ship that rests and sails": rest_then_transit(),
    "an aircraft": (TIME, 100.0 * NORTH),
    "a float every ten days": (86_400.0 * TIME, 30.0 * NORTH),
    "acoustic fixes of 15 m": (
        TIME,
        NORTH + 15.0 * np.random.default_rng(1).standard_normal((40, 2)),
    ),
    "two pings at each time": (np.repeat(TIME[:20], 2), np.repeat(NORTH[:20], 2, axis=0)),
    "three rows": (TIME[:3], 1e6 * NORTH[:3]),
}


@pytest.mark.parametrize("case", GOOD)
def test_a_plausible_track_is_not_changed(case):
    time, position = GOOD[case]
    assert impossible_positions(time, position, geographic=False) == ({}, [])
    small = degrees(1e-2 * position if case == "three rows" else position)
    assert impossible_positions(time, small, geographic=True) == ({}, [])


def test_a_correction_of_dead_reckoning_is_only_noted():
    fixed = NORTH.copy()
    fixed[30:, 1] += 1500.0
    rows = PositionRows("dive.csv", RecordError)
    assert rows.possible(TIME, fixed, LINE, geographic=False).all()
    assert rows.notes == ("dive.csv, line 32: the position jumps by 1.5 km in 10 s",)
    # 5,000 km is no correction: a sign that is lost for the rest of the file
    fixed[30:, 1] += 5e6
    refused(
        RecordError,
        "dive.csv, line 32: the position changes by 5e.03 km in 10 s and does not return",
        rows.possible, TIME, fixed, LINE, geographic=False,
    )  # fmt: skip


def test_patterns_of_a_survey_may_be_far_from_each_other():
    position = np.tile(NORTH, (2, 1))
    position[40:, 1] += 2_000.0
    rows = PositionRows("pings.csv", RecordError, fastest=FASTEST_PLATFORM)
    line = np.arange(80)
    assert rows.possible(10.0 * line, position, line, geographic=False).all()
    assert not rows.notes


def test_the_equator_at_greenwich_is_a_place():
    position = (NORTH - NORTH[20]) / 111_120.0
    assert not missing_fixes(position)
    assert missing_fixes(changed(position + 1.0, 20, 0.0))
    assert not missing_fixes(np.zeros((3, 2)))  # no other row is elsewhere


@pytest.mark.parametrize("about", [180.0, 0.0, -125.1])
def test_longitudes_may_be_in_any_turn(about):
    position = degrees(NORTH[:, ::-1])
    position[:, 1] += 125.1 + about - position[:, 1].mean() - 125.1
    turned = position.copy()
    turned[::2, 1] += 360.0 if about < 0.0 else 0.0
    seam = np.where(position[:, 1] > 180.0, position[:, 1] - 360.0, position[:, 1])
    for lon in (turned[:, 1], seam, position[:, 1] % 360.0):
        own = np.column_stack([position[:, 0], lon])
        assert impossible_positions(TIME, own, geographic=True) == ({}, [])
        middle = middle_longitude(lon) - np.median(position[:, 1])
        assert abs((middle + 180.0) % 360.0 - 180.0) < 1e-9
    assert middle_longitude(position[:, 1]) == np.median(position[:, 1])


def test_radians_are_refused_unless_degrees_are_stated():
    radians = np.radians(degrees(NORTH))
    rows = PositionRows("log.csv", RecordError)
    words = "log.csv: positions such as 0.776672, -2.18341 look like radians; convert them"
    refused(RecordError, words, rows.possible, TIME, radians, LINE, geographic=True)
    assert rows.possible(TIME, radians, LINE, geographic=True, stated_degrees=True).all()
    # a vehicle of 1.5 m/s near 0, 0
    assert rows.possible(TIME, NORTH / 111_120.0, LINE, geographic=True).all()


def test_a_file_of_mostly_impossible_rows_is_refused():
    rows = PositionRows("log.csv", RecordError)
    keep = rows.possible(TIME, changed(degrees(NORTH), slice(0, 20), 0.0), LINE, geographic=True)
    refused(
        RecordError,
        "log.csv, line 2: position 0, 0 is no fix .20 of 40 lines: impossible position",
        rows.refuse_most, int(keep.sum()),
    )  # fmt: skip


def order(time, **options):
    return order_of_times(np.array(time), lambda row: f"line {row + 2}", RecordError, **options)


def test_times_of_day_must_not_pass_midnight():
    late = [86_390.0, 86_399.0, 1.0, 11.0]
    words = "line 4: time falls from 86399 to 1 s, as from one day to the next; write dates"
    refused(RecordError, words, order, late, dated=False)
    assert order([86_399.0, 86_401.0], dated=False) == (None, None)
    assert order([0.0, 0.0, 1.0], dated=False) == (None, None)
    # with a date, or by seconds since 1970, the files were joined in another order
    for time, dated in ((late, True), ([1.7e9 + t for t in late], False)):
        rows, note = order(time, dated=dated)
        assert rows.tolist() == [2, 3, 0, 1]
        assert note.endswith("rows sorted by time (1 fall)")


def test_a_single_time_that_falls_is_refused_between_whole_files():
    words = "line 4: time 1 s is before that of the row above, 3 s; times must not decrease"
    refused(RecordError, words, order, [2.0, 3.0, 1.0, 4.0, 0.5], dated=True, blocks=True)
    words = "line 4: time 1 s is before that of the row above, 3 s; times must not decrease"
    refused(RecordError, words, order, [2.0, 3.0, 1.0, 4.0], dated=True, blocks=True)
    rows, _ = order([2.0, 3.0, 0.0, 1.0], dated=True, blocks=True)
    assert rows.tolist() == [2, 3, 0, 1]


def test_rows_repeat_only_if_all_columns_do():
    names = np.array(["A", "B", "A", "A"])
    assert repeated_rows([np.array([1.0, 1.0, 1.0, 2.0]), names]).tolist() == [0, 0, 1, 0]


@pytest.mark.parametrize(("count", "said"), [
    (1, "a.csv: 1 ping counted once: line 2 repeats an earlier line"),
    (3, "a.csv: 3 pings counted once: lines 2, 3, 4 repeat earlier lines"),
    (99, "a.csv: 99 pings counted once: lines 2, 3, 4, ... repeat earlier lines"),
])  # fmt: skip
def test_repeated_rows_are_noted_with_their_first_lines(count, said):
    assert repeated_note("a.csv", range(2, 2 + count)) == said


@pytest.mark.parametrize(("count", "message"), [(1_100, ""), (60_000, "does not return")])
def test_thousands_of_gross_rows_are_out_or_refused(count, message):
    """Each gross row makes two jumps; more than 20,000 jumps are no track."""
    time = np.arange(8.0 * count)
    position = np.column_stack([75.0 + 1e-6 * time, 10.0 + 0.0 * time])
    position[3::8, 0] = 50.0
    rows = PositionRows("a.csv", RecordError)
    line = np.arange(time.size)
    if message:
        refused(RecordError, message, rows.possible, time, position, line, geographic=True)
        return
    keep = rows.possible(time, position, line, geographic=True)
    np.testing.assert_array_equal(np.flatnonzero(~keep), np.arange(3, time.size, 8))
    assert rows.notes[0].startswith("a.csv: 1,100 lines left out")


@pytest.mark.parametrize(
    ("latitude", "longitude", "missing"),
    [
        (45.0, 170.0, False),
        (-90.0, 359.0, False),
        (0.0, 1e-3, False),
        (0.0, 0.0, True),
        (100.0, 45.0, True),
        (45.0, 361.0, True),
        (999.0, 999.0, True),
    ],
)
def test_no_fix_is_zero_or_off_the_globe(latitude, longitude, missing):
    assert is_no_fix(latitude, longitude) == missing

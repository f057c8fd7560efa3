"""
Which arrival of a link is ranged on: the four rules on arrivals made by hand, and their statuses.
"""

import numpy as np
import pytest
from factories import make_arrivals
from hypothesis import given, settings, strategies as st

from pymantaray.acoustics import Medium, choose_arrivals, find_eigenrays, select
from pymantaray.acoustics.selection import is_near_cutoff, within_cutoff
from pymantaray.records import RayStatus

# link, travel time [s], surface and bottom bounces, spreading [dB]; link 2 has no arrival, link 3
# only bounced ones
TABLE = [
    (0, 1.00, 1, 0, 3.0),
    (0, 1.01, 0, 0, 9.0),
    (0, 1.02, 0, 0, -2.0),
    (0, 1.50, 0, 1, -4.0),
    (1, 2.00, 0, 0, 0.0),
    (3, 4.00, 1, 1, 1.0),
    (3, 4.25, 2, 1, 0.5),
]
STATUS = [RayStatus.OK, RayStatus.OK, RayStatus.WEAK, RayStatus.OK]


def arrivals_of(table, status):
    link, time, surface, bottom, spreading = np.array(table, dtype=float).reshape(-1, 5).T
    n = len(status)
    return make_arrivals(
        link,
        status,
        travel_time=time,
        surface_bounces=surface,
        bottom_bounces=bottom,
        spreading_db=spreading,
        source_slowness=np.multiply.outer(time, [1.0, 2.0, 3.0]),
        receiver_slowness=np.multiply.outer(time, [-1.0, 5.0, 7.0]),
        chord_travel_time=np.arange(n) + 0.5,
        source_sound_speed=np.arange(n) + 1500.0,
        receiver_sound_speed=np.arange(n) + 1400.0,
        shadow_margin=np.where(np.array(status) == RayStatus.OK, 0.0, 12.0),
    )


ARRIVALS = arrivals_of(TABLE, STATUS)


@pytest.mark.parametrize(("rule", "times", "last", "margin"), [
    ("direct", [1.01, 2.0, np.nan, np.nan], RayStatus.SHADOW, np.nan),  # bounced arrivals only
    ("first", [1.0, 2.0, np.nan, 4.0], RayStatus.OK, 0.0),
    ("strongest", [1.5, 2.0, np.nan, 4.25], RayStatus.OK, 0.0),
    ("direct-or-first", [1.01, 2.0, np.nan, 4.0], RayStatus.OK, 0.0),
])  # fmt: skip
def test_each_rule_picks_its_arrival_with_time_slowness_and_status(rule, times, last, margin):
    found = select(ARRIVALS, rule)
    np.testing.assert_array_equal(found.travel_time, times)
    np.testing.assert_array_equal(found.source_slowness, np.multiply.outer(times, [1.0, 2.0, 3.0]))
    np.testing.assert_array_equal(
        found.receiver_slowness, np.multiply.outer(times, [-1.0, 5.0, 7.0])
    )
    np.testing.assert_array_equal(found.status, [*STATUS[:3], last])
    np.testing.assert_array_equal(found.shadow_margin, [0.0, 0.0, 12.0, margin])
    for name in ("chord_travel_time", "source_sound_speed", "receiver_sound_speed"):
        np.testing.assert_array_equal(getattr(found, name), getattr(ARRIVALS, name))
    if rule == "first":
        assert found.to_dataset().identical(ARRIVALS.first().to_dataset())


def test_losses_and_delays_count_before_the_choice():
    loss = np.array(
        [90.0, 70.0, 80.0, 70.0, np.inf, np.nan, 100.0]
    )  # of equals the earliest; NaN is last
    strongest = select(ARRIVALS, "strongest", loss_db=loss)
    np.testing.assert_array_equal(strongest.travel_time, [1.01, 2.0, np.nan, 4.25])
    delay = np.array(
        [0.015, 0.0, 0.0, 0.0, -0.25, 0.0, 0.0]
    )  # the first of link 0 falls behind the second
    first = select(ARRIVALS, "first", delay=delay)
    np.testing.assert_array_equal(first.travel_time, [1.01, 1.75, np.nan, 4.0])
    np.testing.assert_array_equal(choose_arrivals(ARRIVALS, "first", delay=delay).row, [1, 4, 5])


bounces = st.integers(0, 1)
rows = st.tuples(
    st.integers(0, 4),
    st.sampled_from([1.0, 1.5, 2.0]),
    bounces,
    bounces,
    st.sampled_from([-1.0, 0.0, 4.0]),
)


@given(rows=st.lists(rows, max_size=12))
@settings(max_examples=30)
def test_rules_are_the_minima_they_say(rows):
    """
    Against a search row by row: earliest unbounced, earliest, and least (spreading, time) of each
    link.
    """
    rows = sorted(rows, key=lambda r: r[:2])
    status = np.full(5, RayStatus.SHADOW)
    status[[r[0] for r in rows]] = RayStatus.OK
    arrivals = arrivals_of(rows, status)
    for link in range(5):
        own = [r for r in rows if r[0] == link]
        expected = {
            "direct": min((r[1] for r in own if r[2] == r[3] == 0), default=np.nan),
            "first": min((r[1] for r in own), default=np.nan),
            "direct-or-first": min(own, key=lambda r: (r[2] + r[3] > 0, r[1]), default=(0, np.nan))[
                1
            ],
            "strongest": min(own, key=lambda r: (r[4], r[1]), default=(0, np.nan))[1],
        }
        for rule, time in expected.items():
            found = select(arrivals, rule)
            np.testing.assert_array_equal(found.travel_time[link], time)
            assert (found.status[link] == RayStatus.OK) == np.isfinite(time)


def test_a_first_arrival_near_the_cutoff_is_marked():
    """
    Links whose first arrival would be lost, would get an earlier one, would come in at all, and
    would not change.
    """
    spreading = [14.5, 3.0, 15.5, 3.0, 15.9, 3.0, 15.5, 13.9]
    link = [0, 0, 1, 1, 2, 3, 3, 4]
    time = np.array([1.0, 2.0, 1.0, 2.0, 1.0, 1.0, 2.0, 1.0])
    status = [RayStatus.OK] * 5 + [RayStatus.SHADOW]
    long = {"chord_travel_time": np.ones(6), "source_sound_speed": np.full(6, 1500.0)}
    wide = make_arrivals(link, status, travel_time=time, spreading_db=spreading, **long)
    np.testing.assert_array_equal(is_near_cutoff(wide, 15.0, "first"), [1, 1, 1, 0, 0, 0])
    narrow = within_cutoff(wide, 15.0)
    assert narrow.link.tolist() == [0, 0, 1, 3, 4]
    ok, weak = RayStatus.OK, RayStatus.WEAK
    assert narrow.status.tolist() == [ok, ok, weak, ok, ok, RayStatus.SHADOW]


def test_arrivals_within_a_cutoff_are_those_that_it_finds():
    """A search with a higher cut-off finds the same rays to the last digit, and more."""
    z = np.array([0.0, 40.0, 60.0, 100.0, 200.0, 1000.0])
    medium = Medium.from_profile(
        z, [1435.0, 1436.0, 1442.0, 1438.0, 1443.0, 1465.0], bottom_depth=1000.0
    )
    rng = np.random.default_rng(3)
    source, receiver = np.zeros((60, 3)), np.zeros((60, 3))
    source[:, 2], receiver[:, 2] = rng.uniform(10.0, 200.0, (2, 60))
    receiver[:, 0] = rng.uniform(1e3, 8e3, 60)
    one = find_eigenrays(medium, source, receiver, 1, spreading_cutoff_db=9.0)
    wide = find_eigenrays(medium, source, receiver, 1, spreading_cutoff_db=10.0)
    other = within_cutoff(wide, 9.0)
    assert one.link.size < wide.link.size
    for name in ("link", "travel_time", "spreading_db", "status"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def test_no_cutoff_discards_an_echo_within_one_instrument():
    """
    A link of 0.9 m, one of 1.1 m and one that no ray reaches directly; all arrivals are 60 dB
    weaker than spherical.
    """
    chord = np.array([0.9, 1.1, np.nan]) / 1500.0
    wide = make_arrivals(
        [0, 1, 2],
        [RayStatus.OK] * 3,
        travel_time=np.ones(3),
        spreading_db=np.full(3, 60.0),
        chord_travel_time=chord,
        source_sound_speed=np.full(3, 1500.0),
    )
    assert within_cutoff(wide, 15.0).link.tolist() == [0]
    assert not is_near_cutoff(wide, 60.5, "first")[0]

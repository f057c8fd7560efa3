"""Which arrival of a link is ranged on: the three rules on arrivals made by hand, and their statuses."""

import numpy as np
import pytest
from factories import make_arrivals
from hypothesis import given, settings
from hypothesis import strategies as st

from pymantaray.acoustics import choose_arrivals, select
from pymantaray.records import RayStatus

# link, travel time [s], surface and bottom bounces, spreading [dB]; link 2 has no arrival, link 3 only bounced ones
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
])  # fmt: skip
def test_each_rule_picks_its_arrival_with_time_slowness_and_status(rule, times, last, margin):
    found = select(ARRIVALS, rule)
    np.testing.assert_array_equal(found.travel_time, times)
    np.testing.assert_array_equal(found.source_slowness, np.multiply.outer(times, [1.0, 2.0, 3.0]))
    np.testing.assert_array_equal(found.receiver_slowness, np.multiply.outer(times, [-1.0, 5.0, 7.0]))
    np.testing.assert_array_equal(found.status, [*STATUS[:3], last])
    np.testing.assert_array_equal(found.shadow_margin, [0.0, 0.0, 12.0, margin])
    for name in ("chord_travel_time", "source_sound_speed", "receiver_sound_speed"):
        np.testing.assert_array_equal(getattr(found, name), getattr(ARRIVALS, name))
    if rule == "first":
        assert found.to_dataset().identical(ARRIVALS.first().to_dataset())


def test_losses_and_delays_count_before_the_choice():
    loss = np.array([90.0, 70.0, 80.0, 70.0, np.inf, np.nan, 100.0])  # of equals the earliest; NaN is last
    strongest = select(ARRIVALS, "strongest", loss_db=loss)
    np.testing.assert_array_equal(strongest.travel_time, [1.01, 2.0, np.nan, 4.25])
    delay = np.array([0.015, 0.0, 0.0, 0.0, -0.25, 0.0, 0.0])  # the first of link 0 falls behind the second
    first = select(ARRIVALS, "first", delay=delay)
    np.testing.assert_array_equal(first.travel_time, [1.01, 1.75, np.nan, 4.0])
    np.testing.assert_array_equal(choose_arrivals(ARRIVALS, "first", delay=delay).row, [1, 4, 5])


bounces = st.integers(0, 1)
rows = st.tuples(
    st.integers(0, 4), st.sampled_from([1.0, 1.5, 2.0]), bounces, bounces, st.sampled_from([-1.0, 0.0, 4.0])
)


@given(rows=st.lists(rows, max_size=12))
@settings(max_examples=60)
def test_rules_are_the_minima_they_say(rows):
    """Against a search row by row: earliest unbounced, earliest, and least (spreading, time) of each link."""
    rows = sorted(rows, key=lambda r: r[:2])
    status = np.full(5, RayStatus.SHADOW)
    status[[r[0] for r in rows]] = RayStatus.OK
    arrivals = arrivals_of(rows, status)
    for link in range(5):
        own = [r for r in rows if r[0] == link]
        expected = {
            "direct": min((r[1] for r in own if r[2] == r[3] == 0), default=np.nan),
            "first": min((r[1] for r in own), default=np.nan),
            "strongest": min(own, key=lambda r: (r[4], r[1]), default=(0, np.nan))[1],
        }
        for rule, time in expected.items():
            found = select(arrivals, rule)
            np.testing.assert_array_equal(found.travel_time[link], time)
            assert (found.status[link] == RayStatus.OK) == np.isfinite(time)

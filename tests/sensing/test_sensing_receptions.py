"""Receptions of links in both directions: currents, selection, losses, and exchanges of them."""

from dataclasses import replace

import numpy as np
import pytest
from factories import assert_same, make_arrivals

from pymantaray.acoustics import Sonar
from pymantaray.sensing import OneWay, SoundPath, TwoWay
from pymantaray.sensing.exchanges import (
    all_exchanges,
    exchange_times,
    exchange_values,
    selected_exchanges,
)
from pymantaray.sensing.receptions import (
    AlongRays,
    Direction,
    join_receptions,
    receptions_of,
    select_receptions,
    with_detection,
)

LINK = np.array([0, 0, 0, 2])
TIME = np.array([1.0, 1.001, 1.002, 3.0])
SURFACE = np.array([1, 0, 0, 2])
LOSS = np.array([70.0, 80.0, 60.0, 90.0])
DELAY = np.array([0.0, 0.0, -0.004, 0.001])
SONAR = Sonar(source_level_db=170.0, frequency_hz=25e3, bandwidth_hz=1e3, noise=60.0)
AT_REST = AlongRays(None, LOSS)
RNG = np.random.default_rng(3)
SOURCE, RECEIVER = RNG.normal(0.0, 4e-4, (2, 4, 3))


def table(along=AT_REST):
    """
    Receptions of three links, of which the second has none and the third only a reflected one.
    """
    arrivals = make_arrivals(
        LINK,
        travel_time=TIME,
        surface_bounces=SURFACE,
        spreading_db=LOSS - 60.0,
        source_slowness=SOURCE,
        receiver_slowness=RECEIVER,
    )
    return receptions_of(arrivals, along)


def test_a_current_acts_with_opposite_signs_in_both_directions():
    moving, still = table(AlongRays(DELAY, LOSS)), table()
    np.testing.assert_array_equal(moving.travel_time, [*(TIME + DELAY), *(TIME - DELAY)])
    np.testing.assert_array_equal(still.travel_time, [*TIME, *TIME])
    for name in ("link", "path", "arrival", "source_slowness", "receiver_slowness", "loss_db"):
        np.testing.assert_array_equal(*np.split(getattr(moving, name), 2))
    assert moving.path.tolist()[:4] == [
        SoundPath.REFLECTED,
        *[SoundPath.DIRECT] * 2,
        SoundPath.REFLECTED,
    ]


@pytest.mark.parametrize(
    ("rule", "forth", "back"), [("direct", 2, 1), ("first", 2, 0), ("strongest", 2, 2)]
)
def test_each_rule_selects_one_reception_per_link_and_direction(rule, forth, back):
    """The current lets the third arrival overtake forth, and delays it back."""
    rows = select_receptions(
        with_detection(table(AlongRays(DELAY, LOSS)), SONAR), rule
    ).selected_rows(3)
    only_reflected = -1 if rule == "direct" else 3
    np.testing.assert_array_equal(rows[0], [forth, -1, only_reflected])
    np.testing.assert_array_equal(
        rows[1], [4 + back, -1, only_reflected if rule == "direct" else 7]
    )


def test_the_selected_reception_has_the_probability_of_its_detection():
    receptions = select_receptions(with_detection(table(), SONAR), "strongest")
    expected = SONAR.detection_probability(LOSS)
    np.testing.assert_array_equal(receptions.detection, [*expected, *expected])
    np.testing.assert_array_equal(receptions.probability[:4], expected * [0, 0, 1, 1])
    assert (
        select_receptions(table(AlongRays(None, None)), "first").probability[[0, 3]] == 1.0
    ).all()


def test_tables_of_one_direction_join_to_the_table_of_both():
    whole = table()
    parts = [whole.at({"reception": whole.link == k}) for k in (2, 0)]
    assert_same(join_receptions(parts), whole)


def test_exchanges_of_selected_receptions_and_all_combinations():
    """
    Two attempts of the first link, one from either end, one of a link without a reception, and one
    of no link.
    """
    receptions = select_receptions(with_detection(table(), SONAR), "direct")
    link, direction = np.array([0, 0, 1, -1]), np.array([Direction.FORTH, Direction.BACK, 0, 0])
    one = selected_exchanges(receptions, 3, link, direction)
    np.testing.assert_array_equal(one.ping, [1, 5, -1, -1])
    np.testing.assert_array_equal(one.answer, [5, 1, -1, -1])
    p = SONAR.detection_probability(80.0)
    np.testing.assert_array_equal(
        exchange_values(receptions.probability, one, OneWay())[0], [p, p, *[np.nan] * 2]
    )
    attempt, every = all_exchanges(receptions, link, direction, OneWay())
    np.testing.assert_array_equal(attempt, np.repeat([0, 1], 3))
    np.testing.assert_array_equal(every.ping, [0, 1, 2, 4, 5, 6])
    attempt, every = all_exchanges(receptions, link, direction, TwoWay(1.0))
    np.testing.assert_array_equal(attempt, np.repeat([0, 1], 9))
    pairs = {(a, b) for a in (0, 1, 2) for b in (4, 5, 6)}
    assert set(zip(every.ping[:9], every.answer[:9], strict=True)) == pairs
    assert set(zip(every.answer[9:], every.ping[9:], strict=True)) == pairs


def test_the_time_of_an_exchange_follows_the_motion_of_both_ends():
    """
    Fermat: moving an end by v dt changes the travel time by its slowness; one end moves at a time,
    on either side.
    """
    receptions = select_receptions(table(), "direct")
    link = np.zeros(2, dtype=int)
    ends = np.array([Direction.FORTH, Direction.BACK])
    one = selected_exchanges(receptions, 1 + 2, link, ends)
    still, velocity = np.zeros((2, 3)), np.array([[0.3, -0.2, 0.1], [0.5, 0.4, -0.3]])
    t, wait = TIME[1], 2.0
    np.testing.assert_array_equal(exchange_times(receptions, one, TwoWay(wait), (still, still)), t)
    gradient = np.array([-SOURCE[1], RECEIVER[1]])  # of the source's and of the receiver's position
    initiator = exchange_times(receptions, one, TwoWay(wait), (velocity, still)) - t
    np.testing.assert_allclose(
        initiator, 0.5 * (2 * t + wait) * np.sum(gradient * velocity, axis=1), rtol=1e-9
    )
    responder = exchange_times(receptions, one, TwoWay(wait), (still, velocity)) - t
    np.testing.assert_allclose(
        responder, 0.5 * (2 * t + wait) * np.sum(gradient[::-1] * velocity, axis=1), rtol=1e-9
    )
    np.testing.assert_array_equal(
        exchange_times(receptions, one, OneWay(), (velocity, velocity)), t
    )


def test_a_link_without_a_ray_keeps_its_number_in_the_table():
    receptions = select_receptions(replace(table(), path=np.full(8, SoundPath.LEAKED)), "direct")
    assert receptions.selected_rows(3)[0].tolist() == [0, -1, 3]

"""Steps of the authors' program, which are counted many at a time."""

import pytest

from pymantaray.apps.authors.holds import _passed, counted_steps


@pytest.mark.parametrize("limit", [5, 3_000_000])
def test_holds_of_long_dives_are_those_of_single_steps(limit):
    """The sums of many steps have the rounding of one addition after another."""

    def passed(depth, goal, speed, step):
        sign = 1.0 if goal > depth else -1.0
        for count in range(limit + 1):
            if sign * (depth - goal) >= 0.0:
                return depth, count
            moved = depth + min(max(10.0 * (goal - depth), -speed), speed) * step
            if moved == depth:
                return depth, None
            depth = moved
        return depth, limit

    for goal, speed, step in [(700.0, 0.37, 0.005), (37.7, 0.5, 0.1), (1234.5, 0.13, 0.25)]:
        assert _passed(0.01, goal, speed, step, limit) == passed(0.01, goal, speed, step)
    total, count = 0.0, 0
    while total < 5_000.0:
        total, count = total + 0.0011, count + 1
    assert counted_steps(5_000.0, 0.0011) == count

"""The rule that chooses among descents: cost before status, and the best descent is finished."""

from typing import NamedTuple

import numpy as np

from pymantaray.estimation.solvers.descents import choose, lowest


class End(NamedTuple):
    name: str
    cost: float
    converged: bool


def halved(end):
    """A descent that converges at a cost of 1."""
    return End(f"{end.name}+", max(end.cost / 2.0, 1.0), converged=end.cost <= 2.0)


def test_cost_counts_before_status():
    ends = [End("minimum", 54_388.0, converged=True), End("valley", 1568.0, converged=False)]
    assert lowest(ends).name == "valley"


def test_among_equal_costs_a_converged_end_is_first():
    ends = [
        End("a", 10.0, converged=False),
        End("b", 10.000001, converged=True),
        End("c", 10.0, converged=True),
    ]
    assert lowest(ends).name == "b"
    assert (
        lowest([End("a", np.inf, converged=False), End("b", np.inf, converged=False)]).name == "a"
    )


def test_the_best_descent_is_finished_and_no_other():
    best = choose([End("far", 50.0, converged=True), End("near", 8.0, converged=False)], halved)
    assert best == End("near+++", 1.0, converged=True)
    assert choose([End("near", 8.0, converged=True)], halved).name == "near"


def test_a_descent_that_does_not_fall_or_never_converges_ends():
    end = End("stuck", 8.0, converged=False)
    assert choose([end], lambda end: end._replace(cost=9.0)) == end
    assert choose([end], lambda end: end._replace(cost=np.nan)) == end
    assert choose([end], lambda end: end._replace(name=end.name + "+")).name == "stuck" + 8 * "+"

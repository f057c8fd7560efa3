"""The health gate's verdicts."""

from dataclasses import replace

import numpy as np
import pytest

from pymantaray.estimation import SolveOptions
from pymantaray.estimation.gate import Progress, gate
from pymantaray.records import SolveStatus

GOOD = Progress(
    iterations=4,
    initial_cost=900.0,
    final_cost=100.0,
    gradient_norm=1e-3,
    newton_decrement=1e-9,
    last_step=1e-6,
)


@pytest.mark.parametrize(
    ("change", "status"),
    [
        ({}, SolveStatus.OK),
        ({"iterations": 0}, SolveStatus.NO_ITERATION),
        ({"final_cost": 901.0}, SolveStatus.COST_ROSE),
        ({"last_step": 1.0}, SolveStatus.NOT_CONVERGED),
        ({"last_step": np.nan}, SolveStatus.NOT_CONVERGED),
        ({"newton_decrement": 0.1}, SolveStatus.NOT_CONVERGED),
        ({"newton_decrement": np.nan}, SolveStatus.NOT_CONVERGED),
        ({"singular": True}, SolveStatus.FAILED),
        ({"final_cost": np.nan}, SolveStatus.FAILED),
        ({"final_cost": 151.0}, SolveStatus.OVER_CHI_SQUARE),  # expected 100, standard deviation 10
        ({"final_cost": 49.0}, SolveStatus.OVER_CHI_SQUARE),
        ({"final_cost": 149.0}, SolveStatus.OK),
    ],
)
def test_gate_has_a_verdict_for_each_way_to_end(change, status):
    assert gate(replace(GOOD, **change), 200, SolveOptions(), model_is_right=True) == status

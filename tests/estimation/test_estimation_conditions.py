"""Conditions of one realization, the record of all, and bad requests."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from pymantaray.errors import EstimationError
from pymantaray.estimation import CONDITIONS, collect_estimates, dead_reckon, solve_conditions
from pymantaray.records import SolveStatus


def test_refracted_ranges_far_from_the_model_are_a_finding_not_a_failure(make_fleet):
    fleet = make_fleet(seed=1, range_error=30.0, gnss_every=10)
    found = solve_conditions(fleet.noisy, ["straight", "refracted"], (fleet.position, fleet.quaternion))
    assert found["straight"].status == found["refracted"].status == SolveStatus.OK
    assert found["refracted"].final_cost > 5 * found["refracted"].expected_cost


def test_wrong_noise_level_shows_in_the_gate_and_keeps_its_estimate(make_fleet):
    fleet = make_fleet(seed=1, gnss_every=10, n_agents=4)
    sure = replace(fleet.noisy, range_sigma=np.full(fleet.noisy.range_sigma.size, 0.1))
    solution = solve_conditions(sure, ["straight"])["straight"]
    assert solution.status == SolveStatus.OVER_CHI_SQUARE
    assert np.isfinite(solution.position).all()


def test_estimates_hold_every_condition_and_realization(make_fleet):
    runs = [make_fleet(seed=s, n_agents=2, n_times=12, n_landmarks=1, gnss_every=5) for s in (0, 1)]
    solved = [solve_conditions(r.noisy, list(CONDITIONS)) for r in runs]
    estimates = collect_estimates(runs[0].noisy, solved)
    assert estimates.condition.tolist() == list(CONDITIONS)
    assert estimates.position.shape == (len(CONDITIONS), 2, 2, 12, 3)
    assert estimates.landmark_position.shape == (len(CONDITIONS), 2, 1, 3)
    np.testing.assert_array_equal(estimates.position[0, 1], dead_reckon(runs[1].noisy)[0])
    assert np.isnan(estimates.final_cost[0]).all()
    assert np.isfinite(estimates.final_cost[1:]).all()
    with pytest.raises(EstimationError, match="realization 1 has conditions"):
        collect_estimates(runs[0].noisy, [solved[0], {"odometry": solved[1]["odometry"]}])
    with pytest.raises(EstimationError, match="at least one"):
        collect_estimates(runs[0].noisy, [])


def test_bad_requests_are_refused(fleet):
    with pytest.raises(EstimationError, match="unknown condition 'bent'; allowed are odometry"):
        solve_conditions(fleet.noisy, ["bent"])
    with pytest.raises(
        EstimationError, match="starting point has 30 poses and 0 landmarks; the graph has 90 and 0"
    ):
        solve_conditions(fleet.noisy, ["straight"], (fleet.position[:1], fleet.quaternion[:1]))
    lost = np.array(fleet.position)
    lost[1, 3] = np.nan
    with pytest.raises(EstimationError, match=r"^B3: starting point is not finite"):
        solve_conditions(fleet.noisy, ["straight"], (lost, fleet.quaternion))


def test_importing_the_package_does_not_load_the_solver():
    code = "import sys, pymantaray.estimation; sys.exit('gtsam' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0

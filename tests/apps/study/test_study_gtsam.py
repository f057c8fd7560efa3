"""A study that is solved by GTSAM's optimizer instead of the batch solver."""

import json

import numpy as np


def test_a_study_by_gtsam_has_the_same_tables(tiny_run, run_tiny):
    """Positions are within 1 mm; the manifest and the table of costs have the distances."""
    names = ["odometry", "straight", "refracted"]
    ours, theirs = tiny_run, run_tiny(conditions=names, solver="gtsam")
    assert theirs.estimates.condition.tolist() == names
    same = np.flatnonzero(np.isin(ours.estimates.condition, names))
    assert ours.estimates.condition[same].tolist() == names
    np.testing.assert_array_equal(theirs.estimates.solve_status, ours.estimates.solve_status[same])
    apart = np.linalg.norm(theirs.estimates.position - ours.estimates.position[same], axis=-1).max(
        axis=(1, 2, 3)
    )
    rounding = np.sqrt(3.0) * 0.8e-3  # of two positions in files
    told = json.loads((theirs.path / "manifest.json").read_text())["from_batch_m"]
    assert sorted(told) == ["refracted", "straight"]
    distances = [max(told[n]) for n in ("straight", "refracted")]
    assert max(distances) < 1e-3
    assert apart[0] == 0.0
    np.testing.assert_allclose(distances, apart[1:], atol=rounding)
    costs = theirs.tables["costs"].frame.set_index("condition")["from_batch_m"]
    assert costs["straight"] == max(told["straight"])
    assert "from_batch_m" not in ours.tables["costs"].frame
    for name in ("ate_pooled", "ping_error"):
        frames = [run.tables[name].frame.set_index("condition") for run in (ours, theirs)]
        numbers = [frame.loc[frames[1].index].select_dtypes("number") for frame in frames]
        np.testing.assert_allclose(*numbers, atol=1e-3)

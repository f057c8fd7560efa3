"""Table of the links that fans of several widths lose, beside runs with such fans."""

import numpy as np

from pymantaray.config.load import load_study
from pymantaray.evaluation import dropout_table
from pymantaray.study.manifest import Stopwatch
from pymantaray.study.mission import simulate_mission
from pymantaray.study.store import run_in_memory


def quick_run(**changes):
    config = load_study("quick").with_(**changes)
    return run_in_memory(config, simulate_mission(config, Stopwatch(), lambda *_: None))


def test_table_has_the_dropouts_of_studies_with_these_fans():
    narrow = quick_run(**{"acoustics.cone_deg": 4.0})
    table = narrow.tables["cone"].frame
    own = dropout_table(narrow.measurements, narrow.truth)
    free = quick_run(**{"acoustics.cone_deg": "none"})
    without = dropout_table(free.measurements, free.truth)
    assert own["percent"].iloc[-1] > without["percent"].iloc[-1] + 5.0
    np.testing.assert_array_equal(table["fan_4_deg_percent"], own["percent"])
    np.testing.assert_array_equal(table["all_angles_percent"], without["percent"])
    names = ["all_angles_percent", "fan_30_deg_percent", "fan_15_deg_percent", "fan_4_deg_percent"]
    assert list(table) == ["category", "attempts", *names]
    assert (np.diff(table[names], axis=1) >= 0.0).all()
    assert "paper" not in " ".join(table)

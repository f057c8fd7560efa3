"""A study with a sensor whose factors PyFG text cannot hold."""

import numpy as np

from pymantaray.apps.study import run_study
from pymantaray.estimation import FactorGraph


def test_a_graph_that_text_cannot_hold_is_saved_as_netcdf(tiny, tmp_path, as_stored):
    levels = {"altimeter_sigma": 0.05, "altimeter_reach": 1e4}
    run = run_study(tiny(study={"realizations": 1}, noise=levels), tmp_path / "run", workers=1)
    files = sorted((run.path / "pyfg").iterdir())
    assert {file.suffix for file in files} == {".nc"}
    factors = FactorGraph.load(files[0])["altimeter"]
    noisy = run.noisy_measurements(0)
    assert len(factors) == run.truth.status.size
    np.testing.assert_array_equal(factors.column("depth"), noisy.altimeter_depth)
    as_stored({"noisy": noisy, "tables": run.tables["ate_pooled"].frame})

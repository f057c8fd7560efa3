"""Water and clocks estimated with the poses, from the configuration to the run folder."""

import numpy as np
import pytest

from pymantaray.config.door.beliefs import Beliefs
from pymantaray.config.estimators import ModesSection
from pymantaray.errors import OceanError

EXACT = {"kind": "exact"}
OFFSET = 1e-3


@pytest.fixture(scope="module")
def run(run_tiny):
    modes = {"count": 3, "rms": 1.0, "down_to": 300.0}
    return run_tiny(
        landmarks=[],  # nobody keeps the time
        noise={"clock_offset_sigma": OFFSET, "clock_skew_sigma": 1e-8},
        conditions=[
            "straight",
            {"name": "e0", "range_model": {"kind": "eigenray", "belief": "mean", "modes": modes}},
            {"name": "e1", "range_model": {"kind": "eigenray", "belief": EXACT}, "clocks": {}},
            {"name": "e2", "range_model": {"kind": "eigenray", "belief": "mean"}},
        ],
    )


def test_study_finds_water_and_clocks_and_keeps_the_truth_beside_them(run, as_stored):
    as_stored(run.unknowns)
    names = ("unknowns", "unknowns_directions", "ate_pooled", "consistency")
    as_stored({name: run.tables[name].frame for name in names}, name="tables")
    u, n = run.unknowns, run.truth.name.size
    assert u.condition.tolist() == ["e0", "e1"]
    assert u.name[:3].tolist() == ["mode 1", "mode 2", "mode 3"]
    assert np.isfinite(u.prior_sigma).sum(axis=1).tolist() == [3, 2 * n]
    assert np.isnan(u.value[1, :, :3]).all()
    assert np.isnan(u.covariance[1, :, :3]).all()
    truth = u.truth[1, :, 3:]
    sigma = np.sqrt(np.diagonal(u.covariance[1], axis1=1, axis2=2))[:, 3:]
    assert 0.3 < np.std(truth[:, :n]) / OFFSET < 3.0
    assert np.all(np.abs(u.value[1, :, 3:] - truth) < 5.0 * sigma)
    # of clocks only the differences are seen: no landmark keeps the time
    offsets = u.covariance[1, 0, 3 : 3 + n, 3 : 3 + n] / OFFSET**2
    mean = np.full(n, 1.0 / n)
    assert mean @ offsets @ mean == pytest.approx(1.0 / n, rel=1e-3)
    apart = np.eye(n)[0] - np.eye(n)[1]
    assert apart @ offsets @ apart < 0.05 * 2.0  # of two offsets' prior
    wrong = run.config.conditions[1].modes.model_copy(update={"count": 99})
    with pytest.raises(OceanError, match="count is 99, but only"):
        Beliefs(run).modes(wrong)


def test_modes_of_casts_are_scaled_as_those_of_the_ocean(run, tmp_path, as_stored):
    z = np.arange(0.0, 1001.0, 5.0)
    files = []
    for i, warm in enumerate((0.0, 1.0, 2.5)):
        file = tmp_path / f"cast{i}.csv"
        temperature = -1.0 + warm * np.exp(-z / 150.0)
        rows = "\n".join(f"{d:g},{t:.5f},34.5" for d, t in zip(z, temperature, strict=True))
        file.write_text(f"# lat 75.0, lon -140.0\ndepth_m,temperature_c,salinity\n{rows}\n")
        files.append(str(file))
    depth, shapes, sigma = Beliefs(run).modes(
        ModesSection.model_validate({"count": 1, "rms": 2.0, "down_to": 300.0, "casts": files})
    )
    as_stored([shapes, sigma])
    assert shapes.shape == (1, depth.size)
    fine = np.linspace(0.0, 300.0, 301)
    assert sigma[0] * np.sqrt(np.mean(np.interp(fine, depth, shapes[0]) ** 2)) == pytest.approx(
        2.0, rel=0.05
    )
    # warmest at the top, as the casts differ
    assert np.argmax(shapes[0]) == 0

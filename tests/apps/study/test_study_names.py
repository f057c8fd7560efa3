"""Fleets of any size whose vehicles have names of any length, through the whole program."""

import gzip
import json

import numpy as np
import pytest

from pymantaray.apps.study import write_report
from pymantaray.cli.main import main
from pymantaray.estimation import read_pyfg

NAMES = [f"glider-of_the-northern_fleet-{i:02d}" for i in range(30)]


@pytest.fixture(scope="module")
def run(run_tiny):
    """Stations in a grid and a landmark."""
    stations = [
        {
            "name": name,
            "kind": "station",
            "north": 700.0 * (i // 6),
            "east": 900.0 * (i % 6),
            "depth": 20.0 + 10.0 * i,
        }
        for i, name in enumerate(NAMES)
    ]
    buoy = {"name": "buoy_of-the_north", "north": 4000.0, "east": 4000.0, "depth": 500.0}
    study = {"realizations": 1}
    conditions = ["odometry", "straight"]
    return run_tiny(
        study=study,
        conditions=conditions,
        mission={"duration_h": 1.0},
        fleet={"vehicles": stations},
        landmarks=[buoy],
    )


def test_thirty_vehicles_with_long_names_run_and_go_to_a_graph_file(run, tmp_path, capsys):
    assert run.truth.name.tolist() == run.estimates.name.tolist() == NAMES
    file = run.path / "pyfg/realization-0-straight.pyfg.gz"
    assert gzip.decompress(file.read_bytes()).split()[2].decode() == "AA0"
    graph, values = read_pyfg(file)
    assert (graph.vehicle_name.tolist(), graph.landmark_name.tolist()) == (
        NAMES,
        ["buoy_of-the_north"],
    )
    np.testing.assert_allclose(values.position, run.truth.position.reshape(-1, 3), rtol=1e-11)
    with pytest.raises(SystemExit) as end:
        main(["graph", "solve", str(file), "--out", str(tmp_path / "solved")])
    assert end.value.code == 0
    printed = capsys.readouterr().out
    assert "…" not in printed
    assert (tmp_path / f"solved/estimate-{NAMES[29]}.tum").is_file()
    summary = json.loads((tmp_path / "solved/summary.json").read_text())
    assert summary["trajectory_error"][NAMES[0]]["n"] == 19
    labels = run.plot.error_by_vehicle().get_xticklabels()
    assert {label.get_rotation() for label in labels} == {90.0}, "thirty names are upright"


@pytest.mark.slow
def test_thirty_vehicles_with_long_names_are_reported(run):
    write_report(run.path)
    tables = run.path / "index.html", run.path / "tables/ate_per_vehicle.csv"
    assert all(NAMES[29] in path.read_text() for path in tables)

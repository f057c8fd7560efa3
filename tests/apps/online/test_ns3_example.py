"""
The example for ns-3: the same network with a constant sound speed and with a travel-time table.
"""

import csv
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from pymantaray import open_water
from pymantaray.acoustics import find_eigenrays
from pymantaray.apps.table import build_table, save_table
from pymantaray.apps.table.file import c_header
from pymantaray.records import RayStatus

EXAMPLE = Path(__file__).parents[3] / "examples" / "ns3" / "table_network.cc"
LIBRARIES = ("ns3-uan", "ns3-mobility", "ns3-network", "ns3-core")
POSITIONS = np.array(
    [[0.0, 0.0, 150.0], [2000.0, 500.0, 120.0], [-1500.0, 2500.0, 700.0], [3500.0, -1500.0, 30.0]]
)
PROFILE = "depth_m,sound_speed\n0,1487\n20,1486\n40,1478\n80,1466\n150,1461\n300,1462\n1000,1471\n"


def _flags() -> list[str]:
    """Options of the compiler for ns-3; skip the test without ns-3."""
    if shutil.which("g++") is None or shutil.which("pkg-config") is None:
        pytest.skip("no C++ compiler or no pkg-config")
    found = subprocess.run(
        ["pkg-config", "--cflags", "--libs", *LIBRARIES],
        capture_output=True,
        text=True,
        check=False,
    )
    if found.returncode != 0 or not Path("/usr/include/gsl").is_dir():
        pytest.skip("no ns-3: install libns3-dev and libgsl-dev")
    return found.stdout.split()


@pytest.mark.slow
def test_network_has_the_delays_and_the_shadows_of_the_solver(tmp_path: Path) -> None:
    flags = _flags()
    (tmp_path / "profile.csv").write_text(PROFILE)
    water = open_water(str(tmp_path / "profile.csv"), bathymetry=1000.0)
    table = build_table(water, (10.0, 900.0), (10.0, 900.0), (50.0, 6000.0), tolerance=3.0)
    save_table(table, tmp_path / "table.mtt")
    (tmp_path / "mantaray_table.h").write_text(c_header())
    program = tmp_path / "table_network"
    command = ["g++", "-std=c++17", f"-I{tmp_path}", str(EXAMPLE), "-o", str(program), *flags]
    subprocess.run(command, check=True, cwd=tmp_path)
    done = subprocess.run(
        [program, "table.mtt"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    rows = list(csv.DictReader(done.stdout.splitlines()))
    assert len(rows) == 12
    ends = np.array([[int(row["from"]), int(row["to"])] for row in rows])
    medium, _ = water.at_start
    found = find_eigenrays(medium, POSITIONS[ends[:, 0]], POSITIONS[ends[:, 1]]).first()
    lost = np.array([row["table_s"] == "lost" for row in rows])
    np.testing.assert_array_equal(lost, found.status != RayStatus.OK)
    assert 0 < lost.sum() < lost.size
    # both runs add the same duration of the packet to the delay
    straight = np.linalg.norm(np.diff(POSITIONS[ends], axis=1)[:, 0], axis=1)
    difference = np.array([float(row["difference_ms"] or "nan") for row in rows]) * 1e-3
    expected = found.travel_time - straight / 1500.0
    np.testing.assert_allclose(difference[~lost], expected[~lost], atol=5e-4)

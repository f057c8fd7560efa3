"""TUM text as evo reads it."""

import numpy as np
import pytest

from pymantaray.errors import ExchangeError, MantaRayError
from pymantaray.estimation import read_pyfg
from pymantaray.exchange import read_trajectories, write_graph_tum, write_tum
from pymantaray.geometry.se3 import quaternion_from_matrix, so3_exp


@pytest.fixture
def trajectory():
    rng = np.random.default_rng(0)
    return (
        np.arange(20) * 200.0,
        rng.normal(0, 1e4, (20, 3)),
        quaternion_from_matrix(so3_exp(rng.normal(0, 1, (20, 3)))),
    )


def test_evo_reads_back_every_digit(tmp_path, trajectory):
    file_interface = pytest.importorskip("evo.tools.file_interface")
    time, position, quaternion = trajectory
    write_tum(tmp_path / "a.tum", time, position, quaternion)
    read = file_interface.read_tum_trajectory_file(tmp_path / "a.tum")
    np.testing.assert_array_equal(read.timestamps, time)
    np.testing.assert_array_equal(read.positions_xyz, position)
    np.testing.assert_array_equal(read.orientations_quat_wxyz, quaternion)
    assert read.check()[0]
    assert [p.name for p in tmp_path.iterdir()] == ["a.tum"]


def test_trajectory_that_is_none_is_refused_and_leaves_nothing(tmp_path, trajectory):
    time, position, quaternion = trajectory
    lost = position.copy()
    lost[4] = np.nan
    with pytest.raises(MantaRayError, match="pose 4 is not finite"):
        write_tum(tmp_path / "a.tum", time, lost, quaternion)
    with pytest.raises(MantaRayError, match=r"they must be \(n,\), \(n, 3\) and \(n, 4\)"):
        write_tum(tmp_path / "a.tum", time[:-1], position, quaternion)
    assert list(tmp_path.iterdir()) == []


GRAPH = [
    "VERTEX_SE3:QUAT 5 A1 1 0 0 0 0 0 1",
    "VERTEX_SE3:QUAT 0 A0 0 0 0 0 0 0 1",
    "VERTEX_SE3:QUAT 0 C4 9 8 7 0 0 0.6 0.8",
]  # poses out of order, as a foreign graph may have them


@pytest.mark.parametrize(
    ("lines", "names"), [(GRAPH, ["run-A.tum", "run-C.tum"]), (GRAPH[:2], ["run.tum"])]
)
def test_each_vehicle_of_a_graph_gets_a_file_in_order_of_its_poses(tmp_path, lines, names):
    file_interface = pytest.importorskip("evo.tools.file_interface")
    (tmp_path / "g.pyfg").write_text("\n".join([*lines, ""]))
    files = write_graph_tum(tmp_path / "run.tum", *read_pyfg(tmp_path / "g.pyfg"))
    assert [f.name for f in files] == names
    read = [file_interface.read_tum_trajectory_file(file) for file in files]
    assert read[0].timestamps.tolist() == [0.0, 5.0]
    assert read[0].positions_xyz[:, 0].tolist() == [0.0, 1.0]
    if len(read) == 2:
        assert read[1].orientations_quat_wxyz[0].tolist() == [0.8, 0.0, 0.0, 0.6]


@pytest.mark.parametrize(("word", "message"), [
    ("1_000", "1 line left out, not readable"),
    ("99999", "depth 99999 m of pose 3 is below any sea"),
])  # fmt: skip
def test_a_word_that_is_no_depth_is_no_pose(tmp_path, word, message):
    rows = [f"{k} {k} 0 {word if k == 3 else 50} 0 0 0 1" for k in range(9)]
    (tmp_path / "a.tum").write_text("\n".join(rows))
    try:
        (said,) = read_trajectories(tmp_path / "a.tum").notes
    except ExchangeError as error:
        said = str(error)
    assert message in said

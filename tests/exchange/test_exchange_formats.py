"""
Text of other programs by content: TUM, EuRoC and KITTI; units of time; trajectories that are one
vehicle.
"""

import numpy as np
import pytest
from refusals import refused
from scipy.spatial.transform import Rotation

from pymantaray.apps.locate import read_survey
from pymantaray.errors import ExchangeError, MantaRayError
from pymantaray.exchange import read_trajectories
from pymantaray.exchange.kitti import write_kitti

TURN = Rotation.from_euler("ZYX", [[0.1, 0.2, 0.3], [1.0, -0.4, 0.0], [-2.0, 0.1, 0.2]])
PLACE = np.array([[0.0, 0.0, 10.0], [1.5, -2.0, 11.0], [3.0, 0.5, 12.0]])
W_FIRST, W_LAST = TURN.as_quat(scalar_first=True), TURN.as_quat()
NANOSECONDS = 1403715529112143517 + 10**9 * np.arange(3)
EUROC = ("#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [],"
         " q_RS_z [], v_RS_R_x [m s^-1]\n")  # fmt: skip


def rows(*columns, separator=" "):
    return "".join(separator.join(map(str, row)) + "\n" for row in zip(*columns, strict=True))


def tum(times, separator=" "):
    return rows(times, *PLACE.T, *W_LAST.T, separator=separator)


def euroc():
    return EUROC + rows(NANOSECONDS, *PLACE.T, *W_FIRST.T, np.zeros(3), separator=",")


def kitti(folder, name="a.txt", times="a_times.txt"):
    matrix = np.concatenate([TURN.as_matrix(), PLACE[:, :, None]], axis=2).reshape(3, 12)
    (folder / name).write_text(rows(*matrix.T))
    (folder / times).write_text("0.0\n1.0\n2.0\n")
    return folder / name


@pytest.mark.parametrize(("name", "text"), [
    ("a.tum", tum([0, 1, 2])), ("a.txt", tum([0, 1, 2])), ("a.csv", tum([0, 1, 2], ",")),
    ("a.txt", "# comment\n" + tum([5, 6, 7])),
    ("data.csv", euroc()),
])  # fmt: skip
def test_poses_are_read_by_content(tmp_path, name, text, as_stored):
    (tmp_path / name).write_text(text)
    (poses,) = read_trajectories(tmp_path / name).poses
    np.testing.assert_array_equal(poses.time, [0.0, 1.0, 2.0])
    np.testing.assert_allclose(poses.place, PLACE)
    np.testing.assert_allclose(poses.quaternion, W_FIRST, atol=1e-12)
    as_stored(poses)


def test_euroc_has_dates_and_axes_of_ros_on_request(tmp_path, as_stored):
    (tmp_path / "data.csv").write_text(euroc())
    tracks = read_trajectories(tmp_path / "data.csv")
    assert tracks.start == np.datetime64("2014-06-25T16:58:49.112143517")  # date -u -d @1403715529
    up = read_trajectories_enu(tmp_path / "data.csv", euroc().replace(",10.0,", ",-10.0,"))
    np.testing.assert_allclose(up.place[0], [0.0, 0.0, 10.0])
    (tmp_path / "data.csv").write_text(euroc().replace("1403715529112143517,", "1403715529.112,"))
    notes = read_trajectories(tmp_path / "data.csv").notes
    assert "1 line left out, not readable: line 2: not a pose of EuRoC" in notes[0]
    as_stored(tracks)


def read_trajectories_enu(path, text):
    lines = text.splitlines()
    path.write_text(
        "\n".join([lines[0], lines[1], lines[1].replace("1403715529", "1403715530")]) + "\n"
    )
    return read_trajectories(path, enu=True).poses[0]


@pytest.mark.parametrize(
    ("name", "times"),
    [("a.txt", "a_times.txt"), ("a.txt", "times.txt"), ("truth-a.txt", "times-a.txt")],
)
def test_kitti_takes_the_times_beside_it(tmp_path, name, times, as_stored):
    (poses,) = read_trajectories(kitti(tmp_path, name, times)).poses
    np.testing.assert_array_equal(poses.time, [0.0, 1.0, 2.0])
    np.testing.assert_allclose(poses.place, PLACE)
    np.testing.assert_allclose(
        poses.quaternion, np.sign(poses.quaternion[:, :1] * W_FIRST[:, :1]) * W_FIRST, atol=1e-12
    )
    write_kitti(tmp_path / "truth-b.txt", PLACE, W_FIRST)
    (tmp_path / times).rename(tmp_path / "times-b.txt")
    np.testing.assert_allclose(read_trajectories(tmp_path / "truth-b.txt").poses[0].place, PLACE)
    as_stored(poses)


def test_kitti_without_times_or_rotations_is_refused(tmp_path):
    path = kitti(tmp_path)
    refused(
        ExchangeError, "1 number per row and no header", read_trajectories, tmp_path / "a_times.txt"
    )
    (tmp_path / "a_times.txt").write_text("0\n1\n")
    refused(ExchangeError, "2 times, but a.txt has 3 poses", read_trajectories, path)
    (tmp_path / "a_times.txt").unlink()
    refused(
        ExchangeError,
        "poses of KITTI have no times; put them, one per line, into a_times.txt",
        read_trajectories,
        path,
    )
    (tmp_path / "times.txt").write_text("0\n1\n2\n")
    path.write_text(
        path.read_text().replace("10.0", "10.0 ").replace(str(TURN.as_matrix()[0, 0, 0]), "0.5")
    )
    refused(ExchangeError, "pose 0 has no rotation matrix", read_trajectories, path)
    (tmp_path / "b.csv").write_text("0,1,2\n3,4,5\n")
    refused(
        ExchangeError,
        "3 numbers per row and no header; a table needs",
        read_trajectories,
        tmp_path / "b.csv",
    )


@pytest.mark.parametrize(
    ("factor", "unit"), [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")]
)
def test_times_in_other_units_are_refused(tmp_path, factor, unit):
    times = [int(factor * (1403715529 + k)) for k in range(3)]
    (tmp_path / "a.tum").write_text(tum(times))
    (tmp_path / "a.csv").write_text(
        "time,north,east,depth\n" + rows(times, *PLACE.T, separator=",")
    )
    (tmp_path / "survey.csv").write_text(
        "time,node,two_way_time_s,north_m,east_m\n"
        + rows(times, ["A"] * 3, [1, 1, 1], [0, 1, 2], [0, 0, 0], separator=",")
    )
    kitti(tmp_path, "k.txt", "k_times.txt")
    (tmp_path / "k_times.txt").write_text(rows(times))
    for name in ("a.tum", "a.csv", "k.txt"):
        refused(ExchangeError, f"looks like {unit} since 1970", read_trajectories, tmp_path / name)
    refused(MantaRayError, f"looks like {unit} since 1970", read_survey, tmp_path / "survey.csv")
    seconds = tum([t / factor for t in times])
    (tmp_path / "a.tum").write_text(seconds)
    assert read_trajectories(tmp_path / "a.tum").duration == 2.0


def test_one_of_two_trajectories_of_a_vehicle_is_selected_with_a_note(tmp_path):
    east = np.arange(0.0, 100.0, 10.0)
    text = "time,vehicle,north,east,depth\n"
    for name, north, first in (("odom", 0.0, 0.0), ("amcl", 3.0, 0.0), ("other", 50.0, 5.0)):
        text += "".join(f"{first + t},{name},{north},{x},20\n" for t, x in enumerate(east))
    (tmp_path / "a.csv").write_text(text)
    tracks = read_trajectories(tmp_path / "a.csv")
    (note,) = tracks.notes
    assert (
        "odom and amcl are always within 3 m; if they are two estimates of one vehicle, select one"
        in note
    )
    chosen = read_trajectories(tmp_path / "a.csv", names=["odom", "other"])
    assert (chosen.names, chosen.notes) == (["odom", "other"], ())
    assert read_trajectories(tmp_path / "a.csv", names=["other"]).poses[0].time[0] == 0.0
    refused(
        ExchangeError,
        "no trajectory of x; available: odom, amcl, other",
        read_trajectories,
        tmp_path / "a.csv",
        names=["x"],
    )

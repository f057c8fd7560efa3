"""
The ROS 1 example, on loopback: the ranges that the node publishes are those that `mantaray ranges`
computes from the same bag.
"""

import os
import shutil
import signal
import socket
import subprocess
import sys
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pytest
from pages import ROOT

from pymantaray.apps.study import open_run

PYTHON = "/usr/bin/python3"
"""Python of the system, for which distributions package ROS 1."""
pytestmark = [pytest.mark.slow, pytest.mark.network]


def missing():
    """What the test lacks on this machine; empty if it can run."""
    if shutil.which("roscore") is None:
        return "roscore is not installed"
    modules = "import rospy, rosbag, nav_msgs.msg, sensor_msgs.msg, std_msgs.msg"
    done = subprocess.run([PYTHON, "-c", modules], capture_output=True, check=False)
    return f"{PYTHON} has no rospy, rosbag and messages" if done.returncode else ""


@contextmanager
def running(*words, folder, env):
    """
    A process in the background, with its output in a file; it is stopped with all its children.
    """
    log = folder / f"{Path(words[1]).stem}.log"
    with log.open("w") as out:
        process = subprocess.Popen(
            [str(word) for word in words],
            cwd=folder,
            env=env,
            stdout=out,
            stderr=out,
            start_new_session=True,
        )
        try:
            yield log
        finally:
            os.killpg(process.pid, signal.SIGTERM)
            process.wait()


def free_port():
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]


def ranges_in(bag):
    """Ranges of a bag by transmitter, receiver and minute of the ping; infinite if lost."""
    rosbags = pytest.importorskip("rosbags.highlevel", reason="needs the extra ros")
    found = {}
    with rosbags.AnyReader([bag]) as reader:
        for connection, _, raw in reader.messages():
            if connection.topic.endswith("/range"):
                message = reader.deserialize(raw, connection.msgtype)
                minute = round((message.header.stamp.sec - 1000) // 60)
                found[message.header.frame_id, connection.topic.split("/")[1], minute] = (
                    message.range
                )
    return found


@pytest.mark.filterwarnings("default")
def test_a_node_answers_pings_and_its_bag_gives_the_same_ranges(tmp_path):
    if missing():
        pytest.skip(missing())
    master = free_port()
    env = os.environ | {
        "ROS_MASTER_URI": f"http://127.0.0.1:{master}",
        "ROS_IP": "127.0.0.1",
        "ROS_LOG_DIR": str(tmp_path / "log"),
    }
    server = "import sys; from pymantaray.__main__ import main; sys.argv[1:] = {}; main()"
    command = server.format(["serve", "synthetic:beaufort", "--port", "0"])
    with ExitStack() as stack:
        stack.enter_context(
            running(shutil.which("roscore"), "-p", master, folder=tmp_path, env=env)
        )
        (tmp_path / "serve.py").write_text(command)
        log = stack.enter_context(
            running(sys.executable, tmp_path / "serve.py", folder=tmp_path, env=env)
        )
        wait_for = f"while ! grep -q 'listening on' {log}; do sleep 0.5; done"
        subprocess.run(["sh", "-c", wait_for], check=True, timeout=600)
        port = log.read_text().rpartition(":")[2].split()[0]
        node = ROOT / "examples" / "ros1_ranging.py"
        stack.enter_context(running(PYTHON, node, *"ABC", "--port", port, folder=tmp_path, env=env))
        mission = [PYTHON, str(ROOT / "examples" / "ros1_mission.py"), "own.bag"]
        subprocess.run(mission, cwd=tmp_path, env=env, check=True, timeout=600)
    words = [
        "ranges",
        "own.bag",
        "--ocean",
        "synthetic:beaufort",
        "--interval",
        "1 min",
        "--out",
        "again",
    ]
    (tmp_path / "ranges.py").write_text(server.format(words))
    subprocess.run(
        [sys.executable, "ranges.py"], cwd=tmp_path, check=True, timeout=600, capture_output=True
    )
    again = open_run(tmp_path / "again").ranges()
    published = ranges_in(tmp_path / "own.bag")
    assert len(published) == len(again) == 30
    lost = 0
    for row in again.itertuples():
        value = published[row.transmitter, row.receiver, round(row.time / 60.0)]
        lost += np.isinf(value)
        assert np.isnan(row.refracted_range) == np.isinf(value)
        assert (
            np.isinf(value) or abs(value - row.refracted_range) < 1e-3
        )  # m; the message has 24 bits
    assert 0 < lost < 30

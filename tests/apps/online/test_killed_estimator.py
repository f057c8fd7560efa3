"""
A process that is killed in mid-mission and starts again from its file continues on the same track.
"""

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from onboard import BEACONS, SPEED, START, feed, mission

from pymantaray.apps.online import OnlineEstimator

SECONDS, LAG, SAVE = 900.0, 10.0, 25  # s, s, calls between two files
TESTS = Path(__file__).parents[2]
# the vehicle's program: it begins, or continues from the file, and reads its log from the start of
# the history
PROGRAM = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from onboard import BEACONS, SPEED, START, feed, mission
from pymantaray.apps.online import OnlineEstimator
state, seconds, lag, save = Path(sys.argv[2]), *map(float, sys.argv[3:6])
calls, _ = mission(seconds)
if state.exists():
    estimator = OnlineEstimator.restore(state, SPEED)
    calls = [call for call in calls if call[1][0] > estimator.pose().time - lag]
else:
    estimator = OnlineEstimator(START, BEACONS, SPEED, lag=lag)
for k in range(0, len(calls), int(save)):
    feed(estimator, calls[k : k + int(save)])
    estimator.save(state)
    print(estimator.pose().time, flush=True)
"""


def run_until(state: Path, time: float) -> None:
    """Run the vehicle's program, and kill it at some moment after its file has reached a time."""
    command = [
        sys.executable,
        "-c",
        PROGRAM,
        str(TESTS),
        str(state),
        str(SECONDS),
        str(LAG),
        str(SAVE),
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if float(line) > time:
                process.kill()
                break
    assert process.returncode == -signal.SIGKILL, "the program was killed and did not end by itself"


@pytest.mark.slow
def test_a_killed_estimator_continues_on_the_same_track(tmp_path: Path) -> None:
    state = tmp_path / "state.json"
    calls, _ = mission(SECONDS)
    whole = OnlineEstimator(START, BEACONS, SPEED, lag=LAG)
    track = {}
    for call in calls:
        feed(whole, [call])
        if call[0] == "odometry":
            track[call[1][0]] = whole.position()
    for time in (100.0, 250.0, 400.0):
        run_until(state, time)
    last = OnlineEstimator.restore(state, SPEED)
    begin = last.pose().time
    assert 400.0 < begin < SECONDS - 100.0, "killed in mid-mission"
    for call in calls:
        if call[1][0] > begin - LAG:
            feed(last, [call])
            if call[0] == "odometry" and call[1][0] > begin:
                np.testing.assert_array_equal(last.position(), track[call[1][0]])
    for one, other in zip(last.pose(), whole.pose(), strict=True):
        np.testing.assert_array_equal(one, other)

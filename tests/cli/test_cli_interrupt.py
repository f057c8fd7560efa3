"""Ctrl-C and a request to stop, in the middle of a run: the process ends and nothing is left behind."""

import signal
import subprocess
import sys
import time

import pytest


@pytest.mark.slow
@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
@pytest.mark.parametrize("workers", ["1", "2"])
def test_interrupted_run_leaves_nothing(tmp_path, sent, code, workers):
    command = [sys.executable, "-c", "from pymantaray.cli.main import main; main()"]
    words = [
        "study",
        "run",
        "quick",
        "--realizations",
        "40",
        "--workers",
        workers,
        "--out",
        str(tmp_path / "run"),
    ]
    process = subprocess.Popen(command + words, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
    deadline = time.monotonic() + 60.0
    while not list(tmp_path.iterdir()):  # until the run has begun
        assert time.monotonic() < deadline
        time.sleep(0.05)
    time.sleep(3.0)  # into its work
    assert process.poll() is None
    process.send_signal(sent)
    _, printed = process.communicate(timeout=120)
    assert process.returncode == code, printed
    assert "Traceback" not in printed
    assert list(tmp_path.iterdir()) == []

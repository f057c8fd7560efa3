"""Ctrl-C and a request to stop, in the middle of a run: the process ends and nothing is left behind."""

import os
import pty
import re
import select
import signal
import subprocess
import sys
import time

import pytest

from pymantaray.cli.main import main


@pytest.fixture
def begin():
    """Start a process; one that is still there when the test ends, because it failed, is killed."""
    begun = []

    def one(words, **options):
        command = [sys.executable, "-c", "from pymantaray.cli.main import main; main()"]
        begun.append(subprocess.Popen(command + words, stdout=subprocess.DEVNULL, **options))
        return begun[-1]

    yield one
    for process in begun:
        process.kill()
        process.wait()


STOPS = pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
COUNTED = re.compile(r"rays\D*?(\d+)/(\d+)")  # the bar of the stage, on a terminal


@pytest.mark.slow
@STOPS
@pytest.mark.parametrize("workers", ["1", "2"])
def test_interrupted_run_leaves_nothing(tmp_path, begin, sent, code, workers):
    words = f"study run quick --realizations 40 --workers {workers} --out".split()
    process = begin([*words, str(tmp_path / "run")], stderr=subprocess.PIPE, text=True)
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


def shown(terminal):
    """What came to a terminal within a moment, without its colours and movements."""
    if not select.select([terminal], [], [], 0.1)[0]:
        return ""
    try:
        text = os.read(terminal, 65536).decode(errors="replace")
    except OSError:  # nobody writes to it any more
        return ""
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text)


@pytest.mark.slow
@STOPS
def test_interrupt_among_the_rays_is_prompt_and_leaves_nothing(tmp_path, begin, small_text, sent, code):
    """The bar counts links; in the middle of them a block of links is waited for, no more."""
    slow = small_text.replace("ping_interval_h = 4.0", "ping_interval_h = 0.5")
    slow = slow.replace("[acoustics]\n", "[acoustics]\nmax_surface_bounces = 6\nmax_bottom_bounces = 6\n")
    assert slow.count("bounces = 6") == 2
    assert "ping_interval_h = 0.5" in slow
    study = tmp_path / "slow.toml"
    study.write_text(slow)
    words = ["study", "run", str(study), "--out", str(tmp_path / "run")]
    ours, theirs = pty.openpty()
    process = begin(words, stderr=theirs, env={**os.environ, "COLUMNS": "100", "TERM": "xterm"})
    os.close(theirs)
    printed, counts, deadline = "", [], time.monotonic() + 600.0
    while not counts or counts[-1][0] < 1:  # until kernels are compiled and a first block is done
        assert time.monotonic() < deadline, printed
        assert process.poll() is None, printed
        printed += shown(ours)
        counts = [(int(done), int(total)) for done, total in COUNTED.findall(printed)]
    process.send_signal(sent)
    asked = time.monotonic()
    while process.poll() is None and time.monotonic() < asked + 60.0:
        printed += shown(ours)
    assert process.wait(timeout=60) == code, printed
    os.close(ours)
    assert time.monotonic() - asked < 10.0  # all its links would take minutes
    assert counts[-1][0] < counts[-1][1]
    assert [done for done, _ in counts] == sorted(done for done, _ in counts)
    assert "Traceback" not in printed
    assert [path.name for path in tmp_path.iterdir()] == ["slow.toml"]


@pytest.mark.parametrize(("stop", "code"), [(KeyboardInterrupt(), 130), (SystemExit(143), 143), (None, None)])
def test_a_stop_that_meets_the_import_of_a_compiled_module_is_a_stop(monkeypatch, stop, code):
    """pybind11 makes an ImportError of what interrupts the initialization of a module; one that is missing is no stop."""

    def import_gtsam(*_args, **_keywords):
        raise ImportError("gtsam") from stop

    monkeypatch.setattr("pymantaray.cli.main.app", import_gtsam)
    with pytest.raises(ImportError if stop is None else SystemExit) as end:
        main(["study", "list"])
    assert stop is None or end.value.code == code

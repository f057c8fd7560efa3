"""
Ctrl-C and a request to stop, in the middle of a run: the process ends and nothing is left behind.
"""

import os
import pty
import re
import resource
import select
import signal
import subprocess
import sys
import time

import pytest
from factories import python

from pymantaray.cli.main import main
from pymantaray.records import stops

COMMAND = """
from pymantaray.jobs import checkpoint
checkpoint._SAVE_INTERVAL = 3600.0  # a short run saves nothing, however busy the machine is
from pymantaray.cli.main import main
main()
"""


class OnTerminal:
    """The command on a terminal of its own, on which bars count."""

    def __init__(self, words):
        self.ours, theirs = pty.openpty()
        environment = {**os.environ, "COLUMNS": "100", "TERM": "xterm"}
        command = [sys.executable, "-c", COMMAND, *map(str, words)]
        self.process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=theirs, env=environment
        )
        os.close(theirs)
        self.printed = ""

    def running(self):
        """
        Whether it runs still; what came to its terminal meanwhile is read, without colours and
        movements.
        """
        over = self.process.poll() is not None
        while select.select([self.ours], [], [], 0.0 if over else 0.1)[0]:
            try:
                text = os.read(self.ours, 65536).decode(errors="replace")
            except OSError:  # nobody writes to it any more
                break
            self.printed += re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text)
            if not over:
                break
        return not over

    def counts(self, stage):
        """Numbers done and numbers of all that the bar of a stage has shown."""
        return [
            (int(x), int(n)) for x, n in re.findall(rf"{stage}[^\w,\r\n]*(\d+)/(\d+)", self.printed)
        ]

    def stop_within(self, stage, sent):
        """Send a signal when the first of a stage is done; the exit code, once it has ended."""
        while not any(done for done, _ in self.counts(stage)):
            assert self.running(), self.printed
        self.process.send_signal(sent)
        while self.running():
            pass
        return self.process.returncode


@pytest.fixture
def begin():
    """
    Start the command; one that is still there when the test ends, because it failed, is killed.
    """
    begun = []

    def one(*words):
        begun.append(OnTerminal(words))
        return begun[-1]

    yield one
    for command in begun:
        command.process.kill()
        command.process.wait()
        os.close(command.ours)


STOPS = pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])


@pytest.mark.slow
@pytest.mark.parametrize(("sent", "code", "workers"), [
    (signal.SIGINT, 130, "1"), (signal.SIGTERM, 143, "2"),
])  # fmt: skip
def test_interrupted_run_leaves_nothing(tmp_path, begin, sent, code, workers):
    words = f"study run quick --realizations 40 --workers {workers} --out".split()
    command = begin(*words, tmp_path / "run")
    assert command.stop_within("realizations", sent) == code, command.printed
    assert "Traceback" not in command.printed
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@STOPS
def test_an_interrupt_waits_for_few_rays_and_leaves_nothing(
    tmp_path, begin, small_text, sent, code
):
    """The bar counts links; in the middle of them a block of links is waited for, no more."""
    study = tmp_path / "slow.toml"
    study.write_text(small_text)
    changes = (
        "mission.ping_interval_h=0.5",
        "acoustics.max_surface_bounces=6",
        "acoustics.max_bottom_bounces=6",
    )
    options = [word for change in changes for word in ("--set", change)]
    command = begin("study", "run", study, *options, "--out", tmp_path / "run")
    assert command.stop_within("rays", sent) == code, command.printed
    done, links = zip(*command.counts("rays"), strict=True)
    assert done[-1] < links[-1]  # which would take minutes
    assert list(done) == sorted(done)
    assert "Traceback" not in command.printed
    assert [path.name for path in tmp_path.iterdir()] == ["slow.toml"]


@pytest.mark.parametrize(
    ("stop", "code"), [(KeyboardInterrupt(), 130), (SystemExit(143), 143), (None, None)]
)
def test_a_stop_that_meets_the_import_of_a_compiled_module_is_a_stop(monkeypatch, stop, code):
    """
    pybind11 makes an ImportError of what interrupts the initialization of a module; one that is
    missing is no stop.
    """

    def import_gtsam(*_args, **_keywords):
        raise ImportError("gtsam") from stop

    monkeypatch.setattr("pymantaray.cli.main.tree", import_gtsam)
    with pytest.raises(ImportError if stop is None else SystemExit) as end:
        main(["study", "list"])
    assert stop is None or end.value.code == code


MANTARAY = [sys.executable, "-m", "pymantaray"]


BEGUN = """
import sys
from pymantaray.__main__ import main
print("begun", flush=True)
sys.argv[0] = "mantaray"
main()
"""


@pytest.mark.slow
def test_ctrl_c_in_the_first_seconds_exits_quietly_with_130():
    codes = []
    for k in range(16):
        command = [sys.executable, "-c", BEGUN, "study", "show", "quick"]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        assert process.stdout.readline() == b"begun\n"
        time.sleep(0.02 + 0.12 * k)
        process.send_signal(signal.SIGINT)
        errors = process.communicate()[1].decode()
        assert "Traceback" not in errors, errors
        codes.append(process.returncode)
    assert set(codes) <= {0, 130, -signal.SIGINT}  # the last while the interpreter ends
    assert codes.count(130) >= 4


IMPORTING = """
import os, signal, sys
class Interrupt:
    def find_spec(self, name, *_):
        if name == {name!r}:
            os.kill(os.getpid(), signal.SIGINT)
            for _ in range(1000):
                pass
sys.meta_path.insert(0, Interrupt())
sys.argv = ["mantaray", "study", "show", "quick"]
from pymantaray.__main__ import main
main()
"""


@pytest.mark.parametrize(
    "name",
    [
        *("typer", "pymantaray.config", "numpy"),
        *(
            pytest.param(name, marks=pytest.mark.slow)
            for name in ("pymantaray.apps.study.command", "pydantic")
        ),
    ],
)
def test_ctrl_c_at_the_import_of_a_module_ends_quietly_with_130(name):
    command = [sys.executable, "-c", IMPORTING.format(name=name)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


@pytest.mark.parametrize("value", ["abc", "", "1e9", "12.5"])
def test_an_unreadable_date_in_the_environment_is_refused(value, mantaray, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", value)
    done = mantaray("study", "list")
    assert done.code == 2
    assert done.err == (
        f"error: environment: SOURCE_DATE_EPOCH is {value!r}; it must be whole seconds since 1970,"
        " at most 11 digits; correct or unset it\n"
    )
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    assert mantaray("study", "list").code == 0


@pytest.mark.skipif(sys.platform != "linux", reason="limits of address space are Linux's")
@pytest.mark.parametrize("mebibytes", [200, 500, 1000])
def test_too_little_memory_is_told_in_one_line(mebibytes, tmp_path):
    words = [
        "study",
        "run",
        "quick",
        "--realizations",
        "1",
        "--workers",
        "1",
        "--out",
        tmp_path / "run",
    ]
    limit = (mebibytes << 20,) * 2
    done = subprocess.run(
        [*MANTARAY, *words],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, limit),
    )
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert "emory" in done.stderr
    assert not any(tmp_path.iterdir())


SPIN = """
from hashlib import pbkdf2_hmac

def spin(n):
    return pbkdf2_hmac("sha1", b"", b"", n)  # compiled code, which lets other threads work
"""
STOPPED = (
    SPIN
    + """
import sys
import pymantaray.cli.stopping as stopping
from pymantaray.cli.stopping import answered_stops, end_after_stop

where = sys.argv[1]
if len(sys.argv) > 2:
    stopping._PATIENCE = stopping._END_PATIENCE = float(sys.argv[2])
try:
    with answered_stops():
        if where == "thread":
            from pymantaray.acoustics.solving import in_blocks
            def work(start, stop):
                print("go\\n", end="", flush=True)  # one write: threads print at the same time
                return spin(10 if start == 0 else 2**31 - 1)
            import pymantaray.acoustics.solving as solving
            solving._BLOCK_SECONDS = 0.0
            list(in_blocks(work, 3, threads=2))
        print("go", flush=True)
        spin(2**31 - 1)
except (SystemExit, KeyboardInterrupt) as end:
    code = getattr(end, "code", 130)
    end_after_stop(code)
    sys.exit(code)
"""
)


@pytest.mark.parametrize(
    ("sent", "code", "where", "patience"),
    [
        (signal.SIGINT, 130, "thread", ["0.2"]),
        pytest.param(signal.SIGTERM, 143, "main", [], marks=pytest.mark.slow),
        pytest.param(signal.SIGINT, 130, "main", [], marks=pytest.mark.slow),
        pytest.param(signal.SIGTERM, 143, "thread", [], marks=pytest.mark.slow),
    ],
)
def test_a_process_in_compiled_code_stops_within_seconds(sent, code, where, patience):
    with subprocess.Popen(
        [sys.executable, "-c", STOPPED, where, *patience],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        for _ in range(1 if where == "main" else 3):
            assert process.stdout.readline() == "go\n"
        process.send_signal(sent)
        try:
            assert process.wait(timeout=30) in (code, -sent)
        finally:
            process.kill()


def test_signals_of_a_forked_child_do_not_stop_its_parent():
    done = python("""
import os, signal, time
import pymantaray.cli.stopping as stopping
stopping._PATIENCE = 0.3
with stopping.answered_stops():
    child = os.fork()
    if not child:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        signal.signal(signal.SIGINT, lambda *_: None)
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGTERM)
        os._exit(0)
    os.waitpid(child, 0)
    time.sleep(0.9)
print("there")
""")
    assert (done.returncode, done.stdout) == (0, "there\n"), done.stderr


@pytest.mark.slow
def test_a_stop_waits_for_a_block_that_defers_it():
    """
    Compiled code that runs for longer than the patience within the block: the stop comes after it.
    """
    done = python(
        SPIN
        + """
import os, signal, threading, time
import pymantaray.cli.stopping as stopping
from pymantaray.records.stops import deferred_stops

count = 10**5
while True:
    begin = time.monotonic()
    spin(count)
    if time.monotonic() - begin > 0.5:
        break
    count *= 2
stopping._PATIENCE = 0.2
threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGTERM)).start()
with stopping.answered_stops():
    with deferred_stops():
        spin(2 * count)
        print("whole", flush=True)
print("late")
"""
    )
    assert (done.returncode, done.stdout) == (143, "whole\n"), done.stderr


CALLBACK = """
import ctypes, os, signal, sys, time
from pymantaray.cli.stopping import answered_stops

@ctypes.CFUNCTYPE(None)
def {name}():
    os.kill(os.getpid(), signal.{sent})
    for _ in range(1000):
        pass

try:
    with answered_stops():
        {name}()
        print("discarded", flush=True)
        time.sleep(5.0)
        print("late")
except KeyboardInterrupt:
    sys.exit(130)
"""


@pytest.mark.parametrize(("sent", "code"), [("SIGINT", 130), ("SIGTERM", 143)])
@pytest.mark.parametrize("name", ["_raw_object_cache_notify", "of_another_library"])
def test_a_stop_in_a_callback_that_discards_exceptions_is_repeated(name, sent, code):
    done = python(CALLBACK.format(name=name, sent=sent))
    assert (done.returncode, done.stdout, done.stderr) == (code, "discarded\n", "")


def test_an_error_after_a_discarded_stop_is_the_stop(monkeypatch):
    def miss_an_object(*_args, **_keywords):
        stops.requested.append(signal.SIGTERM)
        raise RuntimeError("no compiled object yet")

    monkeypatch.setattr("pymantaray.cli.main.tree", miss_an_object)
    with pytest.raises(SystemExit) as end:
        main(["study", "list"])
    assert end.value.code == 143
    stops.requested.clear()


def test_a_process_that_ends_at_once_removes_half_written_files(tmp_path):
    done = python(
        SPIN
        + f"""
import os, signal, threading
import pymantaray.cli.stopping as stopping
from pymantaray.records.writing import whole_file

stopping._PATIENCE = 0.2
threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGTERM)).start()
with stopping.answered_stops(), whole_file({str(tmp_path / "new.csv")!r}) as part:
    part.write_text("half")
    print(len(os.listdir({str(tmp_path)!r})), flush=True)
    spin(2**31 - 1)
"""
    )
    assert (done.returncode, done.stdout) == (143, "1\n"), done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize(("sent", "code", "after"), [
    (signal.SIGINT, 130, 8.0), (signal.SIGTERM, 143, 0.5),
])  # fmt: skip
def test_a_stop_while_kernels_are_compiled_ends_within_seconds(tmp_path, sent, code, after):
    (tmp_path / "p.csv").write_text("depth,sound_speed\n0,1500\n100,1490\n500,1485\n")
    ends = [
        f"{end}_{axis}" for end in ("source", "receiver") for axis in ("north", "east", "depth")
    ]
    (tmp_path / "l.csv").write_text(f"{','.join(ends)}\n0,0,50,2000,0,90\n")
    words = ["rays", "times", "l.csv", "o.csv", "--profile", "p.csv", "--bathymetry", "600"]
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
    with subprocess.Popen(
        [*MANTARAY, *words], cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True
    ) as process:
        assert "compiling kernels" in process.stderr.readline()
        time.sleep(after)
        process.send_signal(sent)
        try:
            errors = process.communicate(timeout=20)[1]
        finally:
            process.kill()
    assert (process.returncode, errors) == (code, "")
    left = [path for path in tmp_path.rglob("*") if path.suffix == ".part" or ".tmp." in path.name]
    assert not left
    assert not (tmp_path / "o.csv").exists()

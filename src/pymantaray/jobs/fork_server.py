"""
Fork server: a process with one thread that imports the package's modules once and forks workers, which start in milliseconds.

It exists on Linux only, while workers of this process exist, and imports modules of this package only: modules of users may
start threads, and may change between two calls. It can also call functions of the package, which do once for all workers
what each would do at its first use. A fork of a process with several threads may never return. So the server counts its threads, and starts a new interpreter if there is more than one.
"""

import gc
import json
import os
import pickle
import select
import signal
import socket
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO, ClassVar, NoReturn, Self

_PROGRAM = """
import json, sys
path, program = map(json.loads, sys.argv[1:])
sys.path[:] = path
from pymantaray.jobs.fork_server import serve_forks
from pymantaray.jobs.processes import serve
serve_forks(serve, program)
"""
_PACKAGE = "pymantaray."
_MAX_MESSAGE = 2**16  # bytes
_FILES = 4  # of a request: standard input, output and error of the worker, and its working folder
_NO_THREADS = {"JE_ARROW_MALLOC_CONF": "background_thread:false"}  # pandas imports PyArrow if it is installed
AVAILABLE = sys.platform == "linux" and hasattr(os, "pidfd_open")
"""True if the system can fork workers and refer to them without reused numbers."""


class ForkedProcess:
    """Worker that a fork server started, with the methods of `subprocess.Popen` that workers need."""

    def __init__(self, server: "ForkServer", stdin: BinaryIO, stdout: BinaryIO) -> None:
        self.stdin, self.stdout, self._server = stdin, stdout, server
        self.pid = 0
        """Its number; 0 until the server has answered."""
        self.pidfd = -1
        """File that refers to the process."""
        self.lost = False
        """True if the server ended before it started the process."""
        self._code: int | None = None

    def poll(self) -> int | None:
        """Exit code, or None while the process runs."""
        return self.wait() if self.lost or (self.pid and self._has_ended(timeout=0)) else self._code

    def wait(self) -> int:
        """Exit code after the end of the process; 1 if the server has ended and nobody knows it."""
        if self._code is None:
            self._server.receive(self)
            if not self.lost:
                self._has_ended(timeout=None)
            code = None if self.lost else self._server.exit_code(self)
            self._code = 1 if code is None else code
            if self.pidfd >= 0:
                os.close(self.pidfd)
        return self._code

    def kill(self) -> None:
        """End the process at once, even if the server has not started it yet."""
        if self._code is None:
            self._server.receive_or_kill(self)
            if not self.lost:
                signal.pidfd_send_signal(self.pidfd, signal.SIGKILL)

    def communicate(self) -> None:
        """Close the files of the process, and wait for its end."""
        for file in (self.stdin, self.stdout):
            with suppress(OSError):  # unsent bytes
                file.close()
        self.wait()

    def _has_ended(self, *, timeout: float | None) -> bool:
        return _is_readable(self.pidfd, timeout)


class ForkServer:
    """
    Server of this process and of its present environment.

    Parameters
    ----------
    program : sequence of str
        Command of a worker in a new interpreter.
    environment : mapping
        Environment of the server and its workers.
    """

    _current: ClassVar["ForkServer | None"] = None
    _acquiring = threading.Lock()

    def __init__(self, program: Sequence[str], environment: dict[str, str]) -> None:
        self._key = os.getpid(), environment
        self._users = 0
        self._lock = threading.RLock()
        self._starting: deque[ForkedProcess] = deque()
        self._connection, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with other:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", _PROGRAM, json.dumps(sys.path), json.dumps(program)],
                stdin=other.fileno(),
                stdout=subprocess.DEVNULL,
                env=environment | _NO_THREADS,
                process_group=0,  # only the parent receives Ctrl-C
            )

    @classmethod
    def acquire(cls, program: Sequence[str], environment: dict[str, str]) -> Self | None:
        """Return the server of this environment, started if necessary, which `release` ends; None if the system has none."""
        if not AVAILABLE:
            return None
        with cls._acquiring:
            if cls._current is None or cls._current._key != (os.getpid(), environment):
                cls._current = cls(program, environment)
            server: Any = cls._current
            server._users += 1
        return server  # type: ignore[no-any-return]

    def release(self) -> None:
        """End the server after its last user."""
        with ForkServer._acquiring:
            self._users -= 1
            if self._users:
                return
            if ForkServer._current is self:
                ForkServer._current = None
        self._end()
        self._connection.close()

    def start(self, modules: Iterable[str]) -> ForkedProcess | None:
        """Start a worker after imports and calls, see `Workers`, without waiting for it; None if the server has ended."""
        (child_in, stdin), (stdout, child_out) = os.pipe(), os.pipe()
        folder = os.open(".", os.O_PATH)
        process = ForkedProcess(self, os.fdopen(stdin, "wb"), os.fdopen(stdout, "rb"))
        request = json.dumps([name for name in modules if name.startswith(_PACKAGE)])
        try:
            with self._lock:
                socket.send_fds(self._connection, [request.encode()], [child_in, child_out, 2, folder])
                self._starting.append(process)
        except OSError:
            process.stdin.close()
            process.stdout.close()
            return None
        finally:
            for file in (child_in, child_out, folder):
                os.close(file)
        return process

    def receive(self, process: ForkedProcess) -> None:
        """Wait until the server has started a process, or has ended."""
        with self._lock:
            while process in self._starting:
                self._receive_first()

    def receive_or_kill(self, process: ForkedProcess) -> None:
        """End the server if it has not started a process yet."""
        with self._lock:
            while process in self._starting and _is_readable(self._connection.fileno(), 0):
                self._receive_first()
            if process in self._starting:
                self._end()
            self.receive(process)

    def _receive_first(self) -> None:
        message, files = b"", list[int]()
        with suppress(ConnectionError):  # the server has ended
            message, files, _, _ = socket.recv_fds(self._connection, _MAX_MESSAGE, 1)
        process = self._starting.popleft()
        process.pid, process.lost = int(message or 0), not message
        process.pidfd = files[0] if files else -1

    def exit_code(self, process: ForkedProcess) -> int | None:
        """Exit code of an ended process; None if the server has ended."""
        with self._lock:
            while self._starting:
                self._receive_first()
            try:
                self._connection.send(str(process.pid).encode())
                message = self._connection.recv(_MAX_MESSAGE)
            except OSError:
                return None
        return int(message) if message else None

    def _end(self) -> None:
        self._process.kill()  # it has no state
        self._process.wait()


def _is_readable(file: int, timeout: float | None) -> bool:
    waiting = select.poll()
    waiting.register(file, select.POLLIN)
    return bool(waiting.poll(timeout))


def serve_forks(work: Callable[[BinaryIO], NoReturn], program: Sequence[str]) -> None:
    """
    Start workers on request, until the parent ends.

    Parameters
    ----------
    work : callable
        Main loop of a worker, called with its standard input.
    program : sequence of str
        Command of a worker in a new interpreter.
    """
    connection = socket.socket(fileno=os.dup(0))
    started: dict[int, subprocess.Popen[bytes]] = {}  # in new interpreters
    with suppress(ConnectionError):  # the parent was killed
        while True:
            message, files, _, _ = socket.recv_fds(connection, _MAX_MESSAGE, _FILES)
            if not message:
                return
            request = json.loads(message)
            if isinstance(request, int):
                code = started.pop(request).wait() if request in started else _forked_code(request)
                connection.send(str(code).encode())
                continue
            with _ending_with_parent():
                for name in request:
                    with suppress(Exception):  # the worker raises it again
                        _import_or_call(name)
            if _has_one_thread():
                pid = _fork(work, connection, files)
            else:
                process = _start(program, files)
                pid = process.pid
                started[pid] = process
            reference = os.pidfd_open(pid)
            socket.send_fds(connection, [str(pid).encode()], [reference])
            for file in (*files, reference):
                os.close(file)


def _import_or_call(name: str) -> None:
    """Import a module, or call a function that is given as ``module:function``."""
    module, _, function = name.partition(":")
    imported = import_module(module)
    if function:
        getattr(imported, function)()


@contextmanager
def _ending_with_parent() -> Iterator[None]:
    """Let this process end within a second after its parent, while it does not listen to the parent; forks do not inherit the timer."""
    parent = os.getppid()

    def end(*_: object) -> None:
        if os.getppid() != parent:
            os._exit(0)

    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, 1.0, 1.0)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def _has_one_thread() -> bool:
    return sum(1 for _ in Path("/proc/self/task").iterdir()) == 1


def _fork(work: Callable[[BinaryIO], NoReturn], connection: socket.socket, files: Sequence[int]) -> int:
    """Fork a worker with these files, and return its number."""
    gc.freeze()  # collections would copy the memory that processes share
    pid = os.fork()
    if pid:
        return pid
    try:
        connection.close()
        os.fchdir(files[3])
        for number, file in enumerate(files[:3]):
            os.dup2(file, number)
        for file in files:
            os.close(file)
        requests = os.fdopen(0, "rb")
        sys.path[:] = pickle.load(requests)
        work(requests)
    finally:
        os._exit(1)


def _forked_code(pid: int) -> int:
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


def _start(program: Sequence[str], files: Sequence[int]) -> "subprocess.Popen[bytes]":
    """Start a worker with these files in a new interpreter."""
    stdin, stdout, stderr, folder = files
    return subprocess.Popen(
        program, stdin=stdin, stdout=stdout, stderr=stderr, cwd=f"/proc/{os.getpid()}/fd/{folder}"
    )

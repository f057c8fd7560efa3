"""
A server that misbehaves: every fault ends in the right water after a retry, or in one line that
says what happened.
"""

import base64
import contextlib
import http.server
import socket
import sys
import threading
import time

import pytest
from opendap_stand_in import Endless

from pymantaray.errors import OceanError

pytestmark = pytest.mark.network

# what a server does, and what is said if it goes on doing it
FAULTS = {
    "500": "server error 500 Internal Server Error (java.lang.NullPointerException)",
    "503": "server error 503 Service Unavailable",
    "page": "the answer is not data",
    "error": "server reports: timeout in reader",
    "garbage": "the answer is not data",
    "hang": "no answer within 0.5 s",
    "drip": "no complete answer within 2 s",
    "cut": "incomplete answer",
    "chunk": "incomplete answer",
    "short": "unreadable answer",
    "gzip cut": "",
    "flood": "wrong size: more than 64 MiB",
    "shift": "unreadable answer",
}
PLACES = {
    "description": ".dds",
    "attributes": ".das",
    "axis": "dods?lat",
    "block": "salinity.salinity%5B",
}
TEXT = ("description", "attributes")
IMPATIENT = {"hang": {"idle_s": 0.5}, "drip": {"request_s": 2.0}}  # these faults end by a limit
LESS_SO = {
    "hang": {"idle_s": 2.0},
    "drip": {"request_s": 2.0},
}  # and one answer may not take as long
CASES = [
    (place, fault)
    for place in PLACES
    for fault in FAULTS
    if fault != "shift" or place not in TEXT  # text holds no binary lengths
]


def test_each_of_many_passing_faults_ends_in_success(fetch, is_true, thredds, as_stored):
    """In one fetch, whose four blocks meet all faults of a block in turn."""
    variables = ("water_temp", "salinity", "water_u", "water_v")
    faults = [
        (f"{variables[k % 4]}.{variables[k % 4]}%5B", fault) for k, fault in enumerate(FAULTS)
    ]
    thredds.app.faults += [*faults, (".das", "short"), (".dds", "cut")]
    fetched, ocean = fetch(limits={"attempts": 5, "idle_s": 2.0, "request_s": 2.0})
    is_true(ocean, "2014-07-15T12:00")
    assert thredds.app.faults == []
    # one more: after its attributes, the description is asked for again
    assert fetched.requests == len(thredds.app.asked) == 11 + len(FAULTS) + 3
    as_stored(fetched)


@pytest.mark.slow
@pytest.mark.parametrize(("place", "fault"), CASES)
def test_a_passing_fault_ends_in_success_after_a_retry(fetch, is_true, thredds, fault, place):
    thredds.app.faults.append((PLACES[place], fault))
    fetched, ocean = fetch(limits=LESS_SO.get(fault, {}))
    is_true(ocean, "2014-07-15T12:00")
    assert thredds.app.faults == []  # it has happened
    assert fetched.requests == len(thredds.app.asked) > 11


LASTING = [
    pytest.param(fault, marks=() if fault in ("500", "short", "hang") else pytest.mark.slow)
    for fault in FAULTS
]


@pytest.mark.parametrize("fault", LASTING)
def test_a_lasting_fault_ends_in_one_line(refusal, thredds, fault):
    thredds.app.faults += [("salinity%5B", fault)] * 3
    message = refusal(limits=IMPATIENT.get(fault, {}))
    assert message.startswith("127.0.0.1/thredds/dodsC/GLBv0.08/expt_53.X/data/2014: ")
    assert FAULTS[fault] in message
    assert message.endswith("(3 attempts)")


def test_compressed_answers_are_read(fetch, is_true, thredds, as_stored):
    thredds.app.faults += [(place, "gzip") for place in PLACES.values()]
    fetched, ocean = fetch()
    is_true(ocean, "2014-07-15T12:00")
    assert fetched.requests == 11
    assert thredds.app.faults == []
    as_stored(fetched)


def test_a_server_that_asks_to_come_back_much_later_is_asked_soon(fetch, is_true, thredds):
    later = "1e300", "inf", "nan", "-5", "Fri, 31 Dec 9999 23:59:59 GMT", "soon", ""
    thredds.app.faults += [(".das", f"503 {after}") for after in later]
    _, ocean = fetch(limits={"longest_backoff_s": 0.05, "attempts": len(later) + 1})
    is_true(ocean, "2014-07-15T12:00")
    assert thredds.app.faults == []


def test_a_data_set_that_was_withdrawn_is_asked_for_once(refusal, thredds, monkeypatch):
    monkeypatch.delitem(thredds.app.models, "GLBv0.08/expt_56.3")
    message = refusal(experiment="expt_56.3", time="2014-07-15T12")
    assert "expt_56.3: server error 404 Not Found (No such data set)" in message
    assert len(thredds.app.asked) == 1


def test_redirects_without_end_are_refused(refusal, thredds):
    thredds.app.faults += [("das", "loop")] * 40
    assert "too many redirects" in refusal()


def test_the_total_time_limit_holds_where_each_attempt_keeps_its_own(refusal, thredds):
    thredds.app.faults += [("salinity%5B", "hang")] * 50  # of which each lasts 20 s
    start = time.monotonic()
    limits = {"attempts": 50, "idle_s": 0.4, "total_s": 1.0}
    assert "the time limit of 1 s has passed" in refusal(limits=limits)
    assert time.monotonic() - start < 15.0


@pytest.mark.parametrize("what", ["headers", "continue", "text"])
def test_the_total_time_limit_holds_for_answers_without_an_end(refusal, what):
    """Bytes come all the time, so that no limit of a read from the socket is met."""
    ends_in_time_and_leaves_no_thread(refusal, what)


def test_an_attempt_that_connects_after_its_time_is_hung_up(refusal, monkeypatch):
    look_up = socket.getaddrinfo

    def look_up_slowly(*address, **settings):
        time.sleep(0.6)
        return look_up(*address, **settings)

    monkeypatch.setattr(socket, "getaddrinfo", look_up_slowly)
    ends_in_time_and_leaves_no_thread(refusal, "headers")


def ends_in_time_and_leaves_no_thread(refusal, what):
    endless = Endless(what)
    before, start = threading.active_count(), time.monotonic()
    try:
        message = refusal(
            servers=endless.root, limits={"attempts": 50, "request_s": 0.3, "total_s": 1.0}
        )
        assert time.monotonic() - start < 15.0
        assert "the time limit of 1 s has passed" in message
        while threading.active_count() > before and time.monotonic() - start < 30.0:
            time.sleep(0.01)
        assert (
            threading.active_count() <= before
        )  # no attempt goes on unseen, while the server still talks
    finally:
        endless.stop()


def test_nobody_at_the_address_is_said_so(refusal):
    assert "connection refused (3 attempts)" in refusal(servers="http://127.0.0.1:9/dodsC")


def test_a_password_goes_to_the_server_and_nowhere_else(
    fetch, is_true, refusal, thredds, tmp_path, as_stored
):
    thredds.app.account = "Basic " + base64.b64encode(b"ann@home:pa:ss word").decode()
    address = thredds.root.replace("http://", "http://ann%40home:pa:ss%20word@")
    (tmp_path / "mine.toml").write_text(f'[addresses]\nopendap = "{address}"\n')
    fetched, ocean = fetch(servers=tmp_path / "mine.toml")
    is_true(ocean, "2014-07-15T12:00")
    assert thredds.root in ocean.attrs["history"]
    for told in (fetched.path.read_bytes(), repr(fetched).encode()):
        assert b"ann%40" not in told
        assert b"pa:ss" not in told
    for secret in (address.replace("ss%20word", "wrong"), address.replace("thredds/", "nothing/")):
        message = refusal(servers=secret, out="other.nc")
        assert "pa:" not in message
        assert "ann" not in message
    for broken in (
        "http://ann:pa:ss@[::1/x",
        "ftp://ann:pa:ss@example.org",
        "http://ann:pa/ss@example.org:x/",
    ):
        (tmp_path / "mine.toml").write_text(f'[addresses]\nopendap = "{broken}"\n')
        message = refusal(servers=tmp_path / "mine.toml", out="other.nc")
        assert "is not a valid URL" in message
        assert "ann" not in message
        assert "ss@" not in message
    as_stored(fetched)


class Recording(http.server.BaseHTTPRequestHandler):
    """Answers with a redirect if its server has one, and keeps the headers of what it was asked."""

    def do_GET(self):
        self.server.headers.append(self.headers)
        self.send_response(302 if self.server.target else 200)
        if self.server.target:
            self.send_header("Location", self.server.target)
        self.send_header("Content-Length", "0")
        self.end_headers()

    def log_message(self, *_):
        pass


@pytest.fixture
def recording():
    """Servers of that kind, each with the address that it redirects to or none."""
    with contextlib.ExitStack() as stack:

        def one(target):
            server = stack.enter_context(
                http.server.ThreadingHTTPServer(("127.0.0.1", 0), Recording)
            )
            server.target, server.headers = target, []
            threading.Thread(target=server.serve_forever, daemon=True).start()
            stack.callback(server.shutdown)
            return server

        yield one


@pytest.mark.parametrize("account", ["", "ann:mine@"])
def test_a_redirect_sends_no_password_to_the_other_host(recording, monkeypatch, tmp_path, account):
    """
    Not that of the address, and not one that ~/.netrc has for the host that the redirect names.
    """
    from pymantaray.ocean.fetch.limits import FetchLimits
    from pymantaray.ocean.fetch.transport import Connection

    (tmp_path / "netrc").write_text("machine localhost login ann password stolen\n")
    (tmp_path / "netrc").chmod(0o600)
    monkeypatch.setenv("NETRC", str(tmp_path / "netrc"))
    there = recording(None)
    here = recording(f"http://localhost:{there.server_port}/x.dds")
    root = f"http://{account}127.0.0.1:{here.server_port}"
    with Connection(root, FetchLimits(attempts=1)) as connection, pytest.raises(OceanError):
        connection._get(f"http://127.0.0.1:{here.server_port}/x.dds")
    assert [bool(headers["Authorization"]) for headers in here.headers] == [bool(account)]
    assert [headers["Authorization"] for headers in there.headers] == [None]


@pytest.mark.parametrize("name", ["requests", "pydap.client"])
def test_without_the_extra_s_packages_it_is_named(refusal, monkeypatch, name):
    monkeypatch.delitem(sys.modules, "pymantaray.ocean.fetch.transport", raising=False)
    monkeypatch.setitem(sys.modules, name, None)
    assert 'pip install "pymantaray[fetch]"' in refusal()


def test_a_fetch_that_is_interrupted_leaves_no_file(fetch, tmp_path, thredds):
    def interrupt(_stage, done, _total):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fetch(progress=interrupt)
    assert list(tmp_path.iterdir()) == []


def test_a_user_s_own_files_beside_the_output_are_left_alone(fetch, tmp_path):
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "ocean.nc.part").symlink_to(tmp_path / "mine")
    fetch()
    assert (tmp_path / "mine").read_text() == "mine"
    assert (tmp_path / "ocean.nc.part").is_symlink()

"""
The server on loopback: answers to the last digit, one clear line for what is wrong, no harm by any
request.
"""

import contextlib
import http.client
import itertools
import json
import random
import re
import signal
import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from refusals import refused

import pymantaray
from pymantaray.acoustics import Medium
from pymantaray.apps.service import RangingService, connections, make_server, server
from pymantaray.apps.service.messages import ANSWER
from pymantaray.apps.service.server import MAX_BYTES
from pymantaray.cli.main import main
from pymantaray.errors import ServiceError
from pymantaray.jobs.processes import WorkerEndedError
from pymantaray.records import RayStatus

pytestmark = pytest.mark.network
NAMES = ("north", "east", "depth")


@pytest.fixture(scope="module")
def port(serve, service):
    return serve(service)


@pytest.fixture(scope="module")
def loud_port(serve, loud):
    return serve(loud)


def ask(port, body, method="POST", path="/ping"):
    """Status and answer of one request; an answer with NaN or Infinity is no JSON."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=600)
    try:
        connection.request(method, path, body)
        response = connection.getresponse()
        assert response.headers["Content-Type"] == "application/json"
        return response.status, json.loads(response.read(), parse_constant=pytest.fail)
    finally:
        connection.close()


def request(source, receivers, time=0.0, **more):
    """A ping as the server takes it."""
    source, receivers = np.asarray(source).tolist(), np.asarray(receivers).tolist()
    ends = [dict(zip(NAMES, place, strict=True)) for place in (source, *receivers)]
    return {"time": time, "source": ends[0], "receivers": ends[1:]} | more


def columns(answer, name):
    return np.array(
        [np.nan if r[name] is None else r[name] for r in answer["receivers"]], dtype=float
    )


def same_as_ping(answer, ping):
    """An answer has what a ping has, to the last digit, null where it has NaN."""
    assert [r["status"] for r in answer["receivers"]] == [
        RayStatus(s).name.lower() for s in ping.status
    ]
    for name in (
        "travel_time",
        "arrival_time",
        "refracted_range",
        "straight_range",
        "level_db",
        "probability",
    ):
        np.testing.assert_array_equal(columns(answer, name), getattr(ping, name), err_msg=name)


def test_an_answer_is_the_services_to_the_last_digit(port, service, links):
    source, receivers = links(50)
    status, answer = ask(port, json.dumps(request(source, receivers, 7.25)))
    assert status == 200
    assert answer["time"] == 7.25
    same_as_ping(answer, service.ping(7.25, source, receivers))
    assert all(r["arrivals"] is None for r in answer["receivers"])
    ANSWER.validate_python(answer)


def test_with_arrivals_all_that_reaches_a_receiver_is_told(loud_port, loud, links, as_stored):
    source, receivers = links(12)
    _, answer = ask(loud_port, json.dumps(request(source, receivers, 3.0, arrivals=True)))
    ping = loud.ping(3.0, source, receivers)
    as_stored(answer["receivers"][::3])
    rays = [ray for r in answer["receivers"] for ray in r["arrivals"]]
    assert [len(r["arrivals"]) for r in answer["receivers"]] == np.bincount(
        ping.arrivals.link, minlength=12
    ).tolist()
    for name in (
        "travel_time",
        "surface_bounces",
        "bottom_bounces",
        "launch_angle",
        "arrival_angle",
    ):
        np.testing.assert_array_equal([ray[name] for ray in rays], getattr(ping.arrivals, name))
    np.testing.assert_array_equal(
        [ray["arrival_time"] for ray in rays], 3.0 + ping.arrivals.travel_time
    )
    np.testing.assert_array_equal(
        [ray["level_db"] for ray in rays],
        170.0 - ping.receptions.loss_db[: ping.arrivals.link.size],
    )


def test_velocities_move_the_ends_of_an_exchange(loud_port, loud, links, as_stored):
    source, receivers = links(5)
    body = request(source, receivers)
    body["source"]["velocity"] = [1.0, -0.5, 0.1]
    body["receivers"][2]["velocity"] = [0.0, 2.0, 0.0]
    _, answer = ask(loud_port, json.dumps(body))
    as_stored(answer)
    velocities = np.zeros((5, 3))
    velocities[2] = (0.0, 2.0, 0.0)
    moving = {"source_velocity": (1.0, -0.5, 0.1), "receiver_velocities": velocities}
    same_as_ping(answer, loud.ping(0.0, source, receivers, **moving))


def test_positions_may_be_by_latitude_and_longitude(serve, in_varying):
    service = in_varying
    place = [(74.5, -140.0, 50.0), (74.51, -140.02, 80.0), (74.49, -139.95, 60.0)]
    ends = [dict(zip(("lat", "lon", "depth"), p, strict=True)) for p in place]
    body = {"time": 0.0, "source": ends[0], "receivers": [ends[1] | {"name": "B"}, ends[2]]}
    status, answer = ask(serve(service), json.dumps(body))
    assert status == 200
    assert [r["name"] for r in answer["receivers"]] == ["B", None]
    same_as_ping(answer, service.ping(0.0, place[0], place[1:], geographic=True))


def test_the_root_tells_version_and_ocean_and_the_schema_both_sides(port, loud_port, as_stored):
    status, facts = ask(port, None, "GET", "/")
    assert status == 200
    assert facts["mantaray"] == pymantaray.__version__
    assert facts["sea_floor_depth"] == [900.0, 900.0]
    assert (facts["north"], facts["timing"], facts["source_level_db"]) == (None, "one-way", None)
    _, facts = ask(loud_port, None, "GET", "/")
    assert (facts["timing"], facts["turn_around"], facts["source_level_db"]) == (
        "two-way",
        0.25,
        170.0,
    )
    assert facts["max_surface_bounces"] == 1
    as_stored(facts, without="mantaray")
    status, schema = ask(port, None, "GET", "/schema")
    assert status == 200
    assert schema["PingRequest"]["required"] == ["time", "source", "receivers"]
    assert set(schema["PingAnswer"]["properties"]) == {"time", "receivers"}


def test_a_source_outside_the_ocean_is_refused_once(serve, in_varying):
    port = serve(in_varying)
    status, answer = ask(port, json.dumps(GOOD | {"source": HERE | {"north": 1e6}}))
    assert status == 400
    assert re.search(
        "^source: north 1e[+]06 m is outside the ocean, which reaches from -?[0-9.]+ to",
        answer["error"],
    )
    status, answer = ask(
        port, json.dumps(GOOD | {"receivers": [HERE | {"north": 1e6}, HERE | {"depth": -1.0}]})
    )
    assert (status, [r["status"] for r in answer["receivers"]]) == (200, ["outside", "outside"])
    status, answer = ask(port, json.dumps(GOOD | {"source": HERE | {"depth": -1.0}}))
    assert (status, answer["receivers"][0]["status"]) == (200, "outside")


def test_the_root_gives_sound_speeds_of_the_water_above_the_bed_only(serve):
    """
    Sound speed grows by 0.02 /s of depth, over a slope from 100 to 400 m; levels go down to 2000 m.
    """
    axis, depth = np.linspace(-1e3, 1e3, 5), np.linspace(0.0, 2000.0, 21)
    speed = np.broadcast_to(1450.0 + 0.02 * depth, (5, 5, 21))
    bed = np.broadcast_to(250.0 + 0.15 * axis[:, None], (5, 5))
    service = RangingService(Medium.from_grid(axis, axis, depth, speed, bathymetry=bed))
    low, high = ask(serve(service), None, "GET", "/")[1]["sound_speed"]
    assert (low, high) == pytest.approx((1450.0, 1450.0 + 0.02 * 400.0), abs=1e-6)


def test_eight_clients_at_a_time_are_answered_as_one(loud_port, loud, links):
    pings = [(*links(5, seed), float(seed)) for seed in range(16)]
    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(lambda ping: ask(loud_port, json.dumps(request(*ping))), pings))
    for (source, receivers, at), (status, answer) in zip(pings, answers, strict=True):
        assert status == 200
        same_as_ping(answer, loud.ping(at, source, receivers))


HERE = {"north": 0.0, "east": 0.0, "depth": 50.0}
GOOD = {"time": 0.0, "source": HERE, "receivers": [HERE | {"north": 900.0}]}
BAD = {
    "": "not valid JSON: EOF while parsing",
    "{": "not valid JSON: EOF while parsing an object",
    "\xff": "not valid JSON: invalid unicode|not valid JSON: expected value",
    "[" * 100_000: "not valid JSON: recursion limit exceeded",
    "[1, 2]": "the request is not a JSON object; it needs time, source and receivers",
    "null": "the request is not a JSON object",
    "{}": r"time: missing; add it \(seconds since .*\); source: missing; .*; receivers: missing",
    json.dumps(GOOD | {"time": "noon"}): "time: found 'noon'; allowed: .*number",
    json.dumps(GOOD | {"time": float("nan")}): "time: found nan; allowed: .*finite number",
    json.dumps(GOOD).replace("900.0", "1e999"): r"receivers\[0\].north: found inf",
    json.dumps(GOOD | {"receivers": HERE}): "receivers: found .*; allowed: a list",
    json.dumps(
        GOOD | {"receivers": [HERE] * 10_001}
    ): "receivers: found .*; allowed: .*10000 or less",
    json.dumps(
        GOOD | {"receivers": [{"north": 1.0, "east": 2.0}]}
    ): r"receivers\[0\].depth: missing",
    json.dumps(
        GOOD | {"receivers": [{"north": 1.0, "depth": 2.0}]}
    ): r"receivers\[0\]: give either north and east or",
    json.dumps(
        GOOD | {"receivers": [HERE | {"lat": 1.0, "lon": 1.0}]}
    ): r"receivers\[0\]: give either",
    json.dumps(
        GOOD | {"receivers": [{"lat": 95.0, "lon": 0.0, "depth": 5.0}]}
    ): "lat: found 95.0; allowed: 90 or less",
    json.dumps(
        GOOD | {"receivers": [{"lat": 9.0, "lon": 0.0, "depth": 5.0}]}
    ): "some positions have north and east",
    json.dumps(GOOD | {"source": HERE | {"velocity": [1.0]}}): "source.velocity",
    json.dumps(GOOD | {"source": HERE | {"velocity": [1.0, 0.0, 0.0]}}): "velocity: one-way timing",
    json.dumps(GOOD | {"receiver": []}): "`receiver`: unknown key. Did you mean `receivers`?",
    json.dumps(GOOD | {"arrivals": "yes"}): "arrivals: found 'yes'; allowed: true or false",
    json.dumps(
        {"time": 0.0, "source": {"lat": 1.0, "lon": 1.0, "depth": 5.0}, "receivers": []}
    ): "this water has no",
}


@pytest.mark.parametrize(("body", "line"), BAD.items(), ids=range(len(BAD)))
def test_a_malformed_request_is_refused_in_one_line(port, body, line):
    status, answer = ask(port, body.encode("latin-1"))
    assert status == 400
    assert list(answer) == ["error"]
    assert "\n" not in answer["error"]
    assert len(answer["error"]) < 500
    assert re.search(line, answer["error"]), answer["error"]


def test_what_is_not_there_and_what_is_too_large_has_its_status(port):
    status, answer = ask(port, None, "GET", "/pings")
    assert (status, answer["error"]) == (
        404,
        "no '/pings'; allowed are GET /, GET /schema, POST /ping",
    )
    for method, path in (("GET", "/ping"), ("DELETE", "/"), ("POST", "/schema")):
        status, answer = ask(port, None, method, path)
        assert status == 405
        assert re.search(f"^{method} {path}; only (GET|POST) is allowed$", answer["error"])
    status, answer = ask(port, b" " * (MAX_BYTES + 1))
    assert status == 413
    assert answer["error"].startswith(
        f"the request has {MAX_BYTES + 1:,} bytes; {MAX_BYTES:,} are allowed"
    )


def raw(port, text):
    """What comes back for bytes that need not be HTTP."""
    with socket.create_connection(("127.0.0.1", port), timeout=600) as line:
        line.sendall(text)
        return b"".join(iter(lambda: line.recv(65536), b"")).decode()


@pytest.mark.parametrize(
    ("text", "status"),
    [
        (b"who hears me\r\n\r\n", 400),
        (b"POST /ping HTTP/1.1\r\nContent-Length: many\r\n\r\n", 400),
        (b"POST /ping HTTP/1.1\r\nTransfer-Encoding: gzip\r\n\r\n", 501),
        (b"POST /ping HTTP/1.1\r\nContent-Length: 99999999999\r\n\r\n", 413),
        (b"GET / HTTP/1.1\r\nX: " + b"x" * (2**14 - 23) + b"\r\n\r\n", 431),
    ],
)
def test_what_is_no_request_at_all_is_refused_in_the_same_form(port, text, status):
    head, _, body = raw(port, text).partition("\r\n\r\n")
    assert head.startswith((f"HTTP/1.1 {status} ", f"HTTP/1.0 {status} "))
    assert "Content-Type: application/json" in head
    assert list(json.loads(body)) == ["error"]


def test_chunked_bodies_are_read_and_broken_ones_do_no_harm(port):
    body = json.dumps(GOOD).encode()
    status, answer = ask(port, iter([body[:20], body[20:]]))
    assert (status, answer["receivers"][0]["status"]) == (200, "ok")
    with socket.create_connection(("127.0.0.1", port)) as line:
        line.sendall(b"POST /ping HTTP/1.1\r\nContent-Length: 500\r\n\r\n{")
    assert ask(port, body)[0] == 200


def test_where_nobody_can_listen_is_refused_in_one_line(service, port):
    refused(
        ServiceError,
        f"127.0.0.1, port {port}: cannot listen there: Address already in use",
        make_server,
        service,
        port=port,
    )
    refused(
        ServiceError,
        "no.such.host.invalid, port 0: cannot listen there",
        make_server,
        service,
        "no.such.host.invalid",
    )


def test_a_server_has_limits_of_its_own_and_answers_by_its_name(service, monkeypatch):
    monkeypatch.setattr(server, "_THREADS", 3)  # other numbers than those of waitress
    monkeypatch.setattr(connections, "TIMEOUT", 77)
    own = make_server(service)
    try:
        limits = own.adj
        assert limits.max_request_body_size == server._READ_BYTES > MAX_BYTES
        assert limits.max_request_header_size == server._MAX_HEADERS
        assert limits.connection_limit == own.connections + server._OWN_SOCKETS
        assert (limits.threads, limits.channel_timeout) == (3, 77)
        assert (limits.cleanup_interval, limits.ident) == (1, "mantaray")
        assert limits.asyncore_use_poll
    finally:
        own.task_dispatcher.shutdown()
        own.close()


def test_without_waitress_one_line_says_what_to_install(service, monkeypatch):
    monkeypatch.setitem(sys.modules, "waitress.server", None)
    refused(ServiceError, r'pip install "pymantaray\[serve\]"', make_server, service)


@pytest.fixture
def kept_open():
    """Connections that stay open without a request, until the test ends."""
    with contextlib.ExitStack() as stack:
        yield lambda port, count: [
            stack.enter_context(socket.create_connection(("127.0.0.1", port), timeout=600))
            for _ in range(count)
        ]


def test_clients_that_keep_connections_open_do_not_shut_others_out(serve, service, kept_open):
    port = serve(service)
    kept_open(port, 3 * server._MAX_CONNECTIONS)
    for _ in range(20):
        assert ask(port, json.dumps(GOOD))[0] == 200


def test_the_connection_closed_for_another_is_the_longest_idle_one(serve, service, monkeypatch):
    monkeypatch.setattr(server, "_MAX_CONNECTIONS", 8)
    port = serve(service)

    def answered(client):  # so that the server has taken it before the next one comes
        client.request("GET", "/")
        assert client.getresponse().read()
        return client

    with contextlib.ExitStack() as stack:

        def connect():
            client = http.client.HTTPConnection("127.0.0.1", port, timeout=600)
            return answered(stack.enter_context(contextlib.closing(client)))

        busy = connect()
        first = busy.sock
        idle = []
        for _ in range(4):
            idle += [connect() for _ in range(6)]
            answered(busy)
        assert busy.sock is first
        assert idle[0].sock.recv(1) == b""


SLOW = {
    "headers": itertools.chain(
        [b"GET / HTTP/1.1\r\n"], (b"X-%d: y\r\n" % k for k in itertools.count())
    ),
    "a body": itertools.chain(
        [b"POST /ping HTTP/1.1\r\nContent-Length: 90000\r\n\r\n"], itertools.repeat(b" ")
    ),
    "empty lines": itertools.repeat(b"\r\n\r\n"),
}


def is_closed(line, piece):
    """True if the server has closed a connection, after one more piece of a request."""
    try:
        line.sendall(piece)
        return line.recv(1) == b""
    except TimeoutError:
        return False
    except ConnectionError:
        return True


@pytest.mark.parametrize("kind", SLOW)
def test_a_request_that_never_ends_does_not_hold_its_connection(
    serve, service, kept_open, monkeypatch, kind
):
    port = serve(service)
    with monkeypatch.context() as patch:
        patch.setattr(connections, "TIMEOUT", 1)
        (line,) = kept_open(port, 1)
        line.settimeout(0.1)
        end = time.monotonic() + 300.0
        while not is_closed(line, next(SLOW[kind])):
            assert time.monotonic() < end
    assert ask(port, json.dumps(GOOD))[0] == 200


@pytest.mark.parametrize(
    ("head", "status"),
    [
        ("Host: 127.0.0.1:{port}", 200),
        ("Host: localhost", 200),
        ("Host: LOCALHOST:{port}", 200),
        ("Host: [::1]:{port}", 200),
        ("X: without a host", 200),
        ("Host: 127.0.0.1:{port}\r\nOrigin: http://127.0.0.1:{port}", 200),
        ("Host: evil.example:{port}", 403),
        ("Host: 127.0.0.1.evil.example", 403),
        ("Host: evil.example@127.0.0.1.evil.example", 403),
        ("Host: 192.0.2.1", 403),
        ("Host: [", 403),
        ("Host: 127.0.0.1, evil.example", 403),
        ("Host: 127.0.0.1:{port}\r\nOrigin: http://evil.example", 403),
        ("Host: 127.0.0.1:{port}\r\nOrigin: http://127.0.0.1:1", 403),
        ("Host: 127.0.0.1:{port}\r\nOrigin: null", 403),
    ],
)
@pytest.mark.parametrize("what", ["GET /", "POST /ping"])
def test_pages_of_other_sites_cannot_ask_by_a_browser(port, head, status, what):
    """
    A page whose name is made to point at 127.0.0.1 sends its own name as Host, any other page its
    Origin.
    """
    body = json.dumps(GOOD) if what == "POST /ping" else ""
    text = (
        f"{what} HTTP/1.1\r\n{head.format(port=port)}\r\nConnection: close\r\nContent-Length:"
        f" {len(body)}\r\n\r\n{body}"
    )
    answer = raw(port, text.encode())
    assert answer.startswith(f"HTTP/1.1 {status} ")
    assert (list(json.loads(answer.partition("\r\n\r\n")[2])) == ["error"]) == (status == 403)


LONG = "k" * 3_000_000


@pytest.mark.parametrize(
    "body",
    [
        {"a\nb\r\x1b[31m": 1},
        {LONG: 1},
        {"source": HERE | {LONG: 1}},
        {"source": HERE | {"name": LONG}},
        {"time": LONG},
        {"receivers": [HERE | {f"{k}{LONG[:500]}": 1} for k in range(99)]},
    ],
    ids=["newlines", "a long key", "a long key inside", "a long name", "a long value", "many keys"],
)
def test_what_a_request_says_is_repeated_in_a_short_printable_line(port, body):
    status, answer = ask(port, json.dumps(GOOD | body))
    assert status == 400
    assert answer["error"].isprintable()
    assert len(answer["error"]) <= 480


@pytest.mark.slow
def test_a_killed_worker_costs_no_answer_and_faults_have_a_status(
    serve, medium, monkeypatch, caplog
):
    """
    A service without workers is unavailable; a fault of the server is logged. Both times, it goes
    on.
    """
    service = RangingService(medium, workers=1)
    port = serve(service)
    service._workers._processes[0].kill()
    assert ask(port, json.dumps(GOOD))[0] == 200

    def end(ends):
        raise WorkerEndedError("a worker process ended early, by SIGKILL; try fewer workers")

    with monkeypatch.context() as patch:
        patch.setattr(service, "call", lambda *_, **__: end(None))
        status, answer = ask(port, json.dumps(GOOD))
    assert status == 503
    assert answer["error"].endswith("try fewer workers; ask again")
    assert ask(port, json.dumps(GOOD))[0] == 200
    service.close()
    status, answer = ask(port, json.dumps(GOOD))
    assert (status, answer["error"]) == (500, "internal error of the server; see its log")
    assert "POST /ping" in caplog.text
    assert ask(port, None, "GET", "/")[0] == 200


@pytest.fixture
def begin():
    """Start the command; one that is still there when the test ends is killed."""
    begun = []

    def one(*words):
        command = [
            sys.executable,
            "-c",
            "from pymantaray.cli.main import main; main()",
            "serve",
            *words,
        ]
        begun.append(
            subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        )
        lines = [begun[-1].stdout.readline()]
        while lines[-1] and "listening" not in lines[-1]:
            lines.append(begun[-1].stdout.readline())
        return begun[-1], lines, int(lines[-1].rpartition(":")[2])

    yield one
    for process in begun:
        process.kill()
        process.communicate()


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    file = tmp_path_factory.mktemp("config") / "sea.toml"
    file.write_text(
        '[ocean]\nsource = "synthetic:fram"\nhalf_extent_north = 20e3\nhalf_extent_east = 20e3\n'
        '[ranging]\ntiming = "two-way"\nturn_around_s = 0.5\n'
    )
    return str(file)


@pytest.mark.slow
def test_the_command_serves_until_it_is_told_to_stop(begin, config):
    process, lines, port = begin(config, "--port", "0", "--workers", "2")
    assert lines == [
        "Fram Strait (synthetic), around 78 N, 0 E\n",
        f"listening on http://127.0.0.1:{port}\n",
    ]
    status, answer = ask(port, json.dumps(GOOD))
    assert (status, answer["receivers"][0]["status"]) == (200, "ok")
    assert ask(port, None, "GET", "/")[1]["turn_around"] == 0.5
    process.send_signal(signal.SIGTERM)
    printed, said = process.communicate(timeout=600)
    assert (process.returncode, printed) == (143, "")
    (note,) = said.splitlines()
    assert note.startswith("synthetic:fram: 40 km (north) by 40 km (east) around 78 N, 0 E;")


@pytest.mark.slow
def test_who_listens_beyond_this_machine_is_warned(begin):
    process, _, port = begin("synthetic:fram", "--host", "0.0.0.0", "--port", "0")
    assert ask(port, json.dumps(GOOD))[0] == 200
    assert ask(port, None, "GET", "/")[1]["source_level_db"] is None
    process.send_signal(signal.SIGINT)
    printed, said = process.communicate(timeout=600)
    note, warning = sorted(said.splitlines())
    assert note.startswith("synthetic:fram: ")
    assert (
        warning
        == "warning: listening at 0.0.0.0 without a password: anyone who can access it can use it"
    )
    assert (process.returncode, printed) == (130, "")


def test_an_ocean_that_is_not_there_is_one_line(capsys, tmp_path):
    for words, line in (
        (["nowhere.nc"], "nowhere.nc"),
        ([str(tmp_path / "no.toml")], "no.toml: no such file"),
    ):
        with pytest.raises(SystemExit) as caught:
            main(["serve", *words])
        assert caught.value.code == 2
        said = capsys.readouterr().err
        assert said.startswith("error: ")
        assert line in said
        assert said.count("\n") == 1


def resident(process):
    """Memory of a process. [MB]"""
    out = subprocess.run(
        ["ps", "-o", "rss=", "-p", str(process.pid)], capture_output=True, text=True, check=True
    )
    return int(out.stdout) / 1024.0


@pytest.mark.slow
def test_memory_stays_flat_under_good_bad_and_oversized_requests(begin, config):
    process, _, port = begin(config, "--port", "0")
    dice = random.Random(0)
    bodies = [
        json.dumps(GOOD).encode(),
        *(body.encode("latin-1") for body in BAD),
        b" " * (MAX_BYTES + 1),
    ]
    weights = [30.0, *[1.0] * len(BAD), 0.1]
    sizes = []
    for _ in range(4):
        with ThreadPoolExecutor(4) as pool:
            statuses = list(
                pool.map(lambda body: ask(port, body)[0], dice.choices(bodies, weights, k=750))
            )
        assert set(statuses) <= {200, 400, 413}
        sizes.append(resident(process))
    assert sizes[-1] < 1.015 * sizes[0], sizes  # 2.6 kB for each of 2250 requests
    assert process.poll() is None

"""A server that misbehaves: every fault ends in the right water after a retry, or in one line that says what happened."""

import os
import signal
import subprocess
import sys
import time

import pytest

from pymantaray.ocean.fetch.answers import readers

pytestmark = pytest.mark.network

PASSING = [
    "500",
    "503",
    "page",
    "error",
    "garbage",
    "hang",
    "drip",
    "cut",
    "chunk",
    "short",
    "long",
    "flood",
    "shift",
    "gzip cut",
]
PLACES = {"attributes": ".das", "axes": "dods?time", "block": "salinity%5B"}
SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    "place", [pytest.param("attributes", marks=SLOW), pytest.param("axes", marks=SLOW), "block"]
)
@pytest.mark.parametrize("fault", PASSING)
def test_a_passing_fault_ends_in_success_after_a_retry(fetch, is_true, thredds, fault, place):
    if fault == "shift" and place == "attributes":
        pytest.skip("attributes hold no binary lengths")
    thredds.app.faults.append((PLACES[place], fault))
    got, ocean = fetch()
    is_true(ocean, "2014-07-15T12:00")
    assert thredds.app.faults == []  # it has happened
    assert got.service == "OPeNDAP"
    assert got.requests == 7, thredds.app.asked


@pytest.mark.parametrize("fault", ["500", "page", "hang", "cut", "short", "hdf"])
def test_a_passing_fault_of_the_subset_service_ends_in_success(fetch, is_true, thredds, fault):
    thredds.app.services = ("ncss",)
    thredds.app.faults.append(("ncss", fault))
    got, ocean = fetch()
    is_true(ocean, "2014-07-15T12:00")
    assert thredds.app.faults == []
    assert got.service == "the NetCDF Subset Service"


LINES = {
    "500": "server error 500 Internal Server Error (java.lang.NullPointerException)",
    "503": "server error 503 Service Unavailable",
    "page": "something else came",
    "error": "server reports: timeout in reader",
    "garbage": "something else came",
    "hang": "no answer within 0.25 s",
    "cut": "answer cut short",
    "chunk": "answer cut short",
    "short": "answer cut short",
    "long": "wrong size: 4096 bytes more than described",
    "flood": "wrong size: more than the",
    "drip": "answer not complete within 0.5 s",
}


def test_compressed_answers_are_read(fetch, is_true, thredds):
    thredds.app.faults += [(place, "gzip") for place in PLACES.values()]
    got, ocean = fetch()
    is_true(ocean, "2014-07-15T12:00")
    assert got.requests == 6
    assert thredds.app.faults == []


QUICK = ("500", "garbage", "short", "hang")


@pytest.mark.parametrize("fault", [f if f in QUICK else pytest.param(f, marks=SLOW) for f in LINES])
def test_a_lasting_fault_of_both_services_ends_in_one_line(refusal, thredds, fault):
    thredds.app.faults += [("salinity%5B", fault)] * 3 + [("ncss", "always 500")]
    message = refusal()
    assert message.startswith("OPeNDAP: 127.0.0.1/thredds/dodsC/GLBv0.08/expt_53.X/data/2014.dods: ")
    assert LINES[fault] in message, message
    assert "(3 attempts); subset service: 127.0.0.1/thredds/ncss/" in message
    assert message.endswith("what arrived is kept, run the same command again later")


def test_without_a_subset_service_the_line_is_about_opendap(refusal, thredds, tmp_path):
    (tmp_path / "only.toml").write_text(f'[addresses]\nopendap = "{thredds.root}/dodsC"\n')
    thredds.app.faults += [(".das", "500")] * 3
    message = refusal(servers=tmp_path / "only.toml")
    assert message.startswith("127.0.0.1/thredds/dodsC/GLBv0.08/expt_53.X/data/2014.das: server error 500")
    assert "subset" not in message


def test_a_data_set_that_was_withdrawn_is_asked_for_once(refusal, thredds):
    thredds.app.services = ()
    message = refusal()
    assert "2014.das: server error 404 Not Found (No such data set)" in message
    assert len(thredds.app.asked) == 2  # one of each service


def test_redirects_without_end_are_refused(refusal, thredds):
    thredds.app.faults += [("das", "loop")] * 40 + [("ncss", "always 500")]
    assert "redirects without end" in refusal()


def test_the_total_time_limit_holds_whatever_the_server_does(refusal, thredds):
    thredds.app.faults += [("salinity%5B", "hang")] * 50
    start = time.monotonic()
    message = refusal(limits={"attempts": 50, "total_s": 0.8})
    assert time.monotonic() - start < 2.0
    assert "the time limit of 0.8 s has passed; what arrived is kept" in message


def test_nobody_at_the_address_is_said_so(refusal, tmp_path):
    (tmp_path / "gone.toml").write_text('[addresses]\nopendap = "http://127.0.0.1:9/dodsC"\nsubset = ""\n')
    assert "connection refused (3 attempts)" in refusal(servers=tmp_path / "gone.toml")


@pytest.mark.parametrize("name", ["requests", "pydap.parsers.dds"])
def test_without_the_extra_s_packages_it_is_named(refusal, monkeypatch, name):
    readers.cache_clear()
    monkeypatch.setitem(sys.modules, name, None)
    assert 'pip install "pymantaray[fetch]"' in refusal()


@pytest.mark.slow
def test_importing_takes_no_client_and_warns_of_nothing():
    """Network clients are imported when a fetch begins."""
    script = (
        "import sys; import pymantaray.ocean.fetch as f; names = ('requests', 'pydap', 'copernicusmarine');"
        " assert not [n for n in names if n in sys.modules]; from pymantaray.ocean.fetch.transport import Transport;"
        " from pymantaray.ocean.fetch.answers import readers; Transport(); readers()"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", script], check=True)


def program(path, *words):
    return subprocess.Popen(
        [sys.executable, "-W", "ignore", str(path), *words], stdout=subprocess.PIPE, text=True
    )


@pytest.mark.slow
def test_a_server_that_dies_half_way_is_gone_on_with_when_it_is_back(
    fetch, refusal, is_true, thredds, ocean_server, tmp_path
):
    mortal = program(ocean_server.__file__, "4")
    try:
        root = mortal.stdout.readline().strip()
        first = tmp_path / "mortal.toml"
        first.write_text(f'[addresses]\nopendap = "{root}/dodsC"\n')
        assert "connection refused (3 attempts); what arrived is kept" in refusal(servers=first)
        assert mortal.wait(10) == 9
    finally:
        mortal.kill()
        mortal.wait()
        mortal.stdout.close()
    # the same server again, at the same address
    port = root.rpartition(":")[2].partition("/")[0]
    revived = ocean_server.Running(thredds.app, port=int(port))
    try:
        got, ocean = fetch(servers=first)
    finally:
        revived.stop()
    is_true(ocean, "2014-07-15T12:00")
    assert (got.kept, got.requests) == (4, 2)


KILLED = """
import sys
from pymantaray.ocean.fetch import fetch_hycom

def progress(stage, done, total):
    print(done, total, flush=True)
    if done == int(sys.argv[4]):
        sys.stdin.readline()

fetch_hycom((72.0, 76.0), (-150.0, -140.0), "2014-07-15T12", sys.argv[1], servers=sys.argv[2], cache=sys.argv[3],
            progress=progress)
"""


def test_a_killed_fetch_leaves_no_file_and_the_next_goes_on(fetch, is_true, thredds, servers_file, tmp_path):
    script = tmp_path / "killed.py"
    script.write_text(KILLED)
    out, cache = tmp_path / "ocean.nc", tmp_path / "cache"
    fetching = subprocess.Popen(
        [sys.executable, str(script), str(out), str(servers_file), str(cache), "5"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"NO_PROXY": "127.0.0.1"},
    )
    try:
        lines = [fetching.stdout.readline().split() for _ in range(6)]
        assert lines[-1][0] == "5", lines
        total = int(lines[-1][1])
        fetching.send_signal(signal.SIGKILL)
        assert fetching.wait(10) == -signal.SIGKILL
    finally:
        fetching.kill()
        fetching.wait()
        fetching.stdin.close()
        fetching.stdout.close()
    assert not out.exists()
    before = len(thredds.app.asked)
    assert before == 2 + 5
    got, ocean = fetch(lat=(72.0, 76.0), lon=(-150.0, -140.0))
    is_true(ocean, "2014-07-15T12:00")
    assert got.kept == before
    assert got.requests == len(thredds.app.asked) - before == total - 5
    assert sorted(p.name for p in tmp_path.iterdir()) == ["cache", "killed.py", "ocean.nc", "servers.toml"]

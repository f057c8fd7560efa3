"""What is kept between fetches: sound entries are used, broken ones are not, and the folder stays within its size."""

import os
import time

import pytest

from pymantaray.errors import OceanError
from pymantaray.ocean.fetch.cache import Cache, cache_folder

REQUEST = {"url": "http://127.0.0.1/a", "window": [[0.0, 1.0, 2]]}


@pytest.fixture
def cache(tmp_path):
    return Cache(tmp_path / "cache")


def entry(cache):
    (path,) = cache.folder.iterdir()
    return path


def test_what_was_stored_comes_back_for_the_same_request_only(cache):
    cache.put(REQUEST, b"water\n\0\xff")
    assert cache.get(dict(reversed(REQUEST.items()))) == b"water\n\0\xff"
    assert cache.get(REQUEST | {"url": "http://127.0.0.1/b"}) is None
    cache.put(REQUEST, b"new")
    assert cache.get(REQUEST) == b"new"


def flip(body, place):
    return body[:place] + bytes([body[place] ^ 1]) + body[place + 1 :]


@pytest.mark.parametrize(
    "harm",
    [
        lambda whole: whole[:-1],
        lambda whole: whole + b"x",
        lambda whole: flip(whole, len(whole) - 3),
        lambda whole: flip(whole, 20),
        lambda _: b"",
        lambda whole: b"{}\n" + whole,
        lambda _: os.urandom(200),
    ],
    ids=["cut", "longer", "a bit of the body", "a bit of the header", "empty", "another header", "noise"],
)
def test_an_entry_that_is_not_what_was_stored_is_removed(cache, harm):
    cache.put(REQUEST, b"water " * 100)
    path = entry(cache)
    path.write_bytes(harm(path.read_bytes()))
    assert cache.get(REQUEST) is None
    assert not path.exists()


def test_an_entry_of_another_request_under_the_same_name_is_not_taken(cache):
    cache.put(REQUEST, b"theirs")
    path = entry(cache)
    other = REQUEST | {"url": "http://127.0.0.1/b"}
    path.rename(cache._path(other))
    assert cache.get(other) is None


def test_an_old_entry_is_not_taken_where_age_matters(cache):
    cache.put(REQUEST, b"old")
    os.utime(entry(cache), (time.time() - 100.0,) * 2)
    assert cache.get(REQUEST, oldest_s=99.0) is None
    assert cache.get(REQUEST, oldest_s=200.0) == b"old"
    assert cache.get(REQUEST) == b"old"


def test_the_oldest_entries_go_when_there_are_too_many(tmp_path):
    cache = Cache(tmp_path, largest_bytes=3500)
    for i in range(5):
        cache.put({"i": i}, bytes(900))
        os.utime(cache._path({"i": i}), (1e9 + i,) * 2)
    left = tmp_path / ".left.answer.1.part"
    left.write_bytes(b"half")
    os.utime(left, (1e9, 1e9))
    cache.prune()
    assert [i for i in range(5) if cache.get({"i": i}) is not None] == [2, 3, 4]
    assert not left.exists()


def test_a_folder_that_cannot_be_written_is_said_so(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OceanError, match=r"file: cannot be written .*; name another cache folder"):
        Cache(tmp_path / "file").put(REQUEST, b"x")


def test_the_folder_is_the_option_s_then_the_environment_s_then_the_platform_s(tmp_path, monkeypatch):
    monkeypatch.setenv("MANTARAY_CACHE", str(tmp_path / "mine"))
    assert cache_folder(tmp_path) == tmp_path
    assert cache_folder() == tmp_path / "mine"
    monkeypatch.delenv("MANTARAY_CACHE")
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_folder() == tmp_path / "xdg" / "mantaray" / "ocean"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_folder() == tmp_path / ".cache" / "mantaray" / "ocean"
    monkeypatch.setattr("sys.platform", "darwin")
    assert cache_folder() == tmp_path / "Library" / "Caches" / "mantaray" / "ocean"


@pytest.mark.network
def test_a_second_fetch_asks_the_server_nothing(fetch, is_true, thredds):
    fetch()
    thredds.app.asked.clear()
    got, ocean = fetch(out="again.nc")
    assert thredds.app.asked == []
    assert (got.requests, got.kept) == (0, 6)
    is_true(ocean, "2014-07-15T12:00")


@pytest.mark.network
def test_a_corrupt_entry_is_fetched_again(fetch, is_true, thredds, tmp_path):
    fetch()
    largest = max((tmp_path / "cache").iterdir(), key=lambda p: p.stat().st_size)
    whole = largest.read_bytes()
    largest.write_bytes(flip(whole, len(whole) - 100))
    thredds.app.asked.clear()
    got, ocean = fetch(out="again.nc")
    assert (got.requests, got.kept) == (len(thredds.app.asked), 5) == (1, 5)
    is_true(ocean, "2014-07-15T12:00")
    assert largest.read_bytes() == whole


@pytest.mark.network
def test_blocks_are_known_by_what_they_hold_not_by_their_index(fetch, is_true, thredds):
    """A server that lost steps at the front sends another step under the same index."""
    fetch(time="2016-06-01T00")
    model = thredds.app.models["GLBv0.08/expt_57.2"]
    kept, model.instants = model.instants, model.instants[1:]
    thredds.app.handlers.pop("GLBv0.08/expt_57.2")
    try:
        # the kept axes are of before: the time in the answer betrays the other step
        got, later = fetch(time="2016-06-01T03", out="later.nc")
    finally:
        model.instants = kept
        thredds.app.handlers.pop("GLBv0.08/expt_57.2")
    is_true(later, "2016-06-01T03:00")
    assert got.service == "OPeNDAP"
    assert got.requests == 1 + 2 + 4  # one block of the wrong step, the axes anew, the blocks


@pytest.mark.network
def test_nothing_is_kept_where_that_is_asked_for(fetch, thredds, tmp_path):
    got, _ = fetch(use_cache=False)
    assert got.requests == 6
    assert not (tmp_path / "cache").exists()

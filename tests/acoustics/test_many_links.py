"""
Many links: the same in any number of threads and blocks, in flat memory, counted, and stopped when
asked to.
"""

import os
import signal
import threading
import time
import tracemalloc
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from functools import partial
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest
from factories import DUCT, DUCT_DEPTH as Z, assert_same, front_links, make_front, python, wait_for
from hypothesis import given, settings, strategies as st

from pymantaray.acoustics import Medium, find_eigenrays, paths, solving, trace_fan, trace_paths
from pymantaray.acoustics._kernels.link import solve_links
from pymantaray.acoustics.solving import in_blocks

INTERRUPTED = """
import os, signal, threading
import numpy as np
from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.acoustics._kernels import link
Z, DUCT = np.array({z}), np.array({c})
medium = Medium.from_profile(Z, DUCT, bottom_depth=3500.0)
rng = np.random.default_rng(0)
n = 50_000
a, b = (np.column_stack([rng.uniform(0, 2e4, (n, 2)), rng.uniform(0, 800, n)]) for _ in range(2))
solve, blocks = link.solve_links, []
def counted(*arguments):
    blocks.append(None)
    if len(blocks) == 20:
        os.kill(os.getpid(), signal.SIGINT)
    return solve(*arguments)
link.solve_links = counted
try:
    find_eigenrays(medium, a, b, threads={threads})
except KeyboardInterrupt:
    count = len(blocks)
    for thread in threading.enumerate():  # a thread ends after its block
        if thread is not threading.current_thread():
            thread.join(60.0)
    print(count, threading.active_count())
"""


def uniform(speed=DUCT):
    return Medium.from_profile(Z, speed, bottom_depth=3500.0)


def scattered(n, side=5e3, seed=3):
    rng = np.random.default_rng(seed)
    return [
        np.column_stack([rng.uniform(0, side, (n, 2)), rng.uniform(0, 500, n)]) for _ in range(2)
    ]


@settings(max_examples=25)
@given(
    n=st.integers(0, 700),
    threads=st.integers(1, 5),
    each=st.sampled_from([0.0, 1e-6, 1e-3]),
    first=st.integers(1, 20),
)
def test_blocks_hold_every_row_once_and_in_order(n, threads, each, first):
    def work(start, stop):
        return time.sleep(each) or range(start, stop)

    runs = list(in_blocks(work, n, threads=threads, first=first))
    assert [i for run in runs for i in run] == list(range(n))
    assert len(runs[0]) == min(n, first)
    assert max(len(run) for run in runs) <= 512


@pytest.fixture
def single_rows(monkeypatch):
    """Blocks of one row, in threads however little work they are."""
    monkeypatch.setattr(solving, "_BLOCK_SECONDS", 0.0)


def test_a_slow_reader_holds_up_the_work(single_rows):
    """No more blocks are begun than wait for the reader, so that memory is flat."""
    begun = []
    work = in_blocks(lambda *rows: begun.append(rows), 10_000, threads=2)
    next(work), next(work)
    wait_for(lambda: len(begun) >= 1 + 4 * 2)
    work.close()
    assert len(begun) == 1 + 4 * 2


def test_rows_that_are_faster_together_are_in_one_block(single_rows, monkeypatch):
    def sizes(n_rows, threads):
        blocks = in_blocks(lambda *rows: rows, n_rows, threads=threads, together=(32, 128))
        return [stop - start for start, stop in blocks]

    assert sizes(101, 1) == [1, 32, 32, 32, 4]
    assert sizes(41, 4) == [1, 11, 11, 11, 7], "each thread has some"
    assert sizes(600, 2) == [1, *[75] * 7, 74], "each thread has four blocks"
    assert max(sizes(2000, 1)) == 128

    monkeypatch.setattr(solving, "_LONGEST", 0.05)
    slow = in_blocks(
        lambda a, b: time.sleep(0.005 * (b - a)) or b - a, 40, threads=1, together=(32, 128)
    )
    assert max(slow) <= 10, "not if that takes long"


def test_what_waits_is_dropped_when_the_reader_stops(single_rows, monkeypatch):
    begun, stopped = [], threading.Event()

    class Pool(ThreadPoolExecutor):
        def shutdown(self, *arguments, **options):
            stopped.set()
            super().shutdown(*arguments, **options)

    def work(start, _stop):
        begun.append(start)
        assert start < 2 or stopped.wait(600.0)

    monkeypatch.setattr(solving, "ThreadPoolExecutor", Pool)
    running = in_blocks(work, 10_000, threads=2)
    next(running), next(running)
    wait_for(lambda: len(begun) == 4)
    running.close()
    assert len(begun) == 4  # of the 9 that were asked for: read, or at work when the reader stopped


def test_a_block_that_fails_ends_the_work(single_rows):
    def work(start, stop):
        if start > 0:
            raise ValueError(start)

    before = set(threading.enumerate())
    running = in_blocks(work, 10_000, threads=3)
    next(running)
    with pytest.raises(ValueError):
        next(running)
    assert before.issuperset(threading.enumerate())


@pytest.mark.parametrize(
    ("bounces", "front"), [pytest.param(0, False, marks=pytest.mark.slow), (1, False), (0, True)]
)
def test_threads_and_block_boundaries_change_nothing(monkeypatch, bounces, front):
    medium, ends = uniform(), scattered(600 if bounces == 0 else 20)
    if front:  # deep searches; the fewer links a call has, the more rays are traced ahead
        medium, ends = make_front(), front_links(150, 4)
    one = find_eigenrays(medium, *ends, bounces, bounces, threads=1)
    assert one.link.size > 0.9 * len(ends[0])
    for threads in (2, 5):
        assert_same(find_eigenrays(medium, *ends, bounces, bounces, threads=threads), one)
    for seconds in (0.0, 1e-3, 10.0):  # single links, blocks of a few, blocks of most
        monkeypatch.setattr(solving, "_BLOCK_SECONDS", seconds)
        assert_same(find_eigenrays(medium, *ends, bounces, bounces, threads=2), one)


def test_progress_rises_to_the_number_of_links():
    seen = []
    find_eigenrays(uniform(), *scattered(500), progress=lambda *step: seen.append(step))
    done, total = zip(*seen, strict=True)
    assert list(done) == sorted(set(done))
    assert len(done) > 2
    assert set(total) == {done[-1]} == {500}


def test_memory_grows_by_the_results_only(monkeypatch):
    """Room for 64 arrivals a link would be 6.7 kB; what is kept is two copies of about 0.2 kB."""
    clock = SimpleNamespace(perf_counter=partial(next, count(0.0, 1e-3)))
    monkeypatch.setattr(
        solving, "time", clock
    )  # blocks of the same sizes, whatever else the machine does
    medium = uniform(np.full(Z.size, 1500.0))

    def most(n):
        ends = scattered(n)
        tracemalloc.start()
        arrivals = find_eigenrays(medium, *ends, threads=2)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak, sum(getattr(arrivals, f.name).nbytes for f in fields(arrivals))

    most(50)
    (few, kept_few), (many, kept_many) = most(2_000), most(10_000)
    assert (many - few) / 8_000 < 3.5 * (kept_many - kept_few) / 8_000, (
        few,
        many,
        kept_few,
        kept_many,
    )


def test_an_interrupt_stops_threads_within_a_block(monkeypatch):
    blocks, before = [], set(threading.enumerate())

    def counted(*arguments):
        blocks.append(None)
        if len(blocks) == 20:
            os.kill(os.getpid(), signal.SIGINT)
        return solve_links(*arguments)

    monkeypatch.setattr("pymantaray.acoustics._kernels.link.solve_links", counted)
    with pytest.raises(KeyboardInterrupt):
        find_eigenrays(uniform(), *scattered(20_000), threads=2)
    assert 20 <= len(blocks) <= 20 + 4 * 2  # of 40 or more
    wait_for(lambda: before.issuperset(threading.enumerate()))  # a thread ends after its block


@pytest.mark.slow
@pytest.mark.parametrize("threads", [1, 2])
def test_an_interrupt_stops_within_a_block(threads):
    code = INTERRUPTED.format(z=Z.tolist(), c=DUCT.tolist(), threads=threads)
    done = python(code)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    blocks, alive = map(int, done.stdout.split())
    waiting = 0 if threads == 1 else 4 * threads
    assert 20 <= blocks <= 20 + waiting  # of about 800
    assert alive == 1


def test_progress_that_fails_ends_the_work():
    def progress(done, _total):
        if done > 1:
            raise OSError("the terminal is gone")

    before = set(threading.enumerate())
    with pytest.raises(OSError, match="terminal"):
        find_eigenrays(uniform(), *scattered(2_000), threads=2, progress=progress)
    assert before.issuperset(threading.enumerate())


def test_paths_of_many_are_the_paths_of_each(monkeypatch):
    """
    Links solved from either end, with reflections and between equal places; in threads, blocks and
    little room.
    """
    medium, (a, b) = uniform(), scattered(30)
    a[7] = b[7]
    found = find_eigenrays(medium, a, b, 1, 1)
    together = trace_paths(medium, a, b, found, threads=1)
    assert set(together.boundary) == {0, 1, 2}
    for link in (0, 7, 12, 29):
        alone = trace_paths(
            medium, a[link], b[link], find_eigenrays(medium, a[link], b[link], 1, 1)
        )
        rows = np.isin(together.arrival, np.flatnonzero(found.link == link))
        for name in ("travel_time", "position", "slowness", "boundary"):
            np.testing.assert_array_equal(getattr(alone, name), getattr(together, name)[rows])
    for threads in (2, 5):
        assert_same(trace_paths(medium, a, b, found, threads=threads), together)
    monkeypatch.setattr(paths, "_FULL_PATHS_PER_THREAD", 1)  # one ray a call
    assert_same(trace_paths(medium, a, b, found, threads=2), together)


def test_a_fan_of_many_rays_is_the_fan_of_each(monkeypatch):
    medium, angles = uniform(), np.linspace(-0.4, 0.4, 9)
    options = {"max_surface_bounces": 3, "max_bottom_bounces": 2}
    fan = trace_fan(medium, [0, 0, 50.0], 0.3, angles, 2e4, **options)
    for i in (0, 4, 8):
        alone = trace_fan(medium, [0, 0, 50.0], 0.3, angles[i], 2e4, **options)
        np.testing.assert_array_equal(alone.position, fan.position[fan.arrival == i])
    monkeypatch.setattr(paths, "_FULL_PATHS_PER_THREAD", 1)
    assert_same(trace_fan(medium, [0, 0, 50.0], 0.3, angles, 2e4, **options), fan)


def test_no_paths_of_no_rays():
    medium, (a, b) = uniform(), scattered(3)
    a[:, 2] = -1.0  # in the air
    rays = trace_paths(medium, a, b, find_eigenrays(medium, a, b))
    assert rays.position.shape == (0, 3)


def test_positions_in_any_order_of_memory_are_solved_by_the_same_code():
    medium = Medium.from_profile([0.0, 500.0], [1450.0, 1460.0], bottom_depth=500.0)
    source, receiver = np.tile([0.0, 0.0, 20.0], (5, 1)), np.tile([900.0, 0.0, 50.0], (5, 1))
    one = find_eigenrays(medium, source, receiver)
    compiled = len(solve_links.signatures)
    other = find_eigenrays(medium, np.asfortranarray(source), np.broadcast_to(receiver[0], (5, 3)))
    assert_same(one, other)
    assert len(solve_links.signatures) == compiled


def test_a_medium_made_in_parts_is_the_same_and_needs_little_memory(monkeypatch):
    rng = np.random.default_rng(3)
    axes = [np.cumsum(rng.uniform(1.0, 2.0, n)) - 1.0 for n in (60, 50, 40)]
    speed = 1450.0 + rng.normal(0.0, 0.5, (60, 50, 40))
    whole = Medium.from_grid(*axes, speed, bathymetry=30.0)
    monkeypatch.setattr(
        "pymantaray.acoustics.medium._VALUES_PER_PART", 7_000
    )  # two rows, or two levels
    tracemalloc.start()
    parts = Medium.from_grid(*axes, speed, bathymetry=30.0)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert_same(parts, whole, but=("bed", "surface"))
    assert_same(parts.bed, whole.bed)
    assert peak < 1.3 * (parts.sound_speed.nbytes + parts.field.nbytes)


def test_a_thread_reuses_its_workspace_for_the_same_levels():
    """New arrays cause page faults, which take as long as a few links."""
    first = solving._workspace(11)
    assert solving._workspace(11)[1] is first[1]
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(solving._workspace, 11).result()[1] is not first[1]
    assert solving._workspace(12)[1].work.extremes.shape == (2, 12)
    ends, other = scattered(30), Medium.from_profile(Z[::2], DUCT[::2], bottom_depth=3500.0)
    fresh = find_eigenrays(uniform(), *ends, threads=1)
    find_eigenrays(other, *ends, threads=1)
    assert_same(find_eigenrays(uniform(), *ends, threads=1), fresh)

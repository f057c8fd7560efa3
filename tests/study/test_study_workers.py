"""Tasks in processes: in order, and stopped where one of them fails."""

import multiprocessing
import time
from pathlib import Path

import pytest

from pymantaray.study.workers import in_processes

_folder = Path()


def start(folder):
    global _folder
    _folder = folder


def square(number):
    time.sleep(0.1 * (number % 2))
    return number**2


def fail_first_then_take_long(number):
    (_folder / str(number)).touch()
    if number == 0:
        raise ValueError("the first one")
    time.sleep(20.0)
    return number


def test_results_are_in_the_order_of_the_tasks_whoever_was_first(tmp_path):
    told = []
    assert in_processes(square, 7, 2, start, tmp_path, told.append) == [n**2 for n in range(7)]
    assert told == list(range(1, 8))


def test_a_task_that_fails_stops_the_others(tmp_path):
    with pytest.raises(ValueError, match="the first one"):
        in_processes(fail_first_then_take_long, 9, 2, start, tmp_path, lambda _: None)
    assert not multiprocessing.active_children()
    assert len(list(tmp_path.iterdir())) <= 3  # one each, and one that was taken meanwhile

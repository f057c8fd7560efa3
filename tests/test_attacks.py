"""
Hundreds of attempts to make MantaRay run foreign code, hang, fill memory or disk, or end without a
clear line: none succeeds.
"""

import re
import subprocess
import sys

import attacks
import pytest

pytestmark = [pytest.mark.slow, pytest.mark.network]


def test_no_attempt_succeeds():
    """
    A process of its own forks the attempts: the memory of a fork includes that of the process that
    forked it.
    """
    done = subprocess.run(
        [sys.executable, attacks.__file__, "--every", "12"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    counts = dict(re.findall(r"^(\w+) +(\d+) attempts, 0 faults$", done.stdout, re.MULTILINE))
    assert counts.keys() == {*attacks.CLASSES, "all"}
    assert min(map(int, counts.values())) >= 2

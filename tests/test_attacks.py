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


@pytest.mark.parametrize("name", attacks.CLASSES)
def test_no_attempt_succeeds(name):
    """
    A process of its own forks the attempts: the memory of a fork includes that of the process that
    forked it.
    """
    done = subprocess.run(
        [sys.executable, attacks.__file__, name], capture_output=True, text=True, check=False
    )
    print(done.stdout, done.stderr, sep="\n")
    *faults, _, total = done.stdout.splitlines() or ["", ""]
    assert faults == []
    assert done.returncode == 0
    assert int(re.fullmatch(r"all +(\d+) attempts, 0 faults", total)[1]) >= 15

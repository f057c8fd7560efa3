"""Hundreds of attempts to make MantaRay run foreign code, hang, fill memory or disk, or end without a clear line: none succeeds."""

import attacks
import pytest

pytestmark = [pytest.mark.slow, pytest.mark.network]


@pytest.mark.parametrize("name", attacks.CLASSES)
def test_no_attempt_succeeds(name, tmp_path):
    lines = []
    counts, faults = attacks.run_classes([name], tmp_path, lines.append)
    print(*lines, sep="\n")
    assert counts[name] >= 15
    assert faults == []

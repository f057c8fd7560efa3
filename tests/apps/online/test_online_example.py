"""
The example of the estimator on board runs, and the table's ranges are better than those of two
constant sound speeds.
"""

import re
import runpy
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parents[3] / "examples" / "on_board.py"
pytest.importorskip("waitress")


@pytest.mark.slow
def test_the_example_compares_four_estimators_and_draws_them(tmp_path, capsys):
    figure = tmp_path / "tracks.png"
    runpy.run_path(str(EXAMPLE))["main"](str(figure))
    out = capsys.readouterr().out
    rms = {
        name.strip(): float(value)
        for name, value in re.findall(r"^(.{15}) error +([\d.]+) m RMS", out, re.MULTILINE)
    }
    assert len(rms) == 4
    assert rms["MantaRay"] < rms["1467.0 m/s"] < rms["1500 m/s"]
    assert rms["MantaRay"] < rms["dead reckoning"]
    assert figure.read_bytes().startswith(b"\x89PNG")

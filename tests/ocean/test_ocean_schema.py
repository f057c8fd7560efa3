"""
What the schema says beside its rules, which `test_ocean_check` breaks one by one: instants,
history, its page.
"""

from pathlib import Path

import numpy as np
from refusals import refused

from pymantaray.errors import OceanError
from pymantaray.ocean import with_history
from pymantaray.ocean.convert import parse_instant
from pymantaray.ocean.schema import VARIABLES

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "ocean-files.md"


def test_instants_are_utc():
    expected = np.datetime64("2014-07-15T12:00")
    assert parse_instant("2014-07-15T12:00") == expected
    assert parse_instant("2014-07-15T14:00+02:00") == expected
    for rubbish in ("yesterday-ish", "NaT"):
        refused(OceanError, "not an instant", parse_instant, rubbish)


def test_history_grows_by_lines(fram_strait):
    once = with_history(fram_strait, "  thinned ")
    assert once.attrs["history"] == "thinned"
    assert (
        with_history(once, "perturbed by 0.5 m/s").attrs["history"]
        == "thinned\nperturbed by 0.5 m/s"
    )
    assert "history" not in fram_strait.attrs
    for wrong in ("", " \n", "two\nlines"):
        refused(OceanError, "give one line", with_history, once, wrong)


def test_the_reference_page_states_the_limits_that_the_schema_has():
    rows = PAGE.read_text(encoding="utf-8").splitlines()
    for v in VARIABLES:
        (row,) = [line for line in rows if line.startswith(f"| `{v.name}`")]
        assert f"`{v.standard_name}` | {v.units} | {v.lowest:g} to {v.highest:g} |" in row

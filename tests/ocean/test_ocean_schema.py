"""What the schema says beside its rules, which `test_ocean_check` breaks one by one: instants, history, its page."""

import re
from pathlib import Path

import numpy as np
from refusals import refused

from pymantaray.errors import OceanError
from pymantaray.ocean import open_ocean, with_history
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
    assert with_history(once, "perturbed by 0.5 m/s").attrs["history"] == "thinned\nperturbed by 0.5 m/s"
    assert "history" not in fram_strait.attrs
    for wrong in ("", " \n", "two\nlines"):
        refused(OceanError, "one line of text", with_history, once, wrong)


def test_the_reference_page_s_example_writes_a_valid_ocean(tmp_path, monkeypatch):
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    monkeypatch.chdir(tmp_path)
    exec(compile(code, str(PAGE), "exec"), {})  # noqa: S102
    ocean = open_ocean("ligurian.nc")
    assert dict(ocean.sizes) == {"depth": 4, "lat": 26, "lon": 13}
    assert ocean.attrs == {"title": "Ligurian Sea", "source": "my model, run 7", "synthetic": 1}
    assert float(ocean["water_temp"][0, 0, 0]) == 22.0
    assert "history" not in ocean.attrs  # nothing was converted


def test_the_reference_page_states_the_limits_that_the_schema_has():
    rows = PAGE.read_text(encoding="utf-8").splitlines()
    for v in VARIABLES:
        (row,) = [line for line in rows if line.startswith(f"| `{v.name}`")]
        assert f"`{v.standard_name}` | {v.units} | {v.lowest:g} to {v.highest:g} |" in row

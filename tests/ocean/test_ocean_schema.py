"""Each way of not being a valid ocean is refused with one line."""

import re
from pathlib import Path

import numpy as np
import pytest

from pymantaray.errors import OceanError
from pymantaray.ocean import open_ocean
from pymantaray.ocean.convert import parse_instant
from pymantaray.ocean.schema import VARIABLES, validate_ocean, with_history


@pytest.fixture
def ocean(closed_form_ocean):
    return closed_form_ocean(
        45.0, 10.0, temperature=lambda z, _lat, _lon: 5.0 + 0 * z, n=(5, 6), depth=[0.0, 10.0]
    )


def test_a_valid_ocean_passes(ocean):
    validate_ocean(ocean)


def test_both_synthetic_regions_are_valid(beaufort_sea, fram_strait):
    validate_ocean(beaufort_sea)
    validate_ocean(fram_strait)
    assert beaufort_sea.attrs["synthetic"] == fram_strait.attrs["synthetic"] == 1


BREAKS = {
    "no salinity": (lambda o: o.drop_vars("salinity"), "salinity"),
    "no time": (lambda o: o.drop_vars("time"), "time"),
    "time axis": (lambda o: o.expand_dims("time"), "time"),
    "time a number": (lambda o: o.assign_coords(time=3.0), "time"),
    "depth from 5": (lambda o: o.assign_coords(depth=o["depth"] + 5.0), "(depth): starts at 5 m"),
    "depth upward": (lambda o: o.assign_coords(depth=-o["depth"]), "depth"),
    "latitude falls": (lambda o: o.isel(lat=slice(None, None, -1)), "lat"),
    "latitude 95": (lambda o: o.assign_coords(lat=o["lat"] + 50.0), "-90 to 90"),
    "too narrow": (lambda o: o.isel(lon=slice(0, 3)), "3 point"),
    "wrong order": (lambda o: o.transpose("lat", "lon", "depth"), "dimensions"),
    "kelvin": (lambda o: o.assign(water_temp=o["water_temp"] + 273.15), "278.15"),
    "all land": (lambda o: o.assign(water_u=o["water_u"] * np.nan), "land"),
    "masks differ": (
        lambda o: o.assign(water_v=o["water_v"].where(o["lat"] > 45.0)),
        "36 points are missing in it or in water_temp",
    ),
    "dry above wet": (lambda o: o.where(o["depth"] > 5.0), "beneath a dry one"),
    "no title": (lambda o: o.drop_attrs(), "title"),
    "synthetic perhaps": (lambda o: o.assign_attrs(synthetic="perhaps"), "perhaps"),
}


@pytest.mark.parametrize("case", BREAKS, ids=str)
def test_what_is_not_valid_is_refused_in_one_line(ocean, case):
    breaks, says = BREAKS[case]
    with pytest.raises(OceanError) as caught:
        validate_ocean(breaks(ocean))
    message = str(caught.value)
    assert says in message
    assert "\n" not in message


def test_instants_are_utc():
    expected = np.datetime64("2014-07-15T12:00")
    assert parse_instant("2014-07-15T12:00") == expected
    assert parse_instant("2014-07-15T14:00+02:00") == expected
    for rubbish in ("yesterday-ish", "NaT"):
        with pytest.raises(OceanError, match="not an instant"):
            parse_instant(rubbish)


def test_history_grows_by_lines(ocean):
    once = with_history(ocean, "  thinned ")
    twice = with_history(once, "perturbed by 0.5 m/s rms")
    assert once.attrs["history"] == "thinned"
    assert twice.attrs["history"] == "thinned\nperturbed by 0.5 m/s rms"
    assert "history" not in ocean.attrs
    validate_ocean(twice)
    for wrong in ("", " \n", "two\nlines"):
        with pytest.raises(OceanError, match="one line of text"):
            with_history(ocean, wrong)


def test_the_reference_page_s_example_writes_a_valid_ocean(tmp_path, monkeypatch):
    page = Path(__file__).resolve().parents[2] / "docs" / "reference" / "ocean-files.md"
    (code,) = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    monkeypatch.chdir(tmp_path)
    exec(compile(code, str(page), "exec"), {})  # noqa: S102
    ocean = open_ocean("ligurian.nc")
    assert dict(ocean.sizes) == {"depth": 4, "lat": 26, "lon": 13}
    assert ocean.attrs == {"title": "Ligurian Sea", "source": "my model, run 7", "synthetic": 1}
    assert float(ocean["water_temp"][0, 0, 0]) == 22.0
    assert "history" not in ocean.attrs  # nothing was converted


def test_the_reference_page_states_the_limits_that_the_schema_has():
    page = Path(__file__).resolve().parents[2] / "docs" / "reference" / "ocean-files.md"
    text = page.read_text(encoding="utf-8")
    for v in VARIABLES:
        (row,) = [line for line in text.splitlines() if line.startswith(f"| `{v.name}`")]
        assert f"`{v.standard_name}` | {v.units} | {v.lowest:g} to {v.highest:g} |" in row

"""The catalogue: what is shipped is whole, and what a user writes is checked."""

import numpy as np
import pytest

from pymantaray.errors import OceanError
from pymantaray.ocean.fetch.catalogue import covering, load_catalogue


@pytest.fixture(autouse=True)
def _no_environment(monkeypatch):
    monkeypatch.delenv("MANTARAY_OCEAN_SERVERS", raising=False)


@pytest.mark.parametrize(("time", "names"), [
    ("2014-07-15T12", ("expt_53.X", "expt_56.3")),
    ("2016-04-01", ("expt_56.3",)),
    ("2016-08-01", ("expt_57.2", "expt_56.3")),
    ("2017-03-01", ("expt_92.8",)),
    ("2017-08-01", ("expt_57.7",)),
    ("2017-12-01", ("expt_92.9",)),
    ("2018-02-01", ("GLBv-93.0", "expt_92.9")),
    ("2019-03-07", ("GLBy-93.0", "GLBv-93.0")),
    ("2024-09-01", ("GLBy-93.0", "ESPC-D-V02")),
    ("2030-01-01", ("ESPC-D-V02",)),
])  # fmt: skip
def test_every_time_since_1994_has_an_experiment(time, names):
    experiments = covering(
        load_catalogue().experiments, np.datetime64(time, "s"), None, "experiment"
    )
    assert tuple(e.name for e in experiments) == names


def test_there_is_no_hole_between_experiments():
    experiments = load_catalogue().experiments
    for day in np.arange("1994-01-02", "2026-01-01", 4, dtype="datetime64[D]"):
        assert covering(experiments, day.astype("datetime64[s]"), None, "experiment")


def test_a_mirror_needs_only_its_addresses(tmp_path, monkeypatch):
    mine = tmp_path / "mine.toml"
    mine.write_text('[addresses]\nopendap = "https://mirror.example/dodsC"\n')
    catalogue = load_catalogue(mine)
    assert catalogue.addresses.opendap == "https://mirror.example/dodsC"
    assert catalogue.experiments == load_catalogue().experiments
    monkeypatch.setenv("MANTARAY_OCEAN_SERVERS", str(mine))
    assert load_catalogue() == catalogue
    assert load_catalogue("http://127.0.0.1:1/x").addresses.opendap == "http://127.0.0.1:1/x"


EXPERIMENT = """
[[experiments]]
name = "mine"
title = "My run"
first = 2020-01-01T00:00:00
datasets = [{ path = "mine", variables = ["water_temp", "salinity", "water_u", "water_v"] }]
"""


@pytest.mark.parametrize(("text", "line"), [
    ("not = [toml", "mine.toml: not valid TOML"),
    ("[servers]\nopendap = 'http://a'", "mine.toml: servers: Extra inputs are not permitted"),
    ("[addresses]", "mine.toml: addresses.opendap: Field required"),
    ("[addresses]\nopendap = 'file:///etc/passwd'", "is not a valid URL"),
    (EXPERIMENT.replace("2020-01-01T00:00:00", "'soon'"), "mine.toml: experiments.0.first"),
    (EXPERIMENT.replace('"water_v"', '"water_u"'), "water_u, water_u; it must have each of"),
    (None, "mine.toml: no such file"),
])  # fmt: skip
def test_what_is_not_understood_is_refused_in_one_line(tmp_path, text, line):
    if text is not None:
        (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(OceanError) as caught:
        load_catalogue(tmp_path / "mine.toml")
    assert line in str(caught.value)
    assert "\n" not in str(caught.value)

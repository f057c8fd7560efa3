"""Quantities of a configuration: a number in the key's unit, or text with a unit of its own."""

import datetime as dt
import itertools
import math
import re

import numpy as np
import pytest
from refusals import refused

from pymantaray.apps.service.messages import PingRequest
from pymantaray.config import checks, load_study
from pymantaray.config.sections import StudyConfig
from pymantaray.errors import StudyError
from pymantaray.quantities.units import quantity_of

IN_WORDS = {"m": "m", "s": "s", "h": "h", "days": "d", "m/s": "m/s", "degrees": "deg",
            "degrees/s": "deg/s",
            "rad": "rad", "rad/s": "rad/s", "Hz": "Hz"}  # fmt: skip


@pytest.mark.parametrize(("text", "unit", "number"), [
    ("10 m", "m", 10.0), ("2 km", "m", 2000.0), ("-1.5km", "m", -1500.0), ("1 nmi", "m", 1852.0),
    ("5 cm", "m", 0.05),
    ("500 ms", "s", 0.5), ("20 us", "s", 2e-5), ("20 µs", "s", 2e-5), ("1 d 12 h", "h", 36.0),
    ("36 h", "d", 1.5),
    ("3 kn", "m/s", 3 * 1852 / 3600), ("3.6 km/h", "m/s", 1.0), ("25 kHz", "Hz", 25e3),
    ("1e-3 MHz", "Hz", 1e3),
    ("10 deg", "deg", 10.0), ("180 deg", "rad", math.pi), ("0.1 rad", "rad", 0.1),
    ("1 mrad", "rad", 1e-3),
    ("60 deg/min", "deg/s", 1.0), ("+.5 m", "m", 0.5), ("1e3 m", "m", 1e3), ("2000 m", "km", 2.0),
])  # fmt: skip
def test_text_with_a_unit_is_the_number_in_another(text, unit, number):
    assert quantity_of(text, unit) == pytest.approx(number, rel=1e-15, abs=0.0)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "10",
        "m",
        "10 kg",
        "1 h",
        "- m",
        "1 m -2 m",
        "1,5 m",
        "nan m",
        "inf m",
        "0x1 m",
        "1__0 m",
    ],
)
def test_text_that_is_no_length_is_refused_with_what_is_one(text):
    message = re.escape(
        f'found {text!r}; allowed: a number of metres, or text such as "2 km" (units mm, cm, m,'
        " km, nmi)"
    )
    with pytest.raises(ValueError, match=message):
        quantity_of(text, "m")


def test_huge_text_ends_at_once():
    assert quantity_of("9" * 400 + " m", "m") == math.inf
    with pytest.raises(ValueError, match="allowed: a number of metres"):
        quantity_of("1 m " * 1000 + "x", "m")


@pytest.mark.parametrize(("key", "text", "number"), [
    ("mission.duration_h", "1 d", 24.0),
    ("mission.gnss_depth", "50 cm", 0.5),
    ("noise.range_sigma", "2 m", 2.0),
    ("noise.odometry_translation_drift", "1 cm/s", 0.01),
    ("noise.first_rotation_sigma", "1 mrad", 1e-3),
    ("noise.odometry_rotation_drift", "3.6 deg/h", math.radians(1e-3)),
    ("noise.clock_offset_sigma", "1 ms", 1e-3),
    ("ocean.half_extent_north", "100 km", 1e5),
    ("ocean.centre_lat", "74.5 deg", 74.5),
    ("ocean.ice", "2 m", 2.0),
    ("fleet.vehicles.B.north", "-2 km", -2000.0),
    ("fleet.vehicles.B.heading_deg", "1 rad", math.degrees(1.0)),
    ("fleet.vehicles.B.vertical_speed", "1.8 km/h", 0.5),
])  # fmt: skip
def test_a_key_takes_text_with_a_unit(key, text, number):
    base = load_study("quick", **{"ocean.half_extent_north": 1.0, "ocean.half_extent_east": 1.0})
    one, other = (base.with_(**{key: value, "study.description": ""}) for value in (text, number))
    for path in key.split("."):
        one, other = (
            {v.name: v for v in section}[path]
            if isinstance(section, tuple)
            else getattr(section, path)
            for section in (one, other)
        )
    assert one == pytest.approx(other, rel=1e-15)
    assert one == pytest.approx(number, rel=1e-15)


def test_lists_and_detection_take_text_with_a_unit():
    loud = {
        "source_level_db": 185.0,
        "frequency_hz": "25 kHz",
        "bandwidth_hz": "5 kHz",
        "wind_speed": "10 kn",
    }
    route = {"name": "W", "kind": "waypoints", "north": 0.0, "east": "1 km", "depth": "10 m",
             "speed": "3 kn",
             "turn_rate_deg": "0.1 rad/s", "points": [["1 km", 0.0, "20 m"]]}  # fmt: skip
    config = load_study("quick", detection=loud, **{"fleet.vehicles": [route]})
    assert (config.detection.frequency_hz, config.detection.bandwidth_hz) == (25e3, 5e3)
    assert config.fleet.vehicles[0].points == ((1000.0, 0.0, 20.0),)


def test_ice_is_a_draft_or_a_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert load_study("quick", **{"ocean.ice": "ice.nc"}).ocean.ice == str(tmp_path / "ice.nc")
    assert load_study("quick", **{"ocean.ice": 2}).ocean.ice == 2.0


@pytest.mark.parametrize(("key", "value", "line"), [
    ("noise.range_sigma", "2 s", ("noise.range_sigma: found '2 s'; allowed: a number of metres, or"
                                 " text such as \"2 km\"")),
    ("noise.range_sigma", "0 m", "noise.range_sigma: found 0.0; allowed: greater than 0"),
    ("ocean.centre_lat", "2 rad", "ocean.centre_lat: found '2 rad'; allowed: 90 or less"),
    ("fleet.vehicles.B.target_depth", "-5 m", "target_depth: found -5.0; allowed: 0 or more"),
    ("ranging.turn_around_s", "1 m",
     "ranging.turn_around_s: found '1 m'; allowed: a number of seconds"),
])  # fmt: skip
def test_other_text_is_refused_in_one_line(key, value, line):
    refused(StudyError, re.escape(line), load_study, "quick", **{key: value})


def models_below(model):
    models, new = {model}, {model}
    while new:
        new = {
            m
            for one in new
            for f in one.model_fields.values()
            for m in checks.models_in(f.annotation)
        } - models
        models |= new
    return models


def units_in(schema):
    """Units of a key's JSON schema, those of its items and options included."""
    if isinstance(schema, list):
        return list(itertools.chain.from_iterable(map(units_in, schema)))
    if not isinstance(schema, dict):
        return []
    return ([schema["unit"]] if "unit" in schema else []) + units_in(list(schema.values()))


def test_every_quantity_accepts_text_in_the_unit_of_its_description():
    checked = 0
    for model in sorted(models_below(StudyConfig), key=lambda m: m.__name__):
        for name, field in model.model_json_schema()["properties"].items():
            said = re.search(r"\[([^][]+)\]$", field.get("description", ""))
            units = set(said[1].split(", ")) & set(IN_WORDS) if said else set()
            assert set(units_in(field)) >= {IN_WORDS[unit] for unit in units}, (model, name)
            checked += len(units)
    assert checked > 60
    assert not units_in(PingRequest.model_json_schema())


NOON = dt.datetime.fromisoformat("2014-07-15T12:00:00")


@pytest.mark.parametrize(("time", "instant"), [
    ("2014-07-15T12:00:00", NOON),
    ("2014-07-15 12:00", NOON),
    ("2014-07-15T12:00Z", NOON.replace(tzinfo=dt.UTC)),
    ("2014-07-15", NOON.replace(hour=0)),
    (np.datetime64("2014-07-15T12"), NOON),
    (np.datetime64("2014-07-15T12:00:00", "ns"), NOON),
    (dt.date(2014, 7, 15), NOON.replace(hour=0)),
    (NOON, NOON),
])  # fmt: skip
def test_an_instant_is_text_or_an_object_of_date_and_time(time, instant):
    assert load_study("quick", **{"ocean.time": time}).ocean.time == instant


@pytest.mark.parametrize("time", ["noon", "2014-15-07", 5, np.datetime64("NaT", "ms")])
def test_other_instants_are_refused(time):
    message = "ocean.time: found .*; allowed: a time as 2014-07-15T12:00:00"
    with pytest.raises(StudyError, match=message):
        load_study("quick", **{"ocean.time": time})

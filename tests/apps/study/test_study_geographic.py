"""
Vehicles, waypoints and landmarks by latitude and longitude are where they are by north and east.
"""

import copy

import pytest
from factories import TINY
from refusals import refused

from pymantaray import LocalFrame
from pymantaray.config import parse_study, study_toml
from pymantaray.errors import StudyError

FRAME = LocalFrame(74.5, -140.0)


def geographic():
    tree = copy.deepcopy(TINY)
    for entry in (*tree["fleet"]["vehicles"], *tree["landmarks"]):
        entry["lat"], entry["lon"] = map(
            float, FRAME.to_geodetic(entry.pop("north"), entry.pop("east"))
        )
        if "points" in entry:
            entry["points"] = [
                [*map(float, FRAME.to_geodetic(n, e)), d] for n, e, d in entry["points"]
            ]
    return tree


def test_they_have_the_same_places_in_the_resolved_file():
    config, plain = parse_study(geographic()), parse_study(TINY)
    for one, other in zip(
        (*config.fleet.vehicles, *config.landmarks),
        (*plain.fleet.vehicles, *plain.landmarks),
        strict=True,
    ):
        assert (one.north, one.east) == pytest.approx((other.north, other.east), abs=1e-6)
    route, expected = (c.fleet.vehicles[2].points for c in (config, plain))
    for one, other in zip(route, expected, strict=True):
        assert one == pytest.approx(other, abs=1e-6)
    assert "\nlat = " not in study_toml(config)


def test_a_cast_that_is_believed_is_placed_by_lat_and_lon():
    lat, lon = map(float, FRAME.to_geodetic(1000.0, -2000.0))
    cast = {
        "name": "cast",
        "range_model": {"kind": "eigenray", "belief": {"kind": "cast", "lat": lat, "lon": lon}},
    }
    mean = {"name": "mean", "range_model": {"kind": "eigenray", "belief": "mean"}}
    believed = parse_study({**copy.deepcopy(TINY), "conditions": [mean, cast]}).conditions[1].belief
    assert (believed.north, believed.east) == pytest.approx((1000.0, -2000.0), abs=1e-6)
    del cast["range_model"]["belief"]["lon"]
    refused(
        StudyError,
        "the belief of cast: found lat; give either lat and lon, or north and east$",
        parse_study,
        {**copy.deepcopy(TINY), "conditions": [cast]},
    )


def changed(**of_first):
    tree = geographic()
    tree["fleet"]["vehicles"][0] |= of_first
    vehicles = [
        {key: value for key, value in vehicle.items() if value is not None}
        for vehicle in tree["fleet"]["vehicles"]
    ]
    return {**tree, "fleet": {**tree["fleet"], "vehicles": vehicles}}


def no_centre():
    tree = geographic()
    return {**tree, "ocean": {"source": "synthetic:beaufort"}}


REFUSED = {
    "A: found lat, lon, north; give either lat and lon, or north and east": lambda: changed(
        north=1.0
    ),
    "A: found lat; give either lat and lon, or north and east$": lambda: changed(lon=None),
    "A: found lat 95.0, lon -140.0; allowed: numbers, lat from -90 to 90": lambda: changed(
        lat=95.0, lon=-140.0
    ),
    "A: found lat 'north', lon": lambda: changed(lat="north"),
    "which need the frame's centre: give ocean.centre_lat": no_centre,
}


@pytest.mark.parametrize("message", REFUSED)
def test_places_that_are_none_are_one_line_each(message):
    refused(StudyError, message, lambda: parse_study(REFUSED[message]()))


@pytest.mark.parametrize("tree", [[], {"fleet": 3}, {"fleet": {"vehicles": 5}}, {"landmarks": [1]}])
def test_what_is_no_study_is_told_so_by_the_study(tree):
    with pytest.raises(StudyError, match="study"):
        parse_study(tree)

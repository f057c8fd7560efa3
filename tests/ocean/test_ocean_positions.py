"""
Positions in the text of headers and comments; expectations are degrees plus minutes / 60 with the
sign of the hemisphere.
"""

import math

import pytest
from refusals import refused

from pymantaray.acoustics import read_profile, write_asvp
from pymantaray.errors import MantaRayError
from pymantaray.ocean import read_cast
from pymantaray.ocean.positions import angle, position_in_comment, position_in_text

READ = {
    "S12 30.60": -(12 + 30.60 / 60), "s 12 30.60": -(12 + 30.60 / 60),
    "12 30.60 S": -(12 + 30.60 / 60),
    "South 12.51": -12.51, "12.51 degrees south": -12.51,
    "12°30'36\" S": -12.51, "12-30.6S": -12.51,
    "12:30.6 S": -12.51, "12 30 36 S (bridge)": -12.51,
    "12 deg 30.6 min S": -12.51, "32 15 S lat": -32.25,
    "-12 30.6": -12.51, "-12 30.6 S": -12.51, "N44 41.056": 44 + 41.056 / 60,
    "44 41.056 N 500 m from buoy": 44 + 41.056 / 60,
    "12 30.6 Sur": -12.51, "12.51 Süd": -12.51, "Sud 12 30.6": -12.51, "12 30.6 Nord": 12.51,
    "12 59.99 S": -(12 + 59.99 / 60),
    "74.5": 74.5, "74": 74.0, "74.": 74.0, "+74.5": 74.5, "47 24.53 approx": 47 + 24.53 / 60,
}  # fmt: skip
UNREAD = (
    "", "unknown", "S", "12 30.6 Q", "12 30.6 E", "S12 30.6 N", "-12 30.6 N", "12 75 S", "12 60 S",
    "12 30 60 S", "12 30.6 Este", "12.5 30 S", "12 30.6 5 S", "12,51 S",
    "12 N 30.5", "12 30.6 (position of the ship, S of the mooring)",
)  # fmt: skip


@pytest.mark.parametrize(("words", "degrees"), READ.items())
def test_latitudes_are_read_with_a_hemisphere_on_either_side(words, degrees):
    assert angle(words, "latitude") == pytest.approx(degrees, abs=1e-12)


@pytest.mark.parametrize("words", UNREAD)
def test_uncertain_latitudes_are_not_read(words):
    assert math.isnan(angle(words, "latitude"))


@pytest.mark.parametrize(
    "words",
    [
        "W063 38.60",
        "w63 38.60",
        "W 63 38.6",
        "063 38.6 W (bridge)",
        "West 63 38.6",
        "63 38.6 Oeste",
        "Ouest 63 38.6",
    ],
)
def test_longitudes_west_are_negative(words):
    assert angle(words, "longitude") == pytest.approx(-(63 + 38.6 / 60), abs=1e-12)


def test_notes_say_what_is_assumed_or_not_used():
    assert position_in_text("12 30", "63 15") == (
        (12.5, 63.25),
        (
            "latitude '12 30' has no hemisphere: north assumed",
            "longitude '63 15' has no hemisphere: east assumed",
        ),
    )
    assert position_in_text("12 30 Q", "63 15 E") == (
        None,
        ("position not read: latitude '12 30 Q'",),
    )
    assert math.isnan(angle("63 38.6 O", "longitude"))  # east in German, west in Spanish
    for fill in ("999", "0", "99.9999"):
        place, notes = position_in_text(fill, fill)
        assert place is None
        assert notes[0].endswith("not used: no fix, or not a place")
    assert position_in_text("45", "360.5")[0] is None
    assert position_in_text("45", "359.5")[0] == (45.0, 359.5)


def test_comments_have_positions_in_any_order():
    for line in ("# lat S12.5, lon W63.25", "# lon -63.25 lat -12.5 2014-07-24 19:20",
                 "# lat 12 30 S; lon 63 15 W, 1500 m",
                 "# latitude: 12.5 S, longitude: 63.25W"):  # fmt: skip
        assert position_in_comment(line) == (-12.5, -63.25), line
    for line in ("# lat 12 30 Q, lon 63 15 W", "# lat and lon of the log", "# lat 12.5"):
        assert position_in_comment(line) is None, line


HEADERS = {
    "a.cnv": ("** Latitude:  S12 30.60\n** Longitude: W063 38.60\n# name 0 = prdM: p\n# name 1 ="
              " t090C: t\n# name 2 = sal00: s\n"
              "*END*\n 1 27 36\n 100 20 36\n"),
    "a.vp2": ("[HEADER]\nLatitude=S12 30.60\nLongitude=W063"
              " 38.60\n[DATA]\nDepth\tTemperature\tSalinity\nm\tC\tPSU\n"
              "1\t27\t36\n100\t20\t36\n"),
    "a.edf": ("// MK21\nDate of Launch: 07/24/2014\nLatitude : S12 30.60\nLongitude : W063 38.60\n"
              "Depth (m) - Temperature (C) - Salinity (PSU)\n1 27 36\n100 20 36\n"),
    "a.csv": ("% Device,CC1\n% Start latitude,S12 30.60\n% Start longitude,W063 38.60\n"
              "Depth (Meter),Temperature (Celsius),Salinity (Practical Salinity"
              " Scale)\n1,27,36\n100,20,36\n"),
    "a.txt": ("Model=RBRconcerto\nLatitude=S12 30.60\nLongitude=W063 38.60\nTime,Temperature,Sea"
              " pressure,Salinity\n"
              "2014-07-24 19:20:00.000,27,1,36\n2014-07-24 19:20:01.000,20,100,36\n"),
}  # fmt: skip


@pytest.mark.parametrize("name", HEADERS)
def test_every_instrument_reads_the_same_positions(tmp_path, name, as_stored):
    (tmp_path / name).write_text(HEADERS[name])
    cast = read_cast(tmp_path / name)
    assert (cast.lat, cast.lon) == pytest.approx((-12.51, -(63 + 38.6 / 60)), abs=1e-9)
    (tmp_path / name).write_text(HEADERS[name].replace("S12 30.60", "12 30.60 X"))
    refused(
        MantaRayError,
        "no place .position not read: latitude '12 30.60 X'.; give",
        read_cast,
        tmp_path / name,
    )
    assert read_cast(tmp_path / name, lat=-12.0, lon=-63.0).lat == -12.0
    as_stored(cast)


def test_values_without_a_fix_are_no_position(tmp_path, as_stored):
    text = HEADERS["a.vp2"].replace("S12 30.60", "999").replace("W063 38.60", "999")
    text = (
        text.replace("Salinity", "Sound Velocity").replace("PSU", "m/s").replace("\t36", "\t1500")
    )
    (tmp_path / "a.vp2").write_text(text)
    profile = read_profile(tmp_path / "a.vp2")
    assert profile.place is None
    assert "position 999, 999 not used: no fix, or not a place" in profile.notes
    refused(
        MantaRayError,
        "the position of a is unknown .position 999, 999 not used",
        write_asvp,
        tmp_path / "a.asvp",
        profile,
    )
    (tmp_path / "b.csv").write_text("lat,lon,depth,sound_speed\n999,999,1,1500\n999,999,9,1500\n")
    profile = read_profile(tmp_path / "b.csv")
    assert profile.place is None
    assert "not used" in profile.notes[0]
    refused(
        MantaRayError, "latitude must be -90 to 90", read_profile, tmp_path / "b.csv", (91.0, 0.0)
    )
    as_stored(profile)

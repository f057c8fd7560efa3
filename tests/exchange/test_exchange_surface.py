"""
Tracks of surface vehicles as GPX and NMEA 0183 are those that were written, across midnight, with
dates of RMC or ZDA, and without fixes and sentences that are wrong.
"""

from functools import reduce
from operator import xor

import numpy as np
import pytest

from pymantaray import read_trajectories
from pymantaray.errors import ExchangeError

TIMES = np.datetime64("2014-07-24T23:59:50", "ns") + np.arange(30) * np.timedelta64(1, "s")
LAT = -33.5 + 1e-5 * np.arange(30)
LON = -151.25 - 1e-5 * np.arange(30)


def check(track, *, missing=(), tolerance=1e-8):
    rows = [k for k in range(30) if k not in missing]
    assert track.start == TIMES[rows[0]]
    (poses,) = track.poses
    np.testing.assert_allclose(poses.time, np.array(rows) - rows[0], atol=1e-6)
    np.testing.assert_allclose(poses.place[:, 0], LAT[rows], atol=tolerance)
    np.testing.assert_allclose(poses.place[:, 1], LON[rows], atol=tolerance)
    assert np.all(poses.place[:, 2] == 0.0)


def sentence(body, wrong=False):
    checksum = reduce(xor, body.encode(), 0) ^ (1 if wrong else 0)
    return f"${body}*{checksum:02X}"


def parts(k):
    """Time of day, date, and position of a fix in the form of NMEA."""
    stamp = str(np.datetime_as_string(TIMES[k], unit="ms"))
    clock = stamp[11:].replace(":", "")[:9]
    date = stamp[8:10] + stamp[5:7] + stamp[2:4]
    place = []
    for value, width in ((abs(LAT[k]), 2), (abs(LON[k]), 3)):
        minutes = 60.0 * (value % 1.0)
        place.append(f"{int(value):0{width}d}{minutes:010.7f}")
    return clock, date, f"{place[0]},S,{place[1]},W"


def nmea(path, dates="RMC", broken=(), unfixed=()):
    lines = ["# log of a receiver"]
    for k in range(30):
        clock, date, place = parts(k)
        quality = 0 if k in unfixed else 4
        lines.append(
            sentence(f"GPGGA,{clock},{place},{quality},10,0.8,5.0,M,20.0,M,,", wrong=k in broken)
        )
        if dates == "RMC":
            state = "V" if k in unfixed or k in broken else "A"
            lines.append(sentence(f"GNRMC,{clock},{state},{place},1.2,90.0,{date},,,A"))
        elif dates == "ZDA" and k % 7 == 3:
            day, month, year = date[:2], date[2:4], "20" + date[4:]
            lines.append(sentence(f"GPZDA,{clock},{day},{month},{year},00,00"))
        lines.append(sentence("GPGSV,1,1,00"))
    path.write_text("\r\n".join(lines) + "\r\n")
    return path


@pytest.mark.parametrize("dates", ["RMC", "ZDA"])
@pytest.mark.parametrize("name", ["boat.nmea", "boat.txt", "boat.log"])
def test_fixes_of_a_receiver_pass_midnight(tmp_path, dates, name):
    check(read_trajectories(nmea(tmp_path / name, dates)))


def test_wrong_sentences_are_counted_and_left_out(tmp_path):
    track = read_trajectories(nmea(tmp_path / "boat.nmea", broken={5}, unfixed={9}))
    check(track, missing={5, 9})
    assert any("1 sentence with a wrong checksum" in note for note in track.notes)
    assert any("3 sentences without a valid fix" in note for note in track.notes)


@pytest.mark.parametrize("position", [",,,", "3330.0,S,15115.0,W"])
def test_void_sentences_give_no_dates(tmp_path, position):
    path = nmea(tmp_path / "boat.nmea", dates="ZDA")
    starts, lines = [], path.read_text().splitlines()
    for k in range(4):  # a clock that starts in 1980, then the date of the last survey
        day = "060180" if k < 2 else "010313"
        starts += [
            sentence(f"GPGGA,00000{k},{position},0,00,99.9,,M,,M,,"),
            sentence(f"GPRMC,00000{k},V,{position},,,{day},,,N"),
            sentence(f"GPZDA,00000{k},{day[:2]},{day[2:4]},{19 + k // 2}{day[4:]},00,00"),
        ]
    void = sentence(f"GPRMC,235952.500,V,{position},,,060180,,,N")
    path.write_text("\r\n".join([*starts, *lines[:7], void, *lines[7:]]) + "\r\n")
    track = read_trajectories(path)
    check(track)
    assert any("9 sentences without a valid fix" in note for note in track.notes)
    assert any("4 sentences ZDA beside those without" in note for note in track.notes)


def test_a_date_without_any_fix_beside_it_is_refused(tmp_path):
    void = sentence("GPRMC,000001,V,,,,,,,060180,,,N")
    fix = sentence("GPGGA,192000,3330.0,S,15115.0,W,1,08,1.0,5.0,M,20.0,M,,")
    (tmp_path / "a.nmea").write_text(f"{void}\n{fix}\n")
    with pytest.raises(ExchangeError, match="RMC or ZDA sentences with a valid fix"):
        read_trajectories(tmp_path / "a.nmea")


@pytest.mark.parametrize("dated", [0, 29])
def test_one_date_is_enough_for_more_than_a_day(tmp_path, dated):
    hours = np.datetime64("2014-07-24T06:00:00", "s") + np.arange(30) * np.timedelta64(3600, "s")
    lines = []
    for k, time in enumerate(hours):
        clock = str(time)[11:].replace(":", "")
        lines.append(sentence(f"GPGGA,{clock},3330.0,S,15115.0,W,1,08,1.0,5.0,M,20.0,M,,"))
        if k == dated:
            day = str(time)[:10].split("-")
            lines.append(sentence(f"GPZDA,{clock},{day[2]},{day[1]},{day[0]},00,00"))
    (tmp_path / "long.nmea").write_text("\n".join(lines) + "\n")
    track = read_trajectories(tmp_path / "long.nmea")
    assert track.start == hours[0]
    np.testing.assert_array_equal(track.poses[0].time, 3600.0 * np.arange(30))


def test_leading_zeros_of_degrees_may_be_missing(tmp_path):
    lines = [sentence(f"GPRMC,19200{k},A,930.5,N,534.25,W,1.2,90.0,240714,,,A") for k in range(3)]
    (tmp_path / "a.nmea").write_text("\n".join(lines) + "\n")
    (poses,) = read_trajectories(tmp_path / "a.nmea").poses
    np.testing.assert_allclose(poses.place[0, :2], [9.0 + 30.5 / 60.0, -5.0 - 34.25 / 60.0])


@pytest.mark.parametrize("quality", ["6", "7", "8"])
def test_estimated_and_simulated_places_are_no_fixes(tmp_path, quality):
    path = nmea(tmp_path / "boat.nmea")
    lines = path.read_text().splitlines()
    guess = sentence(f"GPGGA,235951.500,1000.0,N,01000.0,E,{quality},00,,,M,,M,,")
    path.write_text("\r\n".join([*lines[:7], guess, *lines[7:]]) + "\r\n")
    track = read_trajectories(path)
    check(track)
    assert any("1 sentence without a valid fix" in note for note in track.notes)


def test_fixes_without_a_date_are_refused(tmp_path):
    with pytest.raises(ExchangeError, match="must also write RMC or ZDA"):
        read_trajectories(nmea(tmp_path / "boat.nmea", dates="none"))
    (tmp_path / "none.nmea").write_text(sentence("GPGSV,1,1,00") + "\n")
    with pytest.raises(ExchangeError, match="no valid fix"):
        read_trajectories(tmp_path / "none.nmea")


STAMPS = {
    "iso": "gnss_one  %Y-%m-%dT%H:%M:%S.0811Z  ",
    "slashes": "NAV %Y/%m/%d %H:%M:%S.561 GPS ",
    "day_of_year": "cnav\t%Y:%j:%H:%M:%S.0656\t",
    "month_first": "%m/%d/%Y,%H:%M:%S.876,",
}
"""Of the loggers of research vessels."""


def logged(path, stamp, dates="none", late=0):
    """Log with a stamp before each sentence, late by some seconds."""
    lines = nmea(path, dates).read_text().splitlines()[1:]
    each = len(lines) // 30
    for k in range(len(lines)):
        time = (TIMES[k // each] + np.timedelta64(late, "s")).astype("datetime64[s]").item()
        lines[k] = time.strftime(stamp) + lines[k]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("late", [-40, 0, 40])  # on the day before and after the fixes, too
@pytest.mark.parametrize("stamp", STAMPS)
@pytest.mark.parametrize("name", ["boat.Raw", "boat.txt", "boat.csv"])
def test_stamps_of_a_logger_give_dates(tmp_path, stamp, name, late):
    track = read_trajectories(logged(tmp_path / name, STAMPS[stamp], late=late))
    check(track)
    assert any("30 sentences with the date of the logger's stamp" in note for note in track.notes)


def test_dates_of_the_receiver_come_before_those_of_a_logger(tmp_path):
    wrong = 40 * 86_400
    track = read_trajectories(logged(tmp_path / "a.txt", STAMPS["iso"], "RMC", late=wrong))
    check(track)
    assert not any("stamp" in note for note in track.notes)


@pytest.mark.parametrize("stamp", ["%d/%m/%Y,%H:%M:%S,", "%Y:400:%H:%M:%S ", "%H:%M:%S "])
def test_impossible_stamps_give_no_dates(tmp_path, stamp):
    with pytest.raises(ExchangeError, match="or the logger stamps such as"):
        read_trajectories(logged(tmp_path / "a.txt", stamp))


def test_a_day_of_zda_may_have_one_digit(tmp_path):
    fixes = [
        sentence(f"GPGGA,19200{k},3330.0,S,15115.0,W,1,08,1.0,5.0,M,20.0,M,,") for k in range(3)
    ]
    date = sentence("GPZDA,192000.00,4,9,2010,+0,+0")
    (tmp_path / "a.nmea").write_text("\n".join([*fixes, date]) + "\n")
    assert read_trajectories(tmp_path / "a.nmea").start == np.datetime64("2010-09-04T19:20:00")


def gpx(path, names=("boat",), untimed=()):
    def point(k):
        time = "" if k in untimed else f"<time>{np.datetime_as_string(TIMES[k], unit='s')}Z</time>"
        return f'<trkpt lat="{LAT[k]:.9f}" lon="{LON[k]:.9f}"><ele>3</ele>{time}</trkpt>'

    def track(name):
        halves = ("".join(map(point, range(15))), "".join(map(point, range(15, 30))))
        segments = "".join(f"<trkseg>{half}</trkseg>" for half in halves)
        return f"<trk><name>{name}</name>{segments}</trk>"

    path.write_text(
        '<?xml version="1.0"?><gpx xmlns="http://www.topografix.com/GPX/1/1" version="1.1">'
        + "".join(map(track, names))
        + "</gpx>"
    )
    return path


def test_a_track_of_gpx_is_a_vehicle(tmp_path):
    track = read_trajectories(gpx(tmp_path / "trip.gpx"))
    assert track.names == ["boat"]
    check(track)
    assert read_trajectories(gpx(tmp_path / "two.gpx", ("A", "B"))).names == ["A", "B"]


def test_points_without_a_time_are_counted(tmp_path):
    track = read_trajectories(gpx(tmp_path / "trip.gpx", untimed={3}))
    check(track, missing={3})
    assert any("1 point without position or time" in note for note in track.notes)


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("<gpx><wpt lat='1' lon='2'/></gpx>", "no track with points that have a time"),
        ("<gpx>", "no XML"),
        ("<!DOCTYPE gpx [<!ENTITY a 'b'>]><gpx/>", "declares a document type"),
    ],
)
def test_other_gpx_is_refused_in_one_line(tmp_path, text, cause):
    (tmp_path / "a.gpx").write_text(text)
    with pytest.raises(ExchangeError) as error:
        read_trajectories(tmp_path / "a.gpx")
    assert cause in str(error.value)
    assert "\n" not in str(error.value)

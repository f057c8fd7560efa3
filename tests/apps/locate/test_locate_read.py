"""
Files of other programs in the variants that occur: line ends, comments, missing columns, flags,
clocks, folders.
"""

import re

import numpy as np
import pandas as pd
import pytest
from campaigns import make_campaign, write_garpos, write_gnatss, write_obsrange, write_table
from refusals import refused

from pymantaray.apps.locate import ReadOptions, TravelDirection, read_survey
from pymantaray.errors import LocateError
from pymantaray.geometry import LocalFrame


@pytest.fixture(scope="module")
def campaign():
    return make_campaign(4, pings=12)


def edited(path, *changes):
    text = path.read_bytes().decode()
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    path.write_bytes(text.encode())
    return path


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_files_of_garpos_are_read_as_they_stand(campaign, tmp_path, end, as_stored):
    survey = read_survey(write_garpos(campaign, tmp_path, end=end, lever_sigma=(0.1, 0.2, 0.3)))
    assert survey.names == campaign.names
    np.testing.assert_allclose([node.position for node in survey.nodes], campaign.prior, atol=1e-4)
    np.testing.assert_allclose([node.sigma for node in survey.nodes], campaign.prior_sigma)
    np.testing.assert_allclose(survey.travel_time, campaign.two_way - 0.013, atol=1e-7)
    np.testing.assert_allclose(survey.transmit_position, campaign.antenna[0], atol=1e-5)
    np.testing.assert_allclose(survey.receive_position, campaign.antenna[1], atol=1e-5)
    turned = np.exp(1j * (survey.receive_attitude - campaign.attitude[1]))
    np.testing.assert_allclose(turned, 1.0, atol=1e-7)
    assert survey.lever.offset == campaign.lever[0]
    assert survey.lever.sigma == (0.1, 0.2, 0.3)
    assert str(survey.epoch)[:10] == "2019-03-15"
    assert survey.profile[0][-1] == 3000.0
    assert survey.rigid is None
    if end == "\n":
        as_stored(survey)


def test_garpos_flags_exclude_pings_and_missing_columns_have_defaults(
    campaign, tmp_path, as_stored
):
    path = write_garpos(campaign, tmp_path)
    table = tmp_path / "obsdata" / "SITE-obs.csv"
    lines = table.read_text().splitlines()
    rows = [line.split(",") for line in lines if line and not line.startswith("#")]
    head = rows[0]
    rows[3][head.index("flag")] = "True"
    kept = [
        i
        for i, name in enumerate(head)
        if name not in ("ResiTT", "TakeOff", "gamma", "pitch0", "RT", "LN")
    ]
    table.write_text("\n".join(",".join(row[i] for i in kept) for row in rows) + "\n")
    survey = read_survey(path)
    assert survey.flagged.nonzero()[0].tolist() == [2]
    assert (survey.transmit_attitude[:, 1] == 0.0).all()
    assert len(survey) == campaign.time.size
    as_stored(survey)


def test_times_of_garpos_may_be_unordered_and_of_any_clock(campaign, tmp_path):
    path = write_garpos(campaign, tmp_path)
    table = tmp_path / "obsdata" / "SITE-obs.csv"
    first, *rest = [
        line for line in table.read_text().splitlines() if line and not line.startswith("#")
    ]
    head = first.split(",")
    unix = 1552608000.0  # 2019-03-15

    def later(line):
        cells = line.split(",")
        for name in ("ST", "RT"):
            cells[head.index(name)] = f"{float(cells[head.index(name)]) + unix:.6f}"
        return ",".join(cells)

    table.write_text("\n".join([first, *(later(line) for line in reversed(rest))]) + "\n")
    survey = read_survey(path)
    assert (np.diff(survey.time) >= 0.0).all()
    assert any("rows sorted by time" in note for note in survey.notes)
    assert survey.time[0] == pytest.approx(30000.0)
    assert str(survey.epoch)[:10] == "2019-03-15"


def test_a_survey_of_garpos_that_passes_midnight_is_refused(campaign, tmp_path):
    path = write_garpos(campaign, tmp_path)
    table = tmp_path / "obsdata" / "SITE-obs.csv"
    lines = table.read_text().splitlines()
    head = lines[1].split(",")
    for row in range(2, len(lines)):
        cells = lines[row].split(",")
        for name in ("ST", "RT"):
            k = head.index(name)
            cells[k] = f"{(float(cells[k]) + 56_165.0) % 86_400.0:.6f}"  # 235 s to midnight
        lines[row] = ",".join(cells)
    table.write_text("\n".join(lines) + "\n")
    refused(LocateError, "line 21: time falls from 86393 to 35 s", read_survey, path)


@pytest.mark.parametrize("column", ["ant_e1", "ant_u1"])
def test_garpos_may_lack_a_profile_and_places_at_reception(campaign, tmp_path, column):
    path = edited(write_garpos(campaign, tmp_path), (" SoundSpeed ", " Sound "))
    edited(tmp_path / "obsdata" / "SITE-obs.csv", (column, "other"))
    survey = read_survey(path)
    assert survey.profile is None
    np.testing.assert_array_equal(survey.receive_position, survey.transmit_position)


def test_fixed_stations_and_a_free_centre_are_a_rigid_array(campaign, tmp_path):
    path = write_garpos(campaign, tmp_path)
    edited(
        path,
        ("5.0000 5.0000 5.0000", "0.0 0.0 0.0"),
        ("dCentPos    = 0.0 0.0 0.0 0.0 0.0 0.0", "dCentPos    = 1.0 2.0 3.0 3.0 2.0 1.0"),
    )
    survey = read_survey(path)
    assert survey.rigid == (2.0, 3.0, 1.0, 0.0)
    np.testing.assert_allclose(
        survey.nodes[0].position, campaign.prior[0] + [2.0, 1.0, -3.0], atol=1e-4
    )


BAD_GARPOS = {
    "[Site-parameter] has no Stations": (" Stations ", " Station "),
    "[Model-parameter] has no N2_dPos": ("N2_dPos", "N9_dPos"),
    "Latitude0 is 'north'; it must be 1 finite numbers": ("= 34.96", "= north"),
    "site at -94.96, ": ("= 34.96", "= -94.96"),
    "site at 34.96, 361; degrees within 90 and 360 are needed": ("= 139.26", "= 361"),
    "site at 34.96, -361; degrees within 90 and 360 are needed": ("= 139.26", "= -361"),
    "./obsdata/none.csv is neither in the working folder": ("SITE-obs.csv", "none.csv"),
}


def test_an_ini_file_without_sections_is_refused_as_one_of_garpos(tmp_path):
    path = tmp_path / "site.ini"
    path.write_text("node,time,travel_time\n")
    refused(LocateError, "site.ini: not a readable ini file", read_survey, path)


@pytest.mark.parametrize("message", BAD_GARPOS)
def test_wrong_files_of_garpos_are_refused_in_one_line(campaign, tmp_path, message):
    path = edited(write_garpos(campaign, tmp_path), BAD_GARPOS[message])
    refused(LocateError, re.escape(message), read_survey, path)


def test_a_reception_before_its_transmission_is_refused_by_its_line(campaign, tmp_path):
    path = write_garpos(campaign, tmp_path)
    table = tmp_path / "obsdata" / "SITE-obs.csv"
    lines = table.read_text().splitlines()
    cells = lines[3].split(",")
    cells[16] = "100.0"
    lines[3] = ",".join(cells)
    table.write_text("\n".join(lines) + "\n")
    refused(LocateError, "line 4: RT 100.0* is not after ST", read_survey, path)


def test_scripps_text_has_one_position_per_ping_at_both_ends(tmp_path, as_stored):
    path, _ = write_obsrange(tmp_path)
    survey = read_survey(path)
    assert len(survey) == 60
    assert survey.notes == (f"{path}: 7 events without an answer",)
    np.testing.assert_array_equal(survey.transmit_position, survey.receive_position)
    assert str(survey.epoch).startswith("2018-04-24T06:00:30")
    received = read_survey(path, ReadOptions(position_at="reception"))
    np.testing.assert_array_equal(received.receive_position, survey.receive_position)
    middle = np.median(survey.travel_time)
    np.testing.assert_allclose(received.time, survey.time - middle)
    moved = received.receive_position - received.transmit_position
    speed = np.linalg.norm(moved[20, :2]) / received.travel_time[20]
    assert 0.5 < speed < 30.0  # m/s, as the ship's places a minute apart say
    as_stored([survey, received])


def test_a_drop_point_off_the_globe_is_refused(tmp_path):
    path, _ = write_obsrange(tmp_path)
    text = path.read_bytes().decode()
    for key, limit in (("Latitude", 90), ("Longitude", 360)):
        for value in (limit + 0.5, -limit - 0.5):
            path.write_text(re.sub(rf"(\({key}\): +)\S+", rf"\g<1>{value}", text))
            message = f"drop point {key.lower()} is {value}; it must be -{limit} to {limit} degrees"
            refused(LocateError, message, read_survey, path)


def test_the_depth_of_a_drop_point_may_be_negative(tmp_path):
    path, _ = write_obsrange(tmp_path)
    nodes = read_survey(path).nodes
    assert read_survey(edited(path, (" 2540", " -2540"))).nodes == nodes


WHOI = """#==============================================================================
# EdgeNmea_Universal_0.9.py VERSION 0.0.9
# UTC Date and Time:    2023-04-06 05:09:59
# Cruise:               Test
# Station:              13
# Instrument:           S05
# Drop-Point Latitude:  01 35.6114 N
# Drop-Point Longitude: 91 48.5609 W
# Drop-Point Depth (m): 2318
# TAT:                  13 ms
# Comment: none
#==============================================================================
# Sys date time utc, rng m,rng ms,    latitude  ,    longitude  , GPS time, heading
2023-04-06 23:59:58,  2329,  3106, 01 35.6648 N, 091 48.5082 W, 23:59:56.00, 84.1
2023-04-07 00:00:01,  2328,  3104, 01 35.6630 N, 091 48.5069 W, 23:59:59.00, 142.8
2023-04-07 00:00:35,      ,      , 01 35.6606 N, 091 48.5058 W, 00:00:33.00, 141.4
"""


def test_woods_hole_text_has_a_turn_around_time_and_crosses_midnight(tmp_path, as_stored):
    path = tmp_path / "S05.txt"
    path.write_text(WHOI)
    survey = read_survey(path)
    assert survey.notes == (f"{path}: 1 event without an answer",)
    assert survey.names == ["S05"]
    assert survey.nodes[0].turn_around == 0.013
    assert survey.nodes[0].position[2] == 2318.0
    assert survey.frame.longitude_deg == pytest.approx(-91.809348333)
    np.testing.assert_allclose(survey.time, [0.0, 3.0])
    np.testing.assert_allclose(survey.travel_time, [3.106, 3.104])
    as_stored(survey)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("two_way_time_s", "time_of_flight"), "exactly one of two_way_time_s, two_way_time_ms"),
        (
            ("two_way_time_s", "two_way_time_s,two_way_time_s"),
            "two columns two_way_time_s; remove one",
        ),
        ((",yes", ",perhaps"), "use is 'perhaps'; allowed: 1, true, yes"),
        (
            ("north_m,east_m,depth_m,heading", "north,east,depth_m,heading"),
            "no positions of the platform",
        ),
        ((",N1,", ",X,"), "no node X, which the survey has"),
    ],
)
def test_wrong_tables_are_refused_in_one_line(campaign, tmp_path, change, message):
    pings, nodes = write_table(campaign, tmp_path)
    text = pings.read_text()
    assert change[0] in text
    header, rows = text.split("\n", 1)
    pings.write_text(
        f"{header.replace(*change)}\n{rows.replace(*change, 1 if change[0] == ',N1,' else -1)}"
    )
    refused(LocateError, message, read_survey, pings, ReadOptions(nodes=nodes))


def test_without_nodes_a_depth_is_needed(campaign, tmp_path, as_stored):
    pings, _ = write_table(campaign, tmp_path)
    refused(LocateError, "the depth of node N1 is unknown; give `depth`", read_survey, pings)
    survey = read_survey(pings, ReadOptions(depth=1300.0))
    assert {node.position[2] for node in survey.nodes} == {1300.0}
    as_stored(survey)


def test_swapped_coordinates_of_nodes_are_refused(tmp_path):
    pings, nodes = tmp_path / "pings.csv", tmp_path / "nodes.csv"
    rows = [f"{10 * i},A,1.8,34.{960 + i},139.26,3" for i in range(5)]
    pings.write_text("\n".join(["time,node,two_way_time_s,lat,lon,depth_m", *rows]) + "\n")
    for place, message in (
        ("34.96,-139.26", "wrong sign .east or west."),
        ("-34.96,139.26", "7,775 km apart; .*north or south"),  # 69.922 degrees of 111.195 km
    ):
        nodes.write_text(f"name,lat,lon,depth_m\nA,{place},1300\n")
        refused(LocateError, message, read_survey, pings, ReadOptions(nodes=nodes))
    pings.write_text("\n".join(["time,node,two_way_time_s,lon,lat,depth_m", *rows]) + "\n")
    refused(LocateError, "they may be exchanged", read_survey, pings, ReadOptions(nodes=nodes))


@pytest.mark.parametrize("bad", [
    "6306 msec. Lat: 4 52.9",
    "6306 msec. Lat: 4 52.9270 S  Lon: 132 41.4272 W  Alt: 29.42 Time(UTC): 2018:400:06:04:30",
    "6306 msec. Lat: 4 52.9270 S  Lon: 132 41.4272 W  Alt: 29.42 Time(UTC): 0000:114:06:04:30",
    "6306 msec. Lat: 4 52.9270 S  Lon: 132 41.4272 W  Alt: 29.42 Time(UTC): 2018:114:26:04:30",
])  # fmt: skip
def test_unreadable_lines_of_scripps_are_listed_and_left_out(tmp_path, bad):
    path, _ = write_obsrange(tmp_path)
    whole = read_survey(path)
    path.write_text(f"{path.read_text().rstrip()}\n{bad}\n")
    survey = read_survey(path)
    np.testing.assert_array_equal(survey.travel_time, whole.travel_time)
    number = len(path.read_text().splitlines())
    start = f"{path}: 1 line left out, not readable: line {number}: '6306 msec. Lat: 4 52.9"
    assert survey.notes[-1].startswith(start)


def test_unreadable_lines_of_woods_hole_are_left_out(tmp_path):
    path = tmp_path / "S05.txt"
    good = "2023-04-07 00:00:05,  2328,  3104, 01 35.6630 N, 091 48.5069 W, 00:00:04.00, 142.8\n"
    for bad in (
        good.replace("2023-04-07", "2018-13-45"),
        good.replace("00:00:05", "99:00:05"),
        good[:40] + "\n",
    ):
        path.write_text(WHOI + bad)
        survey = read_survey(path)
        assert len(survey) == 2
        assert "1 line left out, not readable: line 17" in survey.notes[-1]
    path.write_text(WHOI.replace("2023-04-", "2023-13-"))
    refused(LocateError, "line 14: .* is not a ping; write it as", read_survey, path)


@pytest.mark.parametrize("bad", [
    "26-JUN-23 00:00:07.00 1", "45-JUN-23 00:00:07.00 1 2 3",
    "26-SOL-23 00:00:07.00 1 2 3", "26-JUN-23 25:00:07.00 1 2 3",
    "2018-13-45 00:00:07.00 1 2 3",
])  # fmt: skip
def test_unreadable_lines_of_gnatss_are_listed_and_left_out(campaign, tmp_path, bad):
    path = write_gnatss(campaign, tmp_path)
    whole = read_survey(path)
    times = next(
        file for file in tmp_path.rglob("*") if file.is_file() and "JUN-23" in file.read_text()
    )
    times.write_text(f"{times.read_text().rstrip()}\n{bad}\n")
    survey = read_survey(path)
    np.testing.assert_array_equal(survey.travel_time, whole.travel_time)
    assert (
        f"1 line left out, not readable: line {len(times.read_text().splitlines())}"
        in survey.notes[-1]
    )


@pytest.mark.parametrize("date", ["2018-13-45", "0000-01-01", "2263-01-01", "soon"])
def test_an_impossible_date_of_garpos_is_refused(campaign, tmp_path, date):
    path = write_garpos(campaign, tmp_path)
    text = path.read_text()
    line = next(line for line in text.splitlines() if "Date(UTC)" in line)
    path.write_text(text.replace(line, f"{line.split('=')[0]}= {date}"))
    refused(LocateError, f"Date.UTC. is '{date}'; it must be a date", read_survey, path)


def test_numbers_of_any_length_and_stray_lines_are_one_line(campaign, tmp_path):
    path, _ = write_obsrange(tmp_path)
    path.write_text(path.read_text().replace("Lon: 132", "Lon: " + "9" * 400, 1))
    assert "1 line left out" in read_survey(path).notes[-1]
    path = edited(write_garpos(campaign, tmp_path), ("Date(UTC)", "key\n  Date(UTC)"))
    refused(LocateError, "not a readable ini file", read_survey, path)


TRUNCATED = {  # what is left of a row, and the reason
    "whole but the last cell": (lambda row: row.rpartition(",")[0], "cells, other rows"),
    "half": (lambda row: row[: len(row) // 2], "cells, other rows"),
    "two joined": (lambda row: f"{row},{row}", "cells, but the header has"),
    "open quote": (lambda row: f'"{row}', "has a quote that is not closed"),
    "no time": (
        lambda row: row.replace(row.split(",")[0], "noon", 1),
        "time is 'noon'; all cells must be seconds",
    ),
    "no name": (lambda row: re.sub(r",N\d,", ",,", row), " is ''; it must have a name"),
    "no roll": (
        lambda row: re.sub(r",[-\d.]+(,yes)?$", r",left\1", row),
        "_deg is 'left'; it must",
    ),
}


@pytest.mark.parametrize("case", TRUNCATED)
def test_unreadable_rows_of_our_table_are_listed_and_left_out(campaign, tmp_path, case):
    pings, nodes = write_table(campaign, tmp_path)
    whole = read_survey(pings, ReadOptions(nodes=nodes))
    change, reason = TRUNCATED[case]
    lines = pings.read_text().splitlines()
    lines[6] = change(lines[6])
    pings.write_text("\n".join(lines) + "\n")
    survey = read_survey(pings, ReadOptions(nodes=nodes))
    assert survey.line.tolist() == [line for line in whole.line.tolist() if line != 7]
    np.testing.assert_array_equal(survey.travel_time, np.delete(whole.travel_time, 4))
    assert survey.notes[-1].startswith(f"{pings}: 1 line left out, not readable: line 7: ")
    assert reason in survey.notes[-1]


@pytest.mark.parametrize("case", [name for name in TRUNCATED if name != "no time"])
def test_unreadable_rows_of_garpos_are_listed_and_left_out(campaign, tmp_path, case):
    path = write_garpos(campaign, tmp_path)
    whole = read_survey(path)
    table = tmp_path / "obsdata" / "SITE-obs.csv"
    lines = table.read_text().splitlines()
    lines[8] = TRUNCATED[case][0](lines[8])
    table.write_text("\n".join(lines) + "\n")
    survey = read_survey(path)
    kept = whole.line != 9
    np.testing.assert_array_equal(survey.travel_time, whole.travel_time[kept])
    np.testing.assert_array_equal(survey.line, whole.line[kept])
    assert survey.notes[-1].startswith(f"{table}: 1 line left out, not readable: line 9: ")


@pytest.mark.parametrize("column", ["ant_n0", "ant_e0", "ant_n1", "ant_e1"])
def test_impossible_positions_of_garpos_are_left_out(campaign, tmp_path, column):
    path = write_garpos(campaign, tmp_path)
    whole = read_survey(path)
    table = tmp_path / "obsdata" / "SITE-obs.csv"
    lines = table.read_text().splitlines()
    cells = lines[8].split(",")
    cells[lines[1].split(",").index(column)] = "45000"
    lines[8] = ",".join(cells)
    table.write_text("\n".join(lines) + "\n")
    survey = read_survey(path)
    np.testing.assert_array_equal(survey.line, whole.line[whole.line != 9])
    assert survey.notes[-1].startswith(f"{table}: 1 line left out, impossible position: line 9: ")


def test_files_of_gnatss_may_have_comments_and_fortran_numbers(campaign, tmp_path):
    path = write_gnatss(campaign, tmp_path)
    positions = tmp_path / "POS_FREED_TRANS_TWTT"
    positions.write_text(positions.read_text().replace("1e-6\n", "0.7D-05\n"))
    (tmp_path / "ctd").write_text("# depth, speed\n\n-10, 1481\n0 1480\n-10 1482\n-20 1483\n")
    survey = read_survey(path)
    assert survey.platform_error.horizontal == pytest.approx(np.sqrt((1e-6 + 1e-6 + 7e-6) / 3.0))
    np.testing.assert_array_equal(survey.profile, [[0.0, 10.0, 20.0], [1480.0, 1481.0, 1483.0]])


def test_positions_of_garpos_are_those_of_any_platform(campaign, tmp_path):
    """A ship is not as fast, but the travel time of a wrong position reveals it."""
    path = write_garpos(campaign, tmp_path)
    whole = read_survey(path)
    table = tmp_path / "obsdata" / "SITE-obs.csv"
    lines = table.read_text().splitlines()
    cells = lines[8].split(",")
    column = lines[1].split(",").index("ant_n0")
    cells[column] = f"{float(cells[column]) + 300.0:.5f}"  # 1.5 s from the pings beside it
    lines[8] = ",".join(cells)
    table.write_text("\n".join(lines) + "\n")
    survey = read_survey(path)
    assert (len(survey), survey.notes) == (len(whole), whole.notes)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("0 1480\n", "ctd: not a profile; it must have at least two lines"),
        ("0 1480\n-100 nan\n", "ctd, line 2: '-100 nan' is not a depth"),
        ("0\n-100\n", "ctd, line 1: '0' is not a depth"),
        ("depth speed\n", "ctd, line 1: 'depth speed' is not a depth"),
    ],
)
def test_a_wrong_profile_of_gnatss_is_refused(campaign, tmp_path, rows, message):
    path = write_gnatss(campaign, tmp_path)
    (tmp_path / "ctd").write_text(rows)
    refused(LocateError, message, read_survey, path)


def test_a_table_of_mostly_unreadable_rows_is_refused_in_one_line(campaign, tmp_path):
    pings, nodes = write_table(campaign, tmp_path)
    head, *rows = pings.read_text().splitlines()[1:]
    bad = [row.replace("yes", "perhaps") for row in rows[: len(rows) // 2]]
    pings.write_text("\n".join([head, *bad, *rows[len(rows) // 2 :]]) + "\n")
    message = (
        f"line 2: use is 'perhaps'; allowed: .* .{len(bad)} of {len(rows)} lines: not readable"
    )
    refused(LocateError, message, read_survey, pings, ReadOptions(nodes=nodes))


def test_a_table_of_one_unreadable_row_is_refused(tmp_path):
    pings = tmp_path / "pings.csv"
    pings.write_text("time,node,two_way_time_s,lat,lon,depth_m\n0,A,late,34.96,139.26,3\n")
    message = "line 2: two_way_time_s is 'late'; it must be a finite number$"
    refused(LocateError, message, read_survey, pings)


def test_rows_that_omit_their_last_optional_cells_are_whole(tmp_path, as_stored):
    pings = tmp_path / "pings.csv"
    rows = [f"{10 * i},A,1.8,34.96{i},139.26" for i in range(4)]
    pings.write_text(
        "\n".join(
            ["time,node,two_way_time_s,lat,lon,depth_m,use", *rows, "40,A,1.8,34.96,139.26,3,no"]
        )
    )
    survey = read_survey(pings, ReadOptions(depth=1300.0))
    assert len(survey) == 5
    assert survey.notes == ()
    as_stored(survey)


@pytest.mark.parametrize("bad", ["99 52.9270 S", "4 62.9270 S"])
def test_a_latitude_that_does_not_exist_is_left_out(tmp_path, bad):
    path, _ = write_obsrange(tmp_path)
    text = path.read_text()
    first = next(line for line in text.splitlines() if "msec" in line)
    latitude = re.search(r"Lat: (.*? [NS])", first)[1]
    path.write_text(text.replace(first, first.replace(latitude, bad), 1))
    assert "1 line left out" in read_survey(path).notes[-1]


@pytest.mark.parametrize(
    "bad", ["741052807.0 0 0 0", "741052807.0 1e9 0 0", "741052807.0 -2.6e6 -4.5e6 3.6"]
)
def test_positions_of_gnatss_that_are_not_on_the_earth_are_left_out(
    campaign, tmp_path, bad, as_stored
):
    path = write_gnatss(campaign, tmp_path)
    whole = read_survey(path)
    file = next(f for f in tmp_path.rglob("*POS*"))
    file.write_text(f"{file.read_text().rstrip()}\n{bad}\n")
    survey = read_survey(path)
    np.testing.assert_array_equal(survey.transmit_position, whole.transmit_position)
    assert survey.notes[-1].startswith(f"{file}: 1 line left out, not readable: line ")
    if bad.endswith("1e9 0 0"):
        as_stored(survey)


def log_of(kind, campaign, folder):
    """A survey of a kind, the file with its pings, and options to read it."""
    if kind == "table":
        pings, nodes = write_table(campaign, folder)
        return pings, pings, ReadOptions(nodes=nodes)
    if kind == "obsrange":
        path, _ = write_obsrange(folder)
        return path, path, ReadOptions()
    if kind == "garpos":
        return write_garpos(campaign, folder), folder / "obsdata" / "SITE-obs.csv", ReadOptions()
    return write_gnatss(campaign, folder), folder / "pxp_tt", ReadOptions()


@pytest.mark.parametrize("kind", ["table", "obsrange", "garpos", "gnatss"])
def test_pings_that_occur_twice_count_once(campaign, tmp_path, kind):
    path, log, options = log_of(kind, campaign, tmp_path)
    whole = read_survey(path, options)
    lines = log.read_text().splitlines()
    rows = np.unique(whole.line)
    again = [lines[row - 1] for row in rows]
    log.write_text("\n".join([*lines, *again]) + "\n")
    survey = read_survey(path, options)
    for name in ("node", "time", "travel_time", "transmit_position", "receive_position", "line"):
        np.testing.assert_array_equal(getattr(survey, name), getattr(whole, name), err_msg=name)
    (note,) = [note for note in survey.notes if "counted once" in note]
    count = len(whole.travel_time)
    assert f": {count} pings counted once: lines {len(lines) + 1}, " in note


def test_files_may_be_joined_in_any_order(campaign, tmp_path, as_stored):
    pings, nodes = write_table(campaign, tmp_path)
    whole = read_survey(pings, ReadOptions(nodes=nodes))
    lines = pings.read_text().splitlines()
    first = whole.line[0] - 1
    head, rows = lines[:first], lines[first:]
    half = len(rows) // 2
    pings.write_text("\n".join([*head, *rows[half:], *rows]) + "\n")
    survey = read_survey(pings, ReadOptions(nodes=nodes))
    np.testing.assert_array_equal(survey.travel_time, whole.travel_time)
    np.testing.assert_array_equal(survey.time, whole.time)
    assert [note.partition(": ")[2][:18] for note in survey.notes] == [
        f"{len(rows) - half} pings counted o",
        "time 0 s is before",
    ]
    as_stored(survey)


def geographic(tmp_path, change=pd.DataFrame.copy):
    """Survey of one node by a ship on a circle, after a change of the table."""
    angle = np.linspace(0.0, 6.0, 30)
    lat, lon = LocalFrame(44.5, -125.1).to_geodetic(800.0 * np.cos(angle), 800.0 * np.sin(angle))
    table = pd.DataFrame({"time": 20.0 * np.arange(30), "node": "T1", "lat": lat, "lon": lon})
    table = table.assign(depth_m=3.0, two_way_time_s=1.9 + 1e-4 * np.arange(30))
    table = table if (new := change(table)) is None else new
    table.to_csv(tmp_path / "pings.csv", index=False)
    return read_survey(tmp_path / "pings.csv", ReadOptions(depth=1290.0))


@pytest.mark.parametrize("place", [(0.0, 0.0), (999.0, 999.0), (44.5, 125.1), (45.5, -125.1)])
@pytest.mark.parametrize("rows", [[0], [14], [29], [4, 14, 24]])
def test_a_survey_is_that_without_its_impossible_positions(tmp_path, place, rows):
    def spoil(table):
        table.loc[rows, ["lat", "lon"]] = place

    survey = geographic(tmp_path, spoil)
    without = geographic(tmp_path, lambda table: table.drop(index=rows))
    assert survey.frame.proj_string == without.frame.proj_string
    assert survey.nodes == without.nodes
    np.testing.assert_array_equal(survey.transmit_position, without.transmit_position)
    (note,) = survey.notes
    assert f"left out, impossible position: line {rows[0] + 2}: position " in note


def test_mixed_turns_of_longitude_are_one_survey(tmp_path, as_stored):
    survey = geographic(tmp_path)

    def turn(table):
        table.loc[::2, "lon"] += 360.0

    turned = geographic(tmp_path, turn)
    np.testing.assert_allclose(turned.transmit_position, survey.transmit_position, atol=1e-6)
    np.testing.assert_allclose(turned.nodes[0].position, survey.nodes[0].position, atol=1e-6)
    assert not turned.notes
    as_stored(turned)


def test_a_survey_in_another_frame_has_the_same_places(campaign, tmp_path, as_stored):
    survey, frame = geographic(tmp_path), LocalFrame(44.9, -124.2)
    moved = survey.in_frame(frame)
    there, here = (one.transmit_position[:, :2].T for one in (moved, survey))
    np.testing.assert_allclose(
        frame.to_geodetic(*there), survey.frame.to_geodetic(*here), atol=1e-9
    )
    as_stored(moved)
    plane = read_survey(write_garpos(campaign, tmp_path)).in_frame(LocalFrame(34.8, 139.5))
    assert plane.depth_reference == "surface"
    as_stored(plane, name="plane")
    local = read_survey(write_table(campaign, tmp_path)[0], ReadOptions(depth=1300.0))
    refused(LocateError, "its positions are not geographic", local.in_frame, frame)


def test_radians_and_times_that_pass_midnight_are_refused(tmp_path):
    def to_radians(table):
        table[["lat", "lon"]] = np.radians(table[["lat", "lon"]])

    refused(LocateError, "look like radians; convert them", geographic, tmp_path, to_radians)

    def stated(table):
        to_radians(table)
        return table.rename(columns={"lat": "lat_deg", "lon": "lon_deg"})

    assert len(geographic(tmp_path, stated)) == 30

    def late(table):
        table["time"] = (86_300.0 + table["time"]) % 86_400.0

    refused(LocateError, "line 7: time falls from 86380 to 0 s", geographic, tmp_path, late)


def test_the_prior_of_a_node_is_the_median_of_its_pings(tmp_path):
    def spread(table):
        table.loc[5, "lat"] += 0.02  # 2.2 km: a ship may be there

    near = np.array(geographic(tmp_path).nodes[0].position)
    survey = geographic(tmp_path, spread)
    assert np.linalg.norm(survey.nodes[0].position - near) < 60.0
    assert not survey.notes


def test_two_answers_to_one_ping_are_two_pings(tmp_path):
    def answer(table):
        table.loc[5, ["time", "lat", "lon"]] = table.loc[4, ["time", "lat", "lon"]]

    survey = geographic(tmp_path, answer)
    assert (len(survey), survey.notes) == (30, ())


def test_titles_of_a_table_may_state_degrees_and_milliseconds(tmp_path):
    def titled(table):
        table = table.assign(two_way_time_s=1e3 * table["two_way_time_s"], sigma_s=2e-4)
        table["time"] = pd.Timestamp("2020-01-01") + pd.to_timedelta(table["time"], unit="s")
        names = {"lat": "lat_deg", "lon": "lon_deg", "two_way_time_s": "two_way_time_ms"}
        return table.rename(columns=names)

    plain, survey = geographic(tmp_path), geographic(tmp_path, titled)
    np.testing.assert_allclose(survey.travel_time, plain.travel_time)
    np.testing.assert_allclose(survey.transmit_position, plain.transmit_position)
    np.testing.assert_array_equal(survey.time, plain.time)
    np.testing.assert_array_equal(survey.sigma, 2e-4)
    assert survey.epoch == np.datetime64("2020-01-01")


def test_nodes_without_a_table_are_in_the_order_of_their_names(tmp_path):
    names = [f"T{k}" for k in np.random.default_rng(1).permutation(30)]
    survey = geographic(tmp_path, lambda table: table.assign(node=names))
    assert survey.names == sorted(names)


def test_a_row_without_a_position_of_the_platform_is_left_out(tmp_path):
    survey = geographic(
        tmp_path, lambda table: table.assign(lat=table["lat"].mask(table.index == 4))
    )
    assert survey.line.tolist() == [row for row in range(2, 32) if row != 6]
    (note,) = survey.notes
    assert "line 6: the position of the platform is incomplete: lat is ''" in note


def test_a_wrong_direction_of_a_one_way_time_is_left_out(tmp_path):
    def one_way(table):
        table["direction"] = ["to node", "From node", "sideways", *[""] * 27]
        return table.rename(columns={"two_way_time_s": "one_way_time_s"})

    survey = geographic(tmp_path, one_way)
    away, towards = TravelDirection.FROM_NODE, TravelDirection.TO_NODE
    assert survey.direction.tolist() == [towards, *[away] * 28]
    assert "line 4: direction is 'sideways'; allowed: from node, to node" in survey.notes[0]


def test_pings_between_nodes_have_the_frame_of_the_nodes(tmp_path):
    pings, nodes = tmp_path / "pings.csv", tmp_path / "nodes.csv"
    pings.write_text("time,node,partner,two_way_time_s\n0,A,B,0.5\n9,B,C,0.6\n")
    nodes.write_text("name,lat,lon,depth_m\nA,60,-10,90\nB,60.01,-10.01,80\nC,60.03,-10.04,70\n")
    survey = read_survey(pings, ReadOptions(nodes=nodes))
    assert survey.frame.latitude_deg == pytest.approx(60.01, abs=1e-9)
    assert survey.frame.longitude_deg == pytest.approx(-10.01, abs=1e-9)
    np.testing.assert_allclose(survey.nodes[1].position, [0.0, 0.0, 80.0], atol=1e-6)
    nodes.write_text("name,north_m,east_m,depth_m\nA,1,2,90\nB,3,4,80\nC,5,6,70\n")
    survey = read_survey(pings, ReadOptions(nodes=nodes))
    assert (survey.frame, survey.nodes[2].position) == (None, (5.0, 6.0, 70.0))


def with_track(folder, pings, **options):
    """
    Survey of pings at some times with the track of one of two ships, which turns by 1 degree in 10
    s and sails north from latitude 44.5; times are dates or numbers.
    """
    start, clock = np.datetime64("2020-01-01T00:00:00", "ns"), np.arange(0.0, 101.0, 10.0)
    if np.issubdtype(np.asarray(pings).dtype, np.datetime64):
        clock = start + (1e9 * clock).astype("m8[ns]")
    rows = ["time,vehicle,lat,lon,depth,heading_deg"]
    for name, lat in (("tender", 44.501), ("ship", 44.5)):
        rows += [f"{t},{name},{lat + 1e-5 * k:.6f},-125.1,4,{30 + k}" for k, t in enumerate(clock)]
    (folder / "track.csv").write_text("\n".join(rows) + "\n")
    rows = [f"{t},T1,2.5" for t in pings]
    (folder / "pings.csv").write_text("\n".join(["time,node,two_way_time_s", *rows]) + "\n")
    (folder / "nodes.csv").write_text("name,lat,lon,depth_m\nT1,44.51,-125.1,1300\n")
    chosen = {"platform": "ship", "track": (folder / "track.csv",), "nodes": folder / "nodes.csv"}
    return read_survey(folder / "pings.csv", ReadOptions(**chosen | options))


@pytest.mark.parametrize("dated", [True, False])
def test_a_track_gives_positions_and_headings_at_both_instants(tmp_path, dated):
    since = np.array([20.0, 23.0, 61.0])
    dates = np.datetime64("2020-01-01T00:00:00", "ns") + (1e9 * since).astype("m8[ns]")
    survey = with_track(tmp_path, dates if dated else since)
    assert survey.frame.latitude_deg == pytest.approx(44.5, abs=2e-3)  # of the track
    for wait, position, attitude in (
        (0.0, survey.transmit_position, survey.transmit_attitude),
        (2.5, survey.receive_position, survey.receive_attitude),
    ):
        lat, lon = survey.frame.to_geodetic(*position[:, :2].T)
        np.testing.assert_allclose(lat, 44.5 + 1e-6 * (since + wait), atol=1e-9)
        np.testing.assert_allclose(lon, -125.1, atol=1e-9)
        np.testing.assert_allclose(np.degrees(attitude[:, 0]), 30.0 + 0.1 * (since + wait))


def test_a_platform_that_the_track_lacks_is_refused(tmp_path):
    refused(LocateError, "it contains tender, ship; name the platform with `platform`",
            with_track, tmp_path, [20.0], platform=None)  # fmt: skip
    refused(LocateError, "no platform boat; available: tender, ship",
            with_track, tmp_path, [20.0], platform="boat")  # fmt: skip
    dates = tmp_path / "dates.csv"
    rows = [f"2020-01-01T00:00:0{k},A,44,3,2" for k in range(2)]
    dates.write_text("\n".join(["time,vehicle,lat,lon,depth", *rows]) + "\n")
    refused(LocateError, "only one of track and survey has dates",
            with_track, tmp_path, [20.0], platform="A", track=(dates,))  # fmt: skip


def test_pings_are_in_the_time_of_their_track(tmp_path):
    """Up to the rounding of times, 1 us."""
    assert len(with_track(tmp_path, ["-0.0000005", "97.5000005"])) == 2
    early, late = ["-0.0000015", 50.0], [50.0, "97.5000015"]
    refused(LocateError, "the transmission is -0.0 s after", with_track, tmp_path, early)
    refused(LocateError, "the reception is 100.0 s after", with_track, tmp_path, late)

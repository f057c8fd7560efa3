"""
Stations that were visited several times, and tables without names of stations, give each cast by
itself; one cast stays one, whatever its rows say.
"""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, strategies as st

from pymantaray.ocean import read_casts
from pymantaray.ocean.cast_rows import visits

DEPTH = [5.0, 100.0, 500.0]


def written(path, *casts, columns=()):
    """Table of casts; each gives the cells of these columns, one for all rows or one for each."""
    frames = []
    for k, cells in enumerate(casts):
        water = {"depth": DEPTH, "temperature": [20.0 + k, 19.0, 17.0], "salinity": 36.0}
        frames.append(pd.DataFrame(dict(zip(columns, cells, strict=True)) | water))
    pd.concat(frames).to_csv(path, index=False)
    return path


def first_temperatures(casts):
    return {cast.name: float(cast.temperature[0]) for cast in casts}


@pytest.mark.parametrize(
    ("columns", "casts", "names"),
    [
        (
            ["station", "time"],
            [("1", "2019-03-01"), ("1", "2019-04-01"), ("2", "2019-03-01")],
            ["1 2019-03-01", "1 2019-04-01", "2"],
        ),
        (["station", "cast"], [("12", "1"), ("12", "2")], ["12/1", "12/2"]),
        (["date"], [("2019-03-01",), ("2019-04-01",)], ["2019-03-01", "2019-04-01"]),
        (["lat", "lon"], [(31.0, -64.0), (32.0, -64.0)], ["31 -64", "32 -64"]),
        (
            ["time", "lat", "lon"],
            [("2019-03-01", 31.0, -64.0), ("2019-03-01", 31.0, -64.5)],
            ["2019-03-01 31 -64", "2019-03-01 31 -64.5"],
        ),
    ],
    ids=["station and time", "station and cast", "date", "place", "one date at two places"],
)
def test_each_visit_is_a_cast_of_its_own(tmp_path, columns, casts, names):
    path = written(tmp_path / "casts.csv", *casts, columns=columns)
    read = read_casts(path, default_place=(31.0, -64.0))
    assert first_temperatures(read) == {name: 20.0 + k for k, name in enumerate(names)}
    assert [cast.depth.tolist() for cast in read] == [DEPTH] * len(names)
    assert not any("dropped" in note for cast in read for note in cast.notes)


@pytest.mark.parametrize(
    ("columns", "cells"),
    [
        (["time"], [[f"2019-03-01T{h:02d}:00" for h in (1, 5, 16)]]),
        (["time"], [["2019-03-01T10:00", "", ""]]),
        (["time"], [["soon", "later", "2019-03-01T10:00"]]),
        (["lat", "lon"], [[31.0, 31.02, 31.06], [-0.02, 0.01, 0.04]]),
        (["lat", "lon"], [[31.0, 31.0, 31.0], [359.98, 0.02, 0.05]]),
    ],
    ids=["clock", "first row", "no times", "drift", "drift over the meridian"],
)
def test_rows_of_one_cast_stay_together(tmp_path, columns, cells):
    read = read_casts(
        written(tmp_path / "c.csv", cells, columns=columns), default_place=(31.0, -64.0)
    )
    assert [cast.depth.tolist() for cast in read] == [DEPTH]
    assert read[0].name == "c"


def test_a_spreadsheet_has_a_cast_for_each_time_of_a_station(tmp_path):
    """Also an hour later, because its labels are those of one cast."""
    head = "Cruise\tStation\tType\tyyyy-mm-ddThh:mm\tLongitude\tLatitude\tDepth [m]\t"
    rows = [head + "Temperature [degC]\tQV\tSalinity [psu]"]
    for k, time in enumerate(("2019-03-01T10:00", "2019-03-01T11:00")):
        label = f"HOT\t1\tC\t{time}\t-158\t22.75"
        for z in DEPTH:
            rows.append(f"{label}\t{z}\t{20.0 + k}\t{4 if z == 100.0 else 0}\t35")
            label = "\t" * 5
    (tmp_path / "hot.txt").write_text("\n".join(rows))
    read = read_casts(tmp_path / "hot.txt")
    assert first_temperatures(read) == {
        "HOT/1 2019-03-01T10:00": 20.0,
        "HOT/1 2019-03-01T11:00": 21.0,
    }
    assert [cast.depth.tolist() for cast in read] == [[5.0, 500.0]] * 2
    assert read[0].notes[0] == "whole file: 2 values rejected by quality flags"


@given(
    st.lists(
        st.tuples(st.sampled_from("AB"), st.integers(0, 3), st.sampled_from([0.0, 0.01, 1.0])),
        min_size=1,
        max_size=12,
    ),
    st.booleans(),
)
def test_rows_have_one_name_exactly_if_they_are_of_one_cast(rows, exact):
    """Against a loop over the rows of each station."""
    times = [f"2020-01-{1 + day:02d}" if day else "" for _, day, _ in rows]
    places = np.array([[lat, 0.0] for _, _, lat in rows])
    named = visits([name for name, *_ in rows], times, places, exact=exact)
    cast, last = [], {}
    for (name, day, lat), _ in zip(rows, named, strict=True):
        number, before, there = last.get(name, (0, day, lat))
        new = bool(day and before and day != before) or abs(lat - there) > (0.0 if exact else 0.05)
        last[name] = number + new, day or before, lat
        cast.append((name, number + new))
    assert all(text.startswith(name) for text, (name, *_) in zip(named, rows, strict=True))
    for i, one in enumerate(cast):
        for j in range(i):
            labels = {(times[cast.index(c)], *places[cast.index(c)]) for c in (one, cast[j])}
            assert (named[i] == named[j]) == (
                one == cast[j] or (one[0] == cast[j][0] and len(labels) == 1)
            )


def test_units_of_erddap_are_read_and_its_profiles_are_casts(tmp_path):
    """Feet and Fahrenheit in the row below the header, and two places."""
    rows = ["time,latitude,longitude,depth,temperature,salinity"]
    rows += ["UTC,degrees_north,degrees_east,ft,degree_F,1"]
    rows += [
        f"2020-03-0{1 + k}T10:00:00Z,{40 + k},-30,{z},{59 - 9 * i},35.2"
        for k in range(2)
        for i, z in enumerate((10, 100))
    ]
    (tmp_path / "erddap.csv").write_text("\n".join(rows))
    read = read_casts(tmp_path / "erddap.csv")
    assert [cast.lat for cast in read] == [40.0, 41.0]
    for cast in read:
        np.testing.assert_allclose(cast.depth, [3.048, 30.48])
        np.testing.assert_allclose(cast.temperature, [15.0, 10.0])
        assert not cast.notes

"""
RBR's .rsk files: casts of a database that sqlite3 wrote by RBR's schema, and files that are refused
before they are opened.
"""

import sqlite3
from contextlib import closing

import gsw
import numpy as np
import pytest

from pymantaray.acoustics import read_profiles
from pymantaray.errors import OceanError
from pymantaray.ocean import read_casts
from tests.refusals import refused

START = np.datetime64("2024-03-05T06:07:08", "ms").astype(int).item()
CHANNELS = {
    "cond09": ("Conductivity", "mS/cm"),
    "temp09": ("Temperature", "Deg_C"),
    "pres24": ("Pressure", "dbar"),
    "opt_05": ("Chlorophyll", "ug/l"),
}
SCHEMA = """
CREATE TABLE dbInfo (version VARCHAR(50), type VARCHAR(50));
CREATE TABLE instruments (instrumentID INTEGER PRIMARY KEY, serialID INTEGER, model TEXT,
    firmwareVersion TEXT, firmwareType INTEGER);
CREATE TABLE deployments (deploymentID INTEGER PRIMARY KEY, instrumentID INTEGER, comment TEXT,
    loggerStatus TEXT,
    loggerTimeDrift long, timeOfDownload long, name TEXT, sampleSize INTEGER);
CREATE TABLE channels (channelID INTEGER PRIMARY KEY, shortName TEXT, longName TEXT, units TEXT,
    longNamePlainText TEXT,
    unitsPlainText TEXT, isMeasured BOOLEAN, isDerived BOOLEAN);
CREATE TABLE instrumentChannels (instrumentID INTEGER, channelID INTEGER, channelOrder INTEGER,
    channelStatus INTEGER);
CREATE TABLE epochs (deploymentID INTEGER PRIMARY KEY, startTime long, endTime long);
CREATE TABLE schedules (scheduleID INTEGER PRIMARY KEY, instrumentID INTEGER, mode TEXT,
    gate VARCHAR(512));
CREATE TABLE continuous (continuousID INTEGER PRIMARY KEY, scheduleID INTEGER, samplingPeriod long);
CREATE TABLE region (datasetID INTEGER, regionID INTEGER PRIMARY KEY, type VARCHAR(50),
    tstamp1 LONG, tstamp2 LONG,
    label VARCHAR(512), description TEXT, collapsed BOOLEAN);
CREATE TABLE regionCast (regionID INTEGER, regionProfileID INTEGER, type STRING);
CREATE TABLE geodata (tstamp LONG, latitude DOUBLE, longitude DOUBLE, accuracy DOUBLE,
    accuracyType TEXT);
CREATE TABLE data (tstamp long PRIMARY KEY, channel01 DOUBLE, channel02 DOUBLE, channel03 DOUBLE,
    channel04 DOUBLE);
INSERT INTO dbInfo VALUES ('2.13.0', 'full');
INSERT INTO instruments VALUES (1, 60001, 'RBRconcerto', '1.1', 103);
INSERT INTO deployments VALUES (1, 1, '', 'stopped', 0, 0, 'a.rsk', 600);
INSERT INTO schedules VALUES (1, 1, 'continuous', 'twist');
INSERT INTO continuous VALUES (1, 1, 1000);
"""


def profile(top, count=40):
    """
    Conductivity, temperature and salinity of a downcast at sea pressures from the top [dbar], one
    row a second.
    """
    pressure = top + 2.0 * np.arange(count)
    temperature = 4.0 - 0.02 * pressure
    salinity = 34.0 + 0.01 * pressure
    return gsw.C_from_SP(salinity, temperature, pressure), temperature, pressure, salinity


def write_rsk(path, *, regions=True, extra=""):
    """Two downcasts with an upcast between them, by RBR's schema of full files."""
    with closing(sqlite3.connect(path)) as database:
        database.executescript(SCHEMA)
        for k, (short, (name, unit)) in enumerate(CHANNELS.items(), 1):
            database.execute(
                "INSERT INTO channels VALUES (?,?,?,?,?,?,1,0)", (k, short, name, unit, name, unit)
            )
            database.execute("INSERT INTO instrumentChannels VALUES (1,?,?,0)", (k, k))
        time, spans = START, []
        for top, down in ((1.0, True), (1.0, False), (5.0, True)):
            c, t, p, _ = profile(top)
            rows = np.column_stack([c, t, p + 10.1325, np.zeros_like(c)])[:: 1 if down else -1]
            spans.append((time, time + 1000 * (len(rows) - 1), "DOWN" if down else "UP"))
            for row in rows.tolist():
                database.execute("INSERT INTO data VALUES (?,?,?,?,?)", (time, *row))
                time += 1000
        database.execute("INSERT INTO epochs VALUES (1,?,?)", (START, time))
        for k, (first, last, kind) in enumerate(spans if regions else [], 1):
            database.execute("INSERT INTO region VALUES (1,?,'CAST',?,?,'','',0)", (k, first, last))
            database.execute("INSERT INTO regionCast VALUES (?,1,?)", (k, kind))
        for k, (first, _, _) in enumerate(spans):
            database.execute(
                "INSERT INTO geodata VALUES (?,?,?,1,'')", (first, 74.5 + 0.1 * k, -140.25)
            )
        database.executescript(extra)
        database.commit()
    return path


@pytest.mark.filterwarnings("error::UserWarning")
def test_downcasts_are_read_with_salinity_position_and_time(tmp_path, as_stored):
    """Salinity is that of which sqlite's conductivities were computed; the upcast is no cast."""
    pytest.importorskip("pyrsktools", reason="needs the extra rbr")
    casts = read_casts(write_rsk(tmp_path / "a.rsk"))
    assert [(cast.lat, cast.lon) for cast in casts] == [
        pytest.approx((74.5, -140.25)),
        pytest.approx((74.7, -140.25)),
    ]
    assert [cast.time for cast in casts] == [
        np.datetime64(START + 80_000 * k, "ms") for k in range(2)
    ]
    for cast, top in zip(casts, (1.0, 5.0), strict=True):
        _, temperature, pressure, salinity = profile(top)
        np.testing.assert_allclose(cast.depth, -gsw.z_from_p(pressure, cast.lat), rtol=1e-9)
        np.testing.assert_allclose(cast.temperature, temperature, atol=1e-9)
        np.testing.assert_allclose(cast.salinity, salinity, atol=1e-7)
        assert any("10.1325 dbar" in note for note in cast.notes)
    profiles = read_profiles(tmp_path / "a.rsk")
    assert [p.depth.size for p in profiles] == [40, 40]
    as_stored(cast)


def test_a_file_without_marked_casts_is_one_cast(tmp_path, as_stored):
    """
    Rows of the upcast and of the second downcast are not deeper than earlier rows, except the last
    ones.
    """
    pytest.importorskip("pyrsktools", reason="needs the extra rbr")
    (cast,) = read_casts(write_rsk(tmp_path / "a.rsk", regions=False))
    assert cast.depth.size == 42
    assert cast.dropped == 78
    as_stored(cast)


ENDLESS = (
    "DROP TABLE data; CREATE VIEW data AS WITH RECURSIVE n(tstamp) AS (SELECT 1 UNION ALL SELECT"
    " tstamp + 1 FROM n) SELECT * FROM n;"
)
HUGE = "ALTER TABLE channels ADD COLUMN note AS (hex(zeroblob(900000000)));"
REFUSED = {
    "data is a view, a virtual table or a generated column": ENDLESS,
    "note is a view, a virtual table or a generated column": HUGE,
    "a database without the tables channels and data": "DROP TABLE data;",
    "120 rows of 5 columns; the limit is 100 values": "",
}


@pytest.mark.parametrize("says", REFUSED)
def test_a_file_of_unlimited_time_or_memory_is_refused_unopened(tmp_path, monkeypatch, says):
    """The check does not need pyrsktools."""
    monkeypatch.setattr("pymantaray.ocean.rsk._MAX_VALUES", 100 if "limit" in says else 12_000_000)
    refused(OceanError, says, read_casts, write_rsk(tmp_path / "a.rsk", extra=REFUSED[says]))


def test_damaged_and_misnamed_files_are_refused(tmp_path, monkeypatch):
    """Cut files, names that SQLite reads as options, and large files."""
    whole = write_rsk(tmp_path / "a.rsk").read_bytes()
    (tmp_path / "cut.rsk").write_bytes(whole[:5000])
    refused(OceanError, "a damaged database", read_casts, tmp_path / "cut.rsk")
    (tmp_path / "a?mode=rw.rsk").write_bytes(whole)
    refused(OceanError, "rename the file", read_casts, tmp_path / "a?mode=rw.rsk")
    monkeypatch.setattr("pymantaray.ocean.rsk.MAX_BYTES", 10_000)
    refused(OceanError, "more than 10,000 bytes", read_casts, tmp_path / "a.rsk")


def test_flipped_bytes_give_casts_or_one_line(tmp_path):
    write_rsk(tmp_path / "a.rsk")
    whole = (tmp_path / "a.rsk").read_bytes()
    rng = np.random.default_rng(1)
    names = [whole.find(b"CREATE TABLE data"), whole.find(b"channels")]  # names that are not UTF-8
    for at in [*names, *rng.integers(0, len(whole), 60).tolist()]:
        damaged = bytearray(whole)
        damaged[at + 15 if at in names else at] = 0xFF
        (tmp_path / "b.rsk").write_bytes(damaged)
        lines = ["one"]
        try:
            read_casts(tmp_path / "b.rsk", lat=74.0, lon=-140.0)
        except OceanError as error:
            lines = str(error).splitlines()
        assert len(lines) == 1

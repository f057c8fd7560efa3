"""`mantaray rays times`, `eigen` and `trace`: travel times without writing Python."""

import json
import math
import re
from pathlib import Path

import gsw
import numpy as np
import pandas as pd
import pytest
import xarray as xr

from pymantaray.acoustics import Medium, RayPaths, find_eigenrays, thin_profile, trace_paths
from pymantaray.apps.rays.command import parse_place
from pymantaray.geometry import LocalFrame
from pymantaray.ocean import open_ocean, to_local
from pymantaray.ocean.seawater import sound_speed
from pymantaray.records import Arrivals, FirstArrivals, RayStatus

CASTS = Path(__file__).parents[4] / "shared" / "data" / "casts"
LINKS = """# positions of 12 May
name,source_north,source_east,source_depth,receiver_north,receiver_east,receiver_depth,ping

007,0,0,20,6000,0,500,1
"A #4, deep",0,0,20,500,0,4500,2
C,-100,30.5,20,9000,2000,30,3
D,5,5,40,5,5,40,4
"""
PROFILE = (
    "depth,sound_speed\n0,1434\n50,1436\n100,1442\n200,1443\n"
    "400,1455\n800,1462\n1500,1473\n3000,1499\n"
)
ENDS = [f"{end}_{axis}" for end in ("source", "receiver") for axis in ("north", "east", "depth")]
WATER = ("--profile", "profile.csv", "--bathymetry", 3000)
ISO = ("--profile", "iso.csv", "--bathymetry", 1000)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Links and a profile, in the current folder."""
    monkeypatch.chdir(tmp_path)
    Path("links.csv").write_text(LINKS)
    Path("profile.csv").write_text(PROFILE)
    Path("iso.csv").write_text("depth,sound_speed\n0,1500\n1000,1500\n")
    return tmp_path


@pytest.fixture
def rays(mantaray, folder):
    """
    Call `mantaray rays`, which succeeds, and give what it printed; the output is the third word.
    """

    def call(*words):
        done = mantaray("rays", *words)
        assert done.code == 0, done.err
        return done.out + done.err

    return call


def medium_of(path):
    """How the file of an output says its medium was made."""
    return json.loads(Path(f"{path}.json").read_text())["medium"]


def own_links():
    table = pd.read_csv("links.csv", skiprows=1, dtype={"name": str})
    return table, table[ENDS[:3]].to_numpy(float), table[ENDS[3:]].to_numpy(float)


def own_medium():
    table = pd.read_csv("profile.csv")
    return Medium.from_profile(table["depth"], table["sound_speed"], bottom_depth=3000.0)


def test_times_are_the_solvers_beside_the_columns_that_came_in(rays, folder, as_stored):
    assert rays("times", "links.csv", "out.csv", *WATER) == "4 links: 3 ok, 1 outside\nout.csv\n"
    out = pd.read_csv("out.csv", dtype={"name": str})
    as_stored([out, medium_of("out.csv")])
    links, source, receiver = own_links()
    pd.testing.assert_frame_equal(out[list(links.columns)], links)
    arrivals = find_eigenrays(own_medium(), source, receiver)
    first = arrivals.first()
    assert out["status"].tolist() == [RayStatus(s).name.lower() for s in first.status]
    for name, expected in {
        "travel_time_s": first.travel_time,
        "near_cutoff": np.where(first.status == RayStatus.OK, 0.0, np.nan),
        "complete": np.where(first.status == RayStatus.OK, 1.0, np.nan),
        "chord_travel_time_s": first.chord_travel_time,
        "straight_range_m": np.linalg.norm(receiver - source, axis=1),
        "refracted_range_m": first.travel_time * first.source_sound_speed,
        "receiver_sound_speed_m_s": first.receiver_sound_speed,
    }.items():
        np.testing.assert_allclose(out[name], expected, rtol=1e-11)
    assert math.degrees(arrivals.launch_angle[0]) == pytest.approx(out["launch_angle_deg"][0])
    outside = Path("out.csv").read_text().splitlines()[2].split("outside,")[1]
    assert (
        outside.replace(",", "") == f"{np.linalg.norm(receiver[1] - source[1]):.12g}"
    )  # all else is empty
    assert json.loads(Path("out.csv.json").read_text())["outcomes"] == {"ok": 3, "outside": 1}
    assert medium_of("out.csv")["bottom_depth_m"] == 3000.0
    names = {path.name for path in folder.iterdir()}
    assert names == {"links.csv", "profile.csv", "iso.csv", "out.csv", "out.csv.json"}


def test_scripts_are_told_the_outcomes(told, folder):
    outcomes = {"ok": 3, "outside": 1}
    expected = {"links": 4, "outcomes": outcomes, "notes": [], "file": "out.csv"}
    assert told("rays", "times", "links.csv", "out.csv", *WATER) == expected
    eigen = told("rays", "eigen", "links.csv", "out.csv", *WATER, "--force")
    assert eigen == expected | {"arrivals": len(pd.read_csv("out.csv"))}
    trace = told("rays", "trace", "links.csv", "out.csv", *WATER, "--force")
    assert trace == expected | {"rays": eigen["arrivals"], "nodes": len(pd.read_csv("out.csv"))}


def test_tables_and_netcdf_hold_the_solvers_records(rays, folder, as_stored):
    for command in ("times", "eigen", "trace"):
        for ending in ("csv", "nc"):
            rays(command, "links.csv", f"{command}.{ending}", *WATER, "--max-surface-bounces", 1)
    links, source, receiver = own_links()
    arrivals = find_eigenrays(own_medium(), source, receiver, 1)
    paths = trace_paths(own_medium(), source, receiver, arrivals)
    assert arrivals.surface_bounces.any()
    as_stored(Path("eigen.nc"), without="attrs", name="eigen.nc")
    as_stored({name: pd.read_csv(f"{name}.csv") for name in ("eigen", "trace")})
    eigen, nodes = pd.read_csv("eigen.csv", dtype={"name": str}), pd.read_csv("trace.csv")
    number = pd.Series(arrivals.link).groupby(arrivals.link).cumcount().to_numpy()
    step = paths.position - source[arrivals.link[paths.arrival]]
    own = ("surface_bounces", "bottom_bounces", "turning_points", "caustics", "spreading_db")
    by_arrival = {name: getattr(arrivals, name) for name in own}
    by_arrival |= {
        "row": arrivals.link,
        "arrival": number,
        "launch_angle_deg": np.degrees(arrivals.launch_angle),
        "source_slowness_north_s_m": arrivals.source_slowness[:, 0],
        "receiver_slowness_down_s_m": arrivals.receiver_slowness[:, 2],
    }
    by_node = {
        "row": arrivals.link[paths.arrival],
        "arrival": number[paths.arrival],
        "travel_time_s": paths.travel_time,
        "range_m": np.hypot(step[:, 0], step[:, 1]),
        "depth": paths.position[:, 2],
    }
    for table, columns, atol in ((eigen, by_arrival, 1e-20), (nodes, by_node, 1e-9)):
        for name, expected in columns.items():
            np.testing.assert_allclose(table[name], expected, rtol=1e-11, atol=atol, err_msg=name)
    assert eigen["name"].tolist() == links["name"][arrivals.link].tolist()
    assert (
        nodes["boundary"].tolist()
        == np.array(["water", "surface", "bottom"])[paths.boundary].tolist()
    )
    np.testing.assert_array_equal(
        FirstArrivals.load("times.nc").travel_time, arrivals.first().travel_time
    )
    np.testing.assert_array_equal(
        Arrivals.load("eigen.nc").source_slowness, arrivals.source_slowness
    )
    np.testing.assert_array_equal(RayPaths.load("trace.nc").position, paths.position)
    with xr.open_dataset("trace.nc") as found:
        assert found["row"].values.tolist() == arrivals.link.tolist()
        assert json.loads(found.attrs["made_by"])["command"] == "trace"
    assert len(list(folder.glob("*.json"))) == 3  # beside tables alone


def test_the_cutoff_can_be_switched_off(rays, as_stored):
    Path("one.csv").write_text(";".join([*ENDS, "link"]) + "\n0;0;100;3000;4000;400;x\n")
    words = (*ISO, "--max-surface-bounces", 1, "--max-bottom-bounces", 1, "--cutoff-db", "off")
    assert rays("eigen", "one.csv", "out.csv", *words) == "1 link: 1 ok; 5 arrivals\nout.csv\n"
    assert pd.read_csv("out.csv")["link"].tolist() == ["x"] * 5
    as_stored(pd.read_csv("out.csv"))


def test_a_fan_without_refraction_is_straight(rays, as_stored):
    Path("sources.csv").write_text(f"{','.join(ENDS[:3])}\n10,20,300\n-5,0,500\n")
    words = (*ISO, "--fan", -2, 4, 3, "--azimuth", 90, "--distance", 2000)
    assert rays("trace", "sources.csv", "fan.csv", *words).startswith("2 sources: 6 rays, ")
    out = pd.read_csv("fan.csv")
    as_stored([out, medium_of("fan.csv")])
    assert "outcomes" not in json.loads(Path("fan.csv.json").read_text())
    start = np.array([[10.0, 20.0, 300.0], [-5.0, 0.0, 500.0]])[out["row"]]
    slope = np.tan(np.radians(np.array([-2.0, 1.0, 4.0])[out["ray"]]))
    line = start + out["range_m"].to_numpy()[:, None] * np.stack(
        [0 * slope, 0 * slope + 1, slope], axis=-1
    )
    np.testing.assert_allclose(out[["north", "east", "depth"]], line, rtol=0, atol=1e-6)
    np.testing.assert_allclose(
        out.groupby(["row", "ray"]).last()["range_m"], 2000.0, rtol=0, atol=1e-6
    )
    # without azimuth and distance it reaches for the receiver
    Path("one.csv").write_text(",".join(ENDS) + "\n0,0,300,-3000,4000,400\n")
    rays("trace", "one.csv", "to.nc", *ISO, "--fan", 1, 1, 1)
    as_stored(Path("to.nc"), without="attrs", name="to.nc")
    last = RayPaths.load("to.nc").position[-1]
    np.testing.assert_allclose(last[:2], [-3000.0, 4000.0], rtol=0, atol=1e-6)


def test_an_output_can_be_overwritten_by_force_and_be_an_input(rays):
    for path in ("one.csv", "one.csv.json"):
        Path(path).write_text("old")
    assert rays("times", "links.csv", "one.csv", *WATER, "--quiet", "--force") == "one.csv\n"
    assert [Path(name).name for name in medium_of("one.csv")["profile"]] == ["profile.csv"]
    assert "iso.csv: ends at" not in rays("times", "one.csv", "two.csv", *ISO)
    one, two = pd.read_csv("one.csv"), pd.read_csv("two.csv")
    pd.testing.assert_series_equal(
        two["given_travel_time_s"], one["travel_time_s"], check_names=False
    )
    assert not np.allclose(two["travel_time_s"], one["travel_time_s"], equal_nan=True)


@pytest.mark.skipif(not CASTS.is_dir(), reason=f"{CASTS} is absent")
def test_a_raw_cast_is_thinned_or_smoothed_and_that_is_recorded(rays, as_stored):
    cast = CASTS / "beaufort_axctd_20140724_74N140W.csv"
    words = ("times", "links.csv", "out.csv", "--profile", cast, "--bathymetry", 3000)
    assert "1001 levels thinned within 0.02 m/s to " in rays(*words)
    assert medium_of("out.csv")["thinned"]["vertical_change_s"] < 1e-6
    lines = rays(*words, "--thin", 0.1, "--force").splitlines()
    table = pd.read_csv(cast, comment="#")
    z = table["depth_m"].to_numpy()
    c = sound_speed(table["temperature_degC"], table["practical_salinity"], z, 73.9883, -139.95)
    thin = thin_profile(z, c, tolerance=0.1)
    assert lines[2] == f"{cast.name}: {thin}"
    assert lines[3] == f"{cast.name}: starts at 0.8029 m; sound speed above is constant"
    assert lines[4].startswith(f"{cast.name}: ends at 1000.08 m, above the sea bed at 3000 m")
    record = medium_of("out.csv")
    assert (record["raw_levels"], record["levels"]) == (1001, thin.depth.size)
    assert record["thinned"]["rms_change_m_s"] == pytest.approx(thin.rms_change)
    assert "1001 levels smoothed over 10 m to 202" in rays(*words, "--smooth", 10, "--force")
    assert medium_of("out.csv")["smoothed"]["length_m"] == 10.0
    as_stored([lines, record, medium_of("out.csv")])
    rays(*words, "--thin", 0, "--force")
    record = medium_of("out.csv")
    assert record["levels"] == record["raw_levels"] == 1001
    assert "thinned" not in record


def test_a_profile_by_pressure_is_extended_to_the_surface_with_a_note(rays, as_stored):
    Path("deep.csv").write_text("pressure,sound_speed\n10,1434\n20,1437.9\n3000,1499\n")
    Path("links.csv").write_text(f"{','.join(ENDS)}\n0,0,0,100,0,0\n")
    place = ("--position", 74.5, -140)
    printed = rays(
        "times", "links.csv", "out.csv", "--profile", "deep.csv", "--bathymetry", 3000, *place
    )
    depth = -gsw.z_from_p(10.0, 74.5)
    assert f"deep.csv: starts at {depth:g} m; sound speed above is constant\n" in printed
    assert pd.read_csv("out.csv")["source_sound_speed_m_s"][0] == pytest.approx(1434.0, abs=1e-9)
    medium = medium_of("out.csv")
    assert (medium["computed"], medium["position_deg"]) == ("TEOS-10", [74.5, -140.0])
    as_stored([printed, pd.read_csv("out.csv"), medium])


def test_a_named_ocean_about_a_centre(rays, as_stored):
    words = ("--ocean", "synthetic:fram", "--centre", 79, 1, "--half-extent", "20km", 15000)
    rays("times", *words, "links.csv", "out.csv", "--interpolation", "linear")
    local = to_local(
        open_ocean("synthetic:fram"), centre=(79.0, 1.0), half_extent=(20000.0, 15000.0)
    )
    _, source, receiver = own_links()
    medium = Medium.from_dataset(local, interpolation="linear")
    expected = find_eigenrays(medium, source, receiver).first().travel_time
    np.testing.assert_allclose(pd.read_csv("out.csv")["travel_time_s"], expected, rtol=1e-11)
    assert medium_of("out.csv")["centre_deg"] == [79.0, 1.0]
    as_stored([pd.read_csv("out.csv"), medium_of("out.csv")])


def test_links_in_latitude_and_longitude_are_those_in_the_frame(rays, ocean_file):
    words = ("--ocean", ocean_file, "--centre", 74.5, -140, "--half-extent", "12km", 15000)
    plain, frame = pd.read_csv("links.csv", comment="#").iloc[[0, 2]], LocalFrame(74.5, -140.0)
    plain.to_csv("plain.csv", index=False)
    for end in ("source", "receiver"):
        plain[f"{end}_lat"], plain[f"{end}_lon"] = frame.to_geodetic(
            plain.pop(f"{end}_north"), plain.pop(f"{end}_east")
        )
    plain.to_csv("geographic.csv", index=False)
    for command in ("times", "eigen"):
        rays(command, "plain.csv", f"{command}-plain.csv", *words)
        rays(command, "geographic.csv", f"{command}.csv", *words)
        one, other = pd.read_csv(f"{command}.csv"), pd.read_csv(f"{command}-plain.csv")
        np.testing.assert_allclose(one["travel_time_s"], other["travel_time_s"], rtol=0, atol=1e-9)
    assert "source_lat" not in one.columns
    fan = ("--fan", -5, 5, 3, "--azimuth", 0, "--distance", 1000)
    rays("trace", "geographic.csv", "fan.csv", *fan, *words)
    assert pd.read_csv("fan.csv")["north"].iloc[0] == pytest.approx(0.0, abs=1e-5)


def test_ice_reflects_over_a_profile_and_an_ocean(rays, as_stored):
    Path("links.csv").write_text(f"{','.join(ENDS)}\n0,0,100,3000,4000,400\n0,0,40,3000,4000,400\n")
    words = ("--ice", 50, "--max-surface-bounces", 1)
    assert "1 ok, 1 outside" in rays("eigen", "links.csv", "out.csv", *ISO, *words)
    out = pd.read_csv("out.csv").set_index("surface_bounces")
    assert out["travel_time_s"][1] == pytest.approx(math.hypot(5000.0, 400.0) / 1500.0, abs=1e-9)
    assert medium_of("out.csv")["ice"] == 50.0
    assert "1 ok, 1 outside" in rays(
        "times", "links.csv", "fram.csv", "--ocean", "synthetic:fram", *words
    )
    as_stored([pd.read_csv("out.csv"), pd.read_csv("fram.csv"), medium_of("fram.csv")])


def test_links_of_a_run_take_the_times_that_the_run_has(rays, tiny_run_folder):
    from pymantaray.apps.study import open_run

    run = open_run(tiny_run_folder)
    still = run.measurements.landmark_position
    places = [np.concatenate([run.truth.position[:, i], still]) for i in run.links.sample]
    ends = [
        [p[who] for p, who in zip(places, end, strict=True)]
        for end in (run.links.first, run.links.second)
    ]
    pd.DataFrame(np.hstack(ends), columns=ENDS).to_csv(
        "mine.csv", index=False, float_format="%.17g"
    )
    rays("times", "mine.csv", "out.csv", "--run", tiny_run_folder)
    found = pd.read_csv("out.csv")["travel_time_s"]
    np.testing.assert_allclose(found, run.arrivals.first().travel_time, rtol=1e-11)
    assert medium_of("out.csv")["interpolation"] == run.config.acoustics.interpolation


HEAD = LINKS.splitlines()[1]
TABLES = {
    "lacks.csv": LINKS.replace("source_depth", "Source_depth"),
    "twice.csv": f"{HEAD},source_east\nE,0,0,1,2,3,4,5,6\n",
    "word.csv": LINKS.replace("500,0,4500", "500,x,4500"),
    "lat.csv": HEAD.replace("north", "lat").replace("east", "lon") + "\nA,74,0,20,74,0.1,500,1",
    "far.csv": HEAD.replace("north", "lat").replace("east", "lon") + "\nA,94,0,20,74,0.1,500,1",
    "inf.csv": f"{HEAD}\nE,inf,0,1,2,3,4,5\n",
    "binary.csv": "\0\1",
    "rising.csv": "depth,sound_speed\n-10,1500\n-20,1500\n",
    "holes.csv": "depth,sound_speed\n0,1500\n10,\n",
    "km.csv": "depth,sound_speed\n0,1.5\n10,1.6\n",
    "salty.csv": "depth,salinity\n0,35\n10,35\n",
    "placeless.csv": "pressure,sound_speed\n0,1500\n10,1500\n",
    "old.csv.json": "{}",
    "link_0.env": "mine",
}
REFUSED = {  # what follows `mantaray rays`, with W for a profile that is good; part of the message
    "times links.csv out.txt W": "out.txt: the name of the output must end in .csv or .nc",
    "times links.csv iso.csv W": "iso.csv: already exists; give another name or --force",
    "times links.csv old.csv W": "old.csv.json: already exists; give another name or --force",
    "times links.csv links.csv W --force": "links.csv: is the input",
    "times lacks.csv out.csv W": (
        "lacks.csv: no source_depth; the columns are name, source_north, source_east, Source_depth"
    ),
    "times twice.csv out.csv W": "twice.csv: two columns source_east; remove one",
    "times word.csv out.csv W": (
        "word.csv, line 5: receiver_east is 'x'; it must be a finite number"
    ),
    "times lat.csv out.csv W": (
        "lat.csv: latitudes and longitudes need a place of the profile; give --centre"
    ),
    "times far.csv out.csv --ocean synthetic:fram": (
        "far.csv: a latitude is not in -90 to 90 degrees"
    ),
    "times inf.csv out.csv W": "inf.csv, line 2: source_north is 'inf'",
    "times binary.csv out.csv W": "binary.csv: a binary file, not a text table",
    "times nothing.csv out.csv W": "nothing.csv: no such file",
    "times links.csv out.csv": "no ocean given; exactly one of --ocean, --profile and --run",
    "times links.csv out.csv W --ocean synthetic:fram": "--ocean and --profile given; exactly one",
    "times links.csv out.csv --profile iso.csv": (
        "iso.csv: a profile has no sea bed; give its depth in metres"
    ),
    "times links.csv out.csv --profile iso.csv --bathymetry -5": (
        "ocean.bathymetry: found -5.0; allowed: greater than 0"
    ),
    "times links.csv out.csv --ocean synthetic:fram --thin 1": (
        "ocean.thin .--thin. applies to a profile, not to an ocean"
    ),
    "times links.csv out.csv W --half-extent 0 1": (
        "ocean.half_extent_north: found 0.0; allowed: greater than 0"
    ),
    "times links.csv out.csv W --thin 0.1 --smooth 9": "thin and smooth cannot be combined",
    "times links.csv out.csv W --cutoff-db x": (
        "--cutoff-db is x; it must be a positive number of decibels, or none"
    ),
    "times links.csv out.csv W --cutoff-db nan": (
        "--cutoff-db is nan; it must be a positive number of decibels, or none"
    ),
    "times links.csv out.csv W --tolerance 0": "--tolerance is 0 m; it must be finite and positive",
    "times links.csv out.csv --profile rising.csv --bathymetry 9": (
        "rising.csv: depth is -20 to -10 m; it must be positive down"
    ),
    "times links.csv out.csv --profile holes.csv --bathymetry 9": (
        r"holes.csv: 1 usable levels; .* \(1 of 2 rows dropped: with a missing value\)"
    ),
    "times links.csv out.csv --profile km.csv --bathymetry 9": (
        "km.csv: sound_speed is 1.5 to 1.6; allowed: 1300 to 1800 m/s; name the unit"
    ),
    "times links.csv out.csv --profile salty.csv --bathymetry 9": (
        "no column sound_speed; the columns are depth, salinity"
    ),
    "times links.csv out.csv --profile placeless.csv --bathymetry 9": (
        "needs a position; give --position LAT LON"
    ),
    "times links.csv out.csv --ocean synthetic:mars": "mars",
    "times links.csv out.csv W --ice ice.nc": "ocean.ice is a map, which needs --centre",
    "times links.csv out.csv W --ice 3500": "ice: the draft is 3500 m; it must be 0 to 100 m",
    "times links.csv out.csv --run . --ice 1": "--ice does not apply to --run",
    "times links.csv out.csv --run .": "not a run folder",
    "trace links.csv out.csv W --azimuth 3": "--azimuth and --distance need --fan FROM TO COUNT",
    "trace links.csv out.csv W --fan 5 -5 3": "--fan is 5 -5 3; it must be FROM TO COUNT",
    "trace links.csv out.csv W --fan -5 5 1000000000": (
        "it must be FROM TO COUNT with FROM < TO and COUNT 1 to 100000"
    ),
    "trace links.csv out.csv W --fan -5 5 3 --cutoff-db 3": "--cutoff-db does not apply to --fan",
    "trace links.csv out.csv W --fan -5 5 3": "links.csv, line 7: distance: 0.0; a positive length",
    "trace links.csv out.csv W --fan -95 5 3": (
        r"links.csv, line 4: launch_angles: up to 1\.65806 rad"
    ),
    "compare-bellhop links.csv --out profile.csv W --force": "profile.csv: is the input",
    "compare-bellhop links.csv --out out.csv W --program nothing": "no nothing on PATH; install it",
    "write-bellhop links.csv --out run": (
        "no ocean given; exactly one of --ocean, --profile and --run is needed"
    ),
    "write-bellhop links.csv --out run W --link 1": "give LINKS.csv, or --run with --link ROW",
    "write-bellhop --out run W --link 0": "--link needs a run",
    "write-bellhop links.csv --out . W": (
        "link_0.env: already exists; give another folder or --force"
    ),
}


@pytest.mark.parametrize("words", REFUSED)
def test_what_cannot_be_is_one_line_and_writes_nothing(mantaray, folder, words):
    for name, text in TABLES.items():
        Path(name).write_text(text)
    before = {path: path.read_bytes() for path in folder.iterdir()}
    done = mantaray("rays", *words.replace("W", " ".join(map(str, WATER))).split())
    assert (done.code, done.out) == (2, "")
    assert done.err.startswith("error: ")
    assert done.err.count("\n") == 1
    assert re.search(REFUSED[words], done.err), done.err
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


DIRECT = ("--source", "0,0,20", "--receiver", "6000,0,500")


@pytest.mark.parametrize(
    ("name", "magic"),
    [
        ("rays.png", b"\x89PNG"),
        pytest.param("rays.pdf", b"%PDF", marks=pytest.mark.slow),
    ],
)
def test_plot_draws_a_link_of_the_command_line(rays, folder, name, magic):
    bounces = ("--max-surface-bounces", 1, "--max-bottom-bounces", 1)
    out = rays("plot", name, *DIRECT, *WATER, *bounces, "--fan", -10, 10, 5)
    expected = find_eigenrays(own_medium(), [0.0, 0.0, 20.0], [6000.0, 0.0, 500.0], 1, 1).link.size
    assert out.splitlines()[0] == f"(0, 0, 20) to (6000, 0, 500) m: {expected} rays, ok"
    assert out.splitlines()[-1] == name
    assert Path(name).read_bytes().startswith(magic)


def test_plot_draws_the_links_of_a_table_by_their_names(rays, undrawn, folder, as_stored):
    table = pd.read_csv("links.csv", skiprows=1, dtype={"name": str}).iloc[:3]
    table.to_csv("three.csv", index=False)
    lines = rays("plot", "rays.png", "--links", "three.csv", *WATER).splitlines()
    as_stored(lines)
    assert [line.partition(": (")[0] for line in lines[:3]] == ["007", "A #4, deep", "C"]
    assert lines[1].endswith("0 rays, outside")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "give either --source and --receiver, or --links"),
        (("--source", "0,0,20"), "give either --source and --receiver, or --links"),
        ((*DIRECT, "--links", "links.csv"), "give either --source and --receiver, or --links"),
        (
            ("--source", "0,0", "--receiver", "1,1,1"),
            "--source is '0,0'; it must be north, east and depth",
        ),
        (
            ("--source", "0,0,1", *("--receiver", "9,9,9") * 7),
            "--receiver: 7 links; a figure can show 1 to 6",
        ),
    ],
)
def test_plot_refuses_what_it_cannot_draw(mantaray, folder, words, message):
    done = mantaray("rays", "plot", "rays.png", *words, *WATER)
    assert done.code == 2
    assert message in done.err
    assert not Path("rays.png").exists()


def test_one_link_is_written_in_the_singular(mantaray, tmp_path):
    ends = ",".join(
        f"{end}_{axis}" for end in ("source", "receiver") for axis in ("north", "east", "depth")
    )
    (tmp_path / "one.csv").write_text(f"{ends}\n0,0,20,900,0,60\n")
    (tmp_path / "water.csv").write_text("depth,sound_speed\n0,1440\n500,1450\n")
    words = (
        tmp_path / "one.csv",
        tmp_path / "out.csv",
        "--profile",
        tmp_path / "water.csv",
        "--bathymetry",
        500,
    )
    assert mantaray("rays", "times", *words).out.splitlines()[0] == "1 link: 1 ok"


SEARCH = "--max-surface-bounces 1 --max-bottom-bounces 2 --cutoff-db 25 --tolerance 2mm"
BENT = f"--profile profile.csv --bathymetry 2.5km --ice 3 --equation unesco {SEARCH}"
EVERY = (
    "--bathymetry 3km --crs EPSG:3996 --currents carry --equation unesco --centre 74.1 -140.2"
    " --half-extent 9km 11000 --time 2014-07-24T19:20 --repair-freezing"
    " --name temp=sea_water_temperature --ice 2 --ice-slope 3 --ice-length 4"
    f" --interpolation linear --earth sphere --thin 0.5 {SEARCH}"
)
COMMANDS = {
    "times": "times links.csv out.nc",
    "eigen": "eigen links.csv out.nc",
    "trace": "trace links.csv out.nc",
    "plot": "plot out.png --source 0,0,20 --receiver 9,8,7",
}
SAME = r"lut|knots|nodes|^0\."  # of a medium


@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_reaches_the_water(reached, folder, command):
    words = (*COMMANDS[command].split(), "--profile", "profile.csv", *EVERY.split())
    given = reached("pymantaray.config.door.water.open_waters", "rays", *words)
    assert given[0] == ["profile.csv"]
    assert given["time"].isoformat() == "2014-07-24T19:20:00"
    assert given["names"] == {"temp": "sea_water_temperature"}


def test_every_option_reaches_the_water_of_a_run(reached, folder, tiny_run_folder):
    words = ("rays", "times", "links.csv", "out.csv", "--run", tiny_run_folder, *SEARCH.split())
    reached("pymantaray.config.door.water.open_local", *words, without=r"^0\.")


@pytest.mark.parametrize("command", ["times", "eigen", "trace"])
def test_every_option_reaches_the_search(reached, folder, command):
    words = ("rays", command, "links.csv", "out.csv", *BENT.split())
    known = "lut|knots|nodes" if command == "times" else SAME
    reached("pymantaray.acoustics.find_eigenrays", *words, without=known)


@pytest.mark.parametrize("quiet", [(), ("--quiet",)])
def test_every_option_reaches_the_bar_of_many_links(reached, folder, monkeypatch, quiet):
    monkeypatch.setattr("pymantaray.apps.rays.tables._MIN_LINKS_FOR_BAR", 4)
    words = ("rays", "eigen", "links.csv", "out.csv", *BENT.split(), *quiet)
    reached("pymantaray.acoustics.find_eigenrays", *words, without=rf"{SAME}|^[12]$")


CURRENT = "--currents carry --max-surface-bounces 1 --max-bottom-bounces 1 --tolerance 2mm"


def test_every_option_reaches_the_currents(reached, folder, tiny_run_folder):
    one = f"{','.join(ENDS)}\n0,0,100,900,400,200\n"
    Path("one.csv").write_text(one)
    words = ("rays", "times", "one.csv", "out.csv", "--run", tiny_run_folder, *CURRENT.split())
    reached("pymantaray.acoustics.currents.carried", *words, without=rf"{SAME}|^4\.")


def test_every_option_reaches_the_paths(reached, folder):
    words = ("rays", "trace", "links.csv", "out.csv", *BENT.split())
    reached("pymantaray.acoustics.trace_paths", *words, without=SAME)


TOWARDS = "--fan -20 30 3"
FAN = f"{TOWARDS} --azimuth 40 --distance 0.2km"
BOUNCES = "--max-surface-bounces 1 --max-bottom-bounces 2"


@pytest.mark.parametrize("words", [f"{FAN} {BOUNCES}", TOWARDS], ids=["all", "to the receiver"])
def test_every_option_reaches_the_fan(reached, folder, words):
    table = ("rays", "trace", "links.csv", "out.csv", *WATER, "--tolerance", 0.03)
    reached("pymantaray.acoustics.trace_fan", *table, *words.split(), without=SAME)


def lines_of(printed):
    """Lines without those of kernels that were not compiled yet."""
    return [line for line in printed.splitlines() if "compiling kernels" not in line]


WRITTEN = ["times", "eigen", "trace", "trace fan"]


@pytest.mark.parametrize("ending", ["csv", "nc"])
@pytest.mark.parametrize("command", WRITTEN)
def test_every_option_reaches_what_is_written(
    rays, folder, monkeypatch, as_stored, command, ending
):
    given = []
    monkeypatch.setattr("pymantaray.apps.rays.tables.write_result", lambda *a: given.append(a))
    name, *fan = command.split()
    water = BENT.replace(" --cutoff-db 25", "").split() if fan else BENT.split()
    Path("links.csv").write_text(LINKS.replace("C,-100", "C,-50").replace("D,5,5,40", "D,5,6,40"))
    out = rays(name, "links.csv", f"out.{ending}", *water, *(FAN.split() if fan else []))
    ((result, path, record),) = given
    assert path == Path(f"out.{ending}")
    if ending == "nc":
        as_stored(lines_of(out))
        assert isinstance(result, xr.Dataset)
    else:
        as_stored([lines_of(out), result, record], without="mantaray")


@pytest.mark.parametrize(
    "ends", [DIRECT, (*DIRECT, "--receiver", "1km,2,3"), ("--links", "one.csv")]
)
def test_every_option_reaches_the_picture(rays, mantaray, reached, monkeypatch, as_stored, ends):
    Path("one.csv").write_text(f"name,{','.join(ENDS)}\nA,0,1,20,-300,-4,60\nB,0,2,5,90,4,60\n")
    words = (*ends, *BENT.split(), "--fan", -9, 8, 3)
    reached("pymantaray.acoustics.ray_picture", "rays", "plot", "out.png", *words, without=SAME)
    given = []
    monkeypatch.setattr("pymantaray.apps.rays.write_ray_plot", lambda *a, **k: given.append((a, k)))
    printed = rays("plot", "out.png", *words)
    ((pictures, path), names) = given[0]
    assert path == Path("out.png")
    as_stored([lines_of(printed), [p["ray_arrives"] for p in pictures], names])
    both = rays("plot", "out.png", *words, "--quiet", "--format", "84mm")
    assert both == "out.png\nout.84mm.png\n"
    assert [(path.name, how["one_column"]) for (_, path), how in given[1:]] == [
        ("out.png", False),
        ("out.84mm.png", True),
    ]
    other = mantaray("rays", "plot", "out.png", *words, "--format", "tex")
    assert (other.code, "'tex' is unknown; allowed: 84mm" in other.err) == (2, True)


OUTPUTS = {"times": "csv", "eigen": "nc", "trace": "csv", "plot": "png"}


@pytest.mark.parametrize("command", OUTPUTS)
def test_every_option_reaches_the_check_of_the_output(mantaray, folder, checked_outputs, command):
    for name in ("floor.nc", "ice.nc"):
        Path(name).write_text("")
    out = f"out.{OUTPUTS[command]}"
    ends = (out, "--links", "links.csv") if command == "plot" else ("links.csv", out)
    words = (*ends, "--profile", "profile.csv", "--bathymetry", "floor.nc", "--ice", "ice.nc")
    for force in ((), ("--force",)):
        assert mantaray("rays", command, *words, *force).code == 2
    files = ["links.csv", "profile.csv", "floor.nc", "ice.nc"]
    inputs = [*files[1:], files[0]] if command == "plot" else files
    endings = (".png", ".pdf") if command == "plot" else (".csv", ".nc")
    beside = {} if command == "plot" else {"beside": [Path("out.csv.json")] * out.endswith("csv")}
    for (arguments, options), force in zip(checked_outputs, (False, True), strict=True):
        assert arguments == (Path(out), endings)
        assert options == {"inputs": [*map(Path, inputs)], "force": force, **beside}


def test_a_place_has_numbers_in_metres_or_with_units():
    assert parse_place("--source", "6 km,0,4000") == (6000.0, 0.0, 4000.0)

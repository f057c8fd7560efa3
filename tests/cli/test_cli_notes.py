"""Notes of readers: every command that reads a file prints them once, also in JSON."""

import json
import shutil
from functools import partial

import bellhop_stand_in
import numpy as np
import pytest
import tomli_w
import xarray as xr
from authors_files import write_simulation
from command_fixtures import registered_commands
from factories import pool_here

from pymantaray.apps.study import command as study_command, open_run
from pymantaray.apps.sweep import stages
from pymantaray.ocean import cast_ocean, read_cast
from pymantaray.records import write_netcdf

WATER = "--profile cast.csv --bathymetry 200"
OF_CAST = "rows dropped: with "
OF_BELIEF = "estimators: cast: 1 of 5 rows dropped: with "
OF_CAST_A = "a: 1 of 5 rows dropped: with "
OF_FLOOR = "no value at 1 of "
OF_TRACKS = "at repeated times dropped"
TABLE = "--source-depth 10:30 --receiver-depth 10:30 --range 100:400 --error 5 --out t.nc --force"
ATLAS = "--depths 20 --distances 300 --workers 1 --out atlas.nc --force"
PINGS = "pings.csv --depth 150"
EVENTS = "events.csv"
MODES = "--sound-speed modes --modes casts.csv"
NOTED = {  # words of a command, its output, and a part of the note
    "plan": ("plan.toml --workers 1", OF_CAST),
    "ranges": (f"tracks.csv {WATER} --interval 30 --out ranges", OF_TRACKS),
    "replay": (f"{EVENTS} {WATER} --out replay", OF_CAST),
    "serve": ("cast.csv --bathymetry 200 --port 0", OF_CAST),
    "table": (f"cast.csv --bathymetry 200 {TABLE}", OF_CAST),
    "atlas run": (f"cast.csv --bathymetry 200 {ATLAS}", OF_CAST),
    "atlas show": ("atlas.nc", OF_CAST),
    "graph show": ("g.pyfg --skip-unknown", "left out: 1 FIX"),
    "graph solve": ("g.pyfg --skip-unknown", "left out: 1 FIX"),
    "graph convert": ("g.pyfg o.g2o --skip-unknown --force", "left out: 1 FIX"),
    "locate survey": (f"{PINGS} {WATER} --sound-speed known", OF_CAST),
    "locate plan": (f"--depth 150 {WATER} --pings 12 --pattern circle --radii 50 100 2", OF_CAST),
    "ocean check": ("cast.csv --bathymetry 200", OF_CAST),
    "ocean show": ("cast.csv", OF_CAST),
    "ocean plot": ("cast.csv --bathymetry 200 --half-extent 5000 5000 --out figures", OF_CAST),
    "ocean from-cast": ("cast.csv made.nc --bathymetry 200 --below constant --force", OF_CAST),
    "ocean convert-cast": ("cast.csv made.asvp --force", OF_CAST),
    "ocean correct": ("good.nc cast.csv corrected.nc --force", OF_CAST),
    "ocean perturb": ("cast.csv mean.nc --method mean --bathymetry 200 --force", OF_CAST),
    "rays plot": (
        f"rays.png --source 0,0,10 --receiver 100,0,20 {WATER} --force",
        OF_CAST,
    ),
    "rays times": (f"links.csv times.csv {WATER} --force", OF_CAST),
    "rays eigen": (f"links.csv eigen.csv {WATER} --force", OF_CAST),
    "rays trace": (f"links.csv trace.csv {WATER} --force", OF_CAST),
    "rays compare-bellhop": (
        "links.csv --out compared.csv --profile p.csv --bathymetry 200 --force",
        OF_CAST,
    ),
    "rays write-bellhop": (f"links.csv --out bellhop {WATER} --force", OF_CAST),
    "authors export": ("noted.toml authors", OF_CAST),
    "authors import": ("sim.json", "without meaning here"),
    "study run": ("study.toml --out run --no-figures", OF_TRACKS),
    "sweep run": ("sweep.toml --out sweep --workers 1", OF_CAST),
}
MORE = [  # of the same commands, other readers
    ("locate survey", f"{PINGS} --profile good.csv --bathymetry 200 {MODES}", OF_CAST_A),
    ("ocean perturb", "good.nc p.nc --rms 1 --scale 5 --mode-cast casts.csv --force", OF_CAST_A),
    ("table", f"good.nc --bathymetry floor.nc {TABLE}", OF_FLOOR),
    ("atlas run", f"good.nc --bathymetry floor.nc {ATLAS}", OF_FLOOR),
    ("locate survey", f"{PINGS} --ocean good.nc --bathymetry floor.nc", OF_FLOOR),
    ("study run", "casts.toml --out casts --no-figures", OF_BELIEF),
    ("study run", "modes.toml --out modes --no-figures", f"estimators: {OF_CAST_A}"),
    ("replay", f"{EVENTS} --ocean good.nc --bathymetry floor.nc --out replay", OF_FLOOR),
]
READS_NONE = {
    "atlas plot": "the page of an atlas has its notes",
    "doctor": "reads no file",
    "export": "reads a run, whose page has its notes",
    "ocean fetch copernicus": "downloads",
    "ocean fetch hycom": "downloads",
    "study cite": "reads a configuration only",
    "study compare": "reads runs, whose pages have their notes",
    "study init": "reads a configuration only",
    "study list": "reads no file",
    "study report": "reads a run, whose page has its notes",
    "study show": "reads a configuration only",
    "study tables": "reads a run, whose page has its notes",
    "sweep collect": "reads finished points, whose notes are on its page",
    "sweep show": "reads a configuration only",
    "sweep status": "reads finished points",
}
ROWS = "0,4,34\n20,4,34\n40,99,34\n100,3,34\n200,2,34\n"
TRACKS = (
    "time,vehicle,north,east,depth\n0,A,0,0,10\n0,A,0,0,10\n60,A,9,0,10\n"
    "0,B,200,0,10\n60,B,209,0,10\n"
)
STUDY = {
    "conditions": ["straight"],
    "study": {"name": "noted", "realizations": 1},
    "ocean": {
        "source": "cast.csv",
        "bathymetry": 200.0,
        "half_extent_north": 5000.0,
        "half_extent_east": 5000.0,
    },
    "mission": {"duration_h": 1.0, "ping_interval_h": 0.5},
}
FLEET = {
    "vehicles": [
        {"name": "A", "kind": "station", "north": 0.0, "east": 0.0},
        {
            "name": "B",
            "kind": "twist",
            "north": 300.0,
            "east": 0.0,
            "depth": 50.0,
            "twist": [0.0, 0.0, 0.0, 0.1, 0.0, 0.0],
        },
    ]
}


def sea_floor():
    """Depths around 70 N, 0 E, one of which is missing."""
    lat, lon = 70.0 + np.linspace(-0.1, 0.1, 11), np.linspace(-0.3, 0.3, 11)
    depth = np.full((lat.size, lon.size), 190.0)
    depth[5, 5] = np.nan
    attrs = {"standard_name": "sea_floor_depth_below_sea_surface", "units": "m"}
    return xr.Dataset({"deptho": (("lat", "lon"), depth, attrs)}, {"lat": lat, "lon": lon})


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """Files of which a reader leaves out a row or a line."""
    folder = tmp_path_factory.mktemp("noted")
    head = "depth,temperature,salinity,lat,lon,time"
    lines = [f"{row},70,0,2014-07-15T12:00" for row in ROWS.split()]
    (folder / "cast.csv").write_text("\n".join([head, *lines]) + "\n")
    (folder / "good.csv").write_text("\n".join([head, *lines[:2], *lines[3:]]) + "\n")
    stations = [f"{row},70,0,2014-07-15T12:00,{s}" for s in "ab" for row in ROWS.split()]
    warmer = [row.replace("20,4,", "20,5,") if row.endswith("b") else row for row in stations]
    (folder / "casts.csv").write_text("\n".join([f"{head},station", *warmer]) + "\n")
    ocean = cast_ocean(
        read_cast(folder / "good.csv"),
        bathymetry=200.0,
        half_extent=(5e3, 5e3),
        below="constant",
    )
    write_netcdf(ocean, folder / "good.nc")
    write_netcdf(sea_floor(), folder / "floor.nc")
    (folder / "links.csv").write_text(
        "source_north,source_east,source_depth,receiver_north,receiver_east,receiver_depth\n"
        "0,0,10,100,0,20\n"
    )
    (folder / "p.csv").write_text("depth,sound_speed\n0,1500\n50,9999\n200,1500\n")
    (folder / "tracks.csv").write_text(TRACKS)
    rows = (f"{k},N,0.2,{50 * (k % 3)},{40 * (k % 4)},2\n" for k in range(12))
    (folder / "pings.csv").write_text(
        "time,node,two_way_time_s,north_m,east_m,depth_m\n" + "".join(rows)
    )
    events = (
        f"2014-07-15T12:{k:02d}:00,A,B,0,0,10,{300 + k},0,20,{np.hypot(300 + k, 10) / 1465}\n"
        for k in range(6)
    )
    (folder / "events.csv").write_text(
        "time,source,receiver,source_north,source_east,source_depth,receiver_north,receiver_east,"
        "receiver_depth,travel_time\n" + "".join(events)
    )
    (folder / "g.pyfg").write_text(
        "VERTEX_SE2 0 A0 0 0 0\nVERTEX_SE2 1 A1 1 0 0\n"
        "EDGE_SE2 1 A0 A1 1 0 0 0.1 0 0 0.1 0 0.1\nFIX 0\n"
    )
    plan = {"free": {"mission.ping_interval_h": [0.5]}, "objectives": ["error"]}
    (folder / "plan.toml").write_text(tomli_w.dumps({**STUDY, "fleet": FLEET, "plan": plan}))
    tracks = {"trajectories": ["tracks.csv"]}
    mission = {"ping_interval_h": 0.01}
    (folder / "study.toml").write_text(
        tomli_w.dumps({**STUDY, "mission": mission, "fleet": tracks})
    )
    (folder / "noted.toml").write_text(tomli_w.dumps({**STUDY, "fleet": FLEET}))
    of_file = {"kind": "file", "source": "cast.csv"}
    for name, assumed in (
        ("casts", {"belief": of_file}),
        ("modes", {"belief": "exact", "modes": {"count": 1, "casts": ["casts.csv"]}}),
    ):
        model = {"name": name, "range_model": {"kind": "eigenray", **assumed}}
        own = {"ocean": STUDY["ocean"] | {"source": "good.csv"}, "conditions": [model]}
        (folder / f"{name}.toml").write_text(tomli_w.dumps({**STUDY, **own, "fleet": FLEET}))
    (folder / "sweep.toml").write_text('base = "noted.toml"\ncross.noise.range_sigma = [1.0, 2.0]')
    write_simulation(folder)
    bellhop_stand_in.install(folder)
    return folder


def stopped(server):
    """Close a server; a number for the exit code 0."""
    server.task_dispatcher.shutdown()
    server.trigger.pull_trigger(server.close)
    server.asyncore.loop(timeout=0.1, map=server._map, count=1)
    return -128


def test_the_table_has_every_command():
    assert NOTED.keys() | READS_NONE.keys() == registered_commands().keys()
    assert not NOTED.keys() & READS_NONE.keys()


@pytest.mark.parametrize(
    ("name", "words", "note"), [*((name, *rest) for name, rest in NOTED.items()), *MORE]
)
def test_a_command_prints_a_note_once(
    mantaray, undrawn, inputs, monkeypatch, tmp_path, name, words, note
):
    shutil.copytree(inputs, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", bellhop_stand_in.path_of(tmp_path))
    monkeypatch.setattr("pymantaray.apps.service.command._run", stopped)
    for pool in ("plan.search", "sweep.runner", "atlas.runner"):
        monkeypatch.setattr(f"pymantaray.apps.{pool}.open_pool", pool_here)
    without_figures = partial(study_command.run_and_report, figures=False)
    monkeypatch.setattr(study_command, "run_and_report", without_figures)
    if name == "atlas show":
        mantaray("atlas", "run", *NOTED["atlas run"][0].split())
    as_json = any("--json" in one.opts for one in registered_commands()[name].params)
    done = mantaray(*name.split(), *words.split(), *(["--json"] if as_json else []))
    assert done.code in (0, 1), done.err
    assert sum(note in line for line in done.err.splitlines()) == 1, done.err
    if not as_json:
        assert note not in done.out
        return
    lines = json.loads(done.out)["notes"]
    assert sum(note in line for line in lines) == 1
    assert len(lines) == len(set(lines))


@pytest.mark.slow
def test_a_sweep_keeps_the_notes_of_its_points(mantaray, inputs, monkeypatch, tmp_path):
    """In the ocean that points share, in the runs of its studies and on its page."""
    shutil.copytree(inputs, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("pymantaray.apps.sweep.runner.open_pool", pool_here)
    ocean = STUDY["ocean"] | {"source": "good.nc", "bathymetry": "floor.nc"}
    (tmp_path / "noted.toml").write_text(tomli_w.dumps({**STUDY, "ocean": ocean, "fleet": FLEET}))
    done = mantaray("sweep", "run", "sweep.toml", "--out", "s", "--keep-stages")
    assert (done.code, done.err.count(OF_FLOOR)) == (0, 1), done.err
    for latest in stages.LATEST.values():  # the second sweep reads the ocean of the first
        latest.cache_clear()
    shutil.rmtree("s/points")
    assert mantaray("sweep", "run", "sweep.toml", "--out", "s", "--studies").err == done.err
    for folder in (tmp_path / "s" / "studies").iterdir():
        assert any(OF_FLOOR in note for note in open_run(folder).notes)
    assert mantaray("sweep", "collect", "s").code == 0
    assert (tmp_path / "s" / "index.html").read_text().count(OF_FLOOR) == 1

"""
Sensors and figures of other packages: whatever they do ends in one line with the package's name.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from dataclasses import replace
from importlib.metadata import distributions
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
import typer
from factories import TINY, assert_same, python
from matplotlib.figure import Figure
from other_package import NOTHING, install
from refusals import refused

import pymantaray
from pymantaray import entry_points, installation
from pymantaray.apps.study import command as commands, open_run, report
from pymantaray.apps.study.figures import register as figures
from pymantaray.apps.study.figures.register import RunResults, run_figure_specs
from pymantaray.apps.study.manifest import Stopwatch, describe_run
from pymantaray.apps.study.runner import _job_key
from pymantaray.apps.sweep.keys import POINT, STAGES, task_keys
from pymantaray.config import parse_study
from pymantaray.config.door.study import build_study
from pymantaray.config.text import commented_toml, study_toml
from pymantaray.errors import ExtensionError, MantaRayError, StudyError
from pymantaray.plotting.drawing import draw
from pymantaray.sensing import NoiseModel
from pymantaray.sensing.other_packages import other_sensors
from pymantaray.sensing.sensor import Scene

__all__ = ["install"]
ROOT = Path(__file__).parents[3]
SOURCES = str(Path(pymantaray.__file__).parents[1])


def write_report_of(run, packages):
    """Report of a run, written by a process that finds packages in a folder."""
    return subprocess.run(
        [sys.executable, "-m", "pymantaray", "study", "report", run],
        env=os.environ | {"PYTHONPATH": os.pathsep.join([SOURCES, str(packages)])},
        capture_output=True,
        text=True,
        check=False,
    )


def copy_of(run, folder):
    """A run without its report, whose files are links."""
    folder.mkdir()
    for file in run.iterdir():
        if file.is_file():
            (folder / file.name).symlink_to(file)
    return folder


@pytest.fixture(scope="module")
def packages(tmp_path_factory):
    """Folder in which the example package is installed."""
    folder = tmp_path_factory.mktemp("packages")
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", folder]
    subprocess.run([*command, ROOT / "examples" / "extension"], check=True)
    return folder


@pytest.mark.slow
def test_figure_of_an_installed_package_is_in_the_report(tmp_path, packages, tiny_run_folder):
    run = copy_of(tiny_run_folder, tmp_path / "run")
    done = write_report_of(run, packages)
    assert done.returncode == 0, done.stderr
    assert (run / "figures" / "speed.png").is_file()
    page = (run / "index.html").read_text()
    assert re.search(r"Speed of each of the \d+ vehicles over ground", page)


SENSOR = """
import json
import numpy as np
from factories import TINY
from pymantaray.apps.study import open_run, run_study
from pymantaray.config import parse_study
plain, gauge = (parse_study(TINY, "tiny"), parse_study({**TINY, "mission": {**TINY["mission"],
    "sensors": ["pressure-gauge"]}}, "tiny"))
runs = [run_study(config, name, workers=1) for config, name in ((plain, "a"), (gauge, "b"))]
one, two = (run.noisy_measurements(0) for run in runs)
error = two.depth - one.depth
print(json.dumps({
    "constant": float(abs(error - error[:, :1]).max()), "size": float(abs(error[:, 0]).max()),
    "others": bool(np.array_equal(one.refracted_range, two.refracted_range, equal_nan=True)),
    "version": runs[1].manifest["versions"]["pymantaray-example"],
    "used": [key["name"] for key in runs[1].manifest["extensions"]]}))
"""


@pytest.fixture(scope="module")
def measured(tmp_path_factory, packages):
    """Two studies without and with the sensor of the example, in a process without a report."""
    paths = [SOURCES, str(ROOT / "tests"), str(packages)]
    environment = {"PYTHONPATH": os.pathsep.join(paths)}
    done = python(SENSOR, environment=environment, cwd=tmp_path_factory.mktemp("measured"))
    return json.loads(done.stdout)


@pytest.mark.slow
def test_sensor_of_an_installed_package_replaces_its_columns(measured):
    assert measured["constant"] < 1e-9
    assert 0.01 < measured["size"] < 2.5  # sigma 0.5 m
    assert measured["others"]
    assert measured["version"] == "0.1.0"
    assert measured["used"] == ["pressure-gauge", "speed"]


def test_sensor_that_no_package_has_is_refused(tiny):
    config = tiny(mission={"sensors": ["echo"]})
    refused(MantaRayError, "sensors: no installed package has 'echo'", build_study, config)


def with_sensor():
    return parse_study({**TINY, "mission": {**TINY["mission"], "sensors": ["bad"]}})


@pytest.mark.parametrize(
    ("source", "fault"),
    [
        ("sys.exit(0)", "cannot be loaded: SystemExit: 0"),
        ("class E(BaseException): pass\nraise E", "cannot be loaded: E"),
        ("def x(:", "cannot be loaded: SyntaxError"),
        ("import nowhere", "cannot be loaded: ModuleNotFoundError: No module named 'nowhere'"),
        ("def perturb(m, n): return {}", "has no function 'measure'"),
        ("measure = 3\ndef perturb(m, n): return {}", "has no function 'measure'"),
        ("def measure(s, n): return {}", "has no function 'perturb'"),
    ],
)
def test_a_sensor_that_cannot_be_used_is_named(install, source, fault):
    install(source)
    for _ in range(2):  # a failed import is not repeated
        with pytest.raises(ExtensionError) as error:
            build_study(with_sensor())
        line = str(error.value)
        assert line.startswith(
            "package 'other': its entry point 'bad' of 'pymantaray.sensors' " + fault
        )
        assert line.endswith("repair or uninstall the package")


LEVELS = """
from dataclasses import dataclass
@dataclass(frozen=True)
class Levels:
    depth: float = 5.0
    bias: float = 0.0
    def __post_init__(self):
        if self.depth < 0.0: raise ValueError("depth is negative")
def measure(scene, levels):
    return {"depth": np.full(scene.truth.position.shape[:2], levels.depth)}
def perturb(measurements, normal, levels):
    return {"depth": measurements.depth + levels.bias}
"""


def with_levels(**levels):
    noise = {**TINY.get("noise", {}), "bad": levels}
    mission = {**TINY["mission"], "sensors": ["bad"]}
    return parse_study({**TINY, "mission": mission, "noise": noise})


def test_levels_of_a_sensor_are_a_table_of_the_noise(install, tiny_run_folder):
    install(LEVELS)
    config = parse_study(tomllib.loads(study_toml(with_levels(depth=7))))
    assert "[noise.bad]\ndepth = 7" in commented_toml(config)
    config = config.with_(**{"noise.bad.bias": 0.5})
    sensors = build_study(config).sensors
    assert sensors == {"bad": {"depth": 7.0, "bias": 0.5}}
    run = open_run(tiny_run_folder)
    (sensor,) = other_sensors(sensors)
    scene = Scene(run.truth, run.study.ranging.landmarks, 0.1)
    out = sensor.measured(run.measurements, scene, NoiseModel())
    assert (out.depth == 7.0).all()
    assert (sensor.perturbed(out, out, None).depth == 7.5).all()


def test_levels_that_a_sensor_does_not_have_are_refused(install):
    install(LEVELS)
    unknown = "`noise.bad.dpeth`: unknown key. Allowed: depth, bias"
    refused(ExtensionError, unknown, build_study, with_levels(dpeth=1.0))
    negative = "refuses its noise levels: ValueError: depth is negative"
    refused(ExtensionError, negative, build_study, with_levels(depth=-1.0))
    refused(StudyError, "noise.bad: no sensor", lambda: parse_study({**TINY, "noise": {"bad": {}}}))
    typo = "`noise.depth_sgma`: unknown key. Did you mean `noise.depth_sigma`?"
    refused(StudyError, typo, lambda: parse_study({**TINY, "noise": {"depth_sgma": 1.0}}))


def test_a_sensor_changes_nothing_but_its_columns(install, tiny_run_folder, capsys):
    """It may force its way into what it gets, which are copies, and into the process."""
    install(
        NOTHING
        + """
import os, warnings
def measure(scene, noise):
    for array in (scene.truth.position, scene.landmarks[0].position):
        array.setflags(write=True)
        array[:] = 0.0
    object.__setattr__(noise, "depth_sigma", 9.0)
    os.chdir("/"), warnings.simplefilter("error"), np.seterr(all="raise"), print("shout")
    return {"depth": np.full(scene.truth.position.shape[:2], 5)}
"""
    )
    run = open_run(tiny_run_folder)
    before = run.truth.position.copy()
    marks = run.study.ranging.landmarks
    places = [mark.position.copy() for mark in marks]
    noise, folder, errors = NoiseModel(), Path.cwd(), np.geterr()
    (sensor,) = other_sensors(["bad"])
    out = sensor.measured(run.measurements, Scene(run.truth, marks, 0.1), noise)
    assert (out.depth == 5.0).all()
    assert out.depth.dtype == float
    assert (run.truth.position == before).all()
    assert all((mark.position == p).all() for mark, p in zip(marks, places, strict=True))
    assert (noise, Path.cwd(), np.geterr()) == (NoiseModel(), folder, errors)
    assert capsys.readouterr().out == ""


def test_a_sensor_replaces_its_columns_in_a_realization(install, tiny_run):
    depth = "{'depth': np.full(measurements.depth.shape, 5.0)}"
    install(NOTHING.rpartition("{}")[0] + depth)
    noisy = tiny_run.noise._replace(sensors=("bad",)).noisy(0)
    assert (noisy.depth == 5.0).all()
    assert_same(noisy, tiny_run.noisy_measurements(0), but=("depth",))


FIGURE = """
from matplotlib.figure import Figure
from pymantaray.apps.study.figures.register import register
given = {"place": 1.0, "caption": "Mine.", "draw": lambda r: Figure()}
"""


@pytest.mark.parametrize(
    ("source", "fault"),
    [
        ("sys.exit(0)", "cannot be loaded: SystemExit: 0;"),
        ("register('../x', **given)", "cannot be loaded: ReportError: register: name is '../x';"),
        ("register('/tmp/x', **given)", "register: name is '/tmp/x';"),
        ("register('', **given)", "register: name is '';"),
        ("register.__globals__['_REGISTER'].clear()\nraise GeneratorExit", "GeneratorExit"),
        ("register('a', **given | {'caption': lambda r: None})", "its caption is NoneType, not"),
        ("register('ray_picture', **given)", "register: name 'ray_picture' is that of another"),
        ("[register('a', **given) for _ in '12']", "register: name 'a' is that of another"),
        ("register('a', **given | {'place': float('nan')})", "register: place is nan;"),
        ("register('a', **given | {'draw': 3})", "register: draw, needs and column must be"),
        ("register('a', **given | {'caption': 3})", "register: caption and paper must be text"),
        ("register('a', **given, needs=lambda r: 1 / 0)", "figure 'a': ZeroDivisionError"),
        ("register('a', **given | {'caption': '{r.nothing}'})", "figure 'a': AttributeError"),
        ("register('a', **given | {'caption': '\\ud800'})", "figure 'a': UnicodeEncodeError"),
        ("register('a', **given | {'draw': lambda r: sys.exit(0)})", "figure 'a': SystemExit: 0;"),
        ("register('a', **given | {'draw': lambda r: None})", "its function returns NoneType;"),
        ("register('a', **given | {'draw': lambda: 1})", "figure 'a': TypeError"),
        ("register('a', **given | {'draw': lambda r: Figure((1e5, 1e5))})", "figure 'a': "),
    ],
)
def test_a_figure_that_fails_is_named_and_left_out(install, tiny_run, source, fault):
    install(FIGURE + source, group="figures")
    drawn, (line,) = drawn_of(RunResults(tiny_run))
    assert drawn in ([], ["a"])
    assert line.startswith("package 'other': its entry point 'bad' of 'pymantaray.figures' ")
    assert fault in line


def test_a_figure_that_a_run_does_not_need_is_left_out(install, tiny_run):
    install(FIGURE + "register('a', **given, needs=lambda r: False)", group="figures")
    assert drawn_of(RunResults(tiny_run)) == ([], [])


def test_a_figure_of_the_mission_that_fails_is_reported_at_the_end(
    install, made_run, tmp_path, monkeypatch
):
    source = "register('a', **given | {'draw': lambda r: 1 / 0}, of_mission=True)"
    install(FIGURE + source, group="figures")
    specs = run_figure_specs
    monkeypatch.setattr(
        figures, "run_figure_specs", lambda r, **of: [s for s in specs(r, **of) if s.name == "a"]
    )
    folder = made_run(realizations=1).write(tmp_path / "run")
    maker = report.StudyReport(formats=())
    for _ in maker.begin(folder):
        pass
    assert [*maker._tables] == ["bound"]
    run = open_run(folder.rename(tmp_path / "finished"))
    (line,) = maker.write(run)
    assert "figure 'a': ZeroDivisionError" in line
    assert "A figure is missing: package " in (run.path / "index.html").read_text()


def drawn_of(results):
    """Figures of other packages that are drawn, and the lines of those that fail."""
    specs = run_figure_specs(results)
    own = {name for name, entry in figures._REGISTER.items() if entry.owner is None}
    assert own >= {"ray_picture", "sound_speed"}
    others = [s for s in specs if s.name not in own]
    assert {s.name for s in others} <= {"a", "bad"}  # of the figure, or of the entry point
    failures = []
    drawn = draw(others, formats=(), failures=failures)
    return [picture.name for picture in drawn], failures


def test_a_figure_changes_neither_results_nor_styles(install, tiny_run_folder):
    install(
        FIGURE
        + """
import matplotlib
def draw(r):
    matplotlib.rcParams["font.size"] = 99
    r.tables["range_error"].frame.loc[:, "mean_m"] = 0.0
    r.run.truth.position[:] = 0.0
    return Figure()
register("a", **given | {"draw": draw})
""",
        group="figures",
    )
    results = RunResults(open_run(tiny_run_folder))
    before = results.tables["range_error"].frame.copy()
    position = results.run.truth.position.copy()
    size = mpl.rcParams["font.size"]
    assert drawn_of(results) == (["a"], [])
    assert results.tables["range_error"].frame.equals(before)
    assert (results.run.truth.position == position).all()
    assert mpl.rcParams["font.size"] == size


@pytest.mark.slow
def test_a_report_without_a_figure_that_fails_is_complete_and_says_so(
    install, tiny_run_folder, tmp_path, monkeypatch
):
    install(FIGURE + "register('a', **given | {'draw': lambda r: 1 / 0})", group="figures")
    run = copy_of(tiny_run_folder, tmp_path / "run")
    specs = run_figure_specs

    def without_drawing(results):
        return [s if s.name == "a" else replace(s, draw=Figure) for s in specs(results)]

    monkeypatch.setattr(figures, "run_figure_specs", without_drawing)
    page, (line,) = report.report_of(run)
    text = page.read_text()
    assert "A figure is missing: package &#39;other&#39;: its entry point" in text
    assert line.endswith(
        "fails in its figure 'a': ZeroDivisionError: division by zero; repair or uninstall the"
        " package"
    )
    assert "Provenance" in text
    assert {path.stem for path in (run / "figures").iterdir()} == {
        spec.name for spec in specs(RunResults(open_run(run)))
    } - {"a"}
    main_says = []
    monkeypatch.setattr(commands.LOG, "error", main_says.append)
    with pytest.raises(typer.Exit) as end:
        commands.report(run, quiet=True)
    assert end.value.exit_code == 1
    assert main_says == [line]


def test_versions_and_sources_of_entry_points_are_in_the_keys(install):
    """Stages do not depend on sensors; points and resumed runs do, and on figures."""
    keys = []
    for group, source, version in (
        ("sensors", NOTHING, "1.0"),
        ("sensors", NOTHING + "# other", "1.0"),
        ("sensors", NOTHING, "1.1"),
        ("figures", "", "1.0"),
        ("figures", "# other", "1.0"),
        ("figures", "", "1.1"),
    ):
        install(source, group, version)
        config = with_sensor() if group == "sensors" else parse_study(TINY)
        study = build_study(config)
        keys.append([*task_keys(study, {}).items(), ("run", _job_key(study, {}))])
    for number in (1, 2, 4, 5):
        first = keys[number // 3 * 3]
        changed = {a for (a, x), (_, y) in zip(first, keys[number], strict=True) if x != y}
        assert changed == {POINT, "run"}
    install(NOTHING)
    study = build_study(with_sensor())
    assert [*task_keys(study, {}).items(), ("run", _job_key(study, {}))] == keys[0]
    assert STAGES == ("ocean", "fleet", "rays")


def test_a_manifest_has_the_packages_of_its_sensors(install):
    manifests = []
    for config in (parse_study(TINY), with_sensor()):
        install(NOTHING, version="2.5")
        machine = {"references": (), "workers": 1, "worker_memory_mib": 0.0}
        ocean = {"synthetic": 1}
        manifests.append(describe_run(build_study(config), {}, Stopwatch(), ocean=ocean, **machine))
    assert "extensions" not in manifests[0]
    (used,) = manifests[1]["extensions"]
    assert (used["name"], used["package"], used["version"]) == ("bad", "other", "2.5")
    assert manifests[1]["versions"]["other"] == "2.5"


def test_two_packages_with_one_name_are_refused(install, monkeypatch):
    """Among all that is installed."""
    folder = install(NOTHING)
    monkeypatch.setattr(entry_points, "distributions", distributions)
    shutil.copytree(folder / "other-1.dist-info", folder / "twin-1.dist-info")
    (folder / "twin-1.dist-info" / "METADATA").write_text("Name: twin\nVersion: 2\n")
    entry_points.extensions.cache_clear()
    refused(
        ExtensionError, "an entry point 'bad'; uninstall all but one", build_study, with_sensor()
    )


def test_an_entry_point_without_a_module_fails_alone(install, tiny_run_folder):
    folder = install("", group="figures")
    points = folder / "other-1.dist-info" / "entry_points.txt"
    points.write_text("[pymantaray.figures]\nbad = not a module!\n")
    entry_points.extensions.cache_clear()
    (key,) = entry_points.extension_keys()
    assert (key["package"], key["version"]) == ("other", "1.0")
    drawn, (line,) = drawn_of(RunResults(open_run(tiny_run_folder)))
    assert not drawn
    assert line.startswith("package 'other': ")
    assert "cannot be loaded: " in line


def test_damaged_metadata_of_a_package_are_left_out_with_a_warning(install, caplog):
    folder = install(NOTHING)
    broken = folder / "broken-1.dist-info"
    broken.mkdir()
    (broken / "METADATA").write_text("Name: broken\nVersion: 2\n")
    (broken / "entry_points.txt").write_text("[pymantaray.sensors]\nno equals sign\n")
    entry_points.extensions.cache_clear()
    assert list(entry_points.extensions("sensors")) == ["bad"]
    assert "broken-1.dist-info: its entry points cannot be read" in caplog.text


RUN = """
import sys
import tomllib
from factories import TINY
from pymantaray import ocean
from pymantaray.apps.study import run_study
from pymantaray.config import parse_study
ocean.synthetic_ocean
tree = TINY | {"conditions": ["odometry", "refracted"]}
tree["study"] = {"name": "tiny", "realizations": 1}
tree["mission"] = TINY["mission"] | {"duration_h": 1.0}
tree["ocean"] = TINY["ocean"] | {"source": sys.argv[1]}
run_study(parse_study(tree), "run", workers=1)
print(*sys.modules)
"""


@pytest.mark.slow
def test_no_module_that_shows_results_is_loaded_by_a_run(ocean_file, tmp_path):
    """A change in a module that is not in the key cannot change a result."""
    package = Path(pymantaray.__file__).parent
    shows = set()
    for file in package.rglob("*.py"):
        module = file.relative_to(package)
        if installation.shows_results(module):
            shows.add(".".join(["pymantaray", *module.with_suffix("").parts]))
    paths = os.pathsep.join([SOURCES, str(ROOT / "tests")])
    done = python(RUN, ocean_file, environment={"PYTHONPATH": paths}, cwd=tmp_path)
    loaded = set(done.stdout.split())
    assert loaded & shows == set()
    assert {"pymantaray.apps.study.page", "pymantaray.cli.main", "pymantaray.pages.page"} < shows
    assert {"pymantaray.apps.study.runner", "pymantaray.sensing.measure"} < loaded

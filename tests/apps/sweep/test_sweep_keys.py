"""
Names of tasks: what a stage depends on is in its key and can be read, and nothing else is or can.
`test_every_key` has the law for all keys of a configuration.
"""

import datetime as dt
import re
import shutil
import sys
from dataclasses import dataclass, fields, is_dataclass, replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from factories import TINY

import pymantaray
from pymantaray.apps.study.mission import range_fleet, simulate_fleet
from pymantaray.apps.sweep.keys import FLEET, OCEAN, POINT, RAYS, STAGES, task_keys
from pymantaray.apps.sweep.stages import _PACK, _UNPACK
from pymantaray.config import parse_study
from pymantaray.config.door.study import build_study
from pymantaray.installation import PACKAGES, code_version, shows_results, versions
from pymantaray.jobs.keys import digest, values_of
from pymantaray.records.writing import netcdf_content, netcdf_groups

MODEM = {"source_level_db": 190.0, "frequency_hz": 1e4, "bandwidth_hz": 1e3}


@pytest.fixture
def config(small):
    return small


def test_a_key_contains_no_object_that_it_does_not_know(config):
    @dataclass
    class Part:
        inner: object

    study = build_study(config)
    for part in (study.fleet, study.ranging):
        assert values_of(part).keys() == {"type"} | {f.name for f in fields(part)}
    assert values_of(Part(np.array([1.0, np.inf]))) == {"type": "Part", "inner": [1.0, "inf"]}
    with pytest.raises(TypeError, match="a key cannot contain an object of type function"):
        values_of(Part(test_a_key_contains_no_object_that_it_does_not_know))


def stages_of(config):
    """All stages, each by what it may read alone."""
    study = build_study(config)
    ocean = study.ocean.open()
    truth = simulate_fleet(study.fleet, ocean)
    return ocean, truth, range_fleet(study.ranging, ocean, study.sound.medium(ocean), truth)


def test_all_that_a_stage_does_not_read_changes_no_digit_of_it(config):
    tree = config.model_dump(exclude_none=True)
    tree["study"] = {"name": "other", "seed": 7, "realizations": 5}
    tree["conditions"] = ["odometry"]
    tree["noise"] = {name: 3.0 * value for name, value in tree["noise"].items()}
    tree["estimator"] = {"start": "dead-reckoning", "covariance_interval_h": 1.0}
    tree["mission"] |= {"gnss_depth": 50.0}
    tree["noise"] |= {"clock_offset_sigma": 0.1, "clock_skew_sigma": 1e-6}
    tree["ranging"] |= {"mistaken": "first-detected", "below_strongest_db": 6.0}
    other = parse_study(tree)
    assert [task_keys(build_study(other), {})[stage] for stage in STAGES] == [
        task_keys(build_study(config), {})[stage] for stage in STAGES
    ]
    (ocean, fleet, rays), (ocean_2, fleet_2, rays_2) = stages_of(config), stages_of(other)
    assert ocean.local.identical(ocean_2.local)
    for name in ("geographic", "profile"):
        assert getattr(ocean, name).identical(getattr(ocean_2, name))
    for one, two in (
        (fleet, fleet_2),
        (rays.truth, rays_2.truth),
        (rays.arrivals, rays_2.arrivals),
    ):
        for f in fields(one):
            np.testing.assert_array_equal(getattr(one, f.name), getattr(two, f.name))


def test_the_duration_changes_only_the_key_of_a_varying_ocean(config):
    def key(**changes):
        return task_keys(build_study(config.with_(**changes)), {})[OCEAN]

    longer = {"mission.duration_h": 2.0}
    assert key(**longer) == key()
    assert key(**longer, **{"ocean.time_varying": True}) != key(**{"ocean.time_varying": True})


def test_the_interpolation_counts_where_the_ocean_depends_on_it(tmp_path):
    """It is part of the grid of a turned section, and of the levels of a thinned profile."""
    cast, section = tmp_path / "cast.csv", tmp_path / "section.csv"
    cast.write_text("depth,sound_speed\n0,1500\n50,1495\n200,1490\n")
    section.write_text("depth,0,1000,2000\n0,1500,1501,1502\n200,1490,1491,1492\n")
    box = {"bathymetry": 200.0}

    def keys(**ocean):
        config = parse_study({**TINY, "ocean": ocean})
        forms = [config.with_(**{"acoustics.interpolation": form}) for form in ("smooth", "linear")]
        files = dict.fromkeys(map(str, (cast, section)), "1")
        return [task_keys(build_study(form), files)[OCEAN] for form in forms]

    smooth, linear = keys(source=str(section), bearing=30.0, **box)
    assert smooth != linear
    smooth, linear = keys(source=str(cast), thin=0.1, **box)
    assert smooth != linear
    smooth, linear = keys(source="synthetic:beaufort")
    assert smooth == linear


def test_a_file_counts_by_its_content_and_not_by_its_name(tmp_path):
    def key(name, checksum):
        file = str(tmp_path / name)
        config = parse_study({**TINY, "ocean": {"source": file}})
        return task_keys(build_study(config), {file: checksum})

    assert key("a.nc", "1") == key("b.nc", "1")
    assert all(
        x != y for x, y in zip(key("a.nc", "1").values(), key("a.nc", "2").values(), strict=True)
    )


def test_files_that_a_configuration_does_not_name_are_in_the_key(tmp_path):
    """An `environment.json` names its arrays; a configuration names only the former."""
    file = str(tmp_path / "environment.json")
    study = build_study(parse_study({**TINY, "ocean": {"source": file}}))
    object.__setattr__(study, "files", (*study.files, "a.npy"))
    keys = [task_keys(study, {file: "1", "a.npy": checksum}) for checksum in "12"]
    assert keys[0][POINT] != keys[1][POINT]
    assert len({digest("kind", {}, {"a": one, "b": two}) for one, two in ("12", "21", "11")}) == 3


def test_another_version_of_the_package_has_other_keys(config, monkeypatch):
    before = task_keys(build_study(config), {})
    monkeypatch.setattr("pymantaray.jobs.keys.code_version", lambda: "99")
    assert all(
        x != y
        for x, y in zip(before.values(), task_keys(build_study(config), {}).values(), strict=True)
    )


READERS = {
    "cf_xarray": "names of variables in files",
    "copernicusmarine": "downloads files",
    "distributed": "sends tasks",
    "fsspec": "stores results",
    "lz4": "lossless compression",
    "matplotlib": "name of a cache folder, and plots",
    "meshio": "writes files",
    "packaging": "compares versions",
    "pyarrow": "reads tables",
    "pydap": "downloads files",
    "pyrsktools": "reads casts",
    "requests": "downloads files",
    "rioxarray": "reads sea floors",
    "rerun": "writes files",
    "rosbags": "reads recordings",
    "ruamel": "reads recordings",
    "threadpoolctl": "number of threads",
    "tomli_w": "writes files",
    "urllib3": "downloads files",
    "waitress": "serves requests",
    "yaml": "reads files",
    "zarr": "reads oceans",
}
"""Packages that return the numbers of a file, or have no part in a result."""


def test_packages_that_compute_are_in_the_key():
    package = Path(pymantaray.__file__).parent
    imported = set()
    for file in package.rglob("*.py"):
        if not shows_results(file.relative_to(package)):
            source = file.read_text(encoding="utf-8")
            lines = re.findall(r"^ *(?:from|import) (\w+)", source, re.MULTILINE)
            imported |= {name for name in lines if not is_own(name)}
    assert imported - READERS.keys() == set(PACKAGES)


def is_own(name):
    """True for a module of Python or of this package, and for a word of a text."""
    return name == "pymantaray" or name in sys.stdlib_module_names or find_spec(name) is None


def test_versions_of_packages_change_the_code_version(tmp_path, monkeypatch):
    """Of a package without sources: another test changes these."""
    monkeypatch.setattr("pymantaray.installation.__file__", str(tmp_path / "installation.py"))
    before = code_version.__wrapped__()
    own = versions()
    for name in ("python", *PACKAGES):
        other = own | {name: "0.0"}
        monkeypatch.setattr("pymantaray.installation.versions", lambda other=other: other)
        assert code_version.__wrapped__() != before, name
    monkeypatch.setattr("pymantaray.installation.versions", lambda: own)
    assert code_version.__wrapped__() == before


def test_sources_that_compute_change_the_code_version(tmp_path, monkeypatch):
    package = tmp_path / "pymantaray"
    ignored = shutil.ignore_patterns("__pycache__", "*.toml", "*.html", "*.js")
    shutil.copytree(Path(pymantaray.__file__).parent, package, ignore=ignored)
    monkeypatch.setattr("pymantaray.installation.__file__", str(package / "installation.py"))
    assert code_version.__wrapped__() == code_version()  # a copy is the same code
    changed = (
        ("pages/page.py", True),
        ("plotting/style.py", True),
        ("cli/main.py", True),
        ("apps/study/figures/fleet.py", True),
        ("apps/study/page.py", True),
        ("apps/locate/command.py", True),
        ("apps/study/tables.py", False),
        ("fleet/kernel.py", False),
        ("entry_points.py", False),
    )
    for file in package.rglob("*.py"):  # the others would only be read each time
        if file.relative_to(package).as_posix() not in dict(changed):
            file.unlink()
    before = code_version.__wrapped__()
    for name, shows in changed:
        source = (package / name).read_text()
        (package / name).write_text(source + "\n# changed\n")
        assert (code_version.__wrapped__() == before) is shows, name
        (package / name).write_text(source)


@pytest.mark.parametrize(
    "sections",
    [
        pytest.param({}, marks=pytest.mark.slow),
        {
            "ocean": {"time_varying": True, "time": "2014-07-15T13:30:00"},
            "acoustics": {"currents": True},
        },
        {"ocean": {"ice": 2.0}, "acoustics": {"max_surface_bounces": 1}},
    ],
)
def test_the_store_returns_all_digits(config, sections):
    tree = config.model_dump(exclude_none=True)
    for name, values in sections.items():
        tree[name] |= values
    tree["ocean"]["time"] = dt.datetime.fromisoformat(
        str(tree["ocean"].get("time", "2014-07-15T12:00:00"))
    )
    modem = MODEM
    if "ice" in tree["ocean"]:
        tree["acoustics"]["ice_loss_db"], modem = 2.0, MODEM | {"leakage": True}
    ocean, fleet, rays = stages_of(parse_study(tree | {"detection": modem}))
    ocean = replace(ocean, notes=("one", "two"))
    again = {
        stage: _UNPACK[stage](netcdf_groups(netcdf_content(_PACK[stage](result))))
        for stage, result in ((OCEAN, ocean), (FLEET, fleet), (RAYS, rays))
    }
    assert (ocean.series is not None) == tree["ocean"]["time_varying"]
    for name in (
        "geographic",
        "local",
        "profile",
        *(["series"] if ocean.series is not None else []),
    ):
        one, two = getattr(ocean, name), getattr(again[OCEAN], name)
        xr.testing.assert_identical(one.drop_attrs(), two.drop_attrs())
        assert {k: str(v) for k, v in one.attrs.items()} == {
            k: str(v) for k, v in two.attrs.items()
        }
    assert again[OCEAN].notes == ("one", "two")
    assert again[OCEAN].region.to_csv() == ocean.region.to_csv()
    pairs = [(fleet, again[FLEET])]
    records = [name for name in rays._fields if is_dataclass(getattr(rays, name))]
    pairs += [(getattr(rays, name), getattr(again[RAYS], name)) for name in records]
    for one, two in pairs:
        for f in fields(one):
            np.testing.assert_array_equal(getattr(one, f.name), getattr(two, f.name))
    for one, two in zip(rays, again[RAYS], strict=True):
        if isinstance(one, np.ndarray):
            np.testing.assert_array_equal(one, two)
            assert one.dtype == two.dtype
        assert (one is None) == (two is None)
    np.testing.assert_array_equal(np.stack(rays.attempts), np.stack(again[RAYS].attempts))


def test_the_turn_around_time_changes_the_key_of_replies(config):
    """A vehicle moves while a reply waits, so its range differs; a shared stage would be stale."""
    tree = config.model_dump(exclude_none=True)
    configs = [
        parse_study(
            {**tree, "ranging": {**tree["ranging"], "timing": "two-way", "turn_around_s": seconds}}
        )
        for seconds in (0.0, 30.0)
    ]
    keys = [task_keys(build_study(one), {}) for one in configs]
    assert keys[0][FLEET] == keys[1][FLEET]
    assert keys[0][RAYS] != keys[1][RAYS]
    studies = [build_study(one) for one in configs]
    ocean = studies[0].ocean.open()
    truth, medium = simulate_fleet(studies[0].fleet, ocean), studies[0].sound.medium(ocean)
    truths = [range_fleet(study.ranging, ocean, medium, truth).truth for study in studies]
    unequal = [
        f.name
        for f in fields(truths[0])
        if not np.array_equal(*(getattr(t, f.name) for t in truths))
    ]
    assert unequal

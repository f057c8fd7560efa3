"""
The check of a release refuses what must not be published, and the recipe agrees with the package.
"""

import importlib.metadata
import re
import runpy
import subprocess
import sys
import tomllib
from fnmatch import fnmatch
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name
from pages import ROOT

yaml = pytest.importorskip("yaml")
IN_CONDA = {"netCDF4": "netcdf4", "matplotlib": "matplotlib-base"}


@pytest.fixture
def check(tmp_path):
    """The check, of a copy of the files that it reads."""
    script = runpy.run_path(str(ROOT / ".ci" / "release_check.py"))
    for name in (*script["VERSIONS"], "CHANGELOG.md", "pyproject.toml"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text((ROOT / name).read_text(encoding="utf-8"), encoding="utf-8")
    script["stated_version"].__globals__["ROOT"] = tmp_path
    return script


def test_all_files_state_one_version(check, tmp_path):
    version = check["stated_version"]()
    check["check_changelog"](version, released=False)
    text = (tmp_path / "CITATION.cff").read_text()
    (tmp_path / "CITATION.cff").write_text(text.replace(f"version: {version}", "version: 9.9.9"))
    with pytest.raises(SystemExit, match=r"versions differ: .*CITATION.cff 9\.9\.9"):
        check["stated_version"]()


def test_a_tag_must_be_that_of_the_version(check):
    with pytest.raises(SystemExit, match=r"tag v1\.0\.0, but the files state 0\.9\.0"):
        check["check_version"]("0.9.0", "v1.0.0")


@pytest.mark.parametrize(
    ("changelog", "message"),
    [
        ("## [Unreleased]\n\n- A change\n", r"no section \[5\.0\.0\]"),
        ("## [5.0.0] - 2026-01-02\n\nNothing.\n", r"no section \[5\.0\.0\] with entries"),
        ("## [5.0.0] - 2026-01-03\n\n- A change\n", r"headed ## \[5\.0\.0\] - 2026-01-02"),
    ],
)
def test_a_release_needs_a_dated_section_of_the_changelog(check, tmp_path, changelog, message):
    (tmp_path / "CITATION.cff").write_text('date-released: "2026-01-02"\n')
    (tmp_path / "CHANGELOG.md").write_text(changelog)
    with pytest.raises(SystemExit, match=message):
        check["check_changelog"]("5.0.0", released=True)
    (tmp_path / "CHANGELOG.md").write_text(
        "## [5.0.0] - 2026-01-02\n\n- A change\n\n## [4.0.0] - 2025-01-02\n"
    )
    check["check_changelog"]("5.0.0", released=True)


def test_the_recipe_needs_what_the_package_needs():
    recipe = yaml.safe_load((ROOT / "conda" / "recipe.yaml").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    ours = {
        IN_CONDA.get(r.name, r.name): r.specifier for r in map(Requirement, project["dependencies"])
    }
    rows = [row.split(" ", 1) for row in recipe["requirements"]["run"]]
    theirs = {name: SpecifierSet(version) for name, version in rows}
    assert theirs.pop("python") == SpecifierSet(project["requires-python"])
    assert theirs == ours
    assert recipe["about"]["summary"] == project["description"]
    (command,) = project["scripts"].items()
    assert recipe["build"]["python"]["entry_points"] == [" = ".join(command)]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("requirements:", "requirementz:", "requirementz"),
        ("numpy >=", "numpy >==", "version spec"),
        ("{{ version }}.tar", "{{ release_name }}.tar", "release_name"),
    ],
)
def test_a_recipe_that_does_not_render_is_refused(check, tmp_path, old, new, message):
    pytest.importorskip("rattler_build", reason="needs the group release")
    recipe = tmp_path / "conda" / "recipe.yaml"
    check["check_recipe"](check["stated_version"]())
    recipe.write_text(recipe.read_text().replace(old, new))
    with pytest.raises(SystemExit, match=rf"conda/recipe.yaml: .*{message}"):
        check["check_recipe"]("0.2.0")


def test_tests_that_read_the_source_tree_are_not_run_on_the_wheel():
    """Elsewhere `ROOT` leads only to folders that are copied beside these tests."""
    script = runpy.run_path(str(ROOT / ".ci" / "release_check.py"))
    outside = re.compile(rf'ROOT / "(?!({"|".join(script["COPIED"])})["/]|pyproject)')
    readers = {
        path.name
        for path in (ROOT / "tests").rglob("test_*.py")
        if outside.search(path.read_text())
    }
    assert {"test_readme.py", "test_release.py"} <= readers
    assert [
        name for name in readers if not any(fnmatch(name, p) for p in script["NEED_SOURCE"])
    ] == []


def test_the_wheel_is_used_as_documented_without_test_packages():
    """A study, a survey and the small program of README, by the functions that follow pages."""
    script = runpy.run_path(str(ROOT / ".ci" / "release_check.py"))
    text = "".join((ROOT / name).read_text(encoding="utf-8") for name in script["FOLLOWED"])
    for command in ("mantaray study run", "mantaray rays", "mantaray locate", "find_eigenrays"):
        assert command in text
    blocked = "import sys; sys.modules |= dict.fromkeys(('pytest', 'hypothesis'))\n"
    done = subprocess.run(
        [sys.executable, "-c", blocked + "import pages"],
        cwd=ROOT / "tests",
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def dependencies():
    return runpy.run_path(str(ROOT / ".ci" / "dependencies.py"))


REFERENCE = ROOT / "docs" / "reference"


def test_the_page_of_licences_lists_all_dependencies_and_extras():
    page = (REFERENCE / "dependencies.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| ([\w-]+) \| [^|]+ \| [\d.]+ \| (.+) \|$", page, re.MULTILINE))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    named = {canonicalize_name(Requirement(text).name) for text in project["dependencies"]}
    assert named <= set(rows)
    assert not any("GPL" in licence for licence in rows.values())
    extras = re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE)
    assert extras == sorted(project["optional-dependencies"])
    assert "evo: GPL-3.0" in page


def test_the_size_of_an_installation_is_that_of_the_page():
    page = (REFERENCE / "dependencies.md").read_text(encoding="utf-8")
    sizes = re.findall(r"^\| [\w-]+ \| [^|]+ \| ([\d.]+) \| .+ \|$", page, re.MULTILINE)
    number, total = re.search(r"brings (\d+) packages: (\d+) MB on disk", page).groups()
    assert int(number) == len(sizes) - 1  # itself
    assert abs(sum(map(float, sizes)) - int(total)) < 1.0
    summary = re.search(r"^`pip install pymantaray` (brings .+)$", page, re.MULTILINE)[1]
    installing = (REFERENCE / "installing.md").read_text(encoding="utf-8")
    assert f"The installation {summary}\n" in installing


def test_extras_with_a_copyleft_are_marked_where_users_choose_them():
    page = (REFERENCE / "dependencies.md").read_text(encoding="utf-8")
    installing = (REFERENCE / "installing.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| .+ \| (.+) \|$", page, re.MULTILINE)
    strict = {
        name: found[1] for name, more in rows if (found := re.search(r"((?:GPL|EUPL)\S+\d)", more))
    }
    assert set(strict) == {"copernicus", "evo"}
    for name, licence in strict.items():
        row = re.search(rf"^\| `{name}` \|.+$", installing, re.MULTILINE)[0]
        assert f"copyleft ({licence})" in row


def test_what_pip_installs_has_no_gpl(dependencies):
    base = dependencies["closure"]()
    assert {"numpy", "gtsam", "llvmlite", "pydantic-core"} <= base
    assert not [name for name in base if dependencies["GPL"].search(dependencies["licence"](name))]


def test_copyleft_of_an_extra_is_found(dependencies):
    """By classifier, by expression, and the weak one of the Mozilla foundation."""
    licences = {"evo": "GPL-3.0", "copernicusmarine": "EUPL-1.2", "certifi": "MPL-2.0"}
    for name, licence in licences.items():
        try:
            importlib.metadata.distribution(name)
        except importlib.metadata.PackageNotFoundError:
            pytest.skip(f"needs {name}")
        assert dependencies["licence"](name) == licence
        assert dependencies["copyleft"](name)
    assert "evo" in dependencies["closure"]("evo") - dependencies["closure"]()
    strict = dependencies["GPL"].search
    assert all(map(strict, ("GPL-3.0", "AGPL-3.0", "GNU General Public License v2")))
    assert not any(map(strict, ("LGPL", "GNU Lesser General Public License", "EUPL-1.2")))


def test_what_is_published_was_checked():
    jobs = yaml.safe_load(
        (ROOT / ".github" / "workflows" / "release.yml").read_text(encoding="utf-8")
    )["jobs"]
    assert any(step.get("run") == "make release-check" for step in jobs["check"]["steps"])
    assert (jobs["publish"]["needs"], jobs["publish"]["permissions"]) == (
        "check",
        {"id-token": "write"},
    )
    assert re.search(
        r"^release-check:", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE
    )


def test_parts_of_all_checks_contain_every_test():
    """A folder of tests that no part runs would never be tested before a release."""
    script = runpy.run_path(str(ROOT / ".ci" / "full.py"))
    covered = {Path(path) for paths in script["SLOW"].values() for path in paths}
    tests = [path.relative_to(ROOT) for path in (ROOT / "tests").rglob("test_*.py")]
    lacking = [path for path in tests if not {path, *path.parents} & covered]
    assert not lacking
    kernels = script["parts"]()["bounds"]
    assert kernels[1]["NUMBA_BOUNDSCHECK"] == "1"
    assert all((ROOT / path).exists() for path in script["KERNELS"])

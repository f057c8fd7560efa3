"""
Check a release: version, changelog, conda recipe, archives, and the installed wheel on the oldest
and newest Python, with the oldest and newest Numba.

    python .ci/release_check.py [--tests FOLDER ...] [--write]

FOLDER: only these tests, such as tests/records. With --write, docs/reference/dependencies.md and
installing.md get the size, the time and the licences of this installation.

The version is that of the tag of the current commit. Without a tag the check is a rehearsal: the
changelog may then still say "Unreleased". Archives are left in dist/.
"""

import argparse
import datetime as dt
import json
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DIST = ROOT / "dist"
VERSIONS = {
    "src/pymantaray/version.py": r'^__version__ = "(.+)"$',
    "CITATION.cff": r"^version: (.+)$",
    "README.md": r"^  version = \{(.+)\},$",
    "conda/recipe.yaml": r'^  version: "(.+)"$',
}
"""Files that state the version, and where."""
COPIED = ("tests", "benchmarks", "examples", "docs", "ros2")
"""Folders that tests of the installed wheel read."""
FOLLOWED = ("README.md", "docs/tutorials/6-locate-nodes.md")
"""Pages whose commands and Python must run with what the wheel alone brings: a study, a survey."""
FOLLOW = "import pages, pathlib, sys; pages.follow(pages.ROOT / sys.argv[1], pathlib.Path())"
NEED_SOURCE = (
    "test_applications.py",
    "test_documentation*.py",
    "test_nomenclature.py",
    "test_packages.py",
    "test_readme.py",
    "test_release.py",
    "test_community.py",
    "test_site.py",
)
"""Tests of the source tree, not of the package."""


def main() -> None:
    """Run all steps; the first that fails ends the check with one line."""
    parser = argparse.ArgumentParser(description=__doc__.strip().partition("\n")[0])
    parser.add_argument("--tests", nargs="+", default=["tests"], metavar="FOLDER")
    parser.add_argument("--write", action="store_true", help="write sizes and licences")
    options = parser.parse_args()
    version, tag = stated_version(), tag_of_commit()
    check_version(version, tag)
    check_changelog(version, released=tag is not None)
    check_recipe(version)
    wheel = build_archives()
    for python in oldest_and_newest():
        check_oldest_numba(python, wheel, version)
        check_installed(python, wheel, version, options.tests)
    if options.write:
        write_sizes()
    print(f"release check passed: {version}{'' if tag else ' (rehearsal: the commit has no tag)'}")


def step(words: str) -> None:
    """Print what begins."""
    print(f"== {words}", flush=True)


def refuse(words: str) -> None:
    """End the check."""
    sys.exit(f"release check failed: {words}")


def call(*words: object, cwd: Path = ROOT, env: dict[str, str] | None = None) -> None:
    """Run a command; its failure ends the check."""
    if subprocess.run([str(word) for word in words], cwd=cwd, env=env, check=False).returncode:
        refuse(" ".join(str(word) for word in words))


def stated_version() -> str:
    """Version that all files state."""
    step("version")
    found = {}
    for name, pattern in VERSIONS.items():
        match = re.search(pattern, (ROOT / name).read_text(encoding="utf-8"), re.MULTILINE)
        if match is None:
            refuse(f"{name}: no version")
        found[name] = match[1]
    if len(set(found.values())) != 1:
        refuse(
            "versions differ: " + ", ".join(f"{name} {version}" for name, version in found.items())
        )
    return found["CITATION.cff"]


def git(*words: str) -> str:
    """Output of a command of git; empty if it fails."""
    return subprocess.run(
        ["git", *words], cwd=ROOT, capture_output=True, text=True, check=False
    ).stdout.strip()


def tag_of_commit() -> str | None:
    """Tag of a version that the current commit has."""
    tags = [tag for tag in git("tag", "--points-at", "HEAD").split() if re.match(r"v\d", tag)]
    if len(tags) > 1:
        refuse(f"the commit has several tags: {', '.join(tags)}")
    return tags[0] if tags else None


def check_version(version: str, tag: str | None) -> None:
    """
    Compare the version with the tag; a tagged tree must be clean, and its origin the stated
    address.
    """
    if tag is None:
        print(f"no tag at this commit; the tag of version {version} is v{version}")
        return
    if tag != f"v{version}":
        refuse(f"tag {tag}, but the files state {version}")
    if git("status", "--porcelain"):
        refuse("the working tree has changes that are not committed")
    origin = git("remote", "get-url", "origin").removesuffix(".git")
    home = re.search(
        r'^Repository = "(.+)"$',
        (ROOT / "pyproject.toml").read_text(encoding="utf-8"),
        re.MULTILINE,
    )
    if origin.startswith("https://") and home and origin != home[1]:
        refuse(f"origin is {origin}, but pyproject.toml states {home[1]}")


def check_changelog(version: str, *, released: bool) -> None:
    """Require a section of the version with entries, dated as CITATION.cff."""
    step("changelog")
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    sections = dict(re.findall(r"^## \[(.+?)\](.*(?:\n(?!## ).*)*)", text, re.MULTILINE))
    section = sections.get(version, "" if released else sections.get("Unreleased", ""))
    if not re.search(r"^- ", section, re.MULTILINE):
        refuse(f"CHANGELOG.md: no section [{version}] with entries")
    date = re.search(
        r'^date-released: "(.+)"$',
        (ROOT / "CITATION.cff").read_text(encoding="utf-8"),
        re.MULTILINE,
    )
    if date is None and not released and version not in sections:  # nothing is released yet
        return
    if date is None or not _is_date(date[1]):
        refuse('CITATION.cff: no line date-released: "YYYY-MM-DD"')
    if version in sections and section.partition("\n")[0].strip() != f"- {date[1]}":
        refuse(
            f"CHANGELOG.md: the section of {version} must be headed ## [{version}] - {date[1]}, as"
            " in CITATION.cff"
        )


def _is_date(text: str) -> bool:
    try:
        dt.date.fromisoformat(text)
    except ValueError:
        return False
    return True


def check_recipe(version: str) -> None:
    """
    Render the conda recipe; this finds unknown keys, malformed requirements and missing variables.
    """
    from rattler_build import RattlerBuildError, Stage0Recipe

    step("conda recipe")
    try:
        rendered = Stage0Recipe.from_file(str(ROOT / "conda" / "recipe.yaml")).render()
    except RattlerBuildError as error:
        refuse(f"conda/recipe.yaml: {' '.join(str(error).split())}")
    package = rendered[0].recipe.to_dict()["package"]
    if package["version"] != version:
        refuse(f"conda/recipe.yaml: renders version {package['version']}, not {version}")


def build_archives() -> Path:
    """Build source archive and wheel, check both, and return the wheel."""
    step("archives")
    shutil.rmtree(DIST, ignore_errors=True)
    call(sys.executable, "-m", "build", "--outdir", DIST)
    (wheel,) = DIST.glob("*.whl")
    (source,) = DIST.glob("*.tar.gz")
    call(sys.executable, "-m", "twine", "check", "--strict", source, wheel)
    call(sys.executable, "-m", "check_wheel_contents", wheel)
    return wheel


def oldest_and_newest() -> list[Path]:
    """Interpreters of the oldest and the newest supported version that are here."""
    supported = re.findall(
        r"Python :: (3\.\d+)", (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    )
    here = [python for version in supported if (python := interpreter(version)) is not None]
    if not here:
        refuse(f"no Python {supported[0]} to {supported[-1]} found")
    return [here[0]] if len(here) == 1 else [here[0], here[-1]]


def interpreter(version: str) -> Path | None:
    """Interpreter of a version, on PATH or of pyenv."""
    kept = sorted((Path.home() / ".pyenv" / "versions").glob(f"{version}.*/bin/python"))
    for candidate in (shutil.which(f"python{version}"), *map(str, reversed(kept))):
        words = "import sys, venv, ensurepip; print('%d.%d' % sys.version_info[:2])"
        if candidate is not None:
            done = subprocess.run(
                [candidate, "-c", words], capture_output=True, text=True, check=False
            )
            if done.returncode == 0 and done.stdout.strip() == version:
                return Path(candidate)
    return None


def check_oldest_numba(python: Path, wheel: Path, version: str) -> None:
    """Use the wheel with the oldest Numba that it allows, if that has a wheel for this Python."""
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    numba = "numba==" + re.search(r'"numba>=([\d.]+)"', project)[1]
    step(f"{python}: use with {numba} outside the tree")
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        own = environment(python, place)
        download = (own, "-m", "pip", "download", "--quiet", "--no-deps", "--dest", place / "numba")
        done = subprocess.run(
            [*map(str, download), "--only-binary", ":all:", numba],
            capture_output=True,
            text=True,
            check=False,
        )
        if "No matching distribution found" in done.stderr:
            print(f"{numba} has no wheel for this Python: skipped")
            return
        if done.returncode:
            refuse(done.stderr.strip())
        call(own, "-m", "pip", "install", "--quiet", wheel, numba)
        use(own, version, place)


def check_installed(python: Path, wheel: Path, version: str, tests: list[str]) -> None:
    """
    Install the wheel into a clean environment, use it, and run tests in a folder without the
    sources; the page on sizes and licences is left in dist/.
    """
    step(f"{python}: install, use and test outside the tree")
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        own = environment(python, place)
        start = processor_time()
        call(own, "-m", "pip", "install", "--quiet", wheel)
        took = processor_time() - start
        env = use(own, version, place)
        call(own, "-m", "pip", "install", "--quiet", "--group", f"{ROOT / 'pyproject.toml'}:test")
        done = subprocess.run(
            [str(own), str(ROOT / ".ci" / "dependencies.py"), f"{took:.0f}"],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            refuse(done.stderr.strip())
        (DIST / "dependencies.md").write_text(done.stdout, encoding="utf-8")
        words = ("-m", "pytest", "-q", "-n", "auto", "--dist", "worksteal")
        call(own, *words, *tests, cwd=place / "tree", env=env)


def processor_time() -> float:
    """Processor time of all commands so far, which other programs do not lengthen. [s]"""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def environment(python: Path, place: Path) -> Path:
    """Interpreter of a new environment below a folder, with the newest pip."""
    call(python, "-m", "venv", place / "environment")
    own = place / "environment" / "bin" / "python"
    call(own, "-m", "pip", "install", "--quiet", "--upgrade", "pip>=25.1")
    return own


def use(own: Path, version: str, place: Path) -> dict[str, str]:
    """
    Do in an environment, outside the tree, what users do first: the pages of `FOLLOWED`, and a
    package with a sensor and a figure. Return the environment variables.
    """
    tree = place / "tree"
    for name in COPIED:
        without = shutil.ignore_patterns("__pycache__", *NEED_SOURCE)
        shutil.copytree(ROOT / name, tree / name, ignore=without)
    for name in ("pyproject.toml", "README.md"):
        shutil.copy2(ROOT / name, tree)
    home = place / "home"
    home.mkdir()
    env = {"PATH": f"{own.parent}{os.pathsep}{os.environ['PATH']}", "HOME": str(home)}
    stated = f"import pymantaray; assert pymantaray.__version__ == {version!r}"
    call(own, "-c", stated, cwd=home, env=env)
    for name in FOLLOWED:
        print(name, flush=True)
        folder = home / Path(name).stem
        folder.mkdir()
        call(own, "-c", FOLLOW, name, cwd=folder, env={**env, "PYTHONPATH": str(tree / "tests")})
    use_extension(own, tree, home, env)
    return env


def use_extension(own: Path, tree: Path, home: Path, env: dict[str, str]) -> None:
    """Run a study with the sensor and the figure of the package in examples/extension."""
    print("examples/extension", flush=True)
    call(own, "-m", "pip", "install", "--quiet", "--no-deps", tree / "examples" / "extension")
    study = ("study", "run", "quick", "--quiet", "--realizations", 1, "--out", "extended")
    sensor = ("--set", 'mission.sensors=["pressure-gauge"]')
    call(own.parent / "mantaray", *study, *sensor, cwd=home, env=env)
    manifest = json.loads((home / "extended" / "manifest.json").read_text(encoding="utf-8"))
    used = {entry["name"] for entry in manifest["extensions"]}
    if used != {"pressure-gauge", "speed"}:
        refuse(f"the run has the extensions {sorted(used)}, not pressure-gauge and speed")
    if not (home / "extended" / "figures" / "speed.png").is_file():
        refuse("the run lacks the figure of examples/extension")
    call(own, "-m", "pip", "uninstall", "--quiet", "--yes", "pymantaray-example")


def write_sizes() -> None:
    """Put the page of the newest Python, and its sum, into the documentation."""
    reference = ROOT / "docs" / "reference"
    text = (DIST / "dependencies.md").read_text(encoding="utf-8")
    (reference / "dependencies.md").write_text(text, encoding="utf-8")
    summary = re.search(r"^`pip install pymantaray` (brings .+)$", text, re.MULTILINE)[1]
    installing = reference / "installing.md"
    words = re.sub(
        r"(?<=^The installation )brings .+$",
        summary,
        installing.read_text(encoding="utf-8"),
        flags=re.MULTILINE,
    )
    installing.write_text(words, encoding="utf-8")


if __name__ == "__main__":
    main()

"""
What is published: contents of wheel and source archive, and that both install into an empty
environment and run there.
"""

import os
import re
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "pymantaray"


def call(*words, **options):
    done = subprocess.run(
        [str(word) for word in words], capture_output=True, text=True, check=False, **options
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


IMPORT_ALL = """
import importlib, pkgutil, runpy, sys, pymantaray
names = [m.name for m in pkgutil.walk_packages(pymantaray.__path__, "pymantaray.")]
names = [name for name in names if name.rpartition(".")[2] != "__main__"]
for name in names:
    importlib.import_module(name)
print(pymantaray.__file__, len(names))
for words in ("study list", "ocean show cast.csv"):
    sys.argv = ["mantaray", *words.split()]
    try:
        runpy.run_module("pymantaray", run_name="__main__")
    except SystemExit as stop:
        assert not stop.code
"""


def ours_importable():
    """Modules and packages of the package."""
    modules = {path.relative_to(PACKAGE).with_suffix("") for path in PACKAGE.rglob("*.py")}
    names = {m.parent if m.name == "__init__" else m for m in modules} - {Path()}
    return {name for name in names if name.name != "__main__"}


@pytest.fixture(scope="module")
def archives(once):
    """Source archive, and the wheel that is built from it."""
    folder = once("dist", lambda path: call(sys.executable, "-m", "build", "--outdir", path, ROOT))
    return next(folder.glob("*.tar.gz")), next(folder.glob("*.whl"))


@pytest.fixture(scope="module")
def empty(tmp_path_factory):
    """Python of an environment in which there is nothing but pip."""
    folder = tmp_path_factory.mktemp("empty") / "env"
    call(sys.executable, "-m", "venv", folder)
    return folder / "bin" / "python"


def tracked():
    """Files of the package that belong into the archives."""
    suffixes = {".py", ".h", ".toml", ".html", ".js", ".css", ".mplstyle", ".typed"}
    files = [
        path for path in PACKAGE.rglob("*") if path.is_file() and "__pycache__" not in path.parts
    ]
    assert {path.suffix or path.name for path in files} <= {*suffixes, "py.typed"}
    return {f"pymantaray/{path.relative_to(PACKAGE).as_posix()}" for path in files}


@pytest.mark.slow
def test_archives_hold_the_package_and_nothing_else(archives):
    source, wheel = archives
    names = set(zipfile.ZipFile(wheel).namelist())
    ours = tracked()
    assert {name for name in names if not re.match(r"[^/]+\.dist-info/", name)} == ours
    for name in (
        "py.typed",
        "config/presets/quick.toml",
        "pages/templates/page.html",
        "apps/study/templates/run.js",
        "plotting/mantaray.mplstyle",
        "apps/table/mantaray_table.h",
    ):
        assert f"pymantaray/{name}" in ours
    with tarfile.open(source) as archive:
        inside = {name.partition("/")[2] for name in archive.getnames()}
    beside = {
        "README.md",
        "LICENSE",
        "CHANGELOG.md",
        "CITATION.cff",
        "pyproject.toml",
        "PKG-INFO",
        ".gitignore",
    }
    assert inside == {f"src/{name}" for name in ours} | beside
    call(sys.executable, "-m", "twine", "check", "--strict", source, wheel)


def test_the_wheel_alone_answers_beside_the_libraries(archives, tmp_path):
    """Outside the tree, before the package that this environment has; all its modules import."""
    site = tmp_path / "site"
    zipfile.ZipFile(archives[1]).extractall(site)
    env = {"PATH": os.environ["PATH"], "HOME": str(tmp_path), "PYTHONPATH": str(site)}
    inside = {"cwd": tmp_path, "env": env}
    (tmp_path / "cast.csv").write_text(
        "depth,temperature,salinity,lat,lon\n0,4,34,70,0\n90,2,34,70,0\n"
    )
    said = call(sys.executable, "-c", IMPORT_ALL, **inside)
    imported = [str(site / "pymantaray" / "__init__.py"), str(len(ours_importable()))]
    assert said.split()[:3] == [*imported, "beaufort"]
    assert "sound speed" in said


@pytest.mark.slow
def test_the_wheel_runs_in_a_read_only_empty_environment(archives, empty, tmp_path):
    """
    Outside the tree; kernels are kept in the user's cache then. The source archive installs there
    too.
    """
    source, wheel = archives
    call(empty, "-m", "pip", "install", "--quiet", "--no-compile", wheel)
    site = (
        Path(call(empty, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip())
        / "pymantaray"
    )
    assert site.is_dir()
    for folder in [
        path for path in (site, *site.rglob("*")) if path.is_dir() and path.name != "__pycache__"
    ]:
        cache = folder / "__pycache__"  # root may write anywhere, but not into what is no folder
        if cache.exists():
            call("rm", "-r", cache)
        cache.write_text("")
    home = tmp_path / "home"
    home.mkdir()
    env = {"PATH": os.environ["PATH"], "HOME": str(home)}
    mantaray = empty.with_name("mantaray")
    said = call(mantaray, "study", "run", "quick", "--out", "run", cwd=tmp_path, env=env)
    assert said.splitlines()[-1] == str(tmp_path / "run")
    assert (tmp_path / "run" / "index.html").stat().st_size > 100_000
    caches = home / ("Library/Caches" if sys.platform == "darwin" else ".cache")
    assert len(list((caches / "numba").rglob("*.nbi"))) >= 10
    assert "the installation is complete" in call(mantaray, "doctor", cwd=tmp_path, env=env)

    call(empty, "-m", "pip", "install", "--quiet", "--force-reinstall", "--no-deps", source)
    assert call(mantaray, "study", "list", cwd=tmp_path, env=env).split()[0] == "beaufort"

"""
Run all checks in parts, and record each part that passes for the tree of the commit.

    python .ci/full.py [--list] [--again] [PART ...]      PART: begins the name of some parts

A part that has passed on the same tree is not run again, so an interrupted run goes on where it
stopped. Records are in .venv/full.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RECORDS = ROOT / ".venv" / "full"
PYTEST = (
    sys.executable,
    "-m",
    "pytest",
    "-n",
    "auto",
    "--dist",
    "worksteal",
    "-q",
    "--durations=15",
)
COMPILED = {"PYMANTARAY_TESTS_COMPILED": "1"}  # by the fast tests, see tests/conftest.py
BOUNDS = {"NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(ROOT / ".venv" / "boundscheck")}
SLOW = {  # folders of tests, or files
    "physics": ("tests/physics",),
    "acoustics": ("tests/acoustics",),
    "estimation": ("tests/estimation", "tests/evaluation", "tests/fleet", "tests/sensing"),
    "locate": ("tests/apps/locate",),
    "replay": ("tests/apps/replay", "tests/apps/online"),
    "study": ("tests/apps/study", "tests/apps/sweep", "tests/apps/plan", "tests/config"),
    "applications": (
        *(f"tests/apps/{name}" for name in ("atlas", "authors", "bellhop", "export", "graphs")),
        *(f"tests/apps/{name}" for name in ("ocean", "rays", "service", "table")),
        "tests/apps/test_applications.py",
    ),
    "library": (
        *(f"tests/{name}" for name in ("cli", "compile", "exchange", "geometry", "jobs")),
        *(f"tests/{name}" for name in ("ocean", "pages", "quantities", "records")),
        "tests/range_models",
    ),
    # builds the site once, with warnings as errors
    "documentation": tuple(sorted(f"tests/{p.name}" for p in (ROOT / "tests").glob("test_*.py"))),
}
"""Groups of slow tests; a test checks that they contain all."""
KERNELS = (
    "tests/acoustics",
    "tests/fleet",
    "tests/physics/test_any_medium.py",
    "tests/physics/test_caustics.py",
    "tests/physics/test_closed_forms.py",
    "tests/physics/test_ice.py",
    *(
        f"tests/estimation/solvers/test_estimation_{name}.py"
        for name in ("covariance", "influence")
    ),
    "tests/estimation/solvers/test_estimation_normal_equations.py",
    "tests/apps/locate/test_locate_air_gun.py",
)
"""Fast tests that together run every kernel, also at edges, on levels and from boundaries."""


def parts() -> dict[str, tuple[tuple[str, ...], dict[str, str]]]:
    """Command and further environment of each part."""
    slow = {
        f"slow {name}": (
            (*PYTEST, "-m", "slow", *(p for p in paths if (ROOT / p).exists())),
            COMPILED,
        )
        for name, paths in SLOW.items()
    }
    return {
        "lint": (("make", "lint"), {}),
        "quick": (("make", "quick"), {}),
        "fast": (PYTEST, {}),
        **slow,
        "bounds": ((*PYTEST, *KERNELS), BOUNDS),
    }


def tree_of_commit() -> str:
    """Name of the tree of the current commit, whose files are unchanged."""
    if subprocess.run(
        ["git", "status", "--porcelain"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout:
        sys.exit(
            "full: files differ from the commit; commit or remove them: parts are recorded"
            " for a tree"
        )
    return subprocess.run(
        ["git", "rev-parse", "HEAD^{tree}"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.strip()


def run(command: tuple[str, ...], environment: dict[str, str]) -> dict[str, float] | None:
    """Run one part; its CPU time and wall time [s], or None if it fails."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.monotonic()
    code = subprocess.run(command, cwd=ROOT, env=os.environ | environment, check=False).returncode
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    nothing_selected = 5  # exit code of pytest
    if code not in (0, nothing_selected if "pytest" in command else 0):
        return None
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"cpu_s": round(cpu, 1), "wall_s": round(time.monotonic() - start, 1)}


def recorded(records: Path) -> dict[str, dict[str, float]]:
    """Parts that have passed, by their names."""
    return json.loads(records.read_text()) if records.exists() else {}


def main() -> None:
    """Run the parts that have not passed on this tree."""
    parser = argparse.ArgumentParser(description=__doc__.strip().partition("\n")[0])
    parser.add_argument("parts", nargs="*", metavar="PART")
    parser.add_argument("--list", action="store_true", help="only print what has passed")
    parser.add_argument("--again", action="store_true", help="run parts that have passed, too")
    options = parser.parse_args()
    tree = tree_of_commit()
    records = RECORDS / f"{tree}.json"
    passed = recorded(records)
    failed = []
    chosen = tuple(options.parts) or ("",)
    for name, (command, environment) in parts().items():
        if options.list or not name.startswith(chosen) or (name in passed and not options.again):
            continue
        print(f"== {name}", flush=True)
        took = run(command, environment)
        if took is None:
            failed.append(name)
            print(f"== {name} failed", flush=True)
            continue
        passed = recorded(records) | {name: took}  # another call may have written it
        records.parent.mkdir(parents=True, exist_ok=True)
        records.write_text(json.dumps(passed, indent=1) + "\n")
    print(f"\ntree {tree}")
    for name in parts():
        took = passed.get(name)
        print(
            f"{name:20s} "
            + ("-" if took is None else "{cpu_s:7.0f} s of CPU {wall_s:7.0f} s".format(**took))
        )
    lacking = [name for name in parts() if name not in passed]
    cpu = sum(took["cpu_s"] for took in passed.values())
    print(
        f"{cpu / 60.0:.1f} min of CPU; "
        + (f"not run: {', '.join(lacking)}" if lacking else "all passed")
    )
    sys.exit(bool(failed) or (bool(lacking) and not options.list and not options.parts))


if __name__ == "__main__":
    main()

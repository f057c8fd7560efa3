"""
Command `mantaray doctor`: report packages, extras, folders, processors and faults, and compile
kernels ahead of their use.
"""

import tempfile
import time
from pathlib import Path
from typing import Annotated, Any

import typer

from pymantaray.cli.options import Json
from pymantaray.cli.printing import Printer, printer

EXIT_FAULTS = 1
_WIDTH = 12


Compile = Annotated[
    bool,
    typer.Option(
        "--compile",
        help="First compile the kernels of rays, fleets and studies, for an image, a classroom or"
        " a vessel.",
    ),
]


def doctor(compile_kernels: Compile = False, as_json: Json = False) -> None:
    """Report installed packages and extras, and list faults; exit with 1 if there are any."""
    from pymantaray.installation import installation

    before = installation()["kernels"]["compiled"] if compile_kernels else 0
    start = time.process_time()
    if compile_kernels:
        _use_kernels()
    seconds = time.process_time() - start
    state = installation()
    with printer(as_json=as_json) as out:
        if compile_kernels:
            new = state["kernels"]["compiled"] - before
            out.line(
                f"compiled {new} kernels in {seconds:.0f} s of a processor; {before} were there",
                compiled_now=new,
                compile_s=round(seconds, 1),
            )
        out.add(**state)
        _print(out, state)
    if state["faults"]:
        raise typer.Exit(EXIT_FAULTS)


def _use_kernels() -> None:
    """
    Use the kernels of rays, fleets and studies once, so that Numba compiles those that are not on
    disk.

    Kernels are compiled for the types of their arguments. Only a use of the package knows these.
    """
    from pymantaray.acoustics import Medium, find_eigenrays, ray_picture, trace_paths
    from pymantaray.apps.study import run_study
    from pymantaray.config import load_study

    medium = Medium.from_profile([0.0, 100.0], [1450.0, 1460.0], bottom_depth=100.0)
    source, receiver = [0.0, 0.0, 10.0], [1000.0, 0.0, 20.0]
    arrivals = find_eigenrays(medium, source, receiver)
    find_eigenrays(medium, source, receiver, 1, 1)
    trace_paths(medium, source, receiver, arrivals)
    ray_picture(medium, source, receiver, fan_angles=[0.1])
    with tempfile.TemporaryDirectory() as folder:
        for name in ("quick", "survey"):
            run_study(load_study(name, realizations=1), Path(folder) / name, workers=1)


def _print(out: Printer, state: dict[str, Any]) -> None:
    # facts, one a line
    processors = state["processors"]
    kernels = state["kernels"]
    facts = [
        ("mantaray", f"{state['version']} in {state['folder']}"),
        ("Python", state["python"]),
        ("platform", state["platform"]),
        (
            "processors",
            (
                f"{processors['usable_cores']} of {processors['cores']} cores,"
                f" {processors['memory_gib']} GiB"
            ),
        ),
        (
            "kernels",
            (
                f"{kernels['compiled']} of {kernels['all']} compiled; the others are compiled at"
                " first"
                " use"
            ),
        ),
        (
            "packages",
            ", ".join(f"{row['name']} {row['version'] or '-'}" for row in state["packages"]),
        ),
    ]
    for name, text in facts:
        out.line(f"{name:<{_WIDTH}} {text}")
    # folders and extras
    for row in state["folders"]:
        out.line(
            f"{'writable' if row['writable'] else 'READ-ONLY':<{_WIDTH}} {row['folder']}, for"
            f" {row['use']}"
        )
    for row in state["extras"]:
        missing = (
            f"lacks {', '.join(row['missing'])}: {row['install']}"
            if row["missing"]
            else "installed"
        )
        out.line(f"{'extra':<{_WIDTH}} {row['name']} {missing}")
    # faults, if any
    for fault in state["faults"]:
        out.line(f"{'FAULT':<{_WIDTH}} {fault}")
    if not state["faults"]:
        out.line("the installation is complete")


COMMANDS = {"doctor": doctor}

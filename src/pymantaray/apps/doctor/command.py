"""Command `mantaray doctor`: report packages, extras, folders, processors and faults."""

from typing import Any

import typer

from pymantaray.cli.options import Json
from pymantaray.cli.printing import Printer, printer

EXIT_FAULTS = 1
_WIDTH = 12


def doctor(as_json: Json = False) -> None:
    """Report installed packages and extras, and list faults; exit with 1 if there are any."""
    from pymantaray.installation import installation

    state = installation()
    with printer(as_json=as_json) as out:
        out.add(**state)
        _print(out, state)
    if state["faults"]:
        raise typer.Exit(EXIT_FAULTS)


def _print(out: Printer, state: dict[str, Any]) -> None:
    processors = state["processors"]
    device = state["gpu"]
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
        ("GPU", device["name"] or f"none: {device['why_not']}"),
        (
            "kernels",
            (
                f"{kernels['compiled']} of {kernels['all']} compiled; the others are compiled at"
                " first"
                " use"
            ),
        ),
    ]
    facts += [
        (
            "packages",
            ", ".join(f"{row['name']} {row['version'] or '-'}" for row in state["packages"]),
        )
    ]
    for name, text in facts:
        out.line(f"{name:<{_WIDTH}} {text}")
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
    for fault in state["faults"]:
        out.line(f"{'FAULT':<{_WIDTH}} {fault}")
    if not state["faults"]:
        out.line("the installation is complete")


COMMANDS = {"doctor": doctor}

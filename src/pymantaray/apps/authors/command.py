"""Commands of `mantaray authors`: studies from and for the paper's authors' program."""

from pathlib import Path
from typing import Annotated

import typer

from pymantaray.cli.groups import existing
from pymantaray.cli.options import OUTPUT, Commands
from pymantaray.cli.output import write_new
from pymantaray.cli.printing import Printer, printer

app = Commands(help="Read and write files of the paper's authors' program.")


@app.command("import")
def import_command(
    simulation: Annotated[
        Path,
        typer.Argument(
            callback=existing(),
            metavar="SIM.json",
            help="Configuration of the paper's authors' program.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="STUDY.toml",
            help="File to write. Default: print the text.",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
) -> None:
    """
    Convert a configuration of the paper's authors' program to a study, and list what has no meaning
    here.
    """
    from pymantaray.apps.authors import import_authors
    from pymantaray.config.text import commented_toml

    config, lines = import_authors(simulation)
    text = commented_toml(config)
    Printer(quiet=False).notes(f"{simulation}: {line}" for line in lines)
    if out is None:
        typer.echo(text, nl=False)
    else:
        write_new(out, "".join(f"# {line}\n" for line in lines) + "\n" + text)
        typer.echo(f"{out}: written from {simulation}; edit it, then: mantaray study run {out}")


@app.command("export")
def export_command(
    study: Annotated[
        str, typer.Argument(metavar="STUDY", help="A run, a preset, or a study's file.")
    ],
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="FOLDER",
            help="A new or empty folder for sim.json, environment.json and its arrays.",
        ),
    ],
) -> None:
    """Write a study for the paper's authors' program, and list what it does in another way."""
    from pymantaray.apps.authors import export_authors

    written, lines = export_authors(study, folder)
    with printer() as printed:
        printed.notes(f"{study}: {line}" for line in lines)
        printed.paths(written)


COMMANDS = {"authors": app}

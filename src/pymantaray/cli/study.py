"""Commands of `mantaray study`; what they need is imported when they run, so that help is quick."""

from pathlib import Path
from typing import Annotated

import typer

from pymantaray.cli.options import OceanCommand

app = typer.Typer(help="Run the paper's study, or one of your own.", no_args_is_help=True)

Out = Annotated[Path | None, typer.Option("--out", help="Folder for the results; must be new or empty.")]
NameOrFile = Annotated[str, typer.Argument(metavar="NAME|FILE", help="A preset, or a TOML file.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="No progress bars and no summary.")]


@app.command("list")
def list_command() -> None:
    """Names of the presets."""
    from pymantaray.study import list_presets

    presets = list_presets()
    width = max(map(len, presets))
    for name, description in presets.items():
        typer.echo(f"{name:<{width}} {description}")


@app.command()
def show(name: Annotated[str, typer.Argument(metavar="NAME", help="A preset.")]) -> None:
    """Print a preset with its comments."""
    from pymantaray.study import preset_text

    typer.echo(preset_text(name), nl=False)


@app.command()
def init(
    name: Annotated[str, typer.Argument(metavar="NAME", help="A preset.")],
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The copy to make.")],
) -> None:
    """Copy a preset into a file to edit."""
    from pymantaray.errors import StudyError
    from pymantaray.study import preset_text

    text = preset_text(name)
    try:
        with file.open("x", encoding="utf-8") as copy:
            copy.write(text)
    except FileExistsError:
        raise StudyError(f"{file}: exists already; give another name") from None
    except OSError as error:
        raise StudyError(f"{file}: cannot be written: {error.strerror}") from None
    typer.echo(f"{file}: copied from preset {name}; edit it, then: mantaray study run {file}")


@app.command(cls=OceanCommand)
def run(
    study: NameOrFile,
    out: Out = None,
    realizations: Annotated[
        int | None, typer.Option("--realizations", help="Number of noise realizations.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option("--workers", min=1, help="Processes that solve realizations.")
    ] = None,
    ocean: Annotated[
        list[str] | None,
        typer.Option("--ocean", help="Files, or a synthetic ocean's name, in place of the configured ocean."),
    ] = None,
    no_figures: Annotated[
        bool, typer.Option("--no-figures", help="Data only: no tables and figures.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Run a study: data, tables and figures go into one folder."""
    from pymantaray.cli.output import progress_bars
    from pymantaray.study import load_study

    config = load_study(study, realizations=realizations, ocean=ocean)
    from pymantaray.study import run_study  # takes seconds, and not before the file is read

    with progress_bars(quiet=quiet) as progress:
        results = run_study(config, out, workers=workers, progress=progress)
        if not no_figures:
            from pymantaray.report import write_report

            try:
                write_report(results.path, progress=progress)
            except BaseException:
                typer.echo(
                    f"the data are complete; for their report: mantaray study report {results.path}", err=True
                )
                raise
    if not quiet:
        from pymantaray.cli.summary import print_summary

        print_summary(results)
    typer.echo(str(results.path))


@app.command()
def report(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run.")], quiet: Quiet = False
) -> None:
    """Write tables, figures and page of a run: those that it has again, or those that an interrupted one lacks."""
    from pymantaray.cli.output import progress_bars
    from pymantaray.report import write_report

    with progress_bars(quiet=quiet) as progress:
        page = write_report(folder, progress=progress)
    typer.echo(str(page))


@app.command()
def compare(
    first: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run.")],
    second: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of another run.")],
    out: Out = None,
    quiet: Quiet = False,
) -> None:
    """Set two runs side by side: tables, figures and a page in a folder of their own."""
    from pymantaray.cli.output import progress_bars
    from pymantaray.report import write_comparison

    with progress_bars(quiet=quiet) as progress:
        page = write_comparison(first, second, out, progress=progress)
    if not quiet:
        from pymantaray.cli.summary import print_tables

        print_tables(page.parent)
    typer.echo(str(page))

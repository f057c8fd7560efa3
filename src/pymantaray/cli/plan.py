"""Command `mantaray plan`: designs of a deployment and the best of them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from pymantaray.cli.groups import with_options
from pymantaray.cli.options import Force, Set, TableOptions, changes_of
from pymantaray.cli.output import check_output, counted_progress


@dataclass(frozen=True)
class PlanFiles:
    """Files to write."""

    out: Annotated[
        Path | None, typer.Option(metavar="STUDY.toml", help="Write the best design as a study file.")
    ] = None
    table: Annotated[
        Path | None, typer.Option(metavar="FILE.csv", help="Write the table of all designs.")
    ] = None
    force: Force = False

    def check(self, source: Path) -> None:
        """Refuse files that cannot or must not be written."""
        for path, ending in ((self.out, ".toml"), (self.table, ".csv")):
            if path is not None:
                check_output(path, (ending,), inputs=[source], force=self.force)


@with_options
def plan(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A study file with a section plan.")],
    files: PlanFiles,
    printing: TableOptions,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes of this machine.")] = None,
    changes: Set = None,
) -> None:
    """Compare designs of a deployment by their expected position errors and lost links, and print the best."""
    files.check(file)
    from pymantaray.plan import load_plan, search_designs
    from pymantaray.records import whole_file

    deployment = load_plan(file, **changes_of(changes))
    with counted_progress("designs", quiet=printing.quiet) as progress:
        results = search_designs(deployment, workers=workers, progress=progress)
    written = {}
    if files.out is not None:
        results.write_best(files.out, replace=files.force)
        written["study"] = files.out
    if files.table is not None:
        with whole_file(files.table, replace=files.force) as temporary:
            temporary.write_text(results.table.to_csv(), encoding="utf-8")
        written["csv"] = files.table
    with printing.printer() as printed:
        printed.table(results.table)
        for sentence in results.sentences:
            printed.line(sentence)
        printed.add(best=dict(results.designs[results.best]), sentences=results.sentences)
        printed.paths(**written)

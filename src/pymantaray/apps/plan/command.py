"""Command `mantaray plan`: designs of a deployment and the best of them."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import typer

from pymantaray.cli.groups import existing, with_options
from pymantaray.cli.options import OUTPUT, Force, ProcessOptions, Set, TableOptions, changes_of
from pymantaray.cli.output import check_output, counted_progress
from pymantaray.errors import WriteError

if TYPE_CHECKING:
    from pymantaray.apps.plan import PlanResults


@dataclass(frozen=True)
class PlanFiles:
    """Files to write."""

    panel: ClassVar = OUTPUT

    out: Annotated[
        Path | None,
        typer.Option(metavar="STUDY.toml", help="Write the best design as a study file."),
    ] = None
    table: Annotated[
        Path | None, typer.Option(metavar="FILE.csv", help="Write the table of all designs.")
    ] = None
    page: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER", help="Write a page with front, map, errors over time and lost links."
        ),
    ] = None
    force: Force = False

    def check(self, source: Path) -> None:
        """Refuse files that cannot or must not be written."""
        for path, ending in ((self.out, ".toml"), (self.table, ".csv")):
            if path is not None:
                check_output(path, (ending,), inputs=[source], force=self.force)
        page = self.page
        if page is not None and page.exists() and not (page.is_dir() and not any(page.iterdir())):
            raise WriteError(f"{page}: already exists; give a new or empty folder")

    def write(self, results: "PlanResults") -> dict[str, Path]:
        """Write all files; return their paths by kind."""
        from pymantaray.records import whole_file

        written = {}
        if self.out is not None:
            results.write_best(self.out, replace=self.force)
            written["study"] = self.out
        if self.table is not None:
            with whole_file(self.table, replace=self.force) as temporary:
                temporary.write_text(results.table.to_csv(), encoding="utf-8")
            written["csv"] = self.table
        if self.page is not None:
            from pymantaray.apps.plan import write_plan_page

            written["page"] = write_plan_page(results, self.page)
        return written


@with_options
def plan(
    file: Annotated[
        Path,
        typer.Argument(
            callback=existing(), metavar="FILE", help="A study file with a section plan."
        ),
    ],
    files: PlanFiles,
    printing: TableOptions,
    processes: ProcessOptions,
    changes: Set = None,
) -> None:
    """
    Compare designs of a deployment by their expected position errors and lost links, and print the
    best.
    """
    files.check(file)
    from pymantaray.apps.plan import load_plan, search_designs

    deployment = load_plan(file, **changes_of(changes))
    with counted_progress("designs", quiet=printing.quiet) as progress:
        results = search_designs(
            deployment, client=processes.scheduler, workers=processes.workers, progress=progress
        )
    written = files.write(results)
    with printing.printer() as printed:
        printed.notes(results.notes)
        printed.table(results.table)
        for sentence in results.sentences:
            printed.line(sentence)
        printed.add(best=dict(results.designs[results.best]), sentences=results.sentences)
        printed.paths(**written)


COMMANDS = {"plan": plan}

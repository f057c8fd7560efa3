"""Commands of `mantaray locate`: positions of nodes from a survey, and plans of surveys."""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pymantaray.apps.locate.options import LocateOptions, PlanOptions
from pymantaray.apps.locate.read_options import ReadOptions
from pymantaray.apps.locate.survey import PlatformError, TravelDirection
from pymantaray.cli.groups import Fields, existing, quantity, with_options
from pymantaray.cli.options import (
    OUTPUT,
    AnySourceOptions,
    Commands,
    FolderOptions,
    Force,
    Group,
    TableOptions,
    WaterOptions,
    format_names,
)
from pymantaray.cli.output import EXIT_UNUSABLE
from pymantaray.cli.printing import LOG, Printer, in_options
from pymantaray.errors import LocateError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from pymantaray.acoustics import Medium
    from pymantaray.apps.locate import Location, Survey
    from pymantaray.sensing.water import Water

_BED_FACTOR = 1.2  # default depth of the sea bed over the depth of the deepest prior position
_MAX_LISTED = 10  # unused pings
_MAX_CANDIDATES = 8
_ADVICE = "check the initial positions, the profile and the pings, or give --sound-speed known"
_ONE_WAY_ADVICE = (
    ", a smaller --depth-sigma, pings on a second line, or a clock (--clock-offset-sigma,"
    " --clock-drift-sigma) as uncertain as it is"
)


class _SurveyGroup(Group):
    """Group whose command `survey` is the default."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Insert ``survey`` before words that are not the name of a command."""
        if args and args[0] not in (*self.list_commands(ctx), "--help"):
            args = ["survey", *args]
        return super().parse_args(ctx, args)


app = Commands(
    help="Locate nodes from a survey of pings: mantaray locate SURVEY. Plan a survey: mantaray"
    " locate plan.",
    cls=_SurveyGroup,
)


@dataclass(frozen=True, kw_only=True)
class SurveyOptions:
    """Data that a survey lacks, unknowns in addition to positions, and an earlier campaign."""

    reading: Annotated[
        ReadOptions,
        Fields(
            *("nodes", "track", "platform", "position_at", "transducer_depth", "depth"),
            *("depth_sigma", "horizontal_sigma", "turn_around", "turn_around_sigma", "sigma"),
            *("lever", "lever_sigma"),
            offset_sigma="--clock-offset-sigma",
            drift_sigma="--clock-drift-sigma",
        ),
    ]
    solving: Annotated[
        LocateOptions,
        Fields(
            "correlation",
            "gross",
            speed_model="--sound-speed",
            arrangement="--rigid/--free",
            speed_prior=Fields(
                scale="--sound-speed-sigma", gradient="--gradient-sigma", knot_interval="--knots"
            ),
        ),
    ]
    platform_sigma: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="H V",
            help="Standard deviations of the platform's positions, H V in metres.",
        ),
    ] = None
    platform_correlation: Annotated[
        Any,
        typer.Option(
            parser=quantity("s"),
            metavar="DURATION",
            help="Correlation time of the errors of positions.",
        ),
    ] = "10 min"
    modes: Annotated[
        list[Path] | None,
        typer.Option(
            callback=existing(),
            metavar="CASTS",
            help="Casts for the vertical modes of --sound-speed modes.",
        ),
    ] = None
    earlier: Annotated[
        Path | None,
        typer.Option(
            "--with",
            callback=existing(),
            metavar="EARLIER",
            help="location.json of an earlier campaign, or its folder: estimate the displacement"
            " of the nodes since then.",
        ),
    ] = None

    def read_options(self) -> ReadOptions:
        """Return the data that replace those of a survey."""
        if self.platform_sigma is None:
            return self.reading
        error = PlatformError(*self.platform_sigma, self.platform_correlation)
        return replace(self.reading, platform_error=error)

    def locate_options(self, *, repair_freezing: bool) -> LocateOptions:
        """Return the options of the solver."""
        if not self.modes:
            return self.solving
        from pymantaray.ocean.casts import read_casts
        from pymantaray.ocean.modes import vertical_modes

        repair = repair_freezing
        casts = [cast for path in self.modes for cast in read_casts(path, repair_freezing=repair)]
        return replace(self.solving, modes=vertical_modes(casts))


@dataclass(frozen=True, kw_only=True)
class SurveyFolderOptions(FolderOptions):
    """As `FolderOptions`, but without files by default."""

    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="New or empty folder for page, tables and files. Default: no files.",
        ),
    ] = None


@app.command()
@with_options
def survey(
    file: Annotated[
        Path,
        typer.Argument(
            callback=existing(),
            metavar="SURVEY",
            help="A table of pings, survey text of OBSrange, the ini file of GARPOS, or the"
            " config.yaml of GNATSS.",
            show_default=False,
        ),
    ],
    source: AnySourceOptions,
    options: WaterOptions,
    values: SurveyOptions,
    folder: SurveyFolderOptions,
    printing: TableOptions,
) -> None:
    """Estimate node positions and their uncertainty from measured travel times."""
    from pymantaray.apps.locate import locate, read_campaign, read_survey
    from pymantaray.apps.locate.write import check_names_to_write
    from pymantaray.version import __version__

    # read everything that the estimate needs
    campaign = None if values.earlier is None else read_campaign(values.earlier)
    pings = read_survey(file, values.read_options())
    if folder.out is not None:
        check_names_to_write(pings)
    pings, medium, record, notes = _water(source, replace(options, earth=None), pings)
    # estimate, and compare with the earlier campaign
    solving = values.locate_options(repair_freezing=options.repair_freezing)
    location = locate(pings, medium, replace(solving, earth=options.earth or "auto"))
    if campaign is not None:
        location = location.since(campaign)
    notes = list(dict.fromkeys([*notes, *location.notes]))
    # write the folder
    page = None
    if folder.out is not None:
        from pymantaray.apps.locate import write_location_page

        made_by = {"mantaray": __version__, "survey": str(file), "water": record}
        page = write_location_page(
            location,
            folder.out,
            made_by=made_by,
            notes=notes,
            messages=in_options,
            formats=format_names(folder.formats),
        )
    # print the result; an unusable one has its own exit status
    with printing.printer() as printer:
        _print_result(printer, location, notes)
        if page is not None:
            printer.paths(page=page)
        is_one_way = (pings.direction != TravelDirection.TWO_WAY).any()
        advice = _ADVICE + (_ONE_WAY_ADVICE if is_one_way else "")
        if not location.solution.settled:
            LOG.error("%s: not converged; %s", file, advice)
        for name, why in zip(pings.names, location.unexplained, strict=True):
            if why is not None:
                LOG.error("%s: node %s: %s; %s", file, name, why, advice)
        if not location.usable:
            raise typer.Exit(EXIT_UNUSABLE)


@dataclass(frozen=True, kw_only=True)
class PlannedOptions:
    """Patterns of pings, and assumptions of a plan."""

    pattern: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Pattern: circle, cross, line, rose or lines. May be repeated. Default: all.",
        ),
    ] = None
    pings: Annotated[int, typer.Option(metavar="N", help="Number of pings per pattern.")] = 100
    radii: Annotated[
        tuple[float, float, int] | None,
        typer.Option(
            metavar="FROM TO COUNT",
            help="Radii in metres. Default: from 0.1 to 3 times the depth, and further until the"
            " best is not at an edge.",
        ),
    ] = None
    assumed: Annotated[
        PlanOptions,
        Fields(
            *("depth", "sigma", "transducer_depth", "ship_speed", "turn_time", "criterion"),
            speed_model="--sound-speed",
            speed_prior=Fields(scale="--sound-speed-sigma"),
            lever=Fields(sigma="--lever-sigma"),
        ),
    ]
    depth_sigma: Annotated[
        float,
        typer.Option(
            parser=quantity("m"), metavar="METRES", help="Standard deviation of the prior depth."
        ),
    ] = 100.0
    platform_sigma: Annotated[
        tuple[float, float],
        typer.Option(
            metavar="H V",
            help="Standard deviations of the platform's positions, H V in metres.",
        ),
    ] = (0.0, 0.0)

    def plan_options(self) -> PlanOptions:
        """Return the assumptions of the plan."""
        north, east, _ = self.assumed.node_sigma
        error = PlatformError(*self.platform_sigma)
        return replace(
            self.assumed, node_sigma=(north, east, self.depth_sigma), platform_error=error
        )

    @property
    def radius_values(self) -> "NDArray[np.float64] | None":
        """Radii of the patterns; None for a search. [m]"""
        import numpy as np

        if self.radii is None:
            return None
        first, last, count = self.radii
        if not (0.0 < first <= last and 1 <= count <= 1000):
            raise LocateError(
                f"--radii is {first:g} {last:g} {count}; it must be FROM TO COUNT with 0 < FROM <="
                " TO and COUNT 1 to 1000"
            )
        return np.linspace(first, last, count)


@app.command()
@with_options
def plan(
    source: AnySourceOptions,
    options: WaterOptions,
    planned: PlannedOptions,
    printing: TableOptions,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="OUT.png",
            help="Figure over radius, .png or .pdf; its table is written beside it.",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
    force: Force = False,
) -> None:
    """
    Print the expected standard deviations of a node for patterns of pings, and the best radius of
    each.
    """
    from pymantaray.apps.locate.options import CRITERIA
    from pymantaray.apps.locate.ping_pattern import SHAPES
    from pymantaray.apps.locate.plan import plan_survey
    from pymantaray.cli.output import check_output, progress_bars
    from pymantaray.cli.water import water_notes

    # refuse a wrong output before the computation
    if out is not None:
        check_output(
            out,
            (".png", ".pdf"),
            inputs=[*source.files, *options.files],
            beside=[out.with_suffix(".csv")],
            force=force,
        )
    # the best radius of each pattern
    radii = planned.radius_values
    survey = planned.plan_options()
    water = _water_over_bed(source, options, survey.depth)
    shapes: Any = tuple(planned.pattern) if planned.pattern else SHAPES
    with progress_bars(quiet=printing.quiet) as report:
        progress = None if report is None else partial(report, "patterns")
        result = plan_survey(
            water.at_start[0], survey, radii, shapes=shapes, pings=planned.pings, progress=progress
        )
    if out is not None:
        from pymantaray.apps.locate import write_plan_figure

        write_plan_figure(result, out)
    # print them, and which are at an edge of the search
    with printing.printer() as printer:
        from pymantaray.records.result_table import ResultTable

        printer.notes(water_notes(water))
        _, criterion = CRITERIA[survey.criterion]
        caption = (
            f"Best radius of each pattern (least {criterion}), {planned.pings} pings of"
            f" {1e3 * survey.sigma:g} ms, node at {survey.depth:g} m, ship at"
            f" {survey.ship_speed:g} m/s with turns of {survey.turn_time:g} s"
        )
        sigmas = [f"sigma_{axis}_m" for axis in ("north", "east", "depth")]
        brief = ["pattern", "radius_m", *sigmas, "lost", "length_m", "hours"]
        best = result.best
        printer.table(ResultTable("best", best, caption, brief=brief))
        for row in best[best["at_edge"] != ""].to_dict("records"):
            printer.line(
                f"{row['pattern']}: the best radius is the {row['at_edge']} of the search; a better"
                " one may be beyond"
            )
        printer.add(plan=result.table, criterion=survey.criterion)
        if out is not None:
            printer.paths(out, out.with_suffix(".csv"))


def _water(
    source: AnySourceOptions, options: WaterOptions, survey: "Survey"
) -> tuple["Survey", "Medium", dict[str, Any], list[str]]:
    """Survey in the frame of its water, water, description of the water, and notes."""
    from pymantaray.acoustics import Medium
    from pymantaray.acoustics.profiles import reduce_profile
    from pymantaray.cli.water import water_notes

    deepest = max(node.position[2] + 3.0 * min(node.sigma[2], 100.0) for node in survey.nodes)
    notes = list(survey.notes)
    frame = survey.frame
    # without other water, the profile of the survey
    if not source.given:
        if survey.profile is None:
            raise LocateError("no water; give --profile, --ocean or --run")
        keys = options.keys
        depth, speed = survey.profile
        reduced = reduce_profile(
            depth,
            speed,
            thin=options.thin,
            smooth=options.smooth,
            interpolation=keys.get("interpolation", "linear"),
        )
        if reduced is not None:
            depth, speed = reduced.depth, reduced.sound_speed
            notes.append(f"profile of the survey: {reduced}")
        if "ice_slope_deg" in keys:
            raise LocateError(
                "--ice-slope: rough ice needs --profile or --ocean; add one, or leave out"
                " --ice-slope"
            )
        # by default, the bed is below all nodes
        medium = Medium.from_profile(
            depth,
            speed,
            bottom_depth=keys.get("bathymetry", max(float(depth[-1]), _BED_FACTOR * deepest)),
            interpolation=keys.get("interpolation", "linear"),
            ice_draft=keys.get("ice", 0.0),
        )
        record = {"profile": "of the survey", "last_level_m": float(depth[-1])}
        return survey, medium, record, notes
    # an ocean around the survey, which moves to the ocean's frame
    if source.ocean and options.centre is None and frame is not None:
        options = replace(options, centre=(frame.latitude_deg, frame.longitude_deg))
    water = _water_over_bed(source, options, deepest)
    if water.frame is not None and frame is not None and not water.uniform:
        survey = survey.in_frame(water.frame)
    return survey, water.at_start[0], dict(water.record), [*notes, *water_notes(water)]


def _water_over_bed(source: AnySourceOptions, options: WaterOptions, deepest: float) -> "Water":
    """Water of the source, by default with a sea bed below the profile and the deepest node."""
    from pymantaray.acoustics import read_profiles
    from pymantaray.cli.water import load_water
    from pymantaray.ocean import holds_casts

    if not source.given:
        raise LocateError("no water; give --profile, --ocean or --run")
    first = Path(source.words[0]) if source.words else None
    if (
        options.bathymetry is None
        and first is not None
        and first.is_file()
        and first.suffix != ".toml"
        and holds_casts(first)
    ):
        last = float(read_profiles(first, options.centre or options.position)[0].depth[-1])
        options = replace(options, bathymetry=str(max(last, _BED_FACTOR * deepest)))
    return load_water(source, options, default="linear")


def _print_result(out: Printer, location: "Location", notes: list[str]) -> None:
    """Print the results."""
    from pymantaray.apps.locate.write import summary

    out.notes(notes)
    out.line(in_options(location.earth))
    values = summary(location)
    unused = values["rejected"]
    out.line(
        f"{values['n_used']} of {values['n_all']} pings used, residuals {1e6 * values['rms_s']:.1f}"
        f" us rms; sound speed: {values['hyperparameters']['sound_speed']},"
        f" {values['selection']}"
    )
    for row in unused[:_MAX_LISTED]:
        out.line(f"  not used: line {row['line']}, {row['node']}: {row['reason']}")
    if len(unused) > _MAX_LISTED:
        out.line(f"  and {len(unused) - _MAX_LISTED} more")
    tables = location.tables
    out.table(tables["nodes"])
    if "mirrors" in tables:
        out.table(tables["mirrors"])
    if "budget" in tables:
        out.table(tables["budget"])
    if "candidates" in tables:
        out.table(tables["candidates"].first(_MAX_CANDIDATES))
    passed = [test.text for test in location.tests if test.passed]
    for line in [*passed, *location.warnings]:
        out.line(in_options(line))
    if location.displacement is not None:
        out.table(tables["displacement"])
    out.add(**values)


COMMANDS = {"locate": app}

"""Commands of `mantaray locate`: positions of nodes from a survey of pings, and plans of surveys."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from typer.core import TyperGroup

from pymantaray.cli.options import (
    AnySourceOptions,
    Commands,
    Formats,
    Json,
    Quiet,
    To,
    WaterOptions,
    format_names,
    parse_duration,
    with_options,
)
from pymantaray.cli.printing import Printer, printer
from pymantaray.errors import LocateError

if TYPE_CHECKING:
    from pymantaray.acoustics import Medium
    from pymantaray.locate import Location, Survey
    from pymantaray.locate.read_options import ReadOptions
    from pymantaray.locate.solve import LocateOptions
    from pymantaray.ocean.modes import VerticalModes
    from pymantaray.water import Water

Three = tuple[float, float, float]
_BED_FACTOR = 1.2  # default depth of the sea bed over the depth of the deepest prior position
_SHORT = {"ms": 1e-3, "us": 1e-6}
_MAX_LISTED = 10  # unused pings
_MAX_CANDIDATES = 8


class _Group(TyperGroup):
    """Group whose command `survey` is the default."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Insert ``survey`` before words that are not the name of a command."""
        if args and args[0] not in (*self.list_commands(ctx), "--help"):
            args = ["survey", *args]
        return super().parse_args(ctx, args)


app = Commands(
    help="Locate nodes from a survey of pings: mantaray locate SURVEY. Plan a survey: mantaray locate plan.",
    cls=_Group,
)


@dataclass(frozen=True)
class NodeOptions:
    """Priors of nodes."""

    nodes: Annotated[
        Path | None,
        typer.Option(
            metavar="CSV",
            help="Table of prior positions: name, lat, lon (or north_m, east_m), depth_m, standard deviations.",
        ),
    ] = None
    depth: Annotated[float | None, typer.Option(metavar="M", help="Prior depth of nodes without one.")] = None
    depth_sigma: Annotated[
        float | None,
        typer.Option(metavar="M", help="Standard deviation of prior depths. Default: from the file."),
    ] = None
    horizontal_sigma: Annotated[
        float | None,
        typer.Option(
            metavar="M", help="Standard deviation of prior north and east positions. Default: from the file."
        ),
    ] = None
    turn_around: Annotated[
        str | None, typer.Option(metavar="TIME", help="Turn-around time of all nodes, such as '13 ms'.")
    ] = None
    turn_around_sigma: Annotated[
        str | None,
        typer.Option(
            metavar="TIME",
            help="Standard deviation of turn-around times; the solver then estimates them. Default: known times.",
        ),
    ] = None
    clock_offset_sigma: Annotated[
        str | None,
        typer.Option(metavar="TIME", help="Standard deviation of clock offsets, for one-way times."),
    ] = None
    clock_drift_sigma: Annotated[
        float | None,
        typer.Option(metavar="S/S", help="Standard deviation of clock drifts, for one-way times."),
    ] = None
    rigid: Annotated[
        bool | None,
        typer.Option(
            "--rigid/--free", help="Move all nodes together, or each freely. Default: as in the file."
        ),
    ] = None


@dataclass(frozen=True)
class PlatformOptions:
    """Positions of the platform, and position of its transducer."""

    track: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE", help="Trajectory of the platform, in any format of mantaray ranges."),
    ] = None
    platform: Annotated[
        str | None, typer.Option(metavar="NAME", help="Name of the platform in the track.")
    ] = None
    position_at: Annotated[
        Literal["both", "transmission", "reception"],
        typer.Option(
            help="Instant of a single position per ping; the other position is interpolated between pings."
        ),
    ] = "both"
    transducer_depth: Annotated[
        float, typer.Option(metavar="M", help="Depth of positions without depth.")
    ] = 0.0
    lever: Annotated[
        Three | None,
        typer.Option(
            metavar="F S D", help="Vector from antenna to transducer: forward, starboard, down, in metres."
        ),
    ] = None
    lever_sigma: Annotated[
        Three | None,
        typer.Option(
            metavar="F S D", help="Standard deviations of the lever arm; the solver then estimates it."
        ),
    ] = None
    platform_sigma: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="H V", help="Standard deviations of the platform's positions, in metres."),
    ] = None
    platform_correlation: Annotated[
        str, typer.Option(metavar="TIME", help="Correlation time of the errors of positions.")
    ] = "10 min"


@dataclass(frozen=True)
class ModelOptions:
    """Unknowns of the solver in addition to positions."""

    sound_speed: Annotated[
        Literal["auto", "known", "scale", "time", "gradient", "modes"],
        typer.Option(
            help="Model of the sound speed relative to the profile; auto selects it by the marginal likelihood."
        ),
    ] = "auto"
    sound_speed_sigma: Annotated[
        float, typer.Option(metavar="FRACTION", help="Standard deviation of the scale of the sound speed.")
    ] = 5e-3
    gradient_sigma: Annotated[
        float,
        typer.Option(
            metavar="1/KM", help="Standard deviation of constant horizontal gradients of the sound speed."
        ),
    ] = 1e-4
    knots: Annotated[
        str | None,
        typer.Option(
            metavar="TIME",
            help="Spacing of the splines' knots. Default: 1/80 of the survey, but at least 5 min.",
        ),
    ] = None
    modes: Annotated[
        list[Path] | None,
        typer.Option(metavar="CASTS", help="Casts for the vertical modes of --sound-speed modes."),
    ] = None
    correlation: Annotated[
        Literal["auto", "none"],
        typer.Option(
            help="Correlated noise of pings: auto selects it by the marginal likelihood, none excludes it."
        ),
    ] = "auto"
    sigma: Annotated[
        str | None,
        typer.Option(metavar="TIME", help="Stated standard deviation of times, for a chi-square test."),
    ] = None
    gross: Annotated[
        float,
        typer.Option(metavar="N", help="Limit for gross errors, in robust standard deviations."),
    ] = 5.0


@app.command()
@with_options
def survey(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="SURVEY",
            help="A table of pings, survey text of OBSrange, the ini file of GARPOS, or the config.yaml of GNATSS.",
            show_default=False,
        ),
    ],
    source: AnySourceOptions,
    options: WaterOptions,
    nodes: NodeOptions,
    ship: PlatformOptions,
    model: ModelOptions,
    bootstrap: Annotated[
        int, typer.Option(metavar="N", min=0, help="Number of resampled surveys; 0 for no bootstrap.")
    ] = 0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the bootstrap.")] = 0,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="New or empty folder for page, tables and files. Default: no files.",
        ),
    ] = None,
    formats: Formats = "",
    as_json: Json = False,
    to: To = "text",
    quiet: Quiet = False,
) -> None:
    """Estimate node positions and their uncertainty from measured travel times."""
    import pymantaray
    from pymantaray.cli.output import progress_bars
    from pymantaray.locate import locate, read_survey

    measured = read_survey(file, _read_options(nodes, ship, model))
    measured, water, record, notes = _water(source, options, measured)
    choices = _locate_options(model, nodes)
    with progress_bars(quiet=quiet or not bootstrap) as report:
        located = locate(
            measured,
            water,
            choices,
            bootstrap=bootstrap,
            seed=seed,
            progress=None if report is None else lambda done, total: report("bootstrap", done, total),
        )
    page = None
    if out is not None:
        from pymantaray.report import write_location_page

        made_by = {"mantaray": pymantaray.__version__, "survey": str(file), "water": record}
        page = write_location_page(located, out, made_by=made_by, notes=notes, formats=format_names(formats))
    with printer(as_json=as_json, quiet=quiet, to=to) as printed:
        _tell(printed, located, notes)
        if page is not None:
            printed.paths(page=page)


@app.command()
@with_options
def plan(
    depth: Annotated[float, typer.Option(metavar="M", help="Depth of the node.")],
    source: AnySourceOptions,
    options: WaterOptions,
    pattern: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME", help="Pattern: circle, cross, line, rose or lines. May be repeated. Default: all."
        ),
    ] = None,
    pings: Annotated[int, typer.Option(metavar="N", help="Number of pings per pattern.")] = 100,
    radii: Annotated[
        tuple[float, float, int] | None,
        typer.Option(
            metavar="FROM TO COUNT", help="Radii in metres. Default: 30 radii from 0.1 to 3 times the depth."
        ),
    ] = None,
    sigma: Annotated[str, typer.Option(metavar="TIME", help="Standard deviation of two-way times.")] = "1 ms",
    sound_speed: Annotated[
        Literal["known", "scale", "time", "gradient"],
        typer.Option(help="Model of the sound speed in the solver."),
    ] = "scale",
    sound_speed_sigma: Annotated[
        float, typer.Option(metavar="FRACTION", help="Standard deviation of the scale of the sound speed.")
    ] = 5e-3,
    depth_sigma: Annotated[
        float, typer.Option(metavar="M", help="Standard deviation of the prior depth.")
    ] = 100.0,
    transducer_depth: Annotated[float, typer.Option(metavar="M", help="Depth of the transducer.")] = 5.0,
    lever_sigma: Annotated[
        Three | None, typer.Option(metavar="F S D", help="Standard deviations of the lever arm, in metres.")
    ] = None,
    platform_sigma: Annotated[
        tuple[float, float],
        typer.Option(metavar="H V", help="Standard deviations of the platform's positions."),
    ] = (0.0, 0.0),
    out: Annotated[
        Path | None,
        typer.Option(metavar="PNG", help="Figure over radius, .png or .pdf; its table is written beside it."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the output if it exists.")] = False,
    as_json: Json = False,
    to: To = "text",
    quiet: Quiet = False,
) -> None:
    """Print the expected standard deviations of a node for patterns of pings, and the best radius of each."""
    import numpy as np

    from pymantaray.cli.output import check_output
    from pymantaray.locate.plan import SHAPES, PlanOptions, plan_survey
    from pymantaray.locate.sound_speed import SpeedPrior
    from pymantaray.locate.survey import LeverArm, PlatformError

    if out is not None:
        check_output(
            out,
            (".png", ".pdf"),
            inputs=[*source.files, *options.files],
            beside=[out.with_suffix(".csv")],
            force=force,
        )
    first, last, count = radii or (0.1 * depth, 3.0 * depth, 30)
    if not (0.0 < first <= last and 1 <= count <= 1000):
        raise LocateError(
            f"--radii is {first:g} {last:g} {count}; it must be FROM TO COUNT with 0 < FROM <= TO and COUNT 1 to 1000"
        )
    survey = PlanOptions(
        depth,
        _seconds("--sigma", sigma),
        sound_speed,
        node_sigma=(500.0, 500.0, depth_sigma),
        transducer_depth=transducer_depth,
        lever=LeverArm(sigma=lever_sigma or (0.0, 0.0, 0.0)),
        platform_error=PlatformError(*platform_sigma),
        speed_prior=SpeedPrior(scale=sound_speed_sigma),
    )
    water = _over_a_bed(source, options, depth).at_start[0]
    shapes: Any = tuple(pattern) if pattern else SHAPES
    planned = plan_survey(water, survey, np.linspace(first, last, count), shapes=shapes, pings=pings)
    if out is not None:
        from pymantaray.report import write_plan_figure

        write_plan_figure(planned, out)
    with printer(as_json=as_json, quiet=quiet, to=to) as printed:
        from pymantaray.records.result_table import ResultTable

        caption = (
            f"Best radius of each pattern, {pings} pings of {1e3 * survey.sigma:g} ms, node at {depth:g} m"
        )
        brief = ["pattern", "radius_m", "sigma_north_m", "sigma_east_m", "sigma_depth_m", "lost", "length_m"]
        printed.table(ResultTable("best", planned.best, caption, brief=brief))
        printed.add(plan=planned.table, best_horizontal=planned.best_horizontal)
        if out is not None:
            printed.paths(out, out.with_suffix(".csv"))


def _seconds(option: str, text: str) -> float:
    """Parse a time such as ``13 ms``, ``70 us`` or ``10 min``, or a number of seconds."""
    for unit, size in _SHORT.items():
        if text.strip().endswith(unit):
            try:
                value = float(text.strip().removesuffix(unit)) * size
            except ValueError:
                break
            if not value >= 0.0:
                break
            return value
    return parse_duration(option, text, positive=False)


def _maybe_seconds(option: str, text: str | None) -> float | None:
    return None if text is None else _seconds(option, text)


def _read_options(nodes: NodeOptions, ship: PlatformOptions, model: ModelOptions) -> "ReadOptions":
    from pymantaray.locate.read_options import ReadOptions
    from pymantaray.locate.survey import PlatformError

    error = None
    if ship.platform_sigma is not None:
        correlation = _seconds("--platform-correlation", ship.platform_correlation)
        error = PlatformError(*ship.platform_sigma, correlation)
    return ReadOptions(
        nodes=nodes.nodes,
        track=tuple(ship.track or ()),
        platform=ship.platform,
        position_at=ship.position_at,
        transducer_depth=ship.transducer_depth,
        depth=nodes.depth,
        depth_sigma=nodes.depth_sigma,
        horizontal_sigma=nodes.horizontal_sigma,
        turn_around=_maybe_seconds("--turn-around", nodes.turn_around),
        turn_around_sigma=_maybe_seconds("--turn-around-sigma", nodes.turn_around_sigma),
        offset_sigma=_maybe_seconds("--clock-offset-sigma", nodes.clock_offset_sigma),
        drift_sigma=nodes.clock_drift_sigma,
        sigma=_maybe_seconds("--sigma", model.sigma),
        lever=ship.lever,
        lever_sigma=ship.lever_sigma,
        platform_error=error,
    )


def _locate_options(model: ModelOptions, nodes: NodeOptions) -> "LocateOptions":
    from pymantaray.locate import LocateOptions, SpeedPrior

    knots = 0.0 if model.knots is None else _seconds("--knots", model.knots)
    arrangement: Any = None if nodes.rigid is None else ("rigid" if nodes.rigid else "free")
    return LocateOptions(
        speed_model=model.sound_speed,
        correlation=model.correlation,
        gross=model.gross,
        arrangement=arrangement,
        speed_prior=SpeedPrior(model.sound_speed_sigma, model.gradient_sigma, knots),
        modes=_modes(model.modes),
    )


def _modes(paths: list[Path] | None) -> "VerticalModes | None":
    if not paths:
        return None
    from pymantaray.ocean.casts import read_casts
    from pymantaray.ocean.modes import vertical_modes

    casts = [cast for path in paths for cast in read_casts(path)]
    return vertical_modes(casts)


def _water(
    source: AnySourceOptions, options: WaterOptions, survey: "Survey"
) -> "tuple[Survey, Medium, dict[str, Any], list[str]]":
    """Medium from the options or the survey's own files, the survey in its frame, a description of the water, and notes."""
    from pymantaray.acoustics import Medium
    from pymantaray.cli.water import water_notes

    deepest = max(node.position[2] + 3.0 * min(node.sigma[2], 100.0) for node in survey.nodes)
    notes, frame = list(survey.notes), survey.frame
    if not source.given:
        if survey.profile is None:
            raise LocateError("no water; give --profile, --ocean or --run")
        depth, speed = survey.profile
        given = options.keys
        bottom = given.get("bathymetry", max(float(depth[-1]), _BED_FACTOR * deepest))
        interpolation = given.get("interpolation", "linear")
        if "ice_slope_deg" in given:
            raise LocateError("--ice-slope: rough ice needs --profile or --ocean; add one, or leave out --ice-slope")
        medium = Medium.from_profile(
            depth, speed, bottom_depth=bottom, interpolation=interpolation, ice_draft=given.get("ice", 0.0)
        )
        return survey, medium, {"profile": "of the survey", "last_level_m": float(depth[-1])}, notes
    if source.ocean and options.centre is None and frame is not None:
        options = replace(options, centre=(frame.latitude_deg, frame.longitude_deg))
    water = _over_a_bed(source, options, deepest)
    if water.frame is not None and frame is not None and not water.uniform:
        survey = survey.in_frame(water.frame)
    return survey, water.at_start[0], water.record, [*notes, *water_notes(water)]


def _over_a_bed(source: AnySourceOptions, options: WaterOptions, deepest: float) -> "Water":
    """Water of the source; the default sea bed of a profile is below the profile and the deepest node."""
    from pymantaray.acoustics import read_profiles
    from pymantaray.cli.water import load_water
    from pymantaray.ocean import holds_casts

    if not source.given:
        raise LocateError("no water; give --profile, --ocean or --run")
    first = Path(source.words[0]) if source.words else None
    if (
        options.sea_floor is None
        and first is not None
        and first.is_file()
        and first.suffix != ".toml"
        and holds_casts(first)
    ):
        last = float(read_profiles(first, options.centre or options.position)[0].depth[-1])
        options = replace(options, sea_floor=str(max(last, _BED_FACTOR * deepest)))
    return load_water(source, options, default="linear")


def _tell(out: Printer, located: "Location", notes: list[str]) -> None:
    """Print the results."""
    from pymantaray.locate.write import summary

    for note in notes:
        out.line(note)
    values = summary(located)
    left = values["rejected"]
    out.line(
        f"{values['n_used']} of {values['n_all']} pings used, residuals {1e6 * values['rms_s']:.1f} us rms; sound speed:"
        f" {values['hyperparameters']['sound_speed']}"
    )
    for row in left[:_MAX_LISTED]:
        out.line(f"  not used: line {row['line']}, {row['node']}: {row['reason']}")
    if len(left) > _MAX_LISTED:
        out.line(f"  and {len(left) - _MAX_LISTED} more")
    tables = located.tables
    out.table(tables["nodes"])
    for row in values["nodes"].to_dict("records"):
        if row["status"] != "ok":
            out.line(f"{row['name']}: {row['status']}, {row['n_used']} of {row['n_all']} pings used")
    if "budget" in tables:
        out.table(tables["budget"])
    if "candidates" in tables:
        out.table(tables["candidates"].first(_MAX_CANDIDATES))
    for mirror in located.mirrors:
        verdict = "the pings do not exclude it" if mirror.undecided else "the pings exclude it"
        out.line(
            f"{mirror.node}: the pings are along a line; mirror solution at north {mirror.north:.1f}, east {mirror.east:.1f},"
            f" depth {mirror.depth:.1f} m with a chi-square larger by {mirror.chi_square_difference:.1f}: {verdict}"
        )
    for test in located.tests:
        verdict = "passed" if test.passed else "FAILED"
        out.line(f"{test.name}: chi-square {test.chi_square:.1f} of {test.degrees:.0f}, {verdict}")
    out.add(**values)

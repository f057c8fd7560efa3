"""Page, tables and figures of located nodes, and the figure of a plan."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pymantaray.apps.locate import Location, SurveyPlan
from pymantaray.apps.locate.displacement import CAMPAIGN_FILE
from pymantaray.apps.locate.fit_tests import HALVES
from pymantaray.apps.locate.location import ellipse_points
from pymantaray.apps.locate.options import CRITERIA
from pymantaray.apps.locate.write import write_location
from pymantaray.jobs.progress import Progress
from pymantaray.pages.page import Card, Page, origin_table, write_page
from pymantaray.plotting import style
from pymantaray.plotting.drawing import FigureSpec, Picture
from pymantaray.records import whole_file
from pymantaray.records.digits import counted, show
from pymantaray.records.result_table import ResultTable

_MICRO = 1e6
_MAX_NODES = 6  # whose residuals have a colour
_UNUSED = ["line", "node", "time_s", "travel_time_s", "residual_s", "reason"]
_LINE_STYLES = {"circle": "-", "cross": "--", "line": ":", "rose": "-.", "lines": (0, (5, 1, 1, 1))}
_DIGITS = 6  # of a number in the provenance; the file has all
_CORNERS = 180  # of an ellipse


def write_location_page(
    location: Location,
    out: str | Path | None = None,
    *,
    made_by: dict[str, Any] | None = None,
    notes: list[str] | None = None,
    messages: Callable[[str], str] = str,
    formats: Sequence[str] = (),
    progress: Progress | None = None,
) -> Path:
    """
    Write page, tables, figures and files for other programs into a new folder.

    Parameters
    ----------
    location : Location
        Located nodes.
    out : str or pathlib.Path, optional
        New or empty folder. Default: a new folder in ``runs``.
    made_by : dict, optional
        Origin of the results, such as version and command, for ``locate.json`` and the page.
    notes : list of str, optional
        Lines for the top of the page.
    messages : callable, optional
        Rewrites messages on the page for its readers; the command line writes its options instead
        of arguments. Default: as they are.
    formats : sequence of str
        Additional formats for a paper: figures as ``png`` with 300 dpi, ``pdf`` and ``svg``, and
        for one column of a journal as ``84mm``; tables as ``tex``.
    progress : callable, optional
        Called with ``"report"``, the number of finished parts and the total.

    Returns
    -------
    pathlib.Path
        The page, ``index.html``. The same folder contains ``tables`` (CSV), ``figures``,
        ``landmarks.toml``, ``nodes.geojson``, ``survey.pyfg``, ``location.nc``, ``location.json``
        and ``locate.json``.

    Raises
    ------
    JobError
        If the folder is not empty or cannot be written.

    Examples
    --------
    Continues the example of `pymantaray.apps.locate`:

    >>> from pymantaray.apps.locate import write_location_page
    >>> page = write_location_page(location, "M1")
    >>> page.name, (page.parent / "location.json").is_file()
    ('index.html', True)
    """
    record = (made_by or {}) | {
        "earth": messages(location.earth),
        "model": location.hyperparameters,
    }
    page_of = partial(_page, location, notes or [], messages)
    others = partial(write_location, location)
    return write_page(
        out, "locate", _figure_specs(location), page_of, record, formats, progress, others
    )


def _page(
    location: Location,
    notes: Sequence[str],
    messages: Callable[[str], str],
    pictures: Sequence[Picture],
    record: dict[str, Any],
) -> Page:
    tables = location.tables
    return Page(
        title="Located nodes",
        facts=[_fact(location)],
        notes=[messages(line) for line in (location.earth, *notes, *location.warnings)],
        cards=_cards(location),
        pictures=pictures,
        tables=[_reworded(table, messages) for table in tables.values() if table.caption],
        excerpts=[
            ResultTable(
                "left_out",
                location.pings.loc[~location.pings["used"], _UNUSED],
                "Unused pings",
                folded=True,
                file="tables/pings.csv",
            )
        ],
        other_tables=[table for table in tables.values() if not table.caption],
        links={
            "Every ping": "tables/pings.csv",
            "landmarks of a study": "landmarks.toml",
            "GeoJSON": "nodes.geojson",
            "factor graph": "survey.pyfg",
            "NetCDF": "location.nc",
            "positions with covariance": CAMPAIGN_FILE,
        },
        origin=[
            origin_table(record | {"model": _rounded(record["model"])}, "Options", "locate.json")
        ],
    )


def _reworded(table: ResultTable, messages: Callable[[str], str]) -> ResultTable:
    """Table with the remedies of failed tests in the words of its readers."""
    if "remedy" not in table.frame:
        return table
    frame = table.frame.assign(remedy=table.frame["remedy"].map(messages))
    return replace(table, frame=frame)


def _rounded(content: Any) -> Any:
    """Nested record with numbers of `_DIGITS` significant digits, for the page."""
    if isinstance(content, dict):
        return {name: _rounded(item) for name, item in content.items()}
    if isinstance(content, list | tuple):
        return [_rounded(item) for item in content]
    return float(f"{content:.{_DIGITS}g}") if isinstance(content, float) else content


def _fact(location: Location) -> str:
    n_used = int(location.solution.used.sum())
    count = len(location.survey)
    epoch = location.survey.epoch
    day = ""
    if not np.isnat(epoch):
        day = f", {np.datetime_as_string(epoch, unit='m').replace('T', ' ')} UTC"
    return (
        f"{location.survey.source}: {n_used:,} of {count:,} pings used,"
        f" {counted(len(location.survey.nodes), 'node')}{day}"
    )


def _cards(location: Location) -> list[Card]:
    """Cards of the nodes, the residuals, the model and the tests."""
    cards = []
    for row in location.nodes.head(_MAX_NODES).to_dict("records"):
        coordinates = f"{row['north']:.2f} N, {row['east']:.2f} E m"
        if np.isfinite(row["lat"]):
            coordinates = f"{row['lat']:.6f}, {row['lon']:.6f}"
        sigma = ", ".join(f"{row[f'sigma_{axis}_m']:.2g}" for axis in ("north", "east", "depth"))
        details = f"depth {row['depth']:.2f} m; σ {sigma} m north, east, depth"
        cards.append(Card(str(row["name"]), coordinates, details))
    if location.displacement is not None:
        moved = location.displacement
        value = ", ".join(f"{1e3 * metres:+.0f}" for metres in moved.value)
        sigma = ", ".join(f"{1e3 * metres:.2g}" for metres in moved.sigma)
        details = f"north, east, depth; σ {sigma} mm; {counted(len(moved.nodes), 'node')}"
        cards.append(Card("Displacement", f"{value} mm", details))
    cards.append(
        Card("Residuals", f"{show(_MICRO * location.rms)} µs", "root mean square of the used pings")
    )
    model = location.hyperparameters
    cards.append(Card("Sound speed", str(model["sound_speed"]), location.selection))
    verdict = "passed" if location.passed else "failed"
    halves = [test for test in location.tests if test.name == HALVES]
    lines = [f"{len(location.tests)} chi-square tests"]
    lines += [f"halves in time differ by {test.equivalent_sigma:.1f} sigma" for test in halves]
    cards.append(Card("Tests", verdict, "; ".join(lines)))
    return cards


def _figure_specs(location: Location) -> list[FigureSpec]:
    header = _fact(location)
    specs = [
        FigureSpec.of_both_widths(
            "survey_map",
            "Pings coloured by residual, nodes with their 95 % ellipses, prior positions, and"
            " mirrored positions of nodes whose pings lie along one line."
            " Right: ellipses and prior positions of each node about its estimate.",
            partial(survey_map, location, header),
        ),
        FigureSpec.of_both_widths(
            "residuals",
            "Residuals of the used pings, measured minus predicted, over time, azimuth from the"
            " node and horizontal range.",
            partial(residual_panels, location, header),
        ),
    ]
    if len(location.sound_speed):
        specs.append(
            FigureSpec.of_both_widths(
                "sound_speed",
                "Mean sound speed along the rays minus that of the profile, with its 95 %"
                " interval.",
                partial(speed_over_time, location, header),
            )
        )
    return specs


@style.styled
def survey_map(location: Location, header: str, width: float = style.DOUBLE) -> Figure:
    """Pings, nodes, ellipses and prior positions."""
    figure, (overview, detail) = style.panel_figure(width, header, 2, height=3.6, stacked=3.0)
    # pings by residual, and nodes
    pings = location.pings[location.solution.used & ~location.survey.between_nodes]
    size = _MICRO * pings["residual_s"]
    limit = float(np.percentile(size.abs(), 95.0)) if len(size) else 1.0
    points = overview.scatter(
        pings["east"],
        pings["north"],
        c=size,
        s=3.0,
        cmap="RdBu_r",
        vmin=-limit,
        vmax=limit,
        linewidths=0.2,
        edgecolors=style.GREY,
    )
    figure.colorbar(points, ax=overview, label="Residual [µs]", location="bottom", shrink=0.8)
    nodes = location.nodes
    _draw_nodes(overview, location)
    overview.set_aspect("equal", adjustable="datalim")
    overview.set_xlabel("East [m]")
    overview.set_ylabel("North [m]")
    style.panel_title(overview, "a", "survey")
    # ellipses and prior positions, relative to the estimates
    colours = style.vehicle_colours(len(nodes))
    largest = max(float(nodes["ellipse_major_m"].max()), 1e-3)
    for colour, row in zip(colours, nodes.to_dict("records"), strict=True):
        corners = ellipse_points(row, _CORNERS)
        north, east = np.vstack([corners, corners[:1]]).T
        detail.plot(east, north, color=colour, label=style.plain(style.short(str(row["name"]), 12)))
        detail.plot(
            row["prior_east"] - row["east"], row["prior_north"] - row["north"], "x", color=colour
        )
    detail.plot(0.0, 0.0, "+", color=style.INK)
    detail.set_xlim(-1.5 * largest, 1.5 * largest)
    detail.set_ylim(-1.5 * largest, 1.5 * largest)
    detail.set_aspect("equal", adjustable="box")
    detail.set_xlabel("East of the estimate [m]")
    detail.set_ylabel("North of the estimate [m]")
    style.panel_title(detail, "b", "95 % ellipses")
    # one legend for both panels
    handles = [*overview.get_legend_handles_labels()[0]]
    handles += detail.get_legend_handles_labels()[0][:_MAX_NODES]
    style.common_legend(figure, handles)
    return figure


def _draw_nodes(axes: Axes, location: Location) -> None:
    """Draw prior, reported and mirrored positions of nodes, with their names."""
    nodes = location.nodes
    axes.plot(
        nodes["prior_east"], nodes["prior_north"], "x", color=style.ORANGE, label="prior position"
    )
    axes.plot(nodes["east"], nodes["north"], "o", color=style.INK, markersize=3.0, label="node")
    if location.mirrors:
        mirrored = location.both_sides.query("solution == 'mirrored'")
        axes.plot(
            mirrored["east"],
            mirrored["north"],
            "o",
            color=style.INK,
            markerfacecolor="none",
            markersize=3.0,
            label="mirrored",
        )
    for row in nodes.to_dict("records"):
        axes.annotate(
            style.plain(str(row["name"])),
            (row["east"], row["north"]),
            xytext=(3, 3),
            textcoords="offset points",
            fontsize=6.5,
        )


@style.styled
def residual_panels(location: Location, header: str, width: float = style.DOUBLE) -> Figure:
    """Residuals against time, azimuth and range."""
    figure, panels = style.panel_figure(width, header, 3, height=2.8, stacked=1.9, sharey=True)
    pings = location.pings[location.solution.used]
    axes_of = (
        ("time_s", 1.0 / 3600.0, "Time [h]"),
        ("azimuth_deg", 1.0, "Azimuth from the node [°]"),
        ("range_m", 1e-3, "Horizontal range [km]"),
    )
    names = location.survey.names
    colours = (
        style.vehicle_colours(len(names)) if len(names) <= _MAX_NODES else [style.BLUE] * len(names)
    )
    for axes, (column, factor, label), letter in zip(panels, axes_of, "abc", strict=True):
        for colour, name in zip(colours, names, strict=True):
            part = pings[pings["node"] == name]
            axes.plot(
                factor * part[column],
                _MICRO * part["residual_s"],
                ".",
                color=colour,
                markersize=2.0,
                label=style.plain(style.short(name, 12)),
            )
        axes.axhline(0.0, color=style.INK, linewidth=0.7)
        axes.set_xlabel(label)
        style.panel_title(axes, letter, "over " + label.split(" [")[0].lower())
    for axes in panels if width == style.COLUMN else panels[:1]:
        axes.set_ylabel("Residual [µs]")
    if len(names) <= _MAX_NODES:
        style.common_legend(figure, panels[0].get_legend_handles_labels()[0])
    return figure


@style.styled
def speed_over_time(location: Location, header: str, width: float = style.DOUBLE) -> Figure:
    """Sound speed against time with its interval."""
    figure, (axes,) = style.panel_figure(width, header, 1, height=2.2, stacked=2.0)
    table = location.sound_speed
    hours = table["time_s"] / 3600.0
    half = 1.96 * table["sigma_m_s"]
    axes.fill_between(
        hours,
        table["change_m_s"] - half,
        table["change_m_s"] + half,
        color=style.PALE,
        label="95 % interval",
    )
    axes.plot(hours, table["change_m_s"], color=style.BLUE, label="estimate")
    axes.axhline(0.0, color=style.INK, linewidth=0.7, linestyle="--", label="profile")
    axes.set_xlabel("Time [h]")
    axes.set_ylabel("Sound speed change [m/s]")
    style.common_legend(figure, axes.get_legend_handles_labels()[0])
    return figure


def write_plan_figure(plan: SurveyPlan, out: Path) -> None:
    """
    Write the figure of a plan, and its table as CSV with the same name.

    Parameters
    ----------
    plan : SurveyPlan
        Plan of a survey.
    out : pathlib.Path
        File with the suffix ``.png`` or ``.pdf``.

    Examples
    --------
    >>> from pathlib import Path
    >>> import numpy as np
    >>> from pymantaray import Medium
    >>> from pymantaray.apps.locate import PlanOptions, plan_survey, write_plan_figure
    >>> water = Medium.from_profile([0.0, 1500.0], [1500.0, 1510.0], bottom_depth=1500.0)
    >>> plan = plan_survey(water, PlanOptions(1300.0), np.array([1000.0]), shapes=("cross",))
    >>> write_plan_figure(plan, Path("plan.png"))
    >>> sorted(path.name for path in Path().glob("plan.*"))
    ['plan.csv', 'plan.png']
    """
    kind = out.suffix.removeprefix(".")
    files = style.rendered(plan_figure(plan), (kind,))
    with whole_file(out) as temporary:
        temporary.write_bytes(files[kind])
    with whole_file(out.with_suffix(".csv")) as temporary:
        plan.table.to_csv(temporary, index=False, lineterminator="\n")


@style.styled
def plan_figure(plan: SurveyPlan) -> Figure:
    """Expected standard deviations over the radius, and the best radius of each pattern."""
    # two panels over the radius
    options = plan.options
    header = (
        f"Node at {options.depth:g} m, pings of {1e3 * options.sigma:g} ms,"
        f" sound speed: {options.speed_model}; dots: least {CRITERIA[options.criterion][1]}"
    )
    figure = style.new_figure(style.COLUMN, 4.6, header)
    panels = figure.subplots(2, 1, sharex=True)
    shapes = list(dict.fromkeys(plan.table["pattern"]))
    best = plan.best.set_index("pattern")
    # a curve for each pattern, with a dot at its best radius
    for axes, column, words, letter in zip(
        panels, ("sigma_horizontal_m", "sigma_depth_m"), ("horizontal", "depth"), "ab", strict=True
    ):
        widths = np.linspace(3.6, 0.9, len(shapes))  # a curve does not hide another on its place
        colours = style.vehicle_colours(len(shapes))
        for colour, shape, width in zip(colours, shapes, widths, strict=True):
            part = plan.table[plan.table["pattern"] == shape]
            axes.plot(
                part["radius_m"] / 1e3,
                part[column],
                color=colour,
                linestyle=_LINE_STYLES[shape],
                linewidth=width,
                label=shape,
            )
            axes.plot(
                best.loc[shape, "radius_m"] / 1e3,
                best.loc[shape, column],
                "o",
                color=colour,
                markersize=4.0,
            )
        # scales and labels
        axes.set_xscale("log")
        axes.set_yscale("log")
        style.short_numbers(axes.xaxis)
        style.short_numbers(axes.yaxis)
        axes.set_ylabel(f"Standard deviation, {words} [m]")
        style.panel_title(axes, letter, words)
    panels[-1].set_xlabel("Radius [km]")
    handles = panels[0].get_legend_handles_labels()[0]
    style.common_legend(figure, handles, loc="outside lower center", ncols=len(handles))
    return figure

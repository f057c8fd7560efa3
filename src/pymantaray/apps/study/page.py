"""
Page of a run, and the data of its interactive figures: the fleet, the links of each ping, and rays.
"""

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.colors import to_hex
from numpy.typing import NDArray

from pymantaray.acoustics.paths import picture_variables
from pymantaray.apps.study.figures.register import RunResults, range_ends
from pymantaray.apps.study.mission import earth_note, medium_of_run
from pymantaray.apps.study.references import MANTARAY
from pymantaray.apps.study.store import Run
from pymantaray.arrays import Array
from pymantaray.evaluation import ALL_LINKS
from pymantaray.geometry.boundary import BoundarySurface
from pymantaray.jobs.run_folder import CONFIG, without_checksums
from pymantaray.pages.page import Card, Explorer, Page, as_json, origin_table
from pymantaray.plotting.style import (
    SOUND_SPEED,
    clock,
    condition_label,
    condition_looks,
    vehicle_colours,
)
from pymantaray.plotting.water import RAY_KINDS
from pymantaray.records import RayStatus, SolveStatus
from pymantaray.records.digits import counted, metres, signed_metres
from pymantaray.records.glossary import GLOSSARY, glossary_lines
from pymantaray.records.result_table import ResultTable
from pymantaray.records.status import SOLVE_STATUS_WORDS

SYNTHETIC_NOTE = (
    "The ocean of this study is synthetic: it is composed of published water masses, not of"
    " measurements or a forecast. The results are valid for such an ocean, not for the real ocean"
    " on a day."
)
_CONDITIONS = {
    "odometry": "noisy odometry, integrated from the first pose",
    "straight": "factor graph of the fleet; ranges are straight distances plus noise",
    "refracted": "same graph, noise and links; ranges are those of a modem: travel time times the"
    " sound speed at the transmitter",
    "straight-all": "straight ranges of all attempts, without dropouts",
    "no-ranges": "the graph without ranges",
}
_MAX_FRAMES = 160  # equally spaced over the mission or the sea bed
_MAX_PINGS = 120
_BED_NODES = 41
# pairs on the page; it shows more than _MAX_PINGS pings if they have fewer pairs in total
_MAX_PAIRS = 10_000
_RANGES = 41  # grid points of a section, and points of each ray
_DEPTHS = 301
_POINTS = 81
# levels on the page, and depth of the last one in depths of the deepest ray
_MAX_LEVELS = 51
_DEPTH_FACTOR = 1.3
_MAX_RAYS = 8  # per link, earliest first
_QUANTILES = np.linspace(0.0, 1.0, 101)


def run_page(results: RunResults, rays: str) -> Page:
    """Page of a run without its figures; ``rays`` is the result of `mission_rays`."""
    run = results.run
    study = run.study
    hours = study.duration / 3600.0
    mission = f"{results.region}: {counted(run.truth.name.size, 'vehicle')}, {hours:g} h"
    if study.solves:
        mission += f", {counted(study.realizations, 'noise realization')}"
    return Page(
        title=study.name,
        facts=[mission],
        description=study.description,
        notes=[*([SYNTHETIC_NOTE] if results.synthetic else []), *warnings_of(results)],
        cards=headlines(results),
        question="What did refraction do?",
        lead="refraction",
        long=True,
        words=_words(results),
        explorer=Explorer("pymantaray.apps.study/run", explorer(results, rays)),
        tables=list(results.tables.values()),
        links={"Configuration": "config.toml"},
        made=_provenance(results),
        origin=[origin_table(without_checksums(run.manifest), "Manifest", "manifest.json")],
        citation=citation_of([results]),
        references=run.manifest.get("references", []),
    )


def _provenance(results: RunResults) -> list[str]:
    """Version, water, seed, time and command of the run, and the command that repeats it."""
    manifest = results.run.manifest
    time = str(results.run.ocean.attrs.get("time", ""))
    version = manifest["versions"].get("pymantaray")
    made = manifest.get("made")
    facts = [f"MantaRay {version}"] if version else []
    facts += [f"water of {time[:16].replace('T', ' ')} UTC"] if time else []
    facts.append(f"seed {results.run.study.seed}")
    if made is not None:  # by a version that says so
        began = f"{made['began'][:16].replace('T', ' ')} UTC"
        facts.append(f"made {began} in {sum(manifest['seconds'].values()):.0f} s")
    lines = [", ".join(facts)]
    if made is not None and made["command"]:
        lines.append(f"Command: {made['command']}")
    return [*lines, "Repeat with: mantaray study run config.toml"]


def _words(results: RunResults) -> list[str]:
    """Conditions of the run and terms of its tables, each with its meaning."""
    tables = results.tables
    causes = tables["dropouts"].frame.set_index("category").loc[ALL_LINKS]
    used = [str(name) for name in causes.index if name in GLOSSARY and causes[name] > 0]
    used += ["reference speed", "bending"]
    if not results.run.study.solves:
        return glossary_lines(used)
    lines = [
        f"{condition_label(name)}: {_CONDITIONS[name]}."
        for name in results.errors
        if name in _CONDITIONS
    ]
    used += ["NEES"] if "consistency" in tables else []
    used += (
        ["lower bound", "efficiency"]
        if tables["ping_error"].frame["bound_rmse_m"].notna().any()
        else []
    )
    return [*lines, *glossary_lines(used)]


def citation_of(runs: Sequence[RunResults]) -> tuple[str, str]:
    """
    Citation of runs, as text and as BibTeX: the program, its versions, and what repeats the runs.
    """
    words = " ".join(
        f"Study {study}, made with MantaRay, {how}." for study, how in map(_made, runs)
    )
    versions = dict.fromkeys(_version(r) for r in runs)
    years = sorted({_began(r)[:4] for r in runs} - {""})
    note = "; ".join(
        f"{how.partition(' on ')[0]}; study {study}" for study, how in map(_made, runs)
    )
    # a page contains no address
    fields = {name: value for name, value in MANTARAY.fields.items() if name != "url"}
    fields |= {"version": ", ".join(versions), "note": note}
    fields |= {"year": years[-1]} if years else {}
    return words, replace(MANTARAY, fields=fields).bibtex


def _version(results: RunResults) -> str:
    return str(results.run.manifest["versions"].get("pymantaray", "unknown"))


def _began(results: RunResults) -> str:
    """Day on which a run began; empty if it does not say so."""
    return str((results.run.manifest.get("made") or {}).get("began", ""))[:10]


def _made(results: RunResults) -> tuple[str, str]:
    """Study with seed and configuration of a run, and version and day of its program."""
    run = results.run
    commit = run.manifest["versions"].get("git_commit")
    digest = run.manifest["files"][CONFIG][:12]
    study = f"{run.study.name}, seed {run.study.seed}, configuration {digest}"
    which = f"version {_version(results)}" + (f", commit {commit[:12]}" if commit else "")
    day = _began(results)
    return f"{study} (SHA-256 of config.toml)", f"{which}{f' on {day}' if day else ''}"


def headlines(results: RunResults) -> list[Card]:
    """
    Cards of a run: first the three that answer what refraction did, to ranges, links and positions.
    """
    tables = results.tables
    drop = _row(tables["dropouts"], category=ALL_LINKS)
    total = _row(tables["range_error"], category=ALL_LINKS)
    bending = _row(tables["range_error_split"], category=ALL_LINKS, part="bending")
    ends = [signed_metres(total[f"p{percent}_m"]) for percent in (1, 99)]
    lost = f"{drop['percent']:.1f} % dropouts" if drop["attempts"] else "no attempts"
    shadow = f"; {drop['shadow']:,} in shadow zones, without a direct ray" if drop["shadow"] else ""
    mean_bending = signed_metres(bending["mean_m"])
    cards = [
        Card(
            "Range error from refraction",
            f"{signed_metres(total['mean_m'])} mean, {metres(total['sd_m'])} sd",
            f"range minus straight distance; 1 % to 99 %: {' to '.join(ends)}",
        ),
        Card("Ranges lost", f"{drop['dropouts']:,} of {drop['attempts']:,}", lost + shadow),
        Card(
            "Mean bending", mean_bending, "the remaining range error is due to the reference speed"
        ),
    ]
    if not results.run.study.solves:
        return cards
    first, *others = [*_difference_cards(tables), *_error_cards(tables)]
    return [*cards[:2], first, *others, cards[2]]


def _difference_cards(tables: Mapping[str, ResultTable]) -> list[Card]:
    """Card of the first difference between conditions, refracted minus straight if both exist."""
    mean = tables["ate_pooled"].frame.set_index("condition")["mean_m"]
    cards = []
    for row in tables["ate_difference"].frame.head(1).to_dict("records"):
        ends = [row[f"bootstrap_{end}_m"] for end in ("low", "high")]
        interval = (
            f"; {' to '.join(map(signed_metres, ends))} (95 %)" if np.isfinite(ends).all() else ""
        )
        names = row["condition"], row["baseline"]
        difference = f"{names[0]} minus {names[1]}".capitalize()
        if names == ("refracted", "straight"):
            difference = "Position error from refraction"
        values = " and ".join(f"{metres(mean[n])} with {condition_label(n).lower()}" for n in names)
        cards.append(
            Card(
                difference,
                signed_metres(row["pooled_difference_m"]),
                f"mean over all poses: {values}{interval}",
            )
        )
    return cards


def _error_cards(tables: Mapping[str, ResultTable]) -> list[Card]:
    """Cards of the position errors of each condition."""
    cards = []
    at_pings = tables["ping_error"].frame.set_index("condition")
    for row in tables["ate_pooled"].frame.to_dict("records"):
        what = f"Position error, {condition_label(row['condition']).lower()}"
        pings = at_pings.loc[row["condition"]].to_dict()
        remark = f"mean; RMSE {_rmse(row)}; RMSE under water at pings {_rmse(pings)}"
        cards.append(Card(what, metres(row["mean_m"]), remark))
    return cards


def _rmse(row: Mapping[Hashable, Any]) -> str:
    """RMSE of a row with its standard error, if it has one."""
    error = row["rmse_standard_error_m"]
    return metres(row["rmse_m"]) + (f" ± {metres(error)}" if np.isfinite(error) else "")


def warnings_of(results: RunResults) -> list[str]:
    """Warnings about unhealthy solves, stopped vehicles and a flat Earth, one line each."""
    none = pd.DataFrame(columns=["condition", "status"])
    solves = results.tables["solves"].frame if "solves" in results.tables else none
    lines = []
    for (condition, status), part in solves[solves["status"] != "OK"].groupby(
        ["condition", "status"]
    ):
        every = int((solves["condition"] == condition).sum())
        words = SOLVE_STATUS_WORDS.get(SolveStatus[str(status)])
        meaning = "" if words is None else f" ({words.meaning}; {words.advice})"
        lines.append(
            f"Condition {condition}: {len(part)} of {every} solves have status {status}{meaning}."
        )
    for name, (stop, time) in results.run.truth.stops.items():
        lines.append(f"Vehicle {name} stopped after {clock(time / 3600.0)}: {stop.name}.")
    lines += results.run.notes
    if note := earth_note(results.run.study, results.run.truth, results.run.ranging_truth):
        lines.append(note)
    return lines


def _row(table: ResultTable, **where: str) -> dict[str, Any]:
    """Row of a table with these values."""
    frame = table.frame
    (row,) = frame[
        np.logical_and.reduce([frame[key] == value for key, value in where.items()])
    ].to_dict("records")
    return {str(key): value for key, value in row.items()}


WORST_LINKS, ALL_LINKS_LIMIT = 50, 700
"""
Number of links with the largest range errors whose rays are on the page; number of links up to
which all of them are.
"""
_WATER = [[x, to_hex(SOUND_SPEED(x))] for x in np.linspace(0.0, 1.0, 9).tolist()]
_KINDS = [
    {"name": name, "colour": look["color"], "dash": dash}
    for (name, look), dash in zip(RAY_KINDS, ("solid", "dash", "dashdot", "dot"), strict=True)
]


def explorer(results: RunResults, rays: str) -> str:
    """
    Return all data of the page's script as JSON that is safe in HTML; ``rays`` is the result of
    `mission_rays`.
    """
    run = results.run
    pings = _shown_pings(results.run)
    content = {
        "fleet": _fleet(run, pings) | {"first": _first_vehicle(results)},
        "links": PageLinks(results, pings).rows(),
        "statuses": [status.name for status in RayStatus],
        "errors": _errors(results),
        "nees": _nees(results),
        "water": _WATER,
        "kinds": _KINDS,
        "pings": np.unique(run.measurements.range_sample).size,
        "command": rays_command(run),
    }
    return f'{as_json(content)[:-1]},"rays":{rays}}}'


def mission_rays(results: RunResults) -> str:
    """Return sections with rays of some links as JSON; they do not depend on the realizations."""
    return as_json(list(_rays(results.run, PageLinks(results, _shown_pings(results.run)))))


def rays_command(run: Run) -> str:
    """
    Command for the run's folder that draws the rays of a link, without the options of its ends.
    """
    search = run.study.sound.options
    limit = search.spreading_cutoff_db
    cutoff = "none" if limit is None else f"{limit:g}"
    bounces = (
        f"--max-surface-bounces {search.max_surface_bounces}"
        f" --max-bottom-bounces {search.max_bottom_bounces}"
    )
    return f"mantaray rays plot link.png --run . {bounces} --cutoff-db {cutoff}"


def _shown_pings(run: Run) -> NDArray[np.int64]:
    pings, attempts = np.unique(run.measurements.range_sample, return_counts=True)
    return _evenly(pings, max(_MAX_PINGS, _MAX_PAIRS // int(attempts.max(initial=1))))


class PageLinks:
    """
    Links between unordered pairs at the pings of the page, with the range errors in both
    directions.
    """

    def __init__(self, results: RunResults, pings: NDArray[np.int64]) -> None:
        m = results.run.measurements
        truth = results.run.ranging_truth
        shown = np.flatnonzero(np.isin(m.range_sample, pings))
        first = np.minimum(m.range_transmitter, m.range_receiver)[shown]
        second = np.maximum(m.range_transmitter, m.range_receiver)[shown]
        keys = np.stack([m.range_sample[shown], first, second], axis=1)
        pairs, row = np.unique(keys, axis=0, return_inverse=True)
        self.sample, self.first, self.second = pairs.T
        self.ping = np.searchsorted(pings, self.sample)
        self._attempt = np.full((len(pairs), 2), -1)
        self._attempt[row.ravel(), (m.range_transmitter[shown] != first).astype(int)] = shown
        some = self._attempt.max(axis=1)
        self.status = m.range_status[some]
        self.distance = truth.distance[some]
        source, receiver = range_ends(results.run.truth, m)
        turned = (m.range_transmitter != np.minimum(m.range_transmitter, m.range_receiver))[some]
        self.source = np.where(turned[:, None], receiver[some], source[some])
        self.receiver = np.where(turned[:, None], source[some], receiver[some])
        self._errors = results.ranges

    def _each_way(self, values: Array) -> Array:
        return np.where(self._attempt >= 0, values[self._attempt], np.nan)

    def rows(self) -> dict[str, Any]:
        """Columns of all links, one row per link."""
        errors = self._errors
        return {
            "ping": self.ping,
            "first": self.first,
            "second": self.second,
            "status": self.status,
            "distance": _rounded(self.distance, 1),
            "depth": _rounded(np.maximum(self.source[:, 2], self.receiver[:, 2]), 1),
            "error": _rounded(self._each_way(errors.total), 3),
            "reference": _rounded(self._each_way(errors.reference_speed), 3),
            "bending": _rounded(self._each_way(errors.bending), 3),
        }

    def with_rays(self) -> NDArray[np.int64]:
        """
        Links whose rays are on the page: all if there are few, else those of the ping with most
        arrivals and those with the largest errors.
        """
        apart = np.linalg.norm((self.receiver - self.source)[:, :2], axis=1) > 0.0
        drawable = apart & (self.status != RayStatus.STOPPED)
        if drawable.sum() <= ALL_LINKS_LIMIT:
            return np.flatnonzero(drawable)
        total = self._each_way(self._errors.total)
        worst = np.where(
            np.isfinite(total).any(axis=1), np.nanmax(np.abs(np.nan_to_num(total)), axis=1), -1.0
        )
        received = np.bincount(self.ping[self.status == RayStatus.OK], minlength=1)
        chosen = int(np.argmax(received))
        order = np.argsort(-worst, kind="stable")[:WORST_LINKS]
        links = np.union1d(np.flatnonzero(self.ping == chosen), order[worst[order] >= 0.0])
        return np.asarray(links[drawable[links]])


def _first_vehicle(results: RunResults) -> int:
    """First vehicle with GNSS fixes at fewer than half of its poses, otherwise that with fewest."""
    share = results.fixes.mean(axis=1)
    return int(np.argmax(share < 0.5)) if (share < 0.5).any() else int(np.argmin(share))


def _fleet(run: Run, pings: NDArray[np.int64]) -> dict[str, Any]:
    truth = run.truth
    ocean = run.ocean
    samples = np.union1d(_evenly(np.arange(truth.time.size), _MAX_FRAMES), pings)
    reach = np.nanmax(np.abs(truth.position[..., :2]), initial=1e3) * 1.15
    # a finer sea floor has axes of its own
    bed = BoundarySurface.from_dataset(ocean, "sea_floor_depth")
    axes = (ocean[name].to_numpy() for name in ("north", "east"))
    north, east = (
        np.linspace(max(float(axis[0]), -reach), min(float(axis[-1]), reach), _BED_NODES)
        for axis in axes
    )
    nodes = np.stack(np.meshgrid(north, east, indexing="ij"), axis=-1).reshape(-1, 2)
    return {
        "names": [*truth.name.tolist(), *run.measurements.landmark_name.tolist()],
        "vehicles": truth.name.size,
        "colours": vehicle_colours(truth.name.size),
        "hour": _rounded(truth.time[samples] / 3600.0, 6),
        "ping": np.searchsorted(samples, pings),
        "north": _rounded(truth.position[:, samples, 0], 1),
        "east": _rounded(truth.position[:, samples, 1], 1),
        "down": _rounded(truth.position[:, samples, 2], 1),
        "landmarks": _rounded(run.measurements.landmark_position, 1),
        "bed": {
            "north": _rounded(north, 0),
            "east": _rounded(east, 0),
            "down": _rounded(bed.depth_at(nodes).reshape(north.size, east.size), 0),
        },
    }


def _rays(run: Run, ends: PageLinks) -> Iterator[dict[str, Any]]:
    """
    Sections with rays in the water at each ping; none if this water is not available any more, no
    reflections at rough ice.
    """
    water = medium_of_run(run) if ends.sample.size else None
    if water is None:
        return
    search = run.study.sound.options
    links = ends.with_rays()  # in the order of their pings
    for several in np.split(links, np.flatnonzero(np.diff(ends.sample[links])) + 1):
        if not several.size:
            continue
        medium = water(float(run.truth.time[ends.sample[several[0]]]))
        pictures = picture_variables(
            medium,
            ends.source[several],
            ends.receiver[several],
            shape=(_RANGES, _DEPTHS, _POINTS),
            bounces=(
                search.max_surface_bounces if medium.surface.roughness is None else 0,
                search.max_bottom_bounces,
            ),
            spreading_cutoff_db=search.spreading_cutoff_db,
        )
        for link, (variables, _) in zip(several.tolist(), pictures, strict=True):
            values = {name: value for name, (_, value, *_) in variables.items()}
            yield {"link": link, **_shown(values)}


def _shown(values: dict[str, Array]) -> dict[str, Any]:
    """Section along one link with its earliest rays, to somewhat below the deepest of them."""
    rays = {name: column[:_MAX_RAYS] for name, column in values.items() if name.startswith("ray_")}
    chord = values["chord_depth"]
    depth = values["depth"]
    lowest = float(np.nanmax(rays["ray_depth"], initial=chord.max()))
    shown = int(np.clip(np.searchsorted(depth, _DEPTH_FACTOR * lowest + 20.0), 2, depth.size))
    levels = _evenly(np.arange(shown), _MAX_LEVELS)
    return {
        "range": _rounded(values["range"], 0),
        "depth": _rounded(depth[levels], 1),
        "speed": _rounded(values["sound_speed"].T[levels], 1),
        "bed": _rounded(values["sea_floor_depth"], 0),
        "ray_range": _rounded(rays["ray_range"], 0),
        "ray_depth": _rounded(rays["ray_depth"], 1),
        "time": _rounded(rays["ray_travel_time"], 7),
        "chord": _rounded(values["chord_travel_time"], 7),
        "surface": rays["ray_surface_bounces"],
        "bottom": rays["ray_bottom_bounces"],
        "spreading": _rounded(rays["ray_spreading"], 1),
        "ends": _rounded(chord, 1),
    }


def _errors(results: RunResults) -> dict[str, Any]:
    """
    Position errors by condition: RMS of each vehicle over time, quantiles over all vehicles, and
    standard deviations.
    """
    run = results.run
    samples = _evenly(np.arange(run.truth.time.size), _MAX_FRAMES)
    conditions = []
    looks = condition_looks(list(results.errors))
    for c, (name, error) in enumerate(results.errors.items()):
        usable = error[np.isfinite(error)]
        entry: dict[str, Any] = {
            "name": name,
            "label": condition_label(name),
            "colour": looks[name][0],
            "dash": "dash" if name == "refracted" else "solid",  # lines below it stay visible
            "rms": _rounded(_rms(error[..., samples]), 2),
            "quantiles": _rounded(np.quantile(usable, _QUANTILES), 2) if usable.size else [],
        }
        conditions.append(entry | _sigma(run, c))
    return {"hour": _rounded(run.truth.time[samples] / 3600.0, 4), "conditions": conditions}


def _sigma(run: Run, condition: int) -> dict[str, Any]:
    """
    Three standard deviations of the position error by the covariances of the solves, root mean
    square over realizations.
    """
    covariances = run.covariances
    if covariances is None:
        return {}
    variance = np.einsum("reaiai->rea", covariances.position_covariance[condition])
    with np.errstate(invalid="ignore"):
        sigma = (
            np.sqrt(np.nanmean(variance, axis=0))
            if np.isfinite(variance).any()
            else np.full(variance.shape[1:], np.nan)
        )
    return {
        "sigma_hour": _rounded(covariances.time / 3600.0, 4),
        "sigma3": _rounded(3.0 * sigma.T, 2),
    }


def _nees(results: RunResults) -> list[Mapping[str, Any]]:
    if "consistency_per_epoch" not in results.tables:
        return []
    table = results.tables["consistency_per_epoch"].frame
    part = table[table["statistic"] == "horizontal"]
    columns = ["condition", "time_h", "ratio", "low", "high"]
    return [
        {str(k): v for k, v in row.items()} for row in part[columns].round(4).to_dict("records")
    ]


def _rms(error: Array) -> Array:
    """Root mean square over realizations, shape (vehicles, times)."""
    usable = np.isfinite(error)
    total = np.where(usable, error, 0.0) ** 2
    count = usable.sum(axis=0)
    mean: Array = np.divide(
        total.sum(axis=0), count, out=np.full(count.shape, np.nan), where=count > 0
    )
    return np.asarray(np.sqrt(mean))


def _evenly(values: NDArray[Any], most: int) -> NDArray[Any]:
    """Values at equal spacing, at most ``most``, including the first and the last."""
    if len(values) <= most:
        return values
    return np.asarray(values[np.unique(np.linspace(0, len(values) - 1, most).round().astype(int))])


def _rounded(values: Any, digits: int) -> Array:
    return np.round(np.asarray(values, dtype=float), digits)

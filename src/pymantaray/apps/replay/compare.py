"""Measured and predicted travel times of events, and tables of their differences."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import cast

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymantaray.acoustics.selection import NEAR_DB
from pymantaray.apps.replay.baselines import baseline_table, horizon_table
from pymantaray.apps.replay.clocks import (
    find_gross_errors,
    gross_note,
    known_clocks,
    reciprocity_table,
    unknown_clocks_note,
)
from pymantaray.apps.replay.consistency import ClockFit, fit_clocks_and_nodes, node_note
from pymantaray.apps.replay.draws import (
    bounce_hint,
    choice_of,
    predict_draws,
    with_median_candidate,
)
from pymantaray.apps.replay.events import Events
from pymantaray.apps.replay.learned_mixture import learn_mixture
from pymantaray.apps.replay.mixture import coverage_table, predict_mixture
from pymantaray.apps.replay.options import DEFAULT_OPTIONS, PredictionOptions
from pymantaray.apps.replay.rules import DEFAULT_RULE, DetectionRule, predicted_columns
from pymantaray.apps.replay.summary import quantile_of, summary_table
from pymantaray.apps.replay.switching import switching_table
from pymantaray.apps.replay.water import choose_water, ends_of, instants_in, water_of_echoes
from pymantaray.arrays import Array
from pymantaray.config.door.water import Source, open_waters
from pymantaray.errors import ReplayError
from pymantaray.evaluation import unexplained
from pymantaray.geometry.sphere import flat_earth_note
from pymantaray.jobs.progress import CountProgress
from pymantaray.records import RayStatus
from pymantaray.records.result_table import ResultTable, notebook_html
from pymantaray.sensing import Detector, find_receptions
from pymantaray.sensing.water import Water

_MAX_NAMES = 12  # in a message
SEED = 20140715
"""Default seed, that of studies."""
CAPTIONS = {
    "summary": "Coverage and residuals of groups of events. Intervals (95 %) resample pairs, not"
    " events; a single pair has none",
    "clocks": "Clock offset of each node by least squares, positive if ahead; the mean of each"
    " connected group is 0 unless a reference is given. Standard errors of"
    " independent events, or of errors that the events of a pair share if these are larger",
    "reciprocity": "Residuals of one direction less those of the other near in time, the part due"
    " to clocks, and the rest",
    "baselines": "The prediction beside two without an ocean, learned from the other pairs, and"
    " the last measured time of the same source and receiver. Over all events, a missing prediction"
    " counts as an infinite error; clocks are not corrected",
    "horizons": "Sizes of the errors by the time since the last event of the same source and"
    " receiver, beside those of its measured time times the change of the distance. A missing"
    " prediction counts as an infinite error; no draw has the arrivals that are not modelled",
    "nodes": "Offset of each node from its stated position that the ranges of its pairs suggest,"
    " and the scatter of ranges due to it",
    "positions": "Smoothed positions: assumed error of a reading, estimated random walk and drift,"
    " and changes of the positions",
    "coverage": "Residuals and coverage of the predictions. Even hours determine the error that"
    " nothing else explains; odd hours test it. Sizes count events without a prediction as"
    " infinite",
    "draws": "Sizes of the residuals of all events without learning, and their standard errors due"
    " to the draws: a jackknife that leaves out each group of draws once",
    "learned": "Errors of water, positions, pairs and clocks after the last event. The relative"
    " error of a sound speed is a sum of several, see learned_water",
    "learned_water": "Relative error of the sound speed for each pair of depths at the end of each"
    " hour",
    "error_sizes": "Standard deviations and time scales with the largest posterior density, and the"
    " probability that there are no slow errors (no_error)",
    "followed": "Arrivals that are followed by earlier measured times of their source and receiver,"
    " before the event is measured; events are numbered from 1",
    "candidates": "Arrivals that a receiver could have taken; events are numbered from 1",
    "switching": "How often a receiver changes its candidate from one event to the next, and how"
    " often independent picks would",
}
_LEARNED_COVERAGE = (
    "Residuals and coverage of the predictions, each without its own event: from earlier events, or"
    " with smooth learning from all others. Sizes count events without a prediction as infinite"
)
_BRIEF = {
    "summary": [
        "group",
        "events",
        "percent",
        "median_m",
        "median_size_m",
        "median_size_low_m",
        "median_size_high_m",
    ]
}
_HEADS = {
    "percent": "predicted [%]",
    "q90_size_m": "90 % of sizes below [m]",
    "within_1_sigma": "within 1 sigma [%]",
    "within_2_sigma": "within 2 sigma [%]",
    "within_95": "in 95 % interval [%]",
    "within_95_low": "from [%]",
    "within_95_high": "to [%]",
    "last_median_m": "last measured time: median size [m]",
    "last_q90_m": "last measured time: 90 % below [m]",
    "not_modelled": "not modelled [%]",
    "pair_m": "constant per pair [m]",
    "varying_m": "varying [m]",
}


@dataclass(frozen=True, eq=False)
class Replay:
    """
    Measured events with their predictions, and tables of the residuals.

    Parameters
    ----------
    events : pandas.DataFrame
        One row per event, see `replay_events`.
    rule : DetectionRule
    window : float
        Maximum time between paired events, for reciprocity and switching. [s]
    seed : int
        Seed of the bootstrap.
    candidates : pandas.DataFrame
        Every arrival that a receiver could have taken: event, travel time and loss.
    reference : str, optional
        Node with the reference clock; by default the mean of each group of connected nodes.
    notes : tuple of str
        Reservations about the water, for reports.
    clock_drift : bool
        True to fit a constant rate of each clock.
    positions : pandas.DataFrame, optional
        Nodes whose positions were smoothed, from `smooth_positions`.
    more : dict of pandas.DataFrame
        Further tables by name, which follow the others on the page and in files; their captions are
        in ``CAPTIONS``.
    """

    events: pd.DataFrame
    rule: DetectionRule
    window: float
    seed: int
    candidates: pd.DataFrame = field(repr=False)
    reference: str | None = None
    notes: tuple[str, ...] = ()
    clock_drift: bool = False
    positions: pd.DataFrame | None = None
    more: dict[str, pd.DataFrame] = field(default_factory=dict)

    def _repr_html_(self) -> str:
        """Notebook view: status counts, and residuals of all events and by depth and range."""
        counts = {str(name): n for name, n in self.events["status"].value_counts().items()}
        title = f"Replay of {len(self.events)} events by rule {self.rule}"
        return notebook_html(title, counts, [self.brief_summary])

    @cached_property
    def summary(self) -> pd.DataFrame:
        """Coverage and residuals of all events and by pair, depths and range."""
        return summary_table(self.events, seed=self.seed)

    @cached_property
    def _fit(self) -> ClockFit:
        events = self.events
        candidates = self.candidates
        if "learned_clock_s" in events:  # the fit estimates the clocks itself
            clock = events["learned_clock_s"]
            at = candidates["event"].to_numpy(dtype=np.int64)
            predicted = events["modelled_s"] - clock
            events = events.assign(
                predicted_s=predicted, residual_s=events["measured_s"] - predicted
            )
            time = candidates["travel_time_s"] - clock.to_numpy()[at]
            candidates = candidates.assign(travel_time_s=time)
        return fit_clocks_and_nodes(
            events, candidates, reference=self.reference, drift=self.clock_drift
        )

    @property
    def clocks(self) -> pd.DataFrame:
        """Offset of each node's clock with two standard errors; NaN if it cannot be known."""
        return known_clocks(self.events, self._fit.clocks, reference=self.reference)

    @property
    def taken(self) -> pd.DataFrame:
        """Candidate nearest to each event after the clock correction; NaN without a candidate."""
        return self._fit.taken

    @property
    def nodes(self) -> pd.DataFrame:
        """Horizontal offset of each node that the ranges of its pairs suggest."""
        return self._fit.nodes

    @cached_property
    def baselines(self) -> pd.DataFrame:
        """Errors of predictions without an ocean beside those of the prediction."""
        return baseline_table(self.events)

    @property
    def findings(self) -> tuple[str, ...]:
        """Sentences about gross errors, unknown clocks and inconsistent positions."""
        why = self.unexplained
        sentences = (
            f"The water and the positions do not explain the travel times: {why}." if why else None,
            gross_note(self.events),
            unknown_clocks_note(self.clocks),
            node_note(self.nodes),
        )
        return tuple(text for text in sentences if text)

    @property
    def unexplained(self) -> str | None:
        """
        Reason why the predictions do not explain the measured times; None if they do.

        The residuals are those of the nearest candidates after the correction of clocks. The limits
        are those of `pymantaray.evaluation.unexplained`.
        """
        sigma = self.events["sigma_s"].to_numpy()
        if "prediction_sigma_s" in self.events:
            sigma = np.hypot(sigma, self.events["prediction_sigma_s"].to_numpy())
        # a gross error has no clock correction
        taken = self.taken["taken_residual_s"]
        residual = taken.where(taken.notna(), self.events["residual_s"])
        return unexplained(residual, self.events["measured_s"], sigma)

    @cached_property
    def reciprocity(self) -> pd.DataFrame:
        """Difference of residuals between paired events in opposite directions, for each pair."""
        return reciprocity_table(
            self.events, self.taken["taken_time_s"], self._fit.clocks, window=self.window
        )

    @cached_property
    def switching(self) -> pd.DataFrame:
        """
        Rate at which receivers change between candidates, and the rate of independent choices.
        """
        return switching_table(self.events, self.taken, window=self.window, seed=self.seed)

    @property
    def tables(self) -> dict[str, ResultTable]:
        """All tables by name, in the order of the page."""
        frames = {
            "summary": self.summary,
            "clocks": self.clocks,
            "reciprocity": self.reciprocity,
            "switching": self.switching,
            "baselines": self.baselines,
            "horizons": horizon_table(self.events),
            "nodes": self.nodes,
            **({} if self.positions is None else {"positions": self.positions}),
            **self.more,
            "candidates": self.candidates.assign(event=self.candidates["event"] + 1),
            "events": pd.concat([self.events, self.taken], axis=1),
        }
        captions = CAPTIONS | ({"coverage": _LEARNED_COVERAGE} if "learned" in self.more else {})
        return {
            name: ResultTable(
                name, frame, captions.get(name, ""), brief=_BRIEF.get(name, ()), words=_HEADS
            )
            for name, frame in frames.items()
        }

    @property
    def brief_summary(self) -> ResultTable:
        """Summary of all events and by depths and range, for the terminal and for notebooks."""
        table = self.tables["summary"].short()
        return replace(table, frame=table.frame[table.frame["by"] != "pair"])


def replay_events(
    events: Events,
    waters: Water | Source | Sequence[Water],
    rule: DetectionRule | str = DEFAULT_RULE,
    *,
    options: PredictionOptions = DEFAULT_OPTIONS,
    window: float = 60.0,
    reference: str | None = None,
    seed: int = SEED,
    progress: CountProgress | None = None,
) -> Replay:
    r"""
    Predict the travel time of every event and compare it with the measured one.

    Parameters
    ----------
    events : Events
    waters : Water, sequence of Water, or source of `open_waters`
        Water of the events. If there are several, an event uses the one that it names, else the
        nearest in time.
    rule : DetectionRule or str
        Rule that predicts the detected arrival. Fix it before you look at residuals.
    options : PredictionOptions
        Draws of rough ice and errors of predictions.
    window : float
        Maximum time between paired events, for reciprocity and switching. [s]
    reference : str, optional
        Node with the reference clock. By default the mean of all clocks.
    seed : int
        Seed of the bootstrap over pairs.
    progress : callable, optional
        Called with the number of finished events and the total.

    Returns
    -------
    Replay
        Its ``events`` has one row per event: ``status``, ``n_arrivals`` within the cut-off,
        ``predicted_s``, bounces, ``loss_db`` re 1 m (of spreading alone without a detector),
        ``level_db`` at the receiver with one, ``next_s`` and ``next_db`` (how much later and louder
        the next candidate is), ``near_limit`` (a limit 1 dB higher or lower changes the pick),
        ``residual_s`` (measured minus predicted) and ``residual_m`` (times the sound speed at the
        source). An event without a predicted arrival keeps its row, with a status that gives the
        reason. With draws or the rule ``persist``, it also has ``prediction_sigma_s``, ``low_s``
        and ``high_s`` (95 %) and ``log_likelihood``, as from `predict_mixture`. With
        learning, the predicted time contains ``learned_water_s``, ``learned_position_s``,
        ``learned_pair_s`` and ``learned_clock_s``, as from `learn_mixture`; ``modelled_s`` is the
        time of the nearest candidate, and ``not_modelled`` is true if the prediction is a followed
        arrival that no candidate explains. An echo has a distance of 0.

    Raises
    ------
    ReplayError
        If an event names an unknown cast, no cast can be assigned, the rule needs a sonar and there
        is none, or the window is negative.

    Examples
    --------
    Continues the example of `pymantaray.apps.replay`:

    >>> from pymantaray.apps.replay import replay_events
    >>> replay = replay_events(events, water)
    >>> replay.events["status"].tolist()
    ['ok', 'ok', 'ok', 'ok', 'ok', 'ok']
    """
    # rule and waters must suit the events
    rule = checked_rule(events, rule, options, window, reference)
    waters = _waters(waters)
    if rule.kind == "threshold" and any(water.reception.detector is None for water in waters):
        raise ReplayError(
            "rule threshold: it needs a sonar; give a section [detection], or use another rule"
        )
    # predictions, water by water
    has_mixture = options.draws > 1 or rule.kind == "persist"
    parts = []
    done = 0
    for water, time, rows in _parts(events, waters, options.water_interval):

        def tell(part: int, parts: int, done: int = done, here: int = rows.size) -> None:
            if progress is not None:
                progress(done + part * here // max(parts, 1), events.time.size)

        if has_mixture:
            parts.append(
                predict_draws(events, rows, water.at(time), water, rule, options.draws, tell)
            )
        else:
            parts.append([_predict(events, rows, water, time, rule, tell)])
        done += rows.size
    # one table of all waters, with the mixture of all draws
    all_draws, *of_groups = (
        _joined(events, predictions) for predictions in zip(*parts, strict=True)
    )
    table, all_candidates = all_draws
    more: dict[str, pd.DataFrame] = {}
    if has_mixture:
        detector = waters[0].reception.detector
        table, all_candidates, more = _with_mixture(table, all_candidates, rule, options, detector)
        if of_groups:
            unlearned = replace(options, learn=None)
            unexplained = None if options.learn else float(table["unexplained_s"].iloc[0])
            more["draws"] = _draws_table(
                [all_draws, *of_groups], rule, unlearned, detector, unexplained
            )
    # residuals and what they show
    table = _with_residuals(table)
    if has_mixture:
        more = {"coverage": coverage_table(table, seed=seed), **more}
    table["gross"] = find_gross_errors(table, all_candidates)
    hint = bounce_hint(events, waters, table["predicted_s"].notna().to_numpy())
    earth = _earth_note(events, waters, table["distance_m"].to_numpy())
    notes = hint if earth is None else (*hint, earth)
    return Replay(table, rule, window, seed, all_candidates, reference, notes, more=more)


def checked_rule(
    events: Events,
    rule: DetectionRule | str,
    options: PredictionOptions,
    window: float,
    reference: str | None,
) -> DetectionRule:
    """
    Rule of `replay_events`, whose other arguments are checked, too, before any water is opened.

    Errors are learned with the rule ``persist``, which then also replaces the default rule.
    """
    rule = DetectionRule.parse(rule) if isinstance(rule, str) else rule
    if not window >= 0.0:
        raise ReplayError(f"window is {window:g} s; allowed are 0 s and more")
    nodes = set(events.source) | set(events.receiver)
    if reference is not None and reference not in nodes:
        raise ReplayError(
            f"reference {reference!r}: no such node; allowed are"
            f" {', '.join(sorted(nodes)[:_MAX_NAMES])}"
        )
    if options.learn is None or rule.kind == "persist":
        return rule
    if str(rule) != DEFAULT_RULE:
        raise ReplayError(f"rule {rule}: learning needs the rule persist, or persist:MINUTES")
    return DetectionRule.parse("persist")


def _joined(
    events: Events, predictions: Sequence[tuple[pd.DataFrame, pd.DataFrame]]
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Events with their predictions in all waters, and all candidates by event and time."""
    frames, candidates = zip(*predictions, strict=True)
    table = pd.concat([_event_columns(events), pd.concat(frames).sort_index()], axis=1)
    table.loc[events.is_echo, ["distance_m", "chord_s"]] = 0.0
    all_candidates = pd.concat(candidates, ignore_index=True)
    return table, all_candidates.sort_values(["event", "travel_time_s"], ignore_index=True)


def _with_residuals(table: pd.DataFrame) -> pd.DataFrame:
    """Events with their residuals in seconds and in metres."""
    residual = table["measured_s"] - table["predicted_s"]
    return table.drop(columns="sound_speed_m_s").assign(
        residual_s=residual, residual_m=residual * table["sound_speed_m_s"]
    )


def _draws_table(
    predictions: Sequence[tuple[pd.DataFrame, pd.DataFrame]],
    rule: DetectionRule,
    options: PredictionOptions,
    detector: Detector | None,
    unexplained: float | None,
) -> pd.DataFrame:
    """
    Sizes of the residuals of all draws, and their standard errors due to the draws.

    The predictions are those of all draws, then those without each group. All have the same
    unexplained error [s], by default that of all draws, because its estimate takes most of the
    time.
    """
    sizes = []
    for prediction in predictions:
        table, *_ = _with_mixture(*prediction, rule, options, detector, unexplained)
        unexplained = float(table["unexplained_s"].iloc[0])
        size = _with_residuals(table)["residual_m"].abs().fillna(np.inf).to_numpy()
        sizes.append([quantile_of(size, 0.5), quantile_of(size, 0.9)])
    (median, q90), *without = sizes
    median_error, q90_error = jackknife_error(np.array(without))
    row = {
        "draws": options.draws,
        "groups": len(without),
        "median_size_m": median,
        "median_error_m": median_error,
        "q90_size_m": q90,
        "q90_error_m": q90_error,
    }
    return pd.DataFrame([row])


def jackknife_error(without: Array) -> Array:
    """
    Standard error of statistics from their values without each group of draws (groups, statistics).

    NaN if a value is infinite, as for a quantile among events without a prediction.
    """
    groups = len(without)
    with np.errstate(invalid="ignore"):
        deviation = without - without.mean(axis=0)
    return np.asarray(np.sqrt((groups - 1) / groups * np.sum(deviation**2, axis=0)))


def _earth_note(events: Events, waters: Sequence[Water], distance: Array) -> str | None:
    """Sentence about the error of a flat Earth, None if it is small or the Earth is a sphere."""
    flat = [water for water in waters if water.at_start[0].earth is None]
    if not flat or not events.geographic:
        return None
    all_rows = np.arange(events.time.size)
    with_frame = [water for water in flat if water.frame is not None and not water.uniform]
    nodes = [end[:, :2] for water in with_frame for end in ends_of(events, all_rows, water)]
    farthest = max((float(np.hypot(*node.T).max()) for node in nodes), default=0.0)
    return flat_earth_note(float(distance.max()), farthest)


def _with_mixture(
    table: pd.DataFrame,
    candidates: pd.DataFrame,
    rule: DetectionRule,
    options: PredictionOptions,
    detector: Detector | None,
    unexplained: float | None = None,
) -> tuple[pd.DataFrame, pd.DataFrame, dict[str, pd.DataFrame]]:
    """
    Events with the error of each prediction, candidates with their probabilities, and tables of
    what was learned.

    The rule ``persist`` takes the median candidate. The unexplained error [s] is estimated if it is
    None or if errors are learned.
    """
    merit = None if detector is None else detector.sonar.figure_of_merit_db
    persistence = 60.0 * rule.persist_min
    more, followed = {}, None
    if options.learn:
        mixture, learned, followed = learn_mixture(
            table, candidates, options, persistence=persistence, merit_db=merit
        )
        parts = mixture.events.filter(regex="^learned_")
        at = candidates["event"].to_numpy(dtype=np.int64)
        correction = parts.sum(axis=1).to_numpy()[at]
        candidates = candidates.assign(travel_time_s=candidates["travel_time_s"] + correction)
        table = table.assign(**{str(name): column for name, column in parts.items()})
        sizes = asdict(learned.sizes) | {"no_error": learned.no_error_after}
        size_table = pd.DataFrame({"name": list(sizes), "value": list(sizes.values())})
        more = {
            "learned": learned.states,
            "learned_water": learned.history,
            "error_sizes": size_table,
            "followed": followed.assign(event=followed["event"] + 1),
        }
    else:
        mixture = predict_mixture(
            table,
            candidates,
            options,
            persistence=persistence,
            merit_db=merit,
            unexplained=unexplained,
        )
    all_candidates = candidates.assign(sigma_s=mixture.sigma, probability=mixture.probability)
    if rule.kind == "persist":
        median = mixture.events["mixture_s"].to_numpy()
        table = with_median_candidate(table, all_candidates, median, followed)
    bias = table["predicted_s"].to_numpy() - mixture.events["mixture_s"].to_numpy()
    sigma = np.hypot(mixture.events["sigma_s"].to_numpy(), bias)
    table = table.assign(
        prediction_sigma_s=sigma,
        **{name: mixture.events[name] for name in ("low_s", "high_s", "log_likelihood")},
        unexplained_s=mixture.unexplained,
    )
    return table, all_candidates, more


def _waters(waters: Water | Source | Sequence[Water]) -> list[Water]:
    """Waters as a list; a source is opened."""
    if isinstance(waters, Water):
        return [waters]
    if isinstance(waters, Sequence) and not isinstance(waters, str):
        opened = [water for water in waters if isinstance(water, Water)]
        if len(opened) == len(waters):
            return opened
    return open_waters(cast("Source", waters))


def _parts(
    events: Events, waters: list[Water], interval: float
) -> Iterator[tuple[Water, float, NDArray[np.int64]]]:
    """Groups of events with the same water at the same time [s]."""
    which = choose_water(events, waters)
    for index in np.unique(which).tolist():
        rows = np.flatnonzero(which == index)
        times = instants_in(events, rows, waters[index], interval)
        for time in np.unique(times):
            here = rows[times == time]
            is_echo = events.is_echo[here]
            if not is_echo.all():
                yield waters[index], float(time), here[~is_echo]
            if is_echo.any():
                yield water_of_echoes(waters[index], float(time)), float(time), here[is_echo]


def _event_columns(events: Events) -> pd.DataFrame:
    has_dates = not np.isnat(events.epoch)
    return pd.DataFrame(
        {
            "time": events.instant if has_dates else events.time,
            "time_s": events.time,
            "source": events.source,
            "receiver": events.receiver,
            "pair": events.pair,
            "source_depth_m": events.source_position[:, 2],
            "receiver_depth_m": events.receiver_position[:, 2],
            "measured_s": events.travel_time,
            "sigma_s": events.sigma,
            **({} if np.isnan(events.level_db).all() else {"measured_level_db": events.level_db}),
        }
    )


def _predict(
    events: Events,
    rows: NDArray[np.int64],
    water: Water,
    time: float,
    rule: DetectionRule,
    progress: CountProgress,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Prediction of some events in one water at a time, and all candidates of each."""
    reception = water.reception
    medium, currents = water.at(time)
    source, receiver = ends_of(events, rows, water, medium.earth)
    step = receiver - source
    # receptions, also those a little below the cut-off
    cutoff = reception.spreading_cutoff_db
    wide = reception._replace(
        arrival="first", spreading_cutoff_db=None if cutoff is None else cutoff + NEAR_DB
    )
    sound = find_receptions(source, receiver, medium, wide, currents=currents, progress=progress)
    distance = medium.straight_distance(source, receiver)
    # candidates, the pick and the next one
    choice = choice_of(sound, distance, np.inf if cutoff is None else cutoff, reception.detector)
    receptions = choice.receptions
    candidates = choice.candidates(rule)
    picks = choice.pick(rule, candidates)
    after = choice.next(rule, candidates, picks)
    rays = np.where((picks >= 0) & (np.append(receptions.arrival, -1)[picks] >= 0), picks, -1)
    # an event without a pick states the reason
    n_arrivals = np.bincount(receptions.link[choice.within_cutoff()], minlength=rows.size)
    missing = np.where(n_arrivals > 0, RayStatus.UNHEARD, RayStatus.WEAK)
    status = np.where((sound.status == RayStatus.OK) & (picks < 0), missing, sound.status)
    # all candidates, and the row of each event
    table = pd.DataFrame(
        {
            "event": rows[receptions.link],
            "travel_time_s": receptions.travel_time,
            "loss_db": choice.loss_db,
            "surface_bounces": receptions.surface_bounces,
            "bottom_bounces": receptions.bottom_bounces,
            "share": 1.0,
            "spread_s": 0.0,
        }
    )
    frame = pd.DataFrame(
        {
            "cast": water.name,
            "distance_m": distance,
            "bearing_deg": np.degrees(np.arctan2(step[:, 1], step[:, 0])),
            "chord_s": sound.arrivals.chord_travel_time,
            "status": [RayStatus(int(code)).name.lower() for code in status],
            "n_arrivals": n_arrivals,
            **predicted_columns(table, picks, after, choice.sonar, rays=rays),
            "near_limit": choice.near_limit(rule, picks),
            "sound_speed_m_s": sound.arrivals.source_sound_speed,
        },
        index=rows,
    ).astype({"surface_bounces": "Int64", "bottom_bounces": "Int64"})
    return frame, table[candidates]

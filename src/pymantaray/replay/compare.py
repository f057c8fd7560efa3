"""Each measured travel time beside the one predicted, and what the differences say together."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import cast

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymantaray.acoustics.selection import NEAR_DB
from pymantaray.errors import ReplayError
from pymantaray.jobs.progress import CountProgress
from pymantaray.records import RayStatus
from pymantaray.records.notebook import notebook_html
from pymantaray.records.result_table import ResultTable
from pymantaray.replay.clocks import reciprocity_table
from pymantaray.replay.events import Events
from pymantaray.replay.rules import DEFAULT_RULE, Choice, DetectionRule
from pymantaray.replay.summary import summary_table
from pymantaray.replay.switching import fit_clocks, switching_table
from pymantaray.replay.water import choose_water, ends_of, instants_in
from pymantaray.sensing import Detector, Transmission, find_receptions
from pymantaray.sensing.receptions import Direction, receptions_at, values_at
from pymantaray.water import Source, Water, open_waters

Array = NDArray[np.float64]
SEED = 20140715
"""That of studies."""
_CAPTIONS = {
    "summary": "Coverage and residuals of groups of events. Intervals (95 %) resample pairs, not events; a single pair has none",
    "clocks": "Clock offset of each node by least squares, positive if ahead; the mean of each connected group is 0 unless a"
    " reference is given. Standard errors as if events were independent, and by pairs",
    "reciprocity": "Residuals of one direction less those of the other near in time, the part due to clocks, and the rest",
    "switching": "How often a receiver changes its candidate from one event to the next, and how often independent picks would",
}
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
_HEADS = {"percent": "predicted [%]"}


@dataclass(frozen=True, eq=False)
class Replay:
    """
    Measured events, what was predicted of each, and tables of what the differences say.

    Parameters
    ----------
    events : pandas.DataFrame
        A row an event, as `replay_events` says.
    rule : DetectionRule
    window : float
        Events at most so far apart in time are near, for reciprocity and switching. [s]
    seed : int
        Of the bootstrap.
    candidates : pandas.DataFrame
        Every arrival that a receiver could have taken: its event, its travel time, and its loss.
    reference : str, optional
        Node whose clock is taken for true; by default the mean of each group of connected nodes is.
    notes : tuple of str
        What is doubtful about the water.
    """

    events: pd.DataFrame
    rule: DetectionRule
    window: float
    seed: int
    candidates: pd.DataFrame = field(repr=False)
    reference: str | None = None
    notes: tuple[str, ...] = ()

    def _repr_html_(self) -> str:
        """HTML for a notebook: statuses of the events, and residuals of all and by depths and range."""
        counts = {str(name): n for name, n in self.events["status"].value_counts().items()}
        title = f"Replay of {len(self.events)} events by rule {self.rule}"
        return notebook_html(title, counts, [self.brief_summary])

    @cached_property
    def summary(self) -> pd.DataFrame:
        """Coverage and residuals of all events and by pair, depths and range, with intervals over pairs."""
        return summary_table(self.events, seed=self.seed)

    @cached_property
    def _fit(self) -> tuple[pd.DataFrame, pd.DataFrame]:
        return fit_clocks(self.events, self.candidates, reference=self.reference)

    @property
    def clocks(self) -> pd.DataFrame:
        """Offset of each node's clock by least squares, with two standard errors."""
        return self._fit[0]

    @property
    def taken(self) -> pd.DataFrame:
        """Which candidate each event is nearest to, clocks taken off; a row an event, NaN without a candidate."""
        return self._fit[1]

    @cached_property
    def reciprocity(self) -> pd.DataFrame:
        """Residuals of each pair's events one way less those the other way near in time."""
        return reciprocity_table(self.events, self.taken["taken_time_s"], self.clocks, window=self.window)

    @cached_property
    def switching(self) -> pd.DataFrame:
        """How often receivers change from one candidate to another, and how often they would independently."""
        return switching_table(self.events, self.taken, window=self.window, seed=self.seed)

    @property
    def tables(self) -> dict[str, ResultTable]:
        """All tables by name, in the order of the page."""
        frames = {
            "summary": self.summary,
            "clocks": self.clocks,
            "reciprocity": self.reciprocity,
            "switching": self.switching,
            "events": pd.concat([self.events, self.taken], axis=1),
        }
        return {
            name: ResultTable(name, frame, _CAPTIONS.get(name, ""), brief=_BRIEF.get(name, ()), words=_HEADS)
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
    window: float = 60.0,
    water_interval: float = 600.0,
    reference: str | None = None,
    seed: int = SEED,
    notes: Sequence[str] = (),
    progress: CountProgress | None = None,
) -> Replay:
    """
    Predict the travel time of every event, and set it beside what was measured.

    Parameters
    ----------
    events : Events
    waters : Water, sequence of Water, or source of `open_waters`
        What sound runs through; of several an event takes the one that it names, else the nearest in time.
    rule : DetectionRule or str
        Which arrival is taken to have been detected. Fix it before you look at residuals.
    window : float
        Events at most so far apart in time are near each other, for reciprocity and switching. [s]
    water_interval : float
        Water that varies in time is taken at the multiple of this that is nearest to an event. [s]
    reference : str, optional
        Node whose clock is taken for true. By default the mean of all clocks is.
    seed : int
        Of the bootstrap over pairs.
    notes : sequence of str
        What a reader should know of the water.
    progress : callable, optional
        Told how many events are done, and how many there are.

    Returns
    -------
    Replay
        Its ``events`` has a row an event: ``status``, ``n_arrivals`` within the cut-off, ``predicted_s``, bounces, ``loss_db``
        re 1 m (of spreading alone without a detector), ``level_db`` at the receiver with one, ``next_s`` and ``next_db`` (by how much the
        next candidate is later and louder), ``near_limit`` (a limit 1 dB higher or lower would change the pick),
        ``residual_s`` (measured less predicted) and ``residual_m`` (times the sound speed at the source). An event without a
        predicted arrival keeps its row, with a status that says why.

    Raises
    ------
    ReplayError
        If an event names a cast that is not there, none can be chosen, the rule needs a sonar that is not given, or the window is
        negative.
    """
    waters = _waters(waters)
    rule = DetectionRule.parse(rule) if isinstance(rule, str) else rule
    if rule.kind == "threshold" and any(water.reception.detector is None for water in waters):
        raise ReplayError("rule threshold: a sonar says what is heard; give [detection], or another rule")
    if not window >= 0.0:
        raise ReplayError(f"window {window:g} s; allowed are 0 s and more")
    nodes = set(events.source) | set(events.receiver)
    if reference is not None and reference not in nodes:
        raise ReplayError(f"reference {reference!r} is no node; there are {', '.join(sorted(nodes)[:12])}")
    predicted, candidates, done = [], [], 0
    for water, time, rows in _parts(events, waters, water_interval):

        def tell(part: int, parts: int, done: int = done, here: int = rows.size) -> None:
            if progress is not None:
                progress(done + part * here // max(parts, 1), events.time.size)

        frame, others = _predict(events, rows, water, time, rule, tell)
        predicted.append(frame)
        candidates.append(others)
        done += rows.size
    table = pd.concat([_measured(events), pd.concat(predicted).sort_index()], axis=1)
    table["residual_s"] = table["measured_s"] - table["predicted_s"]
    table["residual_m"] = table["residual_s"] * table.pop("sound_speed_m_s")
    every = pd.concat(candidates, ignore_index=True).sort_values(
        ["event", "travel_time_s"], ignore_index=True
    )
    return Replay(table, rule, window, seed, every, reference, tuple(notes))


def _waters(waters: Water | Source | Sequence[Water]) -> list[Water]:
    """Waters as a list, those of a source opened."""
    if isinstance(waters, Water):
        return [waters]
    if (
        isinstance(waters, Sequence)
        and not isinstance(waters, str)
        and all(isinstance(w, Water) for w in waters)
    ):
        return [w for w in waters if isinstance(w, Water)]
    return open_waters(cast("Source", waters))


def _parts(
    events: Events, waters: list[Water], interval: float
) -> Iterator[tuple[Water, float, NDArray[np.int64]]]:
    """Events that share a water and its time [s]."""
    which = choose_water(events, waters)
    for index in np.unique(which).tolist():
        rows = np.flatnonzero(which == index)
        times = instants_in(events, rows, waters[index], interval)
        for time in np.unique(times):
            yield waters[index], float(time), rows[times == time]


def _measured(events: Events) -> pd.DataFrame:
    known = not np.isnat(events.epoch)
    return pd.DataFrame(
        {
            "time": events.instant if known else events.time,
            "time_s": events.time,
            "source": events.source,
            "receiver": events.receiver,
            "pair": events.pair,
            "source_depth_m": events.source_position[:, 2],
            "receiver_depth_m": events.receiver_position[:, 2],
            "measured_s": events.travel_time,
            "sigma_s": events.sigma,
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
    """Prediction of some events in one water at a time, and all candidates of each; indexed by event."""
    reception, (medium, currents) = water.reception, water.at(time)
    source, receiver = ends_of(events, rows, water)
    cutoff = reception.spreading_cutoff_db
    wide = reception._replace(
        arrival="first", spreading_cutoff_db=None if cutoff is None else cutoff + NEAR_DB
    )
    sound = find_receptions(source, receiver, medium, wide, currents=currents, progress=progress)
    distance = np.linalg.norm(receiver - source, axis=-1)
    choice = _choice(sound, distance, np.inf if cutoff is None else cutoff, reception.detector)
    r, sonar = choice.receptions, choice.sonar
    candidates = choice.candidates(rule)
    picks = choice.pick(rule, candidates)
    after = choice.next(rule, candidates, picks)
    rays = np.where((picks >= 0) & (np.append(r.arrival, -1)[picks] >= 0), picks, -1)
    within = np.bincount(r.link[choice.within_cutoff()], minlength=rows.size)
    lost = np.where(within > 0, RayStatus.UNHEARD, RayStatus.WEAK)
    status = np.where((sound.status == RayStatus.OK) & (picks < 0), lost, sound.status)
    level, time_s = values_at(choice.loss_db, picks), r.travel_time
    frame = pd.DataFrame(
        {
            "cast": water.name,
            "distance_m": distance,
            "status": [RayStatus(int(code)).name.lower() for code in status],
            "n_arrivals": within,
            "predicted_s": values_at(time_s, picks),
            "surface_bounces": values_at(r.surface_bounces, rays),
            "bottom_bounces": values_at(r.bottom_bounces, rays),
            "loss_db": level,
            "level_db": np.nan if sonar is None else sonar.source_level_db - level,
            "next_s": values_at(time_s, after) - values_at(time_s, picks),
            "next_db": level - values_at(choice.loss_db, after),
            "near_limit": choice.near_limit(rule, picks),
            "sound_speed_m_s": sound.arrivals.source_sound_speed,
        },
        index=rows,
    ).astype({"surface_bounces": "Int64", "bottom_bounces": "Int64"})
    columns = {"event": rows[r.link], "travel_time_s": time_s, "loss_db": choice.loss_db}
    return frame, pd.DataFrame(columns)[candidates]


def _choice(sound: Transmission, distance: Array, cutoff_db: float, detector: Detector | None) -> Choice:
    """Receptions from source to receiver; without a detector their loss is spreading alone, re 1 m."""
    forth = receptions_at(sound.receptions, np.flatnonzero(sound.receptions.direction == Direction.FORTH))
    loss = forth.loss_db
    if detector is None:
        loss = forth.spreading_db + 20.0 * np.log10(np.maximum(distance[forth.link], 1.0))
    return Choice(forth, distance.size, loss, cutoff_db, None if detector is None else detector.sonar)

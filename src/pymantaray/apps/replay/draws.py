"""
Predictions from several draws of rough ice, whose arrivals are merged into candidates by bounces
and time, and a suggestion to allow reflections.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymantaray.acoustics import Currents, Medium, Sonar
from pymantaray.acoustics.selection import first_rows
from pymantaray.apps.replay.events import Events
from pymantaray.apps.replay.rules import Choice, DetectionRule, first_picks, predicted_columns
from pymantaray.apps.replay.shared_links import SharedLinks, rows_of_ways
from pymantaray.apps.replay.water import ASIDE, choose_water, ends_of, instants_in
from pymantaray.arrays import Array
from pymantaray.errors import ReplayError
from pymantaray.jobs.progress import CountProgress
from pymantaray.records import RayStatus
from pymantaray.sensing import Detector, ReceptionOptions, Transmission, find_receptions
from pymantaray.sensing.receptions import Direction
from pymantaray.sensing.water import Water

Rows = NDArray[np.int64]
_MIN_DRAW_SHARE = 0.5  # of the draws, for a candidate that a rule without a mixture takes
_MIN_PREDICTED_SHARE = 0.7  # of the events; with fewer predictions, reflections are suggested
_MIN_GROUPS, _MAX_GROUPS = 4, 8  # of draws, each of which is left out once
_SUGGESTION_EVENTS = 60  # events of a suggestion
_SUGGESTED_BOUNCES = 7  # reflections
MERGED = 1e-3
"""Arrivals of one candidate differ by less than this in time. [s]"""
GRADIENT = ("by_range", "by_first_depth", "by_second_depth")
"""
Derivatives of the travel time by horizontal range and by the depths of both nodes of a pair, in
alphabetical order. [s/m]
"""


class DrawnArrivals(NamedTuple):
    """Arrivals of several events in all draws, one row each."""

    event: NDArray[np.int64]
    draw: NDArray[np.int64]
    time: Array
    loss_db: Array
    surface_bounces: NDArray[np.int64]
    bottom_bounces: NDArray[np.int64]
    gradient: Array
    """(n, 3), see `GRADIENT`. [s/m]"""

    def at(self, rows: NDArray[np.bool_]) -> "DrawnArrivals":
        """Some of the arrivals."""
        columns: list[Any] = [column[rows] for column in self]
        return DrawnArrivals(*columns)


def merge_draws(arrivals: DrawnArrivals, draws: int) -> pd.DataFrame:
    """
    Merge the arrivals of all draws into candidates.

    Parameters
    ----------
    arrivals : DrawnArrivals
    draws : int
        Number of draws.

    Returns
    -------
    pandas.DataFrame
        One row per candidate, by event and time: ``event``, mean ``travel_time_s``, ``loss_db``,
        bounces, ``share`` of the draws that contain it, ``spread_s``, the standard deviation of its
        times over the draws, and the derivatives of `GRADIENT`.

    Notes
    -----
    Arrivals of an event with the same bounces are sorted by time. The earliest begins a candidate,
    which takes all arrivals less than 1 ms later; the next arrival begins the next candidate. The
    loss of a candidate is that of the mean power of the draws that contain it, to which all its
    arrivals in a draw contribute; its time is the mean weighted by power. The result does not
    depend on the order of the arrivals.
    """
    # arrivals of an event with the same bounces, by time
    order = np.lexsort(
        (
            arrivals.loss_db,
            arrivals.draw,
            arrivals.time,
            arrivals.bottom_bounces,
            arrivals.surface_bounces,
            arrivals.event,
        )
    )
    event, draw, time, loss, surface, bottom, gradient = (column[order] for column in arrivals)
    # the first arrival of each candidate
    first = np.zeros(time.size, dtype=bool)
    start = -np.inf
    before = (-1, -1, -1)
    for i, key in enumerate(zip(event.tolist(), surface.tolist(), bottom.tolist(), strict=True)):
        if key != before or time[i] - start >= MERGED:
            first[i] = True
            start = time[i]
            before = key
    # mean power, mean time and spread of each candidate
    group = np.cumsum(first) - 1
    n = int(group[-1]) + 1 if group.size else 0
    power = 10.0 ** (-0.1 * loss)
    total = np.bincount(group, power, minlength=n)
    in_draws = np.bincount(np.unique(group * draws + draw) // draws, minlength=n)
    mean = np.bincount(group, power * time, minlength=n) / total
    unweighted_mean = np.bincount(group, time, minlength=n) / np.bincount(group, minlength=n)
    variance = np.bincount(group, (time - unweighted_mean[group]) ** 2, minlength=n) / np.bincount(
        group, minlength=n
    )
    columns = {
        "event": event[first],
        "travel_time_s": mean,
        "loss_db": -10.0 * np.log10(total / np.maximum(in_draws, 1)),
        "surface_bounces": surface[first],
        "bottom_bounces": bottom[first],
        "share": in_draws / draws,
        "spread_s": np.sqrt(variance),
    }
    for name, derivative in zip(GRADIENT, gradient.T, strict=True):
        columns[name] = np.bincount(group, power * derivative, minlength=n) / total
    table = pd.DataFrame(columns)
    return table.sort_values(["event", "travel_time_s"], kind="stable", ignore_index=True)


def choice_of(
    sound: Transmission,
    distance: Array,
    cutoff_db: float,
    detector: Detector | None,
    direction: Direction = Direction.FORTH,
) -> Choice:
    """Receptions in a direction of links; without a detector their loss is spreading, re 1 m."""
    receptions = sound.receptions
    # an echo is a reflection, not the sound that passes from the source to the receiver beside it
    is_reflected = (receptions.surface_bounces > 0) | (receptions.bottom_bounces > 0)
    is_possible = is_reflected | (distance[receptions.link] > 1.5 * ASIDE)
    one_way = receptions.at({"reception": (receptions.direction == direction) & is_possible})
    loss = one_way.loss_db
    if detector is None:
        loss = one_way.spreading_db + 20.0 * np.log10(np.maximum(distance[one_way.link], ASIDE))
    return Choice(
        one_way, distance.size, loss, cutoff_db, None if detector is None else detector.sonar
    )


def predict_draws(
    events: Events,
    rows: Rows,
    sea: tuple[Medium, Currents | None],
    water: Water,
    rule: DetectionRule,
    draws: int,
    progress: CountProgress,
) -> list[tuple[pd.DataFrame, pd.DataFrame]]:
    """
    Prediction of some events by the merged arrivals of several draws, and all candidates.

    The first is that of all draws. Those without each group follow, see `draw_groups`. Draws come
    in pairs, of which the second is the first upside down: their errors of travel time cancel to
    first order in the elevation.
    """
    medium, currents = sea
    reception = water.reception
    rough = medium.surface.roughness
    is_echo = bool(events.is_echo[rows].any())
    if draws > 1 and rough is None and not is_echo:
        raise ReplayError(
            "draws: the ice is smooth, so all draws are equal; give `ice_slope_deg`, or leave out"
            " `draws`"
        )
    # links that several events share
    source, receiver = ends_of(events, rows, water, medium.earth)
    links = SharedLinks.of(
        events, rows, (source, receiver), ice=rough, drifts=water.frame is None or water.uniform
    )
    # arrivals of each draw of the ice
    parts = []
    status = np.full(len(links.source), RayStatus.SHADOW, dtype=np.int8)
    for draw in range(draws):
        drawn_medium = medium
        if rough is not None:
            number = rough.draw + draw // 2
            drawn = rough.with_draw(number if draw % 2 == 0 else -1 - number)
            drawn_medium = replace(medium, surface=medium.surface.with_roughness(drawn))
        sound = find_receptions(
            links.source,
            links.receiver,
            drawn_medium,
            reception._replace(arrival="first"),
            currents=currents,
        )
        parts += _arrivals_of(sound, links, medium, reception, draw)
        status = np.where((draw == 0) | (sound.status == RayStatus.OK), sound.status, status)
        progress(draw + 1, draws)
    # values of each event by its link
    arrivals = DrawnArrivals(*(np.concatenate(column) for column in zip(*parts, strict=True)))
    distance = medium.straight_distance(source, receiver)
    speeds = np.stack([sound.arrivals.source_sound_speed, sound.arrivals.receiver_sound_speed])
    speed = speeds[links.direction, links.link]
    sonar = None if reception.detector is None else reception.detector.sonar
    step = receiver - source
    shared_distance = medium.straight_distance(links.source, links.receiver)[links.link]
    chord = sound.arrivals.chord_travel_time[links.link]
    same: dict[str, Any] = {
        "cast": water.name,
        "bearing_deg": np.degrees(np.arctan2(step[:, 1], step[:, 0])),
        "chord_s": chord * distance / np.maximum(shared_distance, 1e-9),
    }
    # candidates of all draws, and of all but one group
    predictions = []
    for members in draw_groups(draws):
        of_group = arrivals.at(np.isin(arrivals.draw, members))
        numbered_draws = of_group._replace(draw=np.searchsorted(members, of_group.draw))
        merged = merge_draws(numbered_draws, members.size)
        candidates = _of_events(merged, links)
        frame = _frame(candidates, status[links.link], distance, speed, rule, sonar).assign(**same)
        numbered = candidates.assign(event=rows[candidates["event"].to_numpy()])
        predictions.append((frame.set_index(rows), numbered))
    return predictions


def draw_groups(draws: int) -> list[Rows]:
    """
    All draws, and if there are eight or more, all draws but one of four to eight groups.

    A draw and its mirror image are in the same group, so groups are independent.
    """
    numbers = np.arange(draws)
    groups = min(_MAX_GROUPS, draws // 2)  # of mirrored pairs
    if groups < _MIN_GROUPS:
        return [numbers]
    return [numbers, *(numbers[numbers // 2 % groups != k] for k in range(groups))]


def _arrivals_of(
    sound: Transmission, links: SharedLinks, medium: Medium, reception: ReceptionOptions, draw: int
) -> list[DrawnArrivals]:
    """Arrivals of all links in one draw, in each direction that events use."""
    distance = medium.straight_distance(links.source, links.receiver)
    cutoff = np.inf if reception.spreading_cutoff_db is None else reception.spreading_cutoff_db
    parts = []
    for direction in Direction:
        choice = choice_of(sound, distance, cutoff, reception.detector, direction)
        receptions = choice.receptions
        is_used = np.isin(2 * receptions.link + direction, links.way)
        is_candidate = is_used & (choice.within_cutoff() | (receptions.arrival < 0))
        arrivals = DrawnArrivals(
            event=2 * receptions.link + direction,
            draw=np.full(receptions.link.size, draw),
            time=receptions.travel_time,
            loss_db=choice.loss_db,
            surface_bounces=receptions.surface_bounces.astype(np.int64),
            bottom_bounces=receptions.bottom_bounces.astype(np.int64),
            gradient=links.gradient_of(
                receptions.link, receptions.source_slowness, receptions.receiver_slowness
            ),
        )
        parts.append(arrivals.at(is_candidate))
    return parts


def _of_events(candidates_of_ways: pd.DataFrame, links: SharedLinks) -> pd.DataFrame:
    """Candidates of each event: those of its link, with travel times for its own geometry."""
    which, event = rows_of_ways(candidates_of_ways["event"].to_numpy(), links.way)
    candidates = candidates_of_ways.iloc[which]
    gradient = candidates[list(GRADIENT)].to_numpy()
    shift = np.einsum("ni,ni->n", gradient, links.change[event])
    candidates = candidates.assign(
        event=event, travel_time_s=candidates["travel_time_s"].to_numpy() + shift
    )
    return candidates.sort_values(["event", "travel_time_s"], kind="stable", ignore_index=True)


def _frame(
    candidates: pd.DataFrame,
    status: NDArray[np.int8],
    distance: Array,
    speed: Array,
    rule: DetectionRule,
    sonar: Sonar | None,
) -> pd.DataFrame:
    """Columns of the events by a rule on merged candidates."""
    n = distance.size
    link = candidates["event"].to_numpy()
    loss = candidates["loss_db"].to_numpy()
    time = candidates["travel_time_s"].to_numpy()
    share = candidates["share"].to_numpy()
    has_usual = np.zeros(n, dtype=bool)
    has_usual[link[share >= _MIN_DRAW_SHARE]] = True
    is_allowed = (share >= _MIN_DRAW_SHARE) | ~has_usual[link]
    least = np.full(n, np.inf)
    np.minimum.at(least, link[is_allowed], loss[is_allowed])
    if rule.kind in ("within", "persist"):
        is_allowed &= loss <= least[link] + (6.0 if rule.within_db is None else rule.within_db)
    if rule.kind == "threshold" and sonar is not None:
        is_allowed &= loss <= sonar.figure_of_merit_db
    keys = [loss, time] if rule.kind == "strongest" else [time]
    first = first_picks(link, keys, is_allowed, n)
    is_allowed[first[first >= 0]] = False
    after = first_picks(link, keys, is_allowed, n)
    outcome = np.where(status == RayStatus.OK, RayStatus.UNHEARD, status)
    outcome[first >= 0] = RayStatus.OK
    return pd.DataFrame(
        {
            "cast": "",
            "distance_m": distance,
            "status": [RayStatus(int(code)).name.lower() for code in outcome],
            "n_arrivals": np.bincount(link, minlength=n),
            **predicted_columns(candidates, first, after, sonar),
            "near_limit": False,
            "sound_speed_m_s": speed,
        }
    ).astype({"surface_bounces": "Int64", "bottom_bounces": "Int64"})


def with_median_candidate(
    table: pd.DataFrame, candidates: pd.DataFrame, median: Array, followed: pd.DataFrame | None
) -> pd.DataFrame:
    """
    Events whose arrival is the candidate or followed arrival nearest to the median of their mixture
    [s].

    A followed arrival within 1 ms of a candidate is this candidate. No draw has the others, which
    have no bounces and no loss, and are ``not_modelled``. ``modelled_s`` is the nearest candidate.
    """
    numbers = ["event", "travel_time_s"]
    every = candidates[numbers] if followed is None else pd.concat([candidates, followed])[numbers]
    events, places = _nearest(every, median)
    predicted = np.full(len(table), np.nan)
    predicted[events] = every["travel_time_s"].to_numpy()[places]
    out = table.assign(predicted_s=predicted)
    events, rows = _nearest(candidates, predicted)
    time = candidates["travel_time_s"].to_numpy()[rows]
    is_modelled = np.zeros(len(table), dtype=bool)
    is_modelled[events] = np.abs(time - predicted[events]) < MERGED
    for name in ("surface_bounces", "bottom_bounces", "loss_db"):
        out.loc[events, name] = candidates[name].to_numpy()[rows]
        out.loc[~is_modelled, name] = pd.NA if name != "loss_db" else np.nan
    if followed is not None:
        out.loc[events, "modelled_s"] = time
        out["not_modelled"] = np.isfinite(predicted) & ~is_modelled
    out.loc[np.isfinite(predicted), "status"] = "ok"
    level = table["level_db"] + table["loss_db"]
    return out.assign(level_db=level - out["loss_db"], next_s=np.nan, next_db=np.nan)


def _nearest(candidates: pd.DataFrame, time: Array) -> tuple[Rows, Rows]:
    """Events with candidates, and the row of the nearest one to a time of each event."""
    event = candidates["event"].to_numpy(dtype=np.int64)
    distance = np.abs(candidates["travel_time_s"].to_numpy() - time[event])
    return first_rows(event, [distance], np.ones(event.size, dtype=bool))


def bounce_hint(
    events: Events, waters: Sequence[Water], predicted: NDArray[np.bool_]
) -> tuple[str, ...]:
    """
    Suggest reflections if none are allowed and they would predict more events.

    The number is from at most 60 events without a prediction, evenly spaced in the table.
    """
    some = any(
        water.reception.max_surface_bounces + water.reception.max_bottom_bounces for water in waters
    )
    if some or not predicted.size or predicted.mean() >= _MIN_PREDICTED_SHARE:
        return ()
    missing = np.flatnonzero(~predicted)
    sample = missing[
        np.unique(
            np.linspace(0, missing.size - 1, min(missing.size, _SUGGESTION_EVENTS)).astype(int)
        )
    ]
    which = choose_water(events, waters)[sample]
    n_gained = 0
    for index in np.unique(which).tolist():
        water = waters[index]
        rows = sample[which == index]
        time = float(instants_in(events, rows, water, 600.0)[0])
        medium, _ = water.at(time)
        smooth = replace(medium, surface=medium.surface.with_roughness(None))
        reception = water.reception._replace(
            arrival="first", max_surface_bounces=_SUGGESTED_BOUNCES, detector=None, leakage=None
        )
        sound = find_receptions(*ends_of(events, rows, water, medium.earth), smooth, reception)
        n_gained += int(np.count_nonzero(sound.status == RayStatus.OK))
    if not n_gained:
        return ()
    share = 100.0 * predicted.mean()
    hint = (
        f"{share:.0f} % of the events are predicted, and no reflections are allowed; with"
        f" `max_surface_bounces={_SUGGESTED_BOUNCES}`, {n_gained} of {sample.size} of the other"
        " events have an arrival"
    )
    return (hint,)

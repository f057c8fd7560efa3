"""Predictions from several draws of rough ice, and a suggestion to allow reflections."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymantaray.acoustics import Currents, Medium
from pymantaray.acoustics.selection import first_rows
from pymantaray.apps.replay.candidates import DrawnArrivals, merge_draws
from pymantaray.apps.replay.events import Events
from pymantaray.apps.replay.rules import Choice, DetectionRule, first_picks, predicted_columns
from pymantaray.apps.replay.water import choose_water, ends_of, instants_in
from pymantaray.arrays import Array
from pymantaray.errors import ReplayError
from pymantaray.jobs.progress import CountProgress
from pymantaray.records import RayStatus
from pymantaray.sensing import Detector, Transmission, find_receptions
from pymantaray.sensing.receptions import Direction
from pymantaray.sensing.water import Water

Rows = NDArray[np.int64]
_MIN_DRAW_SHARE = 0.5  # of the draws, for a candidate that a rule without a mixture takes
_PAIR_SPACING = 37.3  # correlation lengths between the ice of successive pairs
_MIN_PREDICTED_SHARE = 0.7  # of the events; with fewer predictions, reflections are suggested
_SUGGESTION_EVENTS = 60  # events of a suggestion
_SUGGESTED_BOUNCES = 7  # reflections


def choice_of(
    sound: Transmission, distance: Array, cutoff_db: float, detector: Detector | None
) -> Choice:
    """
    Receptions from source to receiver; without a detector their loss is spreading alone, re 1 m.
    """
    forth = sound.receptions.at({"reception": sound.receptions.direction == Direction.FORTH})
    loss = forth.loss_db
    if detector is None:
        loss = forth.spreading_db + 20.0 * np.log10(np.maximum(distance[forth.link], 1.0))
    return Choice(
        forth, distance.size, loss, cutoff_db, None if detector is None else detector.sonar
    )


def predict_draws(
    events: Events,
    rows: Rows,
    sea: tuple[Medium, Currents | None],
    water: Water,
    rule: DetectionRule,
    draws: int,
    progress: CountProgress,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """
    Prediction of some events by the merged arrivals of several draws of rough ice, and all
    candidates; indexed by event.
    """
    (medium, currents), reception = sea, water.reception
    rough = medium.surface.roughness
    if draws > 1 and rough is None:
        raise ReplayError(
            "draws: the ice is smooth, so all draws are equal; give `ice_slope_deg`, or leave out"
            " `draws`"
        )
    source, receiver = ends_of(events, rows, water, medium.earth)
    if rough is not None and events.geographic and (water.frame is None or water.uniform):
        source, receiver = _on_ice(events, rows, source, receiver, rough.length)
    # nodes at rest repeat theirs
    links, of = np.unique(np.hstack([source, receiver]), axis=0, return_inverse=True)
    source = links[:, :3]
    receiver = links[:, 3:]
    distance = medium.straight_distance(source, receiver)
    cutoff = np.inf if reception.spreading_cutoff_db is None else reception.spreading_cutoff_db
    wide = reception._replace(arrival="first")
    parts = []
    status = np.full(len(links), RayStatus.SHADOW, dtype=np.int8)
    for draw in range(draws):
        one = medium
        if rough is not None:
            one = replace(
                medium, surface=medium.surface.with_roughness(rough.with_draw(rough.draw + draw))
            )
        sound = find_receptions(source, receiver, one, wide, currents=currents)
        choice = choice_of(sound, distance, cutoff, reception.detector)
        r = choice.receptions
        kept = choice.within_cutoff() | (r.arrival < 0)
        columns = (
            r.link,
            np.full(r.link.size, draw),
            r.travel_time,
            choice.loss_db,
            r.surface_bounces,
            r.bottom_bounces,
        )
        parts.append([np.asarray(x)[kept] for x in columns])
        status = np.where((draw == 0) | (sound.status == RayStatus.OK), sound.status, status)
        progress(draw + 1, draws)
    link, draw_of, time, loss, surface, bottom = (
        np.concatenate(x) for x in zip(*parts, strict=True)
    )
    merged = merge_draws(
        DrawnArrivals(link, draw_of, time, loss, surface.astype(np.int64), bottom.astype(np.int64)),
        draws,
    )
    frame = _frame(merged, status, distance, sound.arrivals.source_sound_speed, rule, choice)
    at = merged["event"].to_numpy()
    start = np.searchsorted(at, of)
    stop = np.searchsorted(at, of, side="right")
    candidates = merged.iloc[
        np.concatenate([np.arange(i, j) for i, j in zip(start, stop, strict=True)])
    ]
    candidates = candidates.assign(event=np.repeat(rows, stop - start))
    bearing = np.degrees(np.arctan2(*(receiver - source)[:, 1::-1].T))
    known = {"bearing_deg": bearing[of], "chord_s": sound.arrivals.chord_travel_time[of]}
    return frame.iloc[of].assign(cast=water.name, **known).set_index(rows), candidates


def _on_ice(
    events: Events, rows: Rows, source: Array, receiver: Array, length: float
) -> tuple[Array, Array]:
    """
    Ends of events under ice that drifts with the nodes: each pair has its own ice, the same in both
    directions.

    The first node of a pair, by name, keeps its place.
    """
    _, pair = np.unique(events.pair, return_inverse=True)
    back = events.source[rows] > events.receiver[rows]
    origin = np.where(back[:, None], receiver, source) * [1.0, 1.0, 0.0]
    shift = -origin
    shift[:, 0] += _PAIR_SPACING * length * pair[rows]
    return source + shift, receiver + shift


def _frame(
    merged: pd.DataFrame,
    status: NDArray[np.int8],
    distance: Array,
    speed: Array,
    rule: DetectionRule,
    choice: Choice,
) -> pd.DataFrame:
    """Columns of the events by a rule on merged candidates."""
    n = distance.size
    sonar = choice.sonar
    link = merged["event"].to_numpy()
    loss = merged["loss_db"].to_numpy()
    time = merged["travel_time_s"].to_numpy()
    share = merged["share"].to_numpy()
    usual = np.zeros(n, dtype=bool)
    usual[link[share >= _MIN_DRAW_SHARE]] = True
    allowed = (share >= _MIN_DRAW_SHARE) | ~usual[link]
    least = np.full(n, np.inf)
    np.minimum.at(least, link[allowed], loss[allowed])
    if rule.kind in ("within", "persist"):
        allowed &= loss <= least[link] + (6.0 if rule.within_db is None else rule.within_db)
    if rule.kind == "threshold" and sonar is not None:
        allowed &= loss <= sonar.figure_of_merit_db
    keys = [loss, time] if rule.kind == "strongest" else [time]
    first = first_picks(link, keys, allowed, n)
    allowed[first[first >= 0]] = False
    after = first_picks(link, keys, allowed, n)
    state = np.where(
        first >= 0,
        np.int8(RayStatus.OK),
        np.where(status == RayStatus.OK, RayStatus.UNHEARD, status),
    )
    return pd.DataFrame(
        {
            "cast": "",
            "distance_m": distance,
            "status": [RayStatus(int(code)).name.lower() for code in state],
            "n_arrivals": np.bincount(link, minlength=n),
            **predicted_columns(merged, first, after, sonar),
            "near_limit": False,
            "sound_speed_m_s": speed,
        }
    ).astype({"surface_bounces": "Int64", "bottom_bounces": "Int64"})


def with_median_candidate(
    table: pd.DataFrame, candidates: pd.DataFrame, median: Array
) -> pd.DataFrame:
    """
    Events whose predicted arrival is the candidate nearest to the median of their mixture. [s]
    """
    at = candidates["event"].to_numpy(dtype=np.int64)
    far = np.abs(candidates["travel_time_s"].to_numpy() - median[at])
    events, rows = first_rows(at, [far], np.ones(at.size, dtype=bool))
    out = table.copy()
    level = table["level_db"] + table["loss_db"]
    for name, source in (
        ("predicted_s", "travel_time_s"),
        ("surface_bounces", "surface_bounces"),
        ("bottom_bounces", "bottom_bounces"),
        ("loss_db", "loss_db"),
    ):
        out.loc[events, name] = candidates[source].to_numpy()[rows]
    out.loc[events, "status"] = "ok"
    return out.assign(level_db=level - out["loss_db"], next_s=np.nan, next_db=np.nan)


def bounce_hint(
    events: Events, waters: Sequence[Water], predicted: NDArray[np.bool_]
) -> tuple[str, ...]:
    """
    Suggest reflections, if none are allowed, few events are predicted and reflections would predict
    more of them.

    The number is from at most 60 events without a prediction, evenly spaced in the table.
    """
    some = any(w.reception.max_surface_bounces + w.reception.max_bottom_bounces for w in waters)
    if some or not predicted.size or predicted.mean() >= _MIN_PREDICTED_SHARE:
        return ()
    lost = np.flatnonzero(~predicted)
    sample = lost[
        np.unique(np.linspace(0, lost.size - 1, min(lost.size, _SUGGESTION_EVENTS)).astype(int))
    ]
    which = choose_water(events, waters)[sample]
    gained = 0
    for index in np.unique(which).tolist():
        water = waters[index]
        rows = sample[which == index]
        time = float(instants_in(events, rows, water, 600.0)[0])
        medium, _ = water.at(time)
        smooth = replace(medium, surface=medium.surface.with_roughness(None))
        allowed = water.reception._replace(
            arrival="first", max_surface_bounces=_SUGGESTED_BOUNCES, detector=None, leakage=None
        )
        sound = find_receptions(*ends_of(events, rows, water, medium.earth), smooth, allowed)
        gained += int(np.count_nonzero(sound.status == RayStatus.OK))
    if not gained:
        return ()
    share = 100.0 * predicted.mean()
    hint = (
        f"{share:.0f} % of the events are predicted, and no reflections are allowed; with"
        f" `max_surface_bounces={_SUGGESTED_BOUNCES}`, {gained} of {sample.size} of the other"
        " events have an arrival"
    )
    return (hint,)

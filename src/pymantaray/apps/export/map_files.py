"""Maps of a run, of located nodes and of an atlas, as KML or GeoJSON."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import xarray as xr

from pymantaray.apps.study.store import Run
from pymantaray.errors import ExchangeError
from pymantaray.exchange.maps import Feature, geojson, kml
from pymantaray.exchange.recording import Recording
from pymantaray.plotting.style import GREY, INK, LEVELS, condition_looks
from pymantaray.records.status import TRUTH

MAPS: dict[str, Callable[[list[Feature], str], str]] = {
    "kml": kml,
    "geojson": lambda features, _name: geojson(features),
}
"""Text of features by format."""


def run_features(run: Run, recording: Recording) -> list[Feature]:
    """Paths of the vehicles under all conditions, and landmarks."""
    truth = recording.truth
    frame = truth.frame
    if frame is None:
        raise ExchangeError(
            f"{run.path}: the run has no geographic position; a map needs one: give `centre` in its"
            " study"
        )
    looks = condition_looks(list(recording.estimates))
    colours = {TRUTH: INK, **{name: colour for name, (colour, _) in looks.items()}}
    features = []
    for p in recording.poses:
        if not p.samples.size:
            continue
        time = truth.time[p.samples]
        span = None
        if not np.isnat(truth.start):
            since = np.round(time[[0, -1]] * 1e3).astype("m8[ms]")
            first, last = truth.start.astype("M8[ms]") + since
            span = f"{first}Z", f"{last}Z"
        latitude, longitude = frame.to_geodetic(*p.position[:, :2].T)
        features.append(
            Feature(
                "LineString" if np.ptp(p.position, axis=0).any() else "Point",
                np.column_stack([longitude, latitude, -p.position[:, 2], time]),
                {"name": p.vehicle, "condition": p.condition},
                p.condition,
                colours[p.condition],
                span,
            )
        )
    for name, (north, east, down) in zip(
        recording.measurements.landmark_name.tolist(), recording.landmarks.tolist(), strict=True
    ):
        latitude, longitude = frame.to_geodetic(north, east)
        place = np.array([[longitude, latitude, -down]])
        features.append(Feature("Point", place, {"name": name}, "landmarks", GREY))
    return features


def source_features(source: Path) -> tuple[list[Feature], str] | None:
    """
    Features and title of located nodes (``location.json`` or its folder) or of an atlas; None for
    another source.
    """
    from pymantaray.apps.locate.displacement import CAMPAIGN_FILE, read_campaign

    if source.suffix == ".json" or (source / CAMPAIGN_FILE).is_file():
        from pymantaray.apps.locate.write import campaign_features

        return campaign_features(read_campaign(source)), source.name
    if source.suffix == ".nc":
        from pymantaray.apps.atlas import open_atlas

        with open_atlas(source) as atlas:
            return list(_atlas_features(atlas)), str(atlas.attrs["title"])
    return None


def _atlas_features(atlas: xr.Dataset) -> Iterator[Feature]:
    """
    Cells of the atlas in the water, with the largest errors and the mean percentages of lost paths
    over all pairs and bearings, as in the table of the atlas; the colour is the largest error of
    the first convention at the middle distance, relative to that of the atlas.
    """
    from pymantaray.apps.atlas.column import WATER as IN_WATER
    from pymantaray.apps.atlas.dataset import largest_over_pairs, mean_lost_over_pairs

    worst = largest_over_pairs(atlas).values
    lost = mean_lost_over_pairs(atlas).values
    safe = atlas["safe_distance"].values
    conventions = [str(name) for name in atlas["convention"].values]
    distances = [f"{distance:g}m" for distance in atlas["distance"].values]
    shown = worst[..., 0, len(distances) // 2]
    largest = np.nanmax(shown, initial=np.finfo(float).tiny)
    lat_bounds, lon_bounds = atlas["lat_bounds"].values, atlas["lon_bounds"].values
    for t, i, j in np.argwhere(atlas["column_status"].values == IN_WATER).tolist():
        (south, north), (west, east) = lat_bounds[i], lon_bounds[j]
        ring = np.array([[west, south], [east, south], [east, north], [west, north]])
        place = f"{atlas['lat'].values[i]:.4f}, {atlas['lon'].values[j]:.4f}"
        properties = {"name": place}
        instant = atlas["time"].values[t]
        if not np.isnat(instant):
            properties["time_utc"] = f"{np.datetime_as_string(instant, unit='s')}Z"
        for c, convention in enumerate(conventions):
            for d, distance in enumerate(distances):
                properties[f"worst_range_error_{convention}_{distance}_m"] = worst[t, i, j, c, d]
            for s, limit in enumerate(atlas["safe"].values):
                properties[f"safe_distance_{convention}_{limit:g}m_m"] = safe[t, i, j, c, s]
        for d, distance in enumerate(distances):
            properties[f"mean_no_direct_path_{distance}_percent"] = lost[t, i, j, d]
        share = shown[t, i, j] / largest
        colour = (
            ("#" + "".join(f"{round(255 * part):02x}" for part in LEVELS(float(share))[:3]))
            if np.isfinite(share)
            else GREY
        )
        yield Feature("Polygon", ring, properties, properties.get("time_utc", "cells"), colour)

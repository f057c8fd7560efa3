"""Export of located nodes: landmarks of a study, GeoJSON, PyFactorGraph text and NetCDF."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pymantaray.apps.locate.displacement import CAMPAIGN_FILE, Campaign, campaign_values
from pymantaray.apps.locate.fit_tests import test_table
from pymantaray.apps.locate.location import Location, ellipse, ellipse_points
from pymantaray.apps.locate.survey import Survey, TravelDirection
from pymantaray.errors import LocateError
from pymantaray.estimation.graph.graph import KINDS, FactorGraph, GraphValues
from pymantaray.estimation.graph.pyfg import write_pyfg
from pymantaray.exchange.maps import Feature, geojson as as_geojson
from pymantaray.geometry import LocalFrame
from pymantaray.jobs.folder import write_json
from pymantaray.jobs.keys import with_checksum
from pymantaray.messages import one_line
from pymantaray.plotting.style import ORANGE
from pymantaray.records.column_attributes import with_column_attributes
from pymantaray.records.writing import write_netcdf

_CORNERS = 72  # per ellipse
_UNUSED = ["line", "node", "time_s", "residual_s", "reason"]
# keys of the summary in location.json
_STORED = (
    *("campaign", "displacement", "tests_passed", "widening", "selection", "settled", "usable"),
    *("earth", "earths", "mirrors"),
)
_SIGMAS = ("sigma_north_m", "sigma_east_m", "sigma_depth_m")
_ELLIPSE = ("ellipse_major_m", "ellipse_minor_m", "ellipse_azimuth_deg")
_MIN_SIGMA = 1e-3  # m; for known positions in a graph
_NAME = re.compile("[A-Za-z0-9_-]{1,64}")
# names of the platform in a graph, the first that no node has
_PLATFORMS = ("A", "platform", *(f"platform-{k}" for k in range(1000)))


def summary(location: Location) -> dict[str, Any]:
    """Results as the object of ``--json``."""
    moved = location.displacement
    unused = location.pings.loc[~location.pings["used"]]
    return {
        "nodes": location.nodes,
        "rms_s": location.rms,
        "n_used": int(location.solution.used.sum()),
        "n_all": len(location.survey),
        "hyperparameters": location.hyperparameters,
        "selection": location.selection,
        "centre": location.centre,
        "candidates": location.candidates,
        "tests": test_table(location.tests),
        "tests_passed": location.passed,
        "widening": location.widening,
        "budget": location.budget,
        "unknowns": location.other_unknowns,
        "mirrors": _mirrors(location),
        "rejected": unused[_UNUSED].to_dict("records"),
        "earth": location.earth,
        "earths": dict(location.earths),
        "settled": location.solution.settled,
        "usable": location.usable,
        "unexplained": dict(zip(location.survey.names, location.unexplained, strict=True)),
        "campaign": campaign_values(location),
        "displacement": moved.as_dict() if moved is not None else None,
    }


def _mirrors(location: Location) -> list[dict[str, Any]]:
    """Mirrored solutions, each with the reported one."""
    rows = location.both_sides.to_dict("records")
    return [
        vars(mirror) | {str(key): value for key, value in mirrored.items()} | {"reported": reported}
        for mirror, reported, mirrored in zip(location.mirrors, rows[::2], rows[1::2], strict=True)
    ]


def landmarks_toml(location: Location) -> str:
    """Nodes as tables ``[[landmarks]]`` of a study, with standard deviations as comments."""
    blocks = []
    for row in location.nodes.to_dict("records"):
        name = re.sub(r"[^A-Za-z0-9_-]+", "_", str(row["name"])).strip("_")[:64] or "node"
        coordinates = f"north = {row['north']:.4f}\neast = {row['east']:.4f}"
        if np.isfinite(row["lat"]):
            coordinates = f"lat = {row['lat']:.9f}\nlon = {row['lon']:.9f}"
        axes = np.array([row["sigma_north_m"], row["sigma_east_m"], row["sigma_depth_m"]])
        sigma = ", ".join(f"{sigma_axis:.3f}" for sigma_axis in axes)
        size = max(float(np.sqrt(np.mean(axes**2))), _MIN_SIGMA)
        blocks.append(
            f"[[landmarks]]  # {row['status']}; standard deviations {sigma} m north, east, depth\n"
            f'name = "{name}"\n{coordinates}\n'
            f"depth = {max(row['depth'], 0.0):.4f}\nsigma = {size:.4f}\n"
        )
    return "\n".join(blocks)


def geojson(location: Location) -> str:
    """Nodes and 95 % ellipses as GeoJSON features; empty without latitudes and longitudes."""
    return as_geojson(_features(location.nodes.to_dict("records"), location.survey.frame))


def campaign_features(campaign: Campaign) -> list[Feature]:
    """Nodes and 95 % ellipses of ``location.json``."""
    if campaign.origin is None:
        raise LocateError(
            f"{campaign.source}: positions without latitude and longitude; a map needs them"
        )
    frame = LocalFrame(*campaign.origin)
    latitude, longitude = frame.to_geodetic(*campaign.positions[:, :2].T)
    rows = []
    for k, (name, position) in enumerate(zip(campaign.names, campaign.positions, strict=True)):
        covariance = campaign.covariance[3 * k : 3 * k + 3, 3 * k : 3 * k + 3]
        row = {"name": name, "lat": latitude[k], "lon": longitude[k]}
        row |= dict(zip(("north", "east", "depth"), position.tolist(), strict=True))
        row |= dict(zip(_SIGMAS, np.sqrt(np.diag(covariance)).tolist(), strict=True))
        row |= dict(zip(_ELLIPSE, ellipse(covariance[:2, :2]), strict=True))
        rows.append(row)
    return _features(rows, frame)


def _features(rows: list[dict[Any, Any]], frame: LocalFrame | None) -> list[Feature]:
    """Point and ellipse of each node."""
    features: list[Feature] = []
    if frame is None:
        return features
    for row in rows:
        place = np.array([[row["lon"], row["lat"], -row["depth"]]])
        features.append(Feature("Point", place, row, "nodes", ORANGE))
        centre = np.array([row["north"], row["east"]])
        centre_lat, centre_lon = frame.to_geodetic(*centre)
        lat, lon = frame.to_geodetic(*(centre + ellipse_points(row, _CORNERS)).T)
        # a tangent plane has other coordinates, but the same ellipse
        ring = np.column_stack([lon + row["lon"] - centre_lon, lat + row["lat"] - centre_lat])
        properties = {"name": row["name"], "what": "95 % ellipse"}
        features.append(Feature("Polygon", ring, properties, "95 % ellipses", ORANGE))
    return features


def dataset(location: Location) -> xr.Dataset:
    """Nodes with their joint covariance, and pings, as a data set with units."""
    nodes = location.nodes
    pings = location.pings
    data: dict[str, Any] = {
        name: ("node", nodes[name].to_numpy()) for name in nodes.columns.drop("name")
    }
    count = len(nodes)
    joint = location.covariance.reshape(count, 3, count, 3)
    data["position_covariance"] = (("node", "axis", "node_2", "axis_2"), joint, {"units": "m2"})
    for name in ("time_s", "travel_time_s", "residual_s", "leverage", "range_m", "azimuth_deg"):
        data[f"ping_{name}"] = "ping", pings[name].to_numpy()
    data["ping_node"] = ("ping", pings["node"].to_numpy(dtype=str))
    data["ping_used"] = ("ping", pings["used"].to_numpy(dtype=np.int8))
    data["ping_reason"] = ("ping", pings["reason"].to_numpy(dtype=str))
    out = xr.Dataset(
        data, coords={"node": nodes["name"].to_numpy(dtype=str), "axis": ["north", "east", "depth"]}
    )
    out["status"] = out["status"].astype(str)
    model = {
        key: value
        for key, value in location.hyperparameters.items()
        if isinstance(value, (str, float))
    }
    out.attrs = {
        "title": "Located nodes",
        "source": location.survey.source,
        "earth": location.earth,
        "rms_s": location.rms,
    } | model
    return with_column_attributes(out)


def check_names_to_write(survey: Survey) -> None:
    """Raise an error if files cannot hold the name of a node."""
    for name in survey.names:
        if not _NAME.fullmatch(name):
            raise LocateError(
                f"{survey.source}: node {one_line(name, 40)!r}: files of results need names of 1 to"
                " 64 letters, digits, _ and -; rename it in the survey"
            )


def graph(location: Location) -> tuple[FactorGraph, GraphValues]:
    """
    Factor graph of the used pings: poses of the platform, nodes with priors, and ranges.

    Ranges between nodes are included, echoes of the surface are not.

    A range is the straight distance at the solution plus the residual in metres. The solution of
    the graph is therefore that of the survey with the estimated sound speed and clocks.
    """
    survey = location.survey
    solution = location.solution
    rows = np.flatnonzero(solution.used & ~survey.between_nodes)
    transmit_position, receive_position = solution.transducers()
    direction = survey.direction[:, None]
    # a two-way range is that at the middle of the exchange
    platform = 0.5 * (transmit_position + receive_position)
    platform = np.where(direction == TravelDirection.TO_NODE, transmit_position, platform)
    platform = np.where(direction == TravelDirection.FROM_NODE, receive_position, platform)
    platform = platform[rows]
    n = rows.size
    pairs = np.flatnonzero(solution.used & survey.between_nodes & ~survey.echoes)
    pings = np.concatenate([rows, pairs])
    ends = np.concatenate([platform, location.positions[survey.partner[pairs]]])
    half = location.mean_speed * np.where(
        survey.direction[pings] == TravelDirection.TWO_WAY, 0.5, 1.0
    )
    distance = (
        np.linalg.norm(ends - location.positions[survey.node[pings]], axis=1)
        + half * location.residual[pings]
    )
    noise = (
        solution.posterior.sigma
        * np.sqrt(solution.correlation.variance)
        * solution.linear.weight[pings]
    )
    first = np.concatenate([np.arange(n), n + survey.partner[pairs]])
    unit = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    has_prior = [i for i, node in enumerate(survey.nodes) if min(node.sigma) > 0.0]
    prior = np.array([np.diag(np.square(survey.nodes[i].sigma)) for i in has_prior])
    known_covariance = np.tile(np.diag([_MIN_SIGMA**2] * 6), (n, 1, 1))
    graph = FactorGraph(
        vehicle_name=np.array([next(name for name in _PLATFORMS if name not in survey.names)]),
        landmark_name=np.array(survey.names),
        pose_vehicle=np.zeros(n, dtype=np.int32),
        pose_number=np.arange(n, dtype=np.int32),
        pose_time=survey.time[rows] - survey.time[0],
        factors={
            "prior": KINDS["prior"].table(np.arange(n), [platform, unit], known_covariance),
            "survey": KINDS["survey"].table(
                n + np.array(has_prior, dtype=int),
                [[survey.nodes[i].position for i in has_prior]],
                prior,
            ),
            "range": KINDS["range"].table(
                np.column_stack([first, n + survey.node[pings]]), [distance], (half * noise) ** 2
            ),
        },
    )
    return graph, GraphValues(
        position=platform, quaternion=unit, landmark_position=location.positions
    )


def write_location(location: Location, folder: Path) -> list[Path]:
    """
    Write landmarks, GeoJSON, graph, NetCDF and JSON into a folder; return the paths.

    ``location.json`` has the positions with their joint covariance, for `read_campaign`, the tests
    and the displacement since an earlier campaign.

    The graph needs a ping of the platform.
    """
    landmarks = folder / "landmarks.toml"
    landmarks.write_text(landmarks_toml(location), encoding="utf-8")
    nodes = folder / "nodes.geojson"
    nodes.write_text(geojson(location), encoding="utf-8")
    results = folder / "location.nc"
    write_netcdf(dataset(location), results)
    campaign = folder / CAMPAIGN_FILE
    values = summary(location)
    record = {key: values[key] for key in (*_STORED, "unexplained")}
    record["tests"] = values["tests"].to_dict("records")
    write_json(with_checksum(record), campaign)
    if not (location.solution.used & ~location.survey.between_nodes).any():
        return [landmarks, nodes, results, campaign]
    factor_graph, initial = graph(location)
    write_pyfg(factor_graph, folder / "survey.pyfg", initial=initial)
    return [landmarks, nodes, folder / "survey.pyfg", results, campaign]

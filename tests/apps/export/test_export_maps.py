"""Maps and files for ParaView and MATLAB, as other libraries read them."""

import json
import sys
from dataclasses import replace
from xml.etree import ElementTree as ET

import numpy as np
import pyproj
import pytest
import xarray as xr
from factories import names_in
from refusals import refused
from scipy.io import loadmat

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.apps.atlas.dataset import FORMAT, VARIABLES, safety_table
from pymantaray.apps.export import export_run
from pymantaray.apps.export.run_files import record, run_features
from pymantaray.errors import ExchangeError, LocateError, MantaRayError, StudyError, WriteError
from pymantaray.exchange.maps import Feature, geojson, kml
from pymantaray.exchange.matlab import write_mat
from pymantaray.exchange.vtk import write_fleet, write_ranges
from pymantaray.plotting.style import GREY
from pymantaray.records import RayStatus, VehicleStatus

shapely = pytest.importorskip("shapely")
KML = "{http://www.opengis.net/kml/2.2}"
REALIZATION = 1
ORDER = [
    *("name", "TimeSpan", "styleUrl", "ExtendedData"),
    *("Point", "LineString", "Polygon", "MultiGeometry"),
]
"""Elements of a placemark in the order of KML's schema."""


def placemarks(text):
    """Placemarks of a document by folder and name: element and coordinates of its parts."""
    root = ET.fromstring(text)
    out = {}
    for folder in root.iter(f"{KML}Folder"):
        for mark in folder.iter(f"{KML}Placemark"):
            tags = [child.tag.removeprefix(KML) for child in mark]
            assert tags == sorted(tags, key=ORDER.index)
            parts = [
                np.array([[*map(float, word.split(","))] for word in text.text.split()])
                for text in mark.iter(f"{KML}coordinates")
            ]
            key = folder.findtext(f"{KML}name"), mark.findtext(f"{KML}name")
            out.setdefault(key, []).append((mark, parts))
    return out


def features_of(text):
    """Features of a collection, with geometries that shapely has read and finds valid."""
    tree = json.loads(text)
    assert tree["type"] == "FeatureCollection"
    for feature in tree["features"]:
        feature["shape"] = shapely.geometry.shape(feature["geometry"])
        still = np.ptp(shapely.get_coordinates(feature["shape"]), axis=0).max() == 0.0
        assert feature["shape"].is_valid or still  # a vertical line is none for GEOS
        west, _, east, _ = feature["shape"].bounds
        assert west >= -180.0
        assert east <= 180.0
    return tree["features"]


def geodetic(run, position):
    """Longitude, latitude and height of positions, by PROJ."""
    lat, lon = run.truth.centre
    local = pyproj.Proj(proj="sterea", lat_0=lat, lon_0=lon, ellps="WGS84")
    return np.column_stack([*local(position[:, 1], position[:, 0], inverse=True), -position[:, 2]])


def test_names_that_xml_forbids_are_escaped_in_a_valid_document():
    name = "a\x00b\x1b[31m<&>\ufffe"
    shown = r"a\x00b\x1b[31m<&>\ufffe"
    point = Feature("Point", np.array([[8.0, 54.0, 0.0]]), {"name": name, name: name}, name)
    root = ET.fromstring(kml([point], name))
    assert {element.text for element in root.iter(f"{KML}name")} == {shown}
    (data,) = root.iter(f"{KML}Data")
    assert (data.get("name"), data.findtext(f"{KML}value")) == (shown, shown)


def test_maps_have_the_paths_of_all_vehicles(run, tmp_path, as_stored):
    files = {to: tmp_path / f"fleet.{to}" for to in ("geojson", "kml")}
    for to, file in files.items():
        assert export_run(run, to, file, realization=REALIZATION) == file
    features = features_of(files["geojson"].read_text())
    marks = placemarks(files["kml"].read_text())
    as_stored({to: file.read_text() for to, file in files.items()})
    found = {(f["properties"].get("condition"), f["properties"]["name"]): f for f in features}
    truth, estimates = run.truth, run.estimates
    for c, condition in enumerate(["truth", *estimates.condition.tolist()]):
        for i, vehicle in enumerate(truth.name.tolist()):
            position = (
                truth.position[i]
                if condition == "truth"
                else estimates.position[c - 1, REALIZATION, i]
            )
            expected = geodetic(run, position)
            feature = found[condition, vehicle]
            moves = np.ptp(position, axis=0).any()
            assert feature["geometry"]["type"] == ("LineString" if moves else "Point")
            shown = np.atleast_2d(feature["geometry"]["coordinates"])
            expected = expected if moves else expected[:1]
            np.testing.assert_allclose(shown[:, :2], expected[:, :2], rtol=0, atol=2e-9)
            np.testing.assert_allclose(shown[:, 2], expected[:, 2], rtol=0, atol=1e-4)
            if moves:
                np.testing.assert_array_equal(feature["properties"]["time_s"], truth.time)
            ((mark, (line,)),) = marks[condition, vehicle]
            np.testing.assert_array_equal(line, shown)
            assert mark.findtext(f".//{KML}begin") == f"{truth.start.astype('M8[ms]')}Z"
    for name, position in zip(
        run.measurements.landmark_name, run.measurements.landmark_position, strict=True
    ):
        expected = geodetic(run, position[None])[0]
        np.testing.assert_allclose(
            found[None, name]["geometry"]["coordinates"], expected, rtol=0, atol=1e-4
        )
        np.testing.assert_allclose(marks["landmarks", name][0][1][0][0], expected, atol=1e-4)
    assert len(features) == len(marks)


def test_one_pose_is_a_point_and_absence_is_nothing(run):
    recording = record(run, 0)
    status = run.truth.status.copy()
    status[0] = VehicleStatus.ABSENT
    status[1, 1:] = VehicleStatus.ABSENT
    few = replace(recording, truth=replace(run.truth, status=status), estimates={})
    features = features_of(geojson(run_features(run, few)))
    kinds = {f["properties"]["name"]: f["geometry"]["type"] for f in features}
    assert run.truth.name[0] not in kinds
    assert kinds[run.truth.name[1]] == "Point"
    nowhere = replace(recording, truth=replace(run.truth, centre=None))
    refused(ExchangeError, "no geographic position", run_features, run, nowhere)


def test_lines_and_areas_are_cut_at_the_antimeridian(as_stored):
    line = np.array([[178.0, 10.0, -5.0, 0.0], [-178.0, 14.0, -9.0, 8.0], [179.0, 11.0, 0.0, 16.0]])
    area = np.array([[179.0, 0.0], [181.0, 0.0], [181.0, 1.0], [179.0, 1.0]])[::-1]
    features = [
        Feature("LineString", line, {"name": "track"}),
        Feature("Polygon", area, {"name": "cell"}),
        Feature("Polygon", area + np.array([-359.0, 5.0]), {"name": "inside"}),
        Feature("Point", np.array([[190.0, 3.0]]), {"name": "dot"}),
    ]
    track, cell, inside, dot = features_of(geojson(features))
    parts = track["geometry"]["coordinates"]
    assert [len(part) for part in parts] == [2, 3, 2]
    assert parts[0] == [[178.0, 10.0, -5.0], [180.0, 12.0, -7.0]]
    assert parts[1] == [[-180.0, 12.0, -7.0], [-178.0, 14.0, -9.0], [-180.0, 12.0, -3.0]]
    assert track["properties"]["time_s"] == [[0.0, 4.0], [4.0, 8.0, 13.333333], [13.333333, 16.0]]
    assert sorted(part.bounds for part in cell["shape"].geoms) == [
        (-180.0, 0.0, -179.0, 1.0),
        (179.0, 0.0, 180.0, 1.0),
    ]
    for shape in [*cell["shape"].geoms, inside["shape"]]:
        assert shape.exterior.is_ccw
    assert inside["shape"].bounds == (-180.0, 5.0, -178.0, 6.0)
    assert dot["geometry"]["coordinates"] == [-170.0, 3.0]
    ((_, shown),) = placemarks(kml(features, "cut"))["", "track"]
    assert [part.tolist() for part in shown] == parts
    as_stored([track["geometry"], cell["geometry"], dot["geometry"]])


def test_texts_of_users_are_escaped():
    hostile = "</name><b>&\x01"
    feature = Feature("Point", np.zeros((1, 3)), {"name": hostile, "depth_m": np.nan})
    (marks,) = placemarks(kml([feature], hostile)).values()
    ((mark, _),) = marks
    assert mark.findtext(f"{KML}name") == r"</name><b>&\x01"
    assert json.loads(geojson([feature]))["features"][0]["properties"]["depth_m"] is None


@pytest.fixture
def location(tmp_path):
    """Results of a survey with two nodes, one of them with correlated errors."""
    folder = tmp_path / "located"
    folder.mkdir()
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = np.diag([4.0, 1.0, 0.25])
    covariance[3:, 3:] = [[2.5, 1.5, 0.0], [1.5, 2.5, 0.0], [0.0, 0.0, 1.0]]
    campaign = {
        "names": ["M1", "M2"],
        "axes": ["north", "east", "depth"],
        "positions_m": [[100.0, -200.0, 1500.0], [-50.0, 80.0, 1480.0]],
        "covariance_m2": covariance.tolist(),
        "origin_deg": [38.0, 143.0],
        "epoch_utc": "2020-01-01T00:00:00",
        "source": "pings.csv",
    }
    (folder / "location.json").write_text(json.dumps({"campaign": campaign}))
    return folder


def test_located_nodes_become_points_and_ellipses(location, tmp_path):
    local = pyproj.Proj(proj="sterea", lat_0=38.0, lon_0=143.0, ellps="WGS84")
    for source in (location, location / "location.json"):
        file = tmp_path / f"{source.name}.geojson"
        export_run(source, "geojson", file)
        first, ellipse, _, tilted = features_of(file.read_text())
        assert first["properties"]["sigma_north_m"] == 2.0
        lon, lat, height = first["geometry"]["coordinates"]
        np.testing.assert_allclose(local(lon, lat), [-200.0, 100.0], atol=1e-3)
        assert height == -1500.0
        for shape, axes in ((ellipse["shape"], (2.0, 1.0)), (tilted["shape"], (2.0, 1.0))):
            assert shape.exterior.is_ccw
            corners = np.column_stack(local(*np.array(shape.exterior.coords).T))
            area = np.pi * np.prod(axes) * 5.991  # of the 95 % ellipse, by chi-square
            # 72 corners: the inscribed polygon is smaller by 0.13 %
            assert shapely.Polygon(corners).area == pytest.approx(area, rel=2e-3)
        far = np.column_stack(local(*np.array(tilted["shape"].exterior.coords).T)) - [80.0, -50.0]
        longest = far[np.argmax(np.hypot(*far.T))]
        assert abs(longest[0] / longest[1]) == pytest.approx(1.0, abs=0.05)  # to the north-east
    export_run(location, "kml", tmp_path / "nodes.kml")
    marks = placemarks((tmp_path / "nodes.kml").read_text())
    assert {key[0] for key in marks} == {"nodes", "95 % ellipses"}


def test_an_atlas_becomes_cells_with_its_errors(tmp_path, as_stored):
    n_lat, n_lon = 2, 3
    shape = (1, n_lat, n_lon)
    worst = np.arange(48.0).reshape(*shape, 2, 2, 2)  # convention, pair, distance
    lost = np.zeros((*shape, 2, 2))
    lost[..., 0, 0] = 0.25  # of one pair of two, at 1 km
    lost[0, 1, 1, :, 0] = np.nan, 1.0  # one pair is below the sea bed
    status = np.ones(shape, dtype=np.int8)
    status[0, 0, 0] = 0
    place = ("time", "lat", "lon")
    lat, lon = np.array([70.0, 71.0]), np.array([178.0, 180.0, 182.0])
    from pymantaray.apps.atlas.blocks import WATER

    data = xr.Dataset(
        {
            "column_status": (place, np.where(status == 1, WATER, WATER + 1).astype("i1")),
            "worst_range_error": ((*place, "convention", "pair", "distance"), worst),
            "no_direct_path": ((*place, "pair", "distance"), lost),
            "safe_distance": ((*place, "convention", "safe"), np.full((*shape, 2, 1), np.nan)),
            "lat_bounds": (("lat", "bound"), np.stack([lat - 0.5, lat + 0.5], axis=1)),
            "lon_bounds": (("lon", "bound"), np.stack([lon - 1.0, lon + 1.0], axis=1)),
        },
        coords={
            "time": np.array(["2020-01-01"], dtype="datetime64[ns]"),
            "lat": lat,
            "lon": lon,
            "convention": ["nominal", "source"],
            "distance": [1e3, 5e3],
            "safe": [10.0],
        },
        attrs={"format": FORMAT, "title": "Bias"},
    )
    others = {name: (place, np.zeros(shape)) for name in VARIABLES.keys() - set(data.variables)}
    data.assign(others).to_netcdf(tmp_path / "atlas.nc")
    export_run(tmp_path / "atlas.nc", "geojson", tmp_path / "atlas.geojson")
    as_stored(json.loads((tmp_path / "atlas.geojson").read_text()))
    features = features_of((tmp_path / "atlas.geojson").read_text())
    assert len(features) == 5
    seam = next(f for f in features if f["properties"]["name"] == "70.0000, 180.0000")
    assert seam["geometry"]["type"] == "MultiPolygon"
    assert seam["shape"].area == pytest.approx(2.0)
    values = seam["properties"]
    assert values["worst_range_error_source_5000m_m"] == worst[0, 0, 1, 1, 1, 1]
    assert values["mean_no_direct_path_1000m_percent"] == 12.5
    cells = [f["properties"]["mean_no_direct_path_1000m_percent"] for f in features]
    assert sorted(cells) == [12.5] * 4 + [100.0]
    # the table counts a pair at each place: 4 cells of 0.25 and 0, one of 1
    table = safety_table(data)
    assert table["no_direct_path_percent"][0] == pytest.approx(100.0 * 2.0 / 9.0)
    assert np.median(np.delete(worst[0, ..., 0, 1, 0].ravel(), 0)) == table["median_m"][0]
    assert values["safe_distance_nominal_10m_m"] is None
    assert values["time_utc"] == "2020-01-01T00:00:00Z"
    assert len({f["properties"]["fill"] for f in features}) == 5
    export_run(tmp_path / "atlas.nc", "kml", tmp_path / "atlas.kml")
    text = (tmp_path / "atlas.kml").read_text()
    assert len(placemarks(text)) == 5
    assert "<name>2020-01-01T00:00:00Z</name>" in text
    undated = data.assign(others).assign_coords(time=np.array(["NaT"], dtype="datetime64[ns]"))
    undated["worst_range_error"][:] = np.nan  # no direct path anywhere
    undated.to_netcdf(tmp_path / "undated.nc")
    export_run(tmp_path / "undated.nc", "kml", tmp_path / "undated.kml")
    assert "<name>cells</name>" in (tmp_path / "undated.kml").read_text()
    export_run(tmp_path / "undated.nc", "geojson", tmp_path / "undated.geojson")
    features = features_of((tmp_path / "undated.geojson").read_text())
    assert {f["properties"]["fill"] for f in features} == {GREY}


def test_paraview_gets_fleet_residuals_and_rays(run, exported):
    meshio = pytest.importorskip("meshio")
    out = exported("vtk")
    truth, estimates = run.truth, run.estimates
    assert {f"truth-{name}.vtu" for name in truth.name} < set(names_in(out))
    assert json.loads((out / "frame.json").read_text())["axes"] == "east, north, up [m]"
    mesh = meshio.read(out / "refracted-B.vtu")
    c = estimates.condition.tolist().index("refracted")
    north, east, down = estimates.position[c, REALIZATION, 1].T
    np.testing.assert_array_equal(mesh.points, np.column_stack([east, north, -down]))
    n = truth.time.size
    np.testing.assert_array_equal(
        mesh.cells_dict["line"], np.column_stack([np.arange(n - 1), np.arange(1, n)])
    )
    errors = run.errors().query("condition == 'refracted' and realization == 1 and vehicle == 'B'")
    np.testing.assert_allclose(mesh.point_data["error_m"], errors["error"], atol=1e-9)
    heard = run.ranges(REALIZATION).query("status == 'OK'")
    ranges = meshio.read(out / "ranges.vtu")
    assert len(ranges.cells_dict["line"]) == len(heard)
    for name, column in (("range_error_m", heard["refracted_range"] - heard["distance"]),):
        np.testing.assert_allclose(
            np.sort(ranges.cell_data[name][0]), np.sort(column), rtol=0, atol=1e-8
        )
    names = [*truth.name, *run.measurements.landmark_name]
    ends = ranges.points[ranges.cells_dict["line"]]
    data = {name: values[0] for name, values in ranges.cell_data.items()}
    row = heard.reset_index(drop=True).query("receiver in ['A', 'B'] and transmitter == 'C'")
    for _, attempt in row.iterrows():
        k = np.flatnonzero(
            (data["time_s"] == attempt["time"])
            & (np.array(names)[data["transmitter"]] == "C")
            & (np.array(names)[data["receiver"]] == attempt["receiver"])
        ).item()
        assert np.linalg.norm(ends[k, 0] - ends[k, 1]) == pytest.approx(attempt["distance"])
        sample = np.flatnonzero(truth.time == attempt["time"]).item()
        for condition, measured in (("straight", "straight_range"), ("refracted",) * 2):
            e = estimates.position[estimates.condition.tolist().index(condition), REALIZATION]
            apart = np.linalg.norm(e[2, sample] - e["AB".index(attempt["receiver"]), sample])
            expected = attempt[measured.removesuffix("_range") + "_range"] - apart
            assert data[f"residual_{condition}_m"][k] == pytest.approx(expected, abs=1e-8)
    assert not any("odometry" in name for name in data)


def test_absent_vehicles_and_lost_ranges_have_no_vtk_file(run, tmp_path):
    meshio = pytest.importorskip("meshio")
    recording = record(run, 0)
    status = run.truth.status.copy()
    status[0] = VehicleStatus.ABSENT
    status[1, 1:] = VehicleStatus.ABSENT
    m = recording.measurements
    lost = replace(m, range_status=np.full_like(m.range_status, RayStatus.SHADOW))
    truth = replace(run.truth, status=status)
    alone = replace(recording, truth=truth, measurements=lost, estimates={})
    write_fleet(alone, tmp_path)
    write_ranges(alone, {}, tmp_path)
    names = run.truth.name.tolist()
    assert names_in(tmp_path) == sorted(f"truth-{name}.vtu" for name in names[1:])
    assert meshio.read(tmp_path / f"truth-{names[1]}.vtu").cells_dict["vertex"].tolist() == [[0]]


def test_rays_for_paraview_join_the_ends_of_their_links(run, exported):
    meshio = pytest.importorskip("meshio")
    rays = meshio.read(exported("vtk") / "rays.vtu")
    links, arrivals = run.links, run.arrivals
    data = rays.point_data
    assert np.unique(data["arrival"]).tolist() == list(range(arrivals.link.size))
    start, stop = rays.cells_dict["line"].T
    np.testing.assert_array_equal(data["arrival"][start], data["arrival"][stop])
    marks = run.measurements.landmark_position
    everything = np.concatenate(
        [
            run.truth.position,
            np.broadcast_to(marks[:, None], (len(marks), *run.truth.position.shape[1:])),
        ]
    )
    for arrival in (0, arrivals.link.size - 1):
        rows = np.flatnonzero(data["arrival"] == arrival)
        link = arrivals.link[arrival]
        for node, end in ((rows[0], links.first[link]), (rows[-1], links.second[link])):
            north, east, down = everything[end, links.sample[link]]
            np.testing.assert_allclose(rays.points[node], [east, north, -down], atol=0.01)
        time = arrivals.travel_time[arrival]
        assert data["travel_time_s"][rows[-1]] == pytest.approx(time, abs=1e-5)
        medium = Medium.from_dataset(run.ocean, interpolation=run.study.sound.interpolation)
        ends = (everything[e[link], links.sample[link]] for e in (links.first, links.second))
        assert find_eigenrays(medium, *ends).travel_time[0] == pytest.approx(time, abs=1e-6)


def test_matlab_reads_tables_with_their_units(run, exported):
    read = loadmat(exported("mat"), simplify_cells=True)
    assert read["run"]["realization"] == REALIZATION
    assert read["run"]["centre_latitude_deg"] == run.truth.centre[0]
    frames = {"trajectories": run.trajectories(REALIZATION), "ranges": run.ranges(REALIZATION)}
    for title, frame in frames.items():
        table = read[title]
        for name in frame:
            column = frame[name]
            assert name.isidentifier()
            if column.dtype.kind == "M":
                seconds = (column - np.datetime64("1970-01-01")) / np.timedelta64(1, "s")
                np.testing.assert_allclose(table[name], seconds, rtol=0, atol=1e-5)
                assert table["units"][name] == "s since 1970-01-01 UTC"
            else:
                np.testing.assert_array_equal(table[name], column.to_numpy())
                assert table["units"].get(name) == frame.attrs["units"].get(name)
    assert (read["errors"]["error"] >= 0.0).all()


def test_names_in_matlab_are_valid(tmp_path):
    import pandas as pd

    table = pd.DataFrame({"2 m-high ": [1.0], "y" * 80: ["text"]})
    write_mat({"a-b": table}, {"name": "x"}, tmp_path / "x.mat")
    read = loadmat(tmp_path / "x.mat", simplify_cells=True)["a_b"]
    assert set(read) == {"x2_m_high_", "y" * 63, "units"}
    same = pd.DataFrame({"a-b": [1.0], "a_b": [2.0]})
    refused(ExchangeError, "one name in MATLAB", write_mat, {"t": same}, {}, tmp_path / "y.mat")


@pytest.mark.parametrize("to", ["kml", "geojson", "mat"])
def test_an_existing_file_stays(run, tmp_path, to):
    file = tmp_path / f"there.{to}"
    file.write_text("mine")
    refused(WriteError, "already exists", export_run, run, to, file)
    assert file.read_text() == "mine"
    assert names_in(tmp_path) == [file.name]


def test_what_cannot_be_mapped_is_refused_and_leaves_nothing(location, tmp_path, monkeypatch, run):
    out = tmp_path / "out"
    (tmp_path / "other.nc").write_bytes(b"no")
    tree = json.loads((location / "location.json").read_text())
    tree["campaign"]["origin_deg"] = None
    (tmp_path / "nowhere.json").write_text(json.dumps(tree))
    refused(
        LocateError,
        "without latitude and longitude",
        export_run,
        tmp_path / "nowhere.json",
        "kml",
        out,
    )
    refused(
        MantaRayError, "not a readable NetCDF file", export_run, tmp_path / "other.nc", "kml", out
    )
    refused(StudyError, "not a run folder", export_run, tmp_path, "geojson", out)
    refused(StudyError, "not a run folder", export_run, location, "tum", out)
    monkeypatch.setitem(sys.modules, "meshio", None)
    refused(
        ExchangeError,
        r'vtk: meshio is not installed; pip install "pymantaray\[vtk\]"',
        export_run,
        run,
        "vtk",
        out,
    )
    assert names_in(tmp_path) == ["located", "nowhere.json", "other.nc"]

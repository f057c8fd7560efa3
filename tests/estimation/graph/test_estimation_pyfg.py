"""
Factor graphs as text: a round trip without loss, a file written by hand, and one line for each
fault.
"""

import gzip
from dataclasses import replace

import numpy as np
import pytest
from factories import without
from refusals import refused

from pymantaray.apps.graphs import open_graph
from pymantaray.errors import EstimationError
from pymantaray.estimation import GraphSolver, build_graph, read_pyfg, write_pyfg
from pymantaray.estimation.graph.graph import KINDS
from pymantaray.estimation.graph.pyfg import load_pyfg, write_pyfgs
from pymantaray.records import SolveStatus

HAND = """\
VERTEX_SE3:QUAT 0 A0 1 2 3 0 0 0 1
VERTEX_SE3:QUAT 200 A1 11 2 3 0 0 0.6 0.8
VERTEX_XYZ L0 5 6 7
VERTEX_SE3:QUAT:PRIOR 0 A0 1 2 3 0 0 0 1 0.01 0.001 0 0 0 0 0.02 0 0 0 0 0.03 0 0 0 1e-4 2e-5 0 2e-4 0 3e-4
VERTEX_SE3:QUAT:PRIOR 200 A1 11 2 3 0 0 0 1 0.25 0 0 0 0 0 0.36 0 0 0 0 0.49 0 0 0 1e12 0 0 1e12 0 1e12
VERTEX_SE3:QUAT:PRIOR 200 A1 0 0 3.5 0 0 0 1 1e12 0 0 0 0 0 1e12 0 0 0 0 0.0001 0 0 0 1e12 0 0 1e12 0 1e12
VERTEX_XYZ:PRIOR 0 L0 5 6 7 0.5 0.1 0 0.6 0 0.7
EDGE_SE3:QUAT 200 A0 A1 10 0 0 0 0 0.6 0.8 1 0 0 0 0 0.001 2 0 0 0 0 3 0 0 0 1e-6 0 0 2e-6 0 3e-6
EDGE_RANGE 200 A1 L0 8.5 4
"""  # noqa: E501  lines of a file


def assert_same(a, b):
    for name in ("vehicle_name", "landmark_name", "pose_vehicle", "pose_number", "pose_time"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)
    for kind in KINDS:
        for part in ("variables", "measurement", "covariance"):
            same = getattr(a[kind], part), getattr(b[kind], part)
            # depths are ranges of 5e8 m, covariances of fixes are rotated
            atol = {("depth", "measurement"): 1e-7, ("fix", "covariance"): 1e-15}
            np.testing.assert_allclose(
                *same, rtol=0, atol=atol.get((kind, part), 0.0), err_msg=f"{kind} {part}"
            )


def read_text(tmp_path, text):
    path = tmp_path / "graph.pyfg"
    path.write_text(text)
    return read_pyfg(path)


@pytest.mark.parametrize("n_landmarks", [0, 2])
def test_round_trip_keeps_every_bit(tmp_path, make_fleet, n_landmarks):
    fleet = make_fleet(seed=2, n_landmarks=n_landmarks, gnss_every=7, dropouts=0.3)
    graph = build_graph(fleet.noisy, "refracted")
    write_pyfg(graph, tmp_path / "graph.pyfg", initial=fleet.truth)
    again, values = read_pyfg(tmp_path / "graph.pyfg")
    assert_same(graph, again)
    for name in ("position", "quaternion", "landmark_position"):
        np.testing.assert_array_equal(getattr(values, name), getattr(fleet.truth, name))
    assert [p.name for p in tmp_path.iterdir()] == ["graph.pyfg"]


def test_graphs_written_together_have_the_files_of_each_alone(tmp_path, make_fleet):
    fleet = make_fleet(seed=3, n_landmarks=2, gnss_every=7, dropouts=0.3, range_error=5.0)
    straight, refracted = (build_graph(fleet.noisy, ranges) for ranges in ("straight", "refracted"))
    wider = replace(straight["depth"], covariance=4.0 * straight["depth"].covariance)
    graphs = [straight, refracted, straight.with_factors(depth=wider), without(straight, "fix")]
    write_pyfgs({tmp_path / f"{k}": graph for k, graph in enumerate(graphs)}, initial=fleet.truth)
    texts = []
    for k, graph in enumerate(graphs):
        write_pyfg(graph, tmp_path / "alone", initial=fleet.truth)
        texts.append((tmp_path / "alone").read_bytes())
        assert (tmp_path / f"{k}").read_bytes() == texts[k]
    assert len(set(texts)) == len(graphs)


def test_a_compressed_graph_is_the_same_and_a_damaged_one_is_refused(tmp_path, make_fleet):
    """gzip's own program reads what we write, and we read what it writes."""
    fleet = make_fleet(seed=3, n_landmarks=1, gnss_every=7)
    graph = build_graph(fleet.noisy, "straight")
    for name in ("plain.pyfg", "packed.pyfg.gz", "again.pyfg.gz"):
        write_pyfg(graph, tmp_path / name, initial=fleet.truth)
    packed = (tmp_path / "packed.pyfg.gz").read_bytes()
    assert gzip.decompress(packed) == (tmp_path / "plain.pyfg").read_bytes()
    assert packed == (tmp_path / "again.pyfg.gz").read_bytes()
    (tmp_path / "other.pyfg.gz").write_bytes(gzip.compress((tmp_path / "plain.pyfg").read_bytes()))
    for name in ("packed.pyfg.gz", "other.pyfg.gz"):
        assert_same(open_graph(tmp_path / name).graph, graph)
    for content in (packed[: len(packed) // 2], packed[:-5] + b"12345", b"VERTEX", b""):
        (tmp_path / "bad.pyfg.gz").write_bytes(content)
        refused(EstimationError, r"bad\.pyfg\.gz: ", open_graph, tmp_path / "bad.pyfg.gz")


def test_hand_written_file_means_what_it_says(tmp_path):
    graph, values = read_text(tmp_path, HAND)
    assert graph.vehicle_name.tolist() == ["A"]
    assert graph.landmark_name.tolist() == ["L0"]
    np.testing.assert_array_equal(values.quaternion[1], [0.8, 0, 0, 0.6])  # ours has w first
    # rotation comes first in the tangent, last in the file
    prior, edge, fix, depth, ranges = (
        graph[kind] for kind in ("prior", "edge", "fix", "depth", "range")
    )
    np.testing.assert_array_equal(prior.variance[0], [1e-4, 2e-4, 3e-4, 0.01, 0.02, 0.03])
    assert prior.covariance[0, 3, 4] == prior.covariance[0, 4, 3] == 0.001
    assert prior.covariance[0, 0, 1] == 2e-5
    assert (
        edge.covariance[0, 2, 3] == edge.covariance[0, 3, 2] == 0.001
    )  # rotation with translation
    np.testing.assert_array_equal(fix.variance[0], [0.25, 0.36, 0.49])
    assert (depth.subject.tolist(), depth.measurement.tolist(), depth.variance.tolist()) == (
        [1],
        [[3.5]],
        [1e-4],
    )
    assert graph["survey"].covariance[0, 0, 1] == 0.1
    assert (ranges.variables.tolist(), ranges.measurement.tolist(), ranges.variance.tolist()) == (
        [[1, 2]],
        [[8.5]],
        [4.0],
    )
    assert GraphSolver().solve(graph, values).status == SolveStatus.OK
    write_pyfg(graph, tmp_path / "again.pyfg", initial=values)
    text = (tmp_path / "again.pyfg").read_text()
    assert_same(read_text(tmp_path, text)[0], graph)
    above = "VERTEX_XYZ L1 0 0 -5e8\nVERTEX_XYZ:PRIOR 0 L1 0 0 -5e8 1e-6 0 0 1e-6 0 1e-6\n"
    for kept in fields_of(HAND + above):
        is_moved = kept[0] == "VERTEX_SE3:QUAT:PRIOR" and 1e12 in kept  # the fix and the depth
        assert (kept in fields_of(text)) is not is_moved, kept


def fields_of(text):
    """Fields line by line, numbers as numbers."""
    return [
        [float(x) if x[0] in "0123456789-" else x for x in line.split(" ")]
        for line in text.splitlines()
    ]


def test_fix_in_turned_axes_is_turned_into_the_worlds(tmp_path):
    # a quarter turn about down: the file's x axis is the world's east
    turned = HAND.replace(
        "11 2 3 0 0 0 1 0.25", "11 2 3 0 0 0.70710678118654752 0.70710678118654752 0.25"
    )
    graph, _ = read_text(tmp_path, turned)
    np.testing.assert_allclose(graph["fix"].variance[0], [0.36, 0.25, 0.49], rtol=1e-12)


@pytest.mark.parametrize(("line", "old", "new", "message"), [
    (1, "VERTEX_SE3:QUAT", "VERTEX_SE2", r"line 1: VERTEX_SE2 with 10 fields; allowed: 6"),
    (2, "VERTEX_SE3:QUAT ", "VERTEX_SE3:QUAT\t",
        r"line 2: begins with 'VERTEX_SE3:QUAT.t200'; .*one space between"),
    (2, "11 2 3", "11 \u0662 3", r"line 2: VERTEX_SE3:QUAT with a character that is not ASCII"),
    (1, "A0", "A2147483648", r"line 1: VERTEX_SE3:QUAT: number of A2147483648"),
    (2, "11 2 3", "11  2 3", r"line 2: VERTEX_SE3:QUAT with 11 fields; allowed: 10"),
    (2, "11 2 3", "11 two 3", r"line 2: .*could not convert string to float: 'two'"),
    (2, "11 2 3", "11 nan 3", r"line 2: .*not finite"),
    (2, "11 2 3", "1_1 2 3", r"line 2: .*an underscore or a tab"),
    (2, "11 2 3", "1.1e9 2 3", r"line 2: VERTEX_SE3:QUAT with 1.1e\+09; .* at most 1e\+09 m"),
    (2, "0.6 0.8", "0.6 0.9", r"line 2: .*quaternion .*x y z w of length 1"),
    (2, "A1", "A00", r"line 2: second vertex named A0"),
    (2, "A1", "alpha1", r"line 2: name 'alpha1'; allowed: a capital letter"),
    (2, "A1", "L1", r"line 2: VERTEX_SE3:QUAT with landmark L1"),
    (3, "L0", "B0", r"line 3: VERTEX_XYZ with pose B0"),
    (4, " 3e-4", "", r"line 4: VERTEX_SE3:QUAT:PRIOR with 30 fields; allowed: 31"),
    (4, "0.01 0.001", "0.01 0.02",
     r"A0: first-pose prior covariance's eigenvalues, scaled .*is .-0.4"),
    (5, "0.49 0", "1e12 0", r"line 5: pose prior with free axes z rx ry rz"),
    (6, "3.5 0 0 0 1", "3.5 0.6 0 0 0.8", r"line 6: pose prior with free axes .*level axes"),
    (8, "A1", "A7", r"line 8: name A7; allowed: names of the file's vertices"),
    (8, "1 0 0 0 0 0.001", "0 0 0 0 0 0.001", r"A1: odometry variance is .*0,.*positive finite"),
    (9, "A1 L0", "L0 A1", r"line 9: .*the pose first"),
    (9, "A1 L0", "A1 A1", r"line 9: .*from A1 to itself"),
    (9, "A1 L0", "A0001 L99999999999999999999",
     r"line 9: EDGE_RANGE: number of L9+; .* 2147483647"),
    (9, "EDGE_RANGE", "EDGE_SE2_XY", r"line 9: EDGE_SE2_XY in a graph in three dimensions"),
    (9, "8.5 4", "8.5 -4", r"A1: range variance is .-4."),
    (9, "8.5 4", "-8.5 4", r"line 9: EDGE_RANGE with distance -8.5; allowed: 0 or more"),
    (9, "8.5 4", "8.5 4\nFIX 1\nRANGE 2\nFIX 3",
     r"unknown lines: 2 of 'FIX' \(line 10\), 1 of 'RANGE' \(line 11\); allow"),
])  # fmt: skip
def test_fault_is_one_line_that_names_the_place(tmp_path, line, old, new, message):
    lines = HAND.splitlines(keepends=True)
    assert old in lines[line - 1]
    lines[line - 1] = lines[line - 1].replace(old, new, 1)
    refused(EstimationError, message, read_text, tmp_path, "".join(lines))


def test_file_without_a_graph_is_refused(tmp_path):
    for text in ("", HAND.splitlines()[2] + "\n"):
        refused(
            EstimationError,
            "no VERTEX_SE3:QUAT or VERTEX_SE2 in the file",
            read_text,
            tmp_path,
            text,
        )
    refused(
        EstimationError,
        r"none\.pyfg: no such file",
        read_pyfg,
        tmp_path / "none.pyfg",
    )
    refused(EstimationError, "is a folder; name a graph file$", read_pyfg, tmp_path)


def named(graph, *names):
    return replace(graph, vehicle_name=np.array(names))


def test_names_other_than_letters_are_in_a_table_beside_the_file(tmp_path, make_fleet):
    fleet = make_fleet(n_vehicles=3, n_times=6, n_landmarks=1)
    graph = replace(
        named(build_graph(fleet.noisy), "beacon", "float-1", "L"),
        landmark_name=np.array(["buoy_7"]),
    )
    path = tmp_path / "g.pyfg"
    write_pyfg(graph, path, initial=fleet.truth)
    assert path.read_text().splitlines()[0].split()[2] == "A0"
    table = tmp_path / "g.names.csv"
    assert table.read_text().splitlines() == [
        "symbol,name",
        "A,beacon",
        "B,float-1",
        "C,L",
        "L0,buoy_7",
    ]
    again, _ = read_pyfg(path)
    assert_same(again, graph)
    table.rename(tmp_path / "elsewhere.csv")
    assert read_pyfg(path)[0].vehicle_name.tolist() == ["A", "B", "C"]
    # a table belongs to its file: one without names of its own has none
    table.write_text("symbol,name\nA,stale\n")
    write_pyfg(read_pyfg(tmp_path / "g.pyfg")[0], path, initial=fleet.truth)
    write_pyfg(build_graph(fleet.noisy), path, initial=fleet.truth)
    assert not table.exists()
    for odd, message in (
        ("a b", "the name 'a b'"),
        ("../up", "the name '../up'"),
        ("buoy_7", "two equal names"),
    ):
        with pytest.raises(EstimationError, match=message):
            write_pyfg(named(graph, "beacon", odd, "x"), path, initial=fleet.truth)


@pytest.mark.parametrize("rows", [
    "",
    "symbol,name A",
    "symbol,name A,x,y",
    "name,symbol A,x",
    "symbol,name A,x B,x",
    "symbol,name A,../x",
])  # fmt: skip
def test_a_table_of_names_that_is_none_is_refused_by_its_name(tmp_path, rows):
    (tmp_path / "graph.names.csv").write_text("".join(row + "\n" for row in rows.split(" ") if row))
    refused(
        EstimationError,
        r"graph\.names\.csv: not a (readable )?table of names",
        read_text,
        tmp_path,
        HAND,
    )


@pytest.mark.parametrize("n_vehicles", [26, 30])
def test_more_vehicles_than_letters_have_names_of_several(tmp_path, make_fleet, n_vehicles):
    fleet = make_fleet(n_vehicles=2, n_times=n_vehicles)  # as many vehicles of two poses
    many = replace(
        named(
            without(build_graph(fleet.noisy), "edge"),
            *(f"glider-{i:03d}" for i in range(n_vehicles)),
        ),
        pose_vehicle=np.repeat(np.arange(n_vehicles), 2),
        pose_number=np.tile([0, 1], n_vehicles),
    )
    path = tmp_path / "many.pyfg"
    write_pyfg(many, path, initial=fleet.truth)
    assert path.read_text().splitlines()[2].split()[2] == "AB0"
    assert_same(read_pyfg(path)[0], many)
    (tmp_path / "many.names.csv").unlink()
    bare, values = read_pyfg(path)
    assert bare.vehicle_name.tolist()[-1] == {26: "BA", 30: "BE"}[n_vehicles]
    write_pyfg(bare, path, initial=values)  # names that are symbols need no table
    assert [p.name for p in tmp_path.iterdir()] == ["many.pyfg"]
    assert_same(read_pyfg(path)[0], bare)


def test_values_that_do_not_fit_are_refused(tmp_path):
    graph, values = read_text(tmp_path, HAND)
    short = replace(values, position=values.position[:1], quaternion=values.quaternion[:1])
    with pytest.raises(
        EstimationError, match="values for 1 poses and 1 landmarks; the graph has 2 and 1"
    ):
        write_pyfg(graph, tmp_path / "g.pyfg", initial=short)


# as PyFactorGraph's own writer lays a file out: fixed decimals, all vertices first, the odometry of
# each vehicle, then loop closures (one of a vehicle with itself, one between two), sightings and
# ranges; times of factors of their own
LEVEL, TURNED = "0.0000000 0.0000000 0.0000000 1.0000000", "0.0000000 0.0000000 0.7071068 0.7071068"
BACK = "0.0000000 0.0000000 1.0000000 0.0000000"
SPHERE = "0.010000 0.000000 0.000000 0.010000 0.000000 0.010000"
NOISE = " ".join(
    f"{0.01 if i == j < 3 else 0.04 if i == j else 0.0:.6f}" for i in range(6) for j in range(i, 6)
)
FOREIGN = f"""\
VERTEX_SE3:QUAT 0.500000000 A0 0.000000 0.000000 0.000000 {LEVEL}
VERTEX_SE3:QUAT 1.500000000 A1 1.000000 0.000000 0.000000 {TURNED}
VERTEX_SE3:QUAT 2.500000000 A2 1.000000 1.000000 0.000000 {BACK}
VERTEX_SE3:QUAT 0.500000000 B0 0.000000 2.000000 0.500000 {LEVEL}
VERTEX_SE3:QUAT 1.500000000 B1 1.000000 2.000000 0.500000 {LEVEL}
VERTEX_XYZ L0 3.000000 0.000000 1.000000
VERTEX_XYZ L7 0.000000 3.000000 1.000000
VERTEX_SE3:QUAT:PRIOR 0.500000000 A0 0.000000 0.000000 0.000000 {LEVEL} {NOISE}
VERTEX_XYZ:PRIOR 0.500000 L0 3.000000 0.000000 1.000000 {SPHERE}
VERTEX_XYZ:PRIOR 0.500000 L7 0.000000 3.000000 1.000000 {SPHERE}
EDGE_SE3:QUAT 0.750000000 A0 A1 1.000000 0.000000 0.000000 {TURNED} {NOISE}
EDGE_SE3:QUAT 1.750000000 A1 A2 1.000000 0.000000 0.000000 {TURNED} {NOISE}
EDGE_SE3:QUAT 0.750000000 B0 B1 1.000000 0.000000 0.000000 {LEVEL} {NOISE}
EDGE_SE3:QUAT 2.600000000 A2 A0 1.000000 1.000000 0.000000 {BACK} {NOISE}
EDGE_SE3:QUAT 0.600000000 A0 B0 0.000000 2.000000 0.500000 {LEVEL} {NOISE}
EDGE_SE3_XYZ 0.600000000 A0 L0 3.000000 0.000000 1.000000 {SPHERE}
EDGE_RANGE 1.600000000 A1 L0 2.236068 0.010000
EDGE_RANGE 1.600000000 A1 B1 2.061553 0.010000
EDGE_RANGE 1.600000000 L0 L7 4.242641 0.010000
"""


def test_the_truth_of_a_pyfactorgraph_file_is_its_optimum(tmp_path):
    path = tmp_path / "foreign.pyfg"
    path.write_text(FOREIGN)
    graph, values = read_pyfg(path)
    assert graph["sighting"].variables.tolist() == [[0, 5]]
    assert graph.pose_time.tolist() == [0.5, 1.5, 2.5, 0.5, 1.5]
    assert graph.landmark_name.tolist() == ["L0", "L7"]
    edges = [tuple(map(graph.variable_name, ends)) for ends in graph["edge"].variables]
    assert edges == [("A0", "A1"), ("A1", "A2"), ("B0", "B1"), ("A2", "A0"), ("A0", "B0")]
    solution = GraphSolver().solve(graph, values, model_is_right=False)
    assert solution.status == SolveStatus.OK
    assert (
        solution.initial_cost < 1e-8
    )  # the measurements are those of the truth, to their seven digits
    np.testing.assert_allclose(solution.position, values.position, atol=1e-6)


def test_landmarks_keep_their_numbers_despite_trailing_blanks(tmp_path):
    text = "".join(f"{line} \n" for line in FOREIGN.splitlines())
    graph, values = read_text(tmp_path, text.replace("VERTEX_XYZ L7", "VERTEX_XYZ L007"))
    write_pyfg(graph, tmp_path / "again.pyfg", initial=values)
    again, _ = read_pyfg(tmp_path / "again.pyfg")
    assert again.landmark_name.tolist() == ["L0", "L7"]
    assert_same(graph, again)


def test_free_axes_are_written_as_1e12_and_constrain_nothing(tmp_path, make_fleet):
    fleet = make_fleet(n_vehicles=1, n_times=4, gnss_every=1)
    write_pyfg(build_graph(fleet.noisy), tmp_path / "g.pyfg", initial=fleet.truth)
    lines = [x.split() for x in (tmp_path / "g.pyfg").read_text().splitlines() if ":PRIOR" in x]
    corner = np.cumsum([0, 6, 5, 4, 3, 2])  # where the diagonal stands in an upper triangle by rows
    fixes = [line for line in lines if "1000000000000" in line]
    assert len(fixes) == 4
    for line in fixes:
        diagonal = [float(line[10 + i]) for i in corner]
        assert diagonal == [fleet.noisy.gnss_sigma[0] ** 2] * 3 + [1e12] * 3
    fleet = make_fleet(n_vehicles=1, n_times=4)
    write_pyfg(build_graph(fleet.noisy), tmp_path / "g.pyfg", initial=fleet.truth)
    # zero precision, not 1e-12: with that, depths would hold a fleet that nothing else holds across
    loose = without(read_pyfg(tmp_path / "g.pyfg")[0], "prior")
    north = np.array([1.0, 0.0, 0.0])
    near, far = (
        GraphSolver().solve(
            loose, replace(fleet.truth, position=fleet.truth.position + shift * north)
        )
        for shift in (0.0, 2.0**26)  # a power of two: sums stay exact
    )
    assert near.status == far.status == SolveStatus.FAILED
    assert far.initial_cost == pytest.approx(near.initial_cost, rel=1e-3)  # 1e-12 would add 9,000


def test_lines_are_left_out_by_word_and_counted(tmp_path):
    path = tmp_path / "g.pyfg"
    path.write_text(HAND + "FIX 1\nFIX 2\n")
    whole = load_pyfg(path, skip_unknown=True)
    assert whole.left_out == {"FIX": 2}
    file = load_pyfg(path, leave_out=["EDGE_RANGE", "FIX"])
    assert (len(whole.graph["range"]), len(file.graph["range"])) == (1, 0)
    assert file.left_out == {"EDGE_RANGE": 1, "FIX": 2}
    message = "no line begins with 'ranges'; allowed: words of the file"
    refused(EstimationError, message, load_pyfg, path, leave_out=["ranges"], skip_unknown=True)


def test_a_byte_order_mark_blank_lines_and_comments_are_passed_over(tmp_path):
    text = HAND.replace(
        "VERTEX_XYZ L0", "\n# 5 \u00b5m, north\n   \n  # indented\nVERTEX_XYZ L0", 1
    )
    (tmp_path / "g.pyfg").write_text("\ufeff\n# first\n" + text, encoding="utf-8")
    (tmp_path / "plain.pyfg").write_text(HAND)
    assert_same(read_pyfg(tmp_path / "g.pyfg")[0], read_pyfg(tmp_path / "plain.pyfg")[0])


def test_pyfactorgraph_and_we_read_files_of_each_other(tmp_path):
    theirs = pytest.importorskip(
        "py_factor_graph.io.pyfg_text", reason="PyFactorGraph is not installed (it is not on PyPI)"
    )
    (tmp_path / "foreign.pyfg").write_text(FOREIGN)
    graph, values = read_pyfg(tmp_path / "foreign.pyfg")
    of_pose = graph["range"].variables[:, 0] < graph.n_poses  # theirs has none between landmarks
    graph = graph.with_factors(range=graph["range"][of_pose])
    write_pyfg(graph, tmp_path / "ours.pyfg", initial=values)
    read = theirs.read_from_pyfg_text(str(tmp_path / "ours.pyfg"))
    assert [r.dist for r in read.range_measurements] == graph["range"].column("distance").tolist()
    theirs.save_to_pyfg_text(read, str(tmp_path / "theirs.pyfg"))
    again, _ = read_pyfg(tmp_path / "theirs.pyfg")
    for kind in ("edge", "range"):
        np.testing.assert_allclose(again[kind].measurement, graph[kind].measurement, atol=1e-6)

"""
Every kind of factor, and a new one of each form, in every reader: counted with the right weight, or
refused by name.
"""

from dataclasses import replace
from functools import cache, partial

import factories
import numpy as np
import pytest
from refusals import refused

from pymantaray.apps.graphs.chordal_problem import ChordalProblem
from pymantaray.apps.graphs.g2o import load_g2o, write_g2o
from pymantaray.apps.graphs.staircase import certify
from pymantaray.errors import EstimationError
from pymantaray.estimation import build_graph, covariances_at
from pymantaray.estimation.graph.graph import KINDS, POSITION, FactorGraph, check_kinds
from pymantaray.estimation.graph.pyfg import read_pyfg, write_pyfg
from pymantaray.estimation.solve import GraphSolver
from pymantaray.estimation.solvers.influence import factor_influence
from pymantaray.estimation.solvers.losses import Loss
from pymantaray.estimation.solvers.solution import Method
from pymantaray.estimation.solvers.starts import chordal, dead_reckon_graph
from pymantaray.evaluation import DegreesOfFreedom, graph_degrees_of_freedom
from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix, so3_exp

N_TIMES = 6
METHODS = {
    "batch": Method(),
    "robust": Method(loss=Loss("huber", 1.345)),
    "incremental": Method(incremental=True),
    "lag": Method(lag=1e5),
    "incremental lag": Method(lag=1e5, incremental=True),
    "kalman": Method(kalman=True),
    "gtsam": Method(gtsam="converged"),
}
COPIED = sorted(set(KINDS) - {"range"})
PARTS = {
    name: replace(KINDS[like], what=name, plural=f"{name}s", axes=axes, source=None)
    for name, like, axes in [
        ("heading", "attitude", (2,)),
        ("tilt", "attitude", (0, 1)),
        ("plane fix", "fix", (3, 4)),
        ("speed", "dvl", (3,)),
    ]
}
"""Kinds that measure some axes of the columns of another kind."""
OTHERS = {
    **PARTS,
    "pose": replace(KINDS["prior"], what="pose", plural="poses", word=None, axes=()),
    "step": replace(KINDS["edge"], what="step", plural="steps", word=None),
}


@pytest.fixture(scope="module")
def fleet():
    return factories.make_fleet(n_vehicles=1, n_times=N_TIMES, n_landmarks=1)


@pytest.fixture(scope="module")
def graph(fleet):
    return build_graph(fleet.noisy, "straight")


@pytest.fixture(scope="module")
def before(graph, fleet):
    """What a reader says of the graph before a factor is added, computed once for all tests."""
    return cache(lambda reader: refusal(READERS[reader], bare(graph, reader), fleet.truth))


@pytest.fixture(params=COPIED)
def copied(request, monkeypatch):
    """Name of a kind, of which "new" is a copy that files cannot hold."""
    kind = replace(
        KINDS[request.param], what="new", plural="new ones", word=None, axes=(), source=None
    )
    monkeypatch.setattr("pymantaray.estimation.graph.graph.KINDS", {**KINDS, "new": kind})
    return request.param


@pytest.fixture
def part(monkeypatch):
    """Kinds of parts, in graphs and in text."""
    kinds = {**{name: KINDS[name] for name in COPIED}, **OTHERS, "range": KINDS["range"]}
    for module in ("graph.graph", "graph.pyfg", "solvers.influence"):
        monkeypatch.setattr(f"pymantaray.estimation.{module}.KINDS", kinds)


def one_more(graph, name, truth, like=None, error=1.0):
    """
    One factor, of the last pose or the landmark, that measures 1 m and 0.1 rad more than the truth,
    times ``error``.
    """
    kind, n = {**KINDS, **OTHERS}[like or name], graph.n_poses
    last = n if kind.ends[-1] == "landmark" else n - 1
    ends = [n - 2 if kind.ends == ("pose", "pose") else 0, last][-len(kind.ends) :]
    place = np.concatenate([truth.position, truth.landmark_position])
    turn = matrix_from_quaternion(truth.quaternion)
    stride, rotation = place[last], turn[min(last, n - 1)]
    if len(ends) == 2:
        stride, rotation = turn[ends[0]].T @ (stride - place[ends[0]]), turn[ends[0]].T @ rotation
    measured = {
        "position": stride + error,
        "quaternion": quaternion_from_matrix(
            rotation @ so3_exp(error * np.array([0.05, 0.0, 0.1]))
        ),
        "depth": stride[2] + error,
        "distance": np.linalg.norm(stride) + error,
    }
    columns = [[measured[column]] for column, _, _ in kind.columns]
    table = kind.table([ends], columns, [uneven(kind.rows)])
    new = graph[name].kind
    return graph.with_factors(**{name: graph[name].append(replace(table, kind=new))})


def uneven(rows):
    """Covariance with a standard deviation of its own for each row, and correlations."""
    sigma = 1e-3 * 2.0 ** np.arange(rows)
    correlation = np.where(
        np.eye(rows, dtype=bool), 1.0, 0.5 * (-1.0) ** np.add.outer(*[np.arange(rows)] * 2)
    )
    return sigma[:, None] * correlation * sigma


def solved(graph, truth, method):
    """Estimate of a method as one vector; a refusal is its message."""
    try:
        solution = GraphSolver().solve(graph, truth, method=method, model_is_right=False)
    except EstimationError as error:
        return str(error)
    assert solution.usable, (method, solution.status)
    return np.concatenate(
        [
            solution.position.ravel(),
            matrix_from_quaternion(solution.quaternion).ravel(),
            solution.landmark_position.ravel(),
        ]
    )


def covered(graph, truth):
    """Covariances of all poses, as in the bound of a study."""
    return covariances_at(graph, truth, np.arange(graph.n_poses)[:, None]).pose


def certified(graph, truth):
    """Cost of the certificate's problem, or why there is no certificate."""
    certificate = certify(graph, truth)
    return certificate.reason or np.array([certificate.cost])


def influential(graph, truth):
    """Whitened residuals and leverages of all factors, kind by kind."""
    solution = GraphSolver().solve(graph, truth, model_is_right=False)
    kinds = [name for name, table in graph.tables.items() if len(table)]
    table = factor_influence(graph, solution.values, kinds=kinds)
    assert table["kind"].value_counts().to_dict() == {
        kind.kind.what: len(kind) for kind in graph.tables.values() if len(kind)
    }
    return table[["residual_sigmas", "leverage"]].to_numpy().ravel()


def in_text(graph, truth, folder):
    """Numbers of factors of each kind after a file of PyFactorGraph text."""
    write_pyfg(graph, folder / "a.pyfg", initial=truth)
    return counts(read_pyfg(folder / "a.pyfg")[0])


def in_g2o(graph, truth, folder):
    """Numbers of factors of each kind after a g2o file."""
    write_g2o(graph, folder / "a.g2o", initial=truth, leave_out=["landmarks"])
    return counts(load_g2o(folder / "a.g2o").graph)


def in_netcdf(graph, _truth, _folder):
    """Numbers of factors of each kind after a data set, as a NetCDF file holds it."""
    return counts(FactorGraph.from_dataset(graph.to_dataset()))


def counts(graph):
    return np.array([len(table) for table in graph.tables.values()])


READERS = {
    **{name: partial(solved, method=method) for name, method in METHODS.items()},
    "freedom": lambda graph, _: graph.degrees_of_freedom,
    "bound": covered,
    "certificate": certified,
    "influence": influential,
}
FILES = {"PyFactorGraph text": in_text, "g2o": in_g2o, "NetCDF": in_netcdf}


def bare(graph, reader):
    """The graph less what hides the effect of a new factor from a reader."""
    depths = [name for name in KINDS if KINDS[name].is_depth]
    return factories.without(graph, *depths) if reader == "certificate" else graph


def refusal(read, *arguments):
    try:
        return read(*arguments)
    except EstimationError as error:
        return str(error)


@pytest.mark.parametrize("reader", [*READERS, *FILES])
@pytest.mark.parametrize("kind", sorted(KINDS))
def test_every_reader_counts_a_kind_or_refuses_it_by_name(
    graph, fleet, before, kind, reader, tmp_path
):
    more = one_more(bare(graph, reader), kind, fleet.truth)
    plural = KINDS[kind].plural
    if reader in READERS:
        after = refusal(READERS[reader], more, fleet.truth)
        if isinstance(after, str):
            assert plural in after or f"one {kind} " in after, (reader, after)
            return
        assert not isinstance(before(reader), str), (reader, before(reader))
        one, other = np.asarray(before(reader)), np.asarray(after)
        changed = one.shape != other.shape or not np.allclose(one, other, rtol=1e-9, atol=0)
        assert changed, f"{reader} ignores {plural}"
        return
    if reader == "g2o":  # holds no other kind of this graph than odometry
        more = factories.without(more, *set(KINDS) - {kind, "edge"})
    written = refusal(FILES[reader], more, fleet.truth, tmp_path)
    if isinstance(written, str):
        assert plural in written, (reader, written)
        return
    np.testing.assert_array_equal(written, counts(more))


def test_a_new_kind_of_factor_counts_by_its_form_in_every_solver(graph, fleet, before, copied):
    """
    As in the kind of which it is a copy; a solver that ignores it would leave the estimate where it
    is.
    """
    known, new = (one_more(graph, name, fleet.truth, copied) for name in (copied, "new"))
    for name, method in METHODS.items():
        one, other = (solved(g, fleet.truth, method) for g in (known, new))
        if isinstance(other, str):
            assert "new ones" in other, (name, other)
            continue
        assert np.abs(other - before(name)).max() > 0.01, (name, "is ignored")
        if not isinstance(one, str):
            # iSAM2 relinearizes above a threshold, and starts at the priors of first poses
            np.testing.assert_allclose(
                other, one, rtol=0, atol=5e-3 if method.incremental else 1e-5, err_msg=name
            )


@pytest.mark.parametrize("name", ["fix", "attitude", "dvl", "sighting", *OTHERS])
def test_solvers_rotate_uneven_covariances_alike(fleet, part, name):
    """
    The last pose after a small error, so that a filter, GTSAM and a batch solve have one answer;
    standard deviations differ by axis, and no vehicle is level.
    """
    graph = build_graph(fleet.noise_free, "straight")
    more = one_more(graph, name, fleet.truth, error=1e-3)
    shifts = {}
    for method in ("batch", "kalman", "gtsam", "incremental"):
        one, other = (solved(g, fleet.truth, METHODS[method]) for g in (graph, more))
        if isinstance(other, str):
            assert more[name].kind.plural in other, (method, other)
            continue
        shifts[method] = (other - one)[: 3 * graph.n_poses][-3:]  # of the last position
    moved = np.abs(shifts["batch"]).max()
    assert moved > 1e-5
    for method, shift in shifts.items():
        np.testing.assert_allclose(
            shift, shifts["batch"], rtol=0, atol=0.01 * moved, err_msg=method
        )


@pytest.mark.parametrize("name", PARTS)
def test_a_part_counts_its_axes_alone(fleet, part, name, tmp_path):
    """As the whole with variances that leave the other axes free; in text as well."""
    graph = build_graph(fleet.noisy, "straight")
    kind = PARTS[name]
    like = next(k for k, v in KINDS.items() if v.columns == kind.columns and v.ends == kind.ends)
    more = one_more(graph, name, fleet.truth)
    (ends,), (row,) = more[name].variables, more[name].measurement
    covariance = 1e12 * np.eye(3)
    covariance[np.ix_(kind.measured, kind.measured)] = more[name].covariance[0]
    free = KINDS[like].table(ends, [row], covariance)
    whole = graph.with_factors(**{like: graph[like].append(free)})
    for method in ("batch", "kalman", "gtsam", "lag"):
        one, other = (solved(g, fleet.truth, METHODS[method]) for g in (more, whole))
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-5, err_msg=method)
    one, other = (GraphSolver().solve(g, fleet.truth, model_is_right=False) for g in (more, whole))
    assert one.final_cost == pytest.approx(other.final_cost, rel=1e-9)
    n_axes = len(kind.axes)
    assert more.degrees_of_freedom == graph.degrees_of_freedom + n_axes
    assert whole.degrees_of_freedom == graph.degrees_of_freedom + 3
    one, other = (
        factor_influence(g, one.values, kinds=[k])[["residual_sigmas", "leverage"]].iloc[-1]
        for g, k in ((more, name), (whole, like))
    )
    np.testing.assert_allclose(one * [1, n_axes], other * [1, 3], rtol=1e-5)  # a mean over rows
    write_pyfg(more, tmp_path / "a.pyfg", initial=fleet.truth)
    back = read_pyfg(tmp_path / "a.pyfg")[0]
    np.testing.assert_array_equal(counts(back), counts(more))
    np.testing.assert_allclose(back[name].covariance, more[name].covariance, rtol=1e-12)
    np.testing.assert_allclose(back[name].measurement, row[None], rtol=0, atol=1e-12)


def test_covariances_and_freedom_count_a_new_kind(graph, fleet, copied):
    known, new = (one_more(graph, name, fleet.truth, copied) for name in (copied, "new"))
    truth = fleet.truth
    poses = np.arange(graph.n_poses)[:, None]
    one, other, less = (covariances_at(g, truth, poses).pose for g in (known, new, graph))
    np.testing.assert_allclose(other, one, rtol=1e-6, atol=1e-12)
    fell = (1.0 - np.diagonal(other[-1, 0]) / np.diagonal(less[-1, 0])).max()
    assert fell > 1e-6 or copied == "survey"
    assert known.degrees_of_freedom == new.degrees_of_freedom > graph.degrees_of_freedom
    assert graph_degrees_of_freedom(new, truth) == pytest.approx(
        graph_degrees_of_freedom(known, truth), rel=1e-6
    )


def test_the_certificate_counts_a_new_kind_or_says_that_it_cannot(graph, fleet, before, copied):
    alone = bare(graph, "certificate")
    known, new = (one_more(alone, name, fleet.truth, copied) for name in (copied, "new"))
    one, other = certify(known, fleet.truth), certify(new, fleet.truth)
    if KINDS[copied].is_depth:
        assert not one.certified
        assert not other.certified
        assert other.reason == "new ones are not quadratic in the relaxation"
        refused(EstimationError, "cannot hold new ones", ChordalProblem, new)
        return
    assert other.cost == pytest.approx(one.cost, rel=1e-9)
    assert other.cost > before("certificate")[0] + 1e-3
    assert other.certified == one.certified


def test_the_bound_of_dead_reckoning_leaves_out_a_new_sensor(monkeypatch):
    fleet = factories.make_fleet(n_vehicles=1, n_times=N_TIMES, n_landmarks=1, gnss_every=2)
    truth = factories.trajectories(
        fleet.position, time=fleet.noise_free.time, quaternion=fleet.quaternion
    )
    before = {
        name: DegreesOfFreedom(truth, fleet.noise_free, name).fleet
        for name in ("odometry", "straight")
    }
    kind = replace(KINDS["fix"], what="new", plural="new ones", word=None)
    monkeypatch.setattr("pymantaray.estimation.graph.graph.KINDS", {**KINDS, "new": kind})
    monkeypatch.setattr("pymantaray.estimation.graph.build.KINDS", {**KINDS, "new": kind})
    after = {name: DegreesOfFreedom(truth, fleet.noise_free, name).fleet for name in before}
    assert after["odometry"] == pytest.approx(before["odometry"], rel=1e-9)
    assert after["straight"] != pytest.approx(before["straight"], rel=1e-6)


def test_starts_use_a_new_kind_as_one_of_its_form(graph, fleet, copied):
    known, new = (one_more(graph, name, fleet.truth, copied) for name in (copied, "new"))
    if copied in ("prior", "edge"):  # starts use those of odometry and of first poses alone
        return
    for start in (chordal, dead_reckon_graph):
        one, other = (start(g, fleet.truth).values for g in (known, new))
        np.testing.assert_allclose(other.position, one.position, rtol=0, atol=1e-6)


def test_files_hold_a_new_kind_or_say_that_they_cannot(graph, fleet, copied, tmp_path):
    new = one_more(graph, "new", fleet.truth, copied)
    line = "cannot hold 1 new ones"
    refused(EstimationError, line, write_pyfg, new, tmp_path / "a.pyfg", initial=fleet.truth)
    refused(EstimationError, "1 new ones", write_g2o, new, tmp_path / "a.g2o", initial=fleet.truth)
    back = FactorGraph.from_dataset(new.to_dataset())
    np.testing.assert_array_equal(back["new"].measurement, new["new"].measurement)


@pytest.mark.parametrize("name", sorted(name for name, kind in KINDS.items() if kind.word))
def test_text_holds_each_factor_once(graph, fleet, name, tmp_path):
    more = one_more(graph, name, fleet.truth)
    write_pyfg(more, tmp_path / "a.pyfg", initial=fleet.truth)
    back, _ = read_pyfg(tmp_path / "a.pyfg")
    assert {k: len(table) for k, table in back.tables.items()} == {
        k: len(t) for k, t in more.tables.items()
    }
    n_lines = len((tmp_path / "a.pyfg").read_text().splitlines())
    assert n_lines == more.n_variables + more.n_factors + 2  # a landmark above, and its prior


def test_a_data_set_with_a_kind_of_another_version_is_refused(graph, fleet, monkeypatch):
    kind = replace(KINDS["depth"], what="new", plural="new ones", word=None)
    with monkeypatch.context() as patch:
        patch.setattr("pymantaray.estimation.graph.graph.KINDS", {**KINDS, "new": kind})
        data = one_more(graph, "new", fleet.truth, "depth").to_dataset()
    refused(
        EstimationError,
        "factors of a kind 'new'; this version has prior,",
        FactorGraph.from_dataset,
        data,
    )


@pytest.mark.parametrize(("changes", "message"), [
    ({}, "kinds depth and new have the same word VERTEX_SE3:QUAT:PRIOR and axes in files"),
    ({"axes": (4,)}, "kind new: axes .4,. of z; allowed: rising indices of these in rx"),
    ({"ends": ("landmark",), "columns": (POSITION,), "word": None, "axes": (3, 4)},
     "kind new: x, y of landmark; allowed: a whole position, as starting values need"),
    ({"axes": ()}, "kind new: lines of .* cannot hold z of pose"),
    ({"word": "EDGE_DEPTH"}, "kind new: lines of EDGE_DEPTH"),
    ({"word": None, "plural": "depth priors"},
     "kinds depth and new have the same name depth priors"),
    ({"word": None, "what": "depth"}, "kinds depth and new have the same name depth"),
])  # fmt: skip
def test_kinds_that_a_file_cannot_tell_apart_are_refused(
    graph, fleet, monkeypatch, changes, message
):
    kind = replace(KINDS["depth"], **{"what": "new", "plural": "new ones", **changes})
    monkeypatch.setattr("pymantaray.estimation.graph.graph.KINDS", {**KINDS, "new": kind})
    refused(EstimationError, message, check_kinds)
    refused(EstimationError, message, GraphSolver().solve, graph, fleet.truth)

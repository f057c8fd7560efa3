"""
Solver-free factor graph: its variables, and for each kind of factor one table.

One entry of `KINDS` adds a kind of factor: its columns and ends determine its `Residual`, and
thereby batch and incremental solves, checks, NetCDF and PyFactorGraph files, degrees of freedom,
covariances and diagnoses. `check_kinds` refuses a kind without a fitting residual, and kinds that
files cannot tell apart. `build.build_graph` makes a graph from measurements.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property
from itertools import pairwise
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pymantaray.arrays import Array, Indices, Mask
from pymantaray.errors import EstimationError
from pymantaray.geometry.se3 import lengths
from pymantaray.records.base import Column, Record, column

if TYPE_CHECKING:
    import xarray as xr


LARGEST = 1e9  # m; the cost of larger values has no significant digits left
VARIANCES = (1e-30, 1e30)  # m2 or rad2; other values overflow in a solve
QUATERNION_TOLERANCE = 1e-3  # on its length
SMALLEST_EIGENVALUE = 1e-12  # of a correlation matrix; below, its inverse has no significant digits

POSITION = ("position", 3, "m")
QUATERNION = ("quaternion", 4, "1")  # body to world, or end to start; (w, x, y, z)
_ROWS = {
    "quaternion": ("rx", "ry", "rz"),
    "position": ("x", "y", "z"),
    "depth": ("z",),
    "distance": ("distance",),
}
_FIRST = list(_ROWS)  # rotation before others
_UNITS = {
    row: "rad" if name == "quaternion" else "m" for name, rows in _ROWS.items() for row in rows
}
OUT_OF_PLANE = ("rx", "ry", "z")  # of a graph in two dimensions


class Residual(Enum):
    """Residuals that all solvers implement; each kind of factor has one."""

    # of a pose in another pose or in the world; in the world also its rotation alone
    POSE = "relative pose"
    # of the position of a landmark or of another pose in the body frame of a pose
    SIGHTING = "sighting"
    POSITION = "position"  # of a pose or a landmark in the world, or a pose's depth alone
    DISTANCE = "distance"  # between two variables


_RESIDUALS = {  # by the ends and the columns that are measured
    (("pose",), ("position", "quaternion")): Residual.POSE,
    (("pose",), ("quaternion",)): Residual.POSE,
    (("pose", "pose"), ("position", "quaternion")): Residual.POSE,
    (("pose", "landmark"), ("position",)): Residual.SIGHTING,
    (("pose", "pose"), ("position",)): Residual.SIGHTING,
    (("pose",), ("position",)): Residual.POSITION,
    (("landmark",), ("position",)): Residual.POSITION,
    (("pose",), ("depth",)): Residual.POSITION,
    (("any", "any"), ("distance",)): Residual.DISTANCE,
}


class FactorSource(NamedTuple):
    """
    Columns of `Measurements` with the factors of a sensor, one row per vehicle and sample.

    A factor between two poses is between the pose at the sample and the next one. A ``rate`` is per
    second: it and its standard deviation are multiplied by the time between these poses.
    """

    vehicle: str
    sample: str
    columns: tuple[str, ...]
    sigma: str
    rate: bool = False


@dataclass(frozen=True)
class FactorKind:
    """Definition of one kind of factor."""

    what: str  # its name in messages
    plural: str
    # types of its variables: "pose", "landmark", "any"; a pose comes before a landmark
    ends: tuple[str, ...]
    columns: tuple[tuple[str, int, str], ...]  # measured columns: name, width and unit
    # that begins its lines in PyFactorGraph text; None if this text cannot hold it
    word: str | None
    axes: tuple[int, ...] = ()  # measured ones of rx ry rz x y z; default: all of the columns
    anchors: bool = False  # true if it ties its variable to the world
    reckons: bool = False  # true if dead reckoning uses it: first poses, steps and landmarks
    named_after: int = 0  # index of the variable that messages name
    source: FactorSource | None = None  # of factors that `build_graph` makes without further steps

    @property
    def residual(self) -> Residual:
        """Residual that fits the ends and columns; an error if there is none."""
        shape = self.ends, tuple(sorted(self.columns_at))
        if shape not in _RESIDUALS:
            fitting = (
                f"{' and '.join(columns)} of {' and '.join(ends)}" for ends, columns in _RESIDUALS
            )
            raise EstimationError(
                f"{self.what}: no residual for {' and '.join(shape[1])} of"
                f" {' and '.join(self.ends)}; allowed: {', '.join(fitting)}"
            )
        return _RESIDUALS[shape]

    @property
    def is_depth(self) -> bool:
        """True if it measures the down coordinate alone."""
        return "depth" in self.columns_at

    @property
    def column_rows(self) -> tuple[str, ...]:
        """
        Names of the rows that the columns have: three for a quaternion, in the tangent of the body,
        then others.
        """
        names = [name for name, _, _ in self.columns]
        return tuple(row for name in sorted(names, key=_FIRST.index) for row in _ROWS[name])

    @cached_property
    def measured(self) -> list[int]:
        """Indices in `column_rows` of the rows that are measured: those of the axes."""
        axes = {_ALL_AXES[axis] for axis in self.axes}
        return [i for i, row in enumerate(self.column_rows) if not axes or row in axes]

    @cached_property
    def rows(self) -> int:
        """Number of measured rows, which is the size of a covariance."""
        return len(self.measured)

    @property
    def is_partial(self) -> bool:
        """True if it measures a part of a position or of a rotation alone."""
        return self.is_depth or self.rows < len(self.column_rows)

    @property
    def row_names(self) -> tuple[str, ...]:
        """Name of each measured row."""
        return tuple(self.column_rows[i] for i in self.measured)

    @cached_property
    def columns_at(self) -> dict[str, slice]:
        """Slice of the measured numbers for each column."""
        edges = np.cumsum([0, *(width for _, width, _ in self.columns)]).tolist()
        names = (name for name, _, _ in self.columns)
        return {name: slice(*ends) for name, ends in zip(names, pairwise(edges), strict=True)}

    def rows_in(self, units: str, *, planar: bool) -> list[int]:
        """
        Measured rows in "rad", in "m" or in either; of a planar graph only the rows in the plane.
        """
        return [
            i
            for i, name in enumerate(self.row_names)
            if _UNITS[name] in units.split() and not (planar and name in OUT_OF_PLANE)
        ]

    def table(
        self, variables: ArrayLike, measurement: Sequence[ArrayLike], covariance: ArrayLike
    ) -> "Factors":
        """
        Factors of this kind, of variables (n, ends), columns (n, width) and covariances (n, rows,
        rows).
        """
        return self.owning_table(variables, measurement, np.array(covariance, dtype=float))

    def owning_table(
        self, variables: ArrayLike, measurement: Sequence[ArrayLike], covariance: Array
    ) -> "Factors":
        """Factors as by `table`, with these covariances themselves, which become read-only."""
        ends = np.array(variables, dtype=np.int32).reshape(-1, len(self.ends))
        blocks = [
            np.asarray(values, dtype=float).reshape(-1, width)
            for values, (_, width, _) in zip(measurement, self.columns, strict=True)
        ]
        matrices = covariance.reshape(-1, self.rows, self.rows)
        return Factors(self, ends, np.concatenate(blocks, axis=1), matrices)


POSE_PRIOR = "VERTEX_SE3:QUAT:PRIOR"
LANDMARK_PRIOR = "VERTEX_XYZ:PRIOR"
EDGE = "EDGE_SE3:QUAT"
SIGHTING = "EDGE_SE3_XYZ"
RANGE = "EDGE_RANGE"
_ENDS = {  # of the lines of each word
    POSE_PRIOR: ("pose",),
    LANDMARK_PRIOR: ("landmark",),
    EDGE: ("pose", "pose"),
    SIGHTING: ("pose", "landmark"),
    RANGE: ("any", "any"),
}
_ALL_AXES = ("rx", "ry", "rz", "x", "y", "z")  # of a pose prior and of an edge

KINDS: Mapping[str, FactorKind] = MappingProxyType(
    {
        "prior": FactorKind(
            "first-pose prior",
            "pose priors",
            ("pose",),
            (POSITION, QUATERNION),
            POSE_PRIOR,
            axes=(0, 1, 2, 3, 4, 5),
            anchors=True,
            reckons=True,
        ),
        "fix": FactorKind(
            "GNSS fix",
            "fixes",
            ("pose",),
            (POSITION,),
            POSE_PRIOR,
            axes=(3, 4, 5),
            anchors=True,
            source=FactorSource("gnss_vehicle", "gnss_sample", ("gnss_position",), "gnss_sigma"),
        ),
        "depth": FactorKind(
            "depth", "depth priors", ("pose",), (("depth", 1, "m"),), POSE_PRIOR, axes=(5,)
        ),
        "survey": FactorKind(
            "landmark prior",
            "landmark priors",
            ("landmark",),
            (POSITION,),
            LANDMARK_PRIOR,
            anchors=True,
            reckons=True,
        ),
        "edge": FactorKind(
            "odometry",
            "odometry",
            ("pose", "pose"),
            (POSITION, QUATERNION),
            EDGE,
            named_after=1,
            reckons=True,
        ),
        "attitude": FactorKind(
            "attitude",
            "attitudes",
            ("pose",),
            (QUATERNION,),
            POSE_PRIOR,
            axes=(0, 1, 2),
            source=FactorSource(
                "attitude_vehicle", "attitude_sample", ("attitude_quaternion",), "attitude_sigma"
            ),
        ),
        "dvl": FactorKind(
            "DVL velocity",
            "DVL velocities",
            ("pose", "pose"),
            (POSITION,),
            EDGE,
            axes=(3, 4, 5),
            named_after=1,
            source=FactorSource(
                "dvl_vehicle", "dvl_sample", ("dvl_velocity",), "dvl_sigma", rate=True
            ),
        ),
        "altimeter": FactorKind(
            "altimeter depth",
            "altimeter depths",
            ("pose",),
            (("depth", 1, "m"),),
            None,
            source=FactorSource(
                "altimeter_vehicle", "altimeter_sample", ("altimeter_depth",), "altimeter_sigma"
            ),
        ),
        "sighting": FactorKind(
            "sighting", "sightings", ("pose", "landmark"), (POSITION,), SIGHTING
        ),
        "range": FactorKind("range", "ranges", ("any", "any"), (("distance", 1, "m"),), RANGE),
    }
)
"""All kinds of factors; ranges are last, because only they differ between conditions."""


@dataclass(frozen=True, eq=False)
class Factors:
    """All factors of one kind, row by row; ``factors[rows]`` selects rows."""

    kind: FactorKind
    variables: Indices  # (n, ends)
    measurement: Array  # (n, columns); by name with `column`
    covariance: Array  # (n, rows, rows) [rad2, m2]

    def __post_init__(self) -> None:
        """Check shapes and freeze."""
        tables = self.variables, self.measurement, self.covariance
        if len({len(table) for table in tables}) != 1:
            sizes = " and ".join(str(len(table)) for table in tables)
            raise EstimationError(
                f"{self.kind.what}: {sizes} rows of variables, measurements and covariances; their"
                " numbers must be equal"
            )
        for table in tables:
            table.setflags(write=False)

    def __len__(self) -> int:
        """Number of factors."""
        return len(self.variables)

    def __getitem__(self, rows: ArrayLike | slice) -> "Factors":
        """Select factors, in the order of the rows."""
        some = rows if isinstance(rows, slice) else np.asarray(rows)
        return Factors(
            self.kind, self.variables[some], self.measurement[some], self.covariance[some]
        )

    def column(self, name: str) -> Array:
        """One measured column; shape (n,) for a number, else (n, width)."""
        values = self.measurement[:, self.kind.columns_at[name]]
        return values[:, 0] if values.shape[1] == 1 else values

    def with_columns(self, **columns: Array) -> "Factors":
        """Copy with some measured columns replaced."""
        measurement = self.measurement.copy()
        for name, values in columns.items():
            measurement[:, self.kind.columns_at[name]] = values.reshape(len(self), -1)
        return Factors(self.kind, self.variables, measurement, self.covariance)

    @property
    def variance(self) -> Array:
        """Diagonals of the covariances; shape (n,) of a single row, else (n, rows)."""
        diagonal = np.diagonal(self.covariance, axis1=1, axis2=2)
        return np.asarray(diagonal[:, 0] if self.kind.rows == 1 else diagonal)

    @property
    def subject(self) -> Indices:
        """Variables that messages name, shape (n,)."""
        return self.variables[:, self.kind.named_after]

    def append(self, more: "Factors") -> "Factors":
        """Append factors of the same kind."""
        return Factors(
            self.kind,
            np.concatenate([self.variables, more.variables]),
            np.concatenate([self.measurement, more.measurement]),
            np.concatenate([self.covariance, more.covariance]),
        )


@dataclass(frozen=True, eq=False)
class GraphValues(Record):
    """
    Values of all variables of a `FactorGraph`: starting values or an estimate.

    Examples
    --------
    Continues the example of `pymantaray.estimation`:

    >>> from pymantaray.estimation import GraphSolver, GraphValues
    >>> values = GraphValues(
    ...     truth.position.reshape(-1, 3), truth.quaternion.reshape(-1, 4), np.empty((0, 3))
    ... )
    >>> GraphSolver().solve(graph, values).status.name
    'OK'
    """

    kind: ClassVar[str] = "graph_values"

    position: Column = column("pose axis", "m", "north, east, down in the local frame")
    quaternion: Column = column("pose quat", "1", "rotation body to world, (w, x, y, z)")
    landmark_position: Column = column("landmark axis", "m", "landmark position")


@dataclass(frozen=True, eq=False)
class FactorGraph(Record):
    """
    Variables and factors of one estimation problem, independent of any solver.

    A variable is a number: a row of the pose tables, or the number of poses plus a row of
    ``landmark_name``. ``graph["range"]`` is the table of one kind of `KINDS`, empty if there is
    none. Covariances of poses are in the tangent of the body, rotation before translation,
    perturbed from the right; those of positions are in the world's axes, those of sightings (a
    landmark's position relative to a pose) in the body's.

    A ``planar`` graph is two-dimensional: its poses have depth 0 and rotate about the down axis
    only, and its covariances do not couple axes in the plane with others, which have no meaning.
    Its solution is that of the problem in SE(2).
    """

    kind: ClassVar[str] = "factor_graph"

    vehicle_name: Column = column("vehicle", "", "vehicle name", "U")
    landmark_name: Column = column("landmark", "", "landmark name", "U")
    pose_vehicle: Column = column("pose", "1", "index of the vehicle", "i4")
    pose_number: Column = column("pose", "1", "number of the pose in its vehicle's chain", "i4")
    pose_time: Column = column("pose", "s", "time since the start of the mission")
    factors: Mapping[str, Factors] = field(default_factory=dict)
    planar: bool = False

    def __getitem__(self, name: str) -> Factors:
        """Factors of one kind."""
        kind = KINDS[name]
        return self.factors.get(name) or kind.table([], [[]] * len(kind.columns), [])

    @property
    def tables(self) -> dict[str, Factors]:
        """
        Tables of all kinds of factors by the names of `KINDS`, in this order; a reader of factors
        handles or refuses each.
        """
        return {name: self[name] for name in KINDS}

    @property
    def n_factors(self) -> int:
        """Number of factors of all kinds."""
        return sum(map(len, self.tables.values()))

    def of_residual(self, *residuals: Residual) -> list[Factors]:
        """
        Tables of all kinds of factors with one of these residuals, in the order of `KINDS`.

        Parameters
        ----------
        *residuals : Residual
            Kinds of residuals.

        Returns
        -------
        list of Factors
        """
        return [table for table in self.tables.values() if table.kind.residual in residuals]

    def of_ends(self, *ends: tuple[str, ...]) -> list[Factors]:
        """
        Tables of all kinds of factors between variables of these types, in the order of `KINDS`.

        Parameters
        ----------
        *ends : tuple of str
            Types of the variables, as in `FactorKind.ends`.

        Returns
        -------
        list of Factors
        """
        return [table for table in self.tables.values() if table.kind.ends in ends]

    def with_factors(self, **tables: Factors) -> "FactorGraph":
        """
        Copy of the graph with other tables of factors.

        Parameters
        ----------
        **tables : Factors
            New tables by the names of `KINDS`.

        Returns
        -------
        FactorGraph
        """
        return replace(self, factors={**self.factors, **tables})

    @property
    def n_poses(self) -> int:
        """Number of poses; the first landmark has this number as variable."""
        return int(self.pose_vehicle.size)

    @property
    def n_variables(self) -> int:
        """Number of poses and landmarks."""
        return self.n_poses + int(self.landmark_name.size)

    @property
    def degrees_of_freedom(self) -> int:
        """
        Rows of all residuals minus the dimension of all variables; the expected cost is half of it.
        """
        rows = sum(
            len(kind.rows_in("rad m", planar=self.planar)) * len(self[name])
            for name, kind in KINDS.items()
        )
        return int(rows - dimension(self))

    def variable_name(self, variable: int) -> str:
        """
        Readable name of a variable: ``A17``, ``float-1:17`` if the vehicle's name is longer, or
        ``L0``.

        Parameters
        ----------
        variable : int
            Index of a pose or landmark.

        Returns
        -------
        str
        """
        if variable >= self.n_poses:
            return str(self.landmark_name[variable - self.n_poses])
        name = str(self.vehicle_name[self.pose_vehicle[variable]])
        number = int(self.pose_number[variable])
        return f"{name}{number}" if len(name) == 1 and not name.isdigit() else f"{name}:{number}"

    def to_dataset(self) -> "xr.Dataset":
        """
        Convert to an xarray data set with units and long names; empty kinds of factors are omitted.
        """
        dataset = super().to_dataset().assign_attrs(planar=int(self.planar))
        for name, factors in self.factors.items():
            if not len(factors):
                continue
            what = factors.kind.what
            about = {"long_name": f"variables of {what}"}
            dataset[f"{name}_variables"] = ((name, f"{name}_end"), factors.variables, about)
            for part, _, unit in factors.kind.columns:
                values = factors.measurement[:, factors.kind.columns_at[part]]
                about = {"long_name": f"{part} of {what}", "units": unit}
                dataset[f"{name}_{part}"] = ((name, f"{name}_{part}_axis"), values, about)
            axes = (name, f"{name}_row", f"{name}_column")
            about = {
                "long_name": f"covariance of {what}, rotation before translation",
                "units": "rad2, m2",
            }
            dataset[f"{name}_covariance"] = (axes, factors.covariance, about)
        return dataset

    @classmethod
    def from_dataset(cls, dataset: "xr.Dataset") -> Self:
        """
        Read a graph from a data set.

        Parameters
        ----------
        dataset : xarray.Dataset
            Data set of `to_dataset`.

        Returns
        -------
        FactorGraph
        """
        factors = {
            name: kind.table(
                dataset[f"{name}_variables"].values,
                [dataset[f"{name}_{part}"].values for part, _, _ in kind.columns],
                dataset[f"{name}_covariance"].values,
            )
            for name, kind in KINDS.items()
            if f"{name}_variables" in dataset
        }
        tables = {
            str(name).removesuffix("_variables")
            for name in dataset
            if str(name).endswith("_variables")
        }
        if unknown := sorted(tables - set(KINDS)):
            raise EstimationError(
                f"{cls.kind}: factors of a kind {unknown[0]!r}; this version has {', '.join(KINDS)}"
            )
        planar = bool(dataset.attrs.get("planar", 0))
        return replace(super().from_dataset(dataset), factors=factors, planar=planar)


def dimension(graph: FactorGraph) -> int:
    """Dimension of all variables of a graph."""
    pose, landmark = (3, 2) if graph.planar else (6, 3)
    return pose * graph.n_poses + landmark * int(graph.landmark_name.size)


def check_kinds() -> None:
    """
    Refuse kinds of factors that a solver or a file cannot represent, or that a file or a list of
    counts cannot tell apart.

    Distances are ranges alone. A word fits the kind's ends, and the axes are rows of the columns.
    """
    distances = [name for name, kind in KINDS.items() if kind.residual is Residual.DISTANCE]
    if distances != ["range"]:
        raise EstimationError(
            f"kinds that measure distances: {', '.join(distances)}; allowed: range alone"
        )
    lines: dict[Any, str] = {}
    for name, kind in KINDS.items():
        for key in ((kind.word, kind.axes), kind.what, kind.plural):
            other = lines.setdefault(key, name)
            if other != name and key != (None, kind.axes):
                raise EstimationError(
                    f"kinds {other} and {name} have the same "
                    + (
                        f"name {key}"
                        if isinstance(key, str)
                        else f"word {kind.word} and axes in files"
                    )
                    + "; give them different ones, or the new kind the word None"
                )
        if tuple(_ALL_AXES[axis] for axis in kind.axes) not in ((), kind.row_names):
            raise EstimationError(
                f"kind {name}: axes {kind.axes} of {', '.join(kind.column_rows)}; allowed: rising"
                f" indices of these in {' '.join(_ALL_AXES)}"
            )
        if "landmark" in kind.ends and kind.is_partial:
            raise EstimationError(
                f"kind {name}: {', '.join(kind.row_names)} of {' and '.join(kind.ends)}; allowed:"
                " a whole position, as starting values need"
            )
        if kind.word is None:
            continue
        fitting = kind.axes or kind.word not in (POSE_PRIOR, EDGE) or kind.rows == len(_ALL_AXES)
        if _ENDS.get(kind.word) != kind.ends or not fitting:
            raise EstimationError(
                f"kind {name}: lines of {kind.word} with axes {kind.axes} cannot hold"
                f" {', '.join(kind.row_names)} of {' and '.join(kind.ends)}; allowed: a fitting"
                " word, or None"
            )


def check_graph(graph: FactorGraph) -> None:
    """
    Refuse a graph with unusable measurements or noise levels.

    GTSAM treats a zero sigma as a hard constraint, ignores one triangle of an asymmetric matrix,
    accepts a scaled rotation, and raises during a solve for a singular or overflowing covariance.
    """
    check_kinds()
    _check_names(graph)
    unknown = [name for name in graph.factors if name not in KINDS]
    if unknown:
        raise EstimationError(f"factors of a kind {unknown[0]!r}; allowed: {', '.join(KINDS)}")
    for name in KINDS:
        factors = graph[name]
        if len(factors):
            _check_ends(graph, factors)
            _check_measurement(graph, factors)
            _check_covariance(graph, factors)
            if graph.planar:
                _check_planar(graph, factors)


def check_values(graph: FactorGraph, values: GraphValues) -> None:
    """Refuse values that do not fit a graph or are not finite."""
    sizes = values.position.shape[0], values.landmark_position.shape[0]
    needed = graph.n_poses, int(graph.landmark_name.size)
    if sizes != needed:
        raise EstimationError(
            f"values for {sizes[0]} poses and {sizes[1]} landmarks; the graph has {needed[0]} and"
            f" {needed[1]}"
        )
    variables = np.arange(sum(needed), dtype=np.int32)
    position = np.concatenate([values.position, values.landmark_position])
    fine = np.abs(position) <= LARGEST  # NaN does not pass
    _refuse(graph, "position", variables, position, fine, f"finite values of at most {LARGEST:g}")
    _check_length(graph, "quaternion", variables[: needed[0]], values.quaternion)
    if graph.planar:
        _refuse(
            graph, "depth", variables, position[:, 2:], position[:, 2] == 0.0, "0 in two dimensions"
        )
        _check_upright(graph, "quaternion", variables[: needed[0]], values.quaternion)


def check_anchored(graph: FactorGraph) -> None:
    """
    Refuse a graph with variables that nothing ties to the world; a depth leaves the horizontal
    position free.
    """
    loose = connected_parts(graph).loose
    if loose.any():
        raise EstimationError(
            f"{graph.variable_name(int(np.argmax(loose)))}: no first-pose prior, GNSS fix or"
            " landmark prior anchors it or a variable that is tied to it"
            f" ({np.count_nonzero(loose)} variables in all); give its vehicle a prior"
        )


class ConnectedParts(NamedTuple):
    """Connected part of each variable, and whether nothing ties that part to the world."""

    part: Indices
    loose: Mask


def connected_parts(graph: FactorGraph) -> ConnectedParts:
    """Find the sets of variables that odometry, sightings and ranges connect."""
    pairs = np.concatenate(
        [graph[name].variables for name, kind in KINDS.items() if len(kind.ends) == 2]
    )
    part = joined_parts(graph.n_variables, pairs)
    anchored = np.concatenate([graph[name].subject for name, kind in KINDS.items() if kind.anchors])
    return ConnectedParts(part, ~np.isin(part, part[anchored]))


def joined_parts(size: int, pairs: Indices) -> Indices:
    """Number of the connected part of each of ``size`` variables, by pairs (n, 2)."""
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(size, size))
    part: Indices = connected_components(links, directed=False)[1]
    return part


def _check_names(graph: FactorGraph) -> None:
    wrong = (graph.pose_vehicle < 0) | (graph.pose_vehicle >= graph.vehicle_name.size)
    if wrong.any():
        raise EstimationError(
            f"pose: refers to vehicle {graph.pose_vehicle[wrong][0]}; allowed are 0 to"
            f" {graph.vehicle_name.size - 1}"
        )
    # one integer for each name: the pose number has 32 bits
    pose = (
        graph.pose_vehicle.astype(np.int64) << 32 | graph.pose_number.astype(np.int64) & 0xFFFFFFFF
    )
    for names, first in ((pose, 0), (graph.landmark_name, graph.n_poses)):
        distinct = np.unique(names, return_index=True)[1]
        if distinct.size != names.size:
            twice = first + int(np.setdiff1d(np.arange(names.size), distinct)[0])
            raise EstimationError(
                f"{graph.variable_name(twice)}: two variables of this name; allowed is one"
            )


def _check_ends(graph: FactorGraph, factors: Factors) -> None:
    kind = factors.kind
    n = graph.n_poses
    allowed = {"pose": (0, n), "landmark": (n, graph.n_variables), "any": (0, graph.n_variables)}
    for end, variables in zip(kind.ends, factors.variables.T, strict=True):
        low, high = allowed[end]
        wrong = (variables < low) | (variables >= high)
        if wrong.any():
            raise EstimationError(
                f"{kind.what}: refers to variable {variables[wrong][0]}; allowed are {low} to"
                f" {high - 1}"
            )
    if len(kind.ends) == 2:
        first, second = factors.variables.T
        two = f"two different {'poses' if kind.ends == ('pose', 'pose') else 'variables'}"
        _refuse(graph, kind.what, first, second[:, None], first != second, two)
        landmark_first = (first >= n) & (second < n)
        _refuse(graph, kind.what, first, second[:, None], ~landmark_first, "the pose named first")


def _check_measurement(graph: FactorGraph, factors: Factors) -> None:
    what = factors.kind.what
    values = factors.measurement
    _refuse(graph, what, factors.subject, values, np.isfinite(values), "finite values")
    small = np.abs(values) <= LARGEST
    _refuse(graph, what, factors.subject, values, small, f"values of at most {LARGEST:g}")
    if "quaternion" in factors.kind.columns_at:
        _check_length(graph, f"{what} quaternion", factors.subject, factors.column("quaternion"))


def _check_planar(graph: FactorGraph, factors: Factors) -> None:
    kind = factors.kind
    inside = kind.rows_in("rad m", planar=True)
    if not inside:
        raise EstimationError(
            f"{kind.what}: {len(factors)} in a graph in two dimensions; allowed is none"
        )
    if "position" in kind.columns_at:
        down = factors.column("position")[:, 2:]
        _refuse(
            graph,
            f"{kind.what} down",
            factors.subject,
            down,
            (down == 0.0).all(axis=1),
            "0 in two dimensions",
        )
    if "quaternion" in kind.columns_at:
        _check_upright(
            graph, f"{kind.what} quaternion", factors.subject, factors.column("quaternion")
        )
    outside = np.setdiff1d(np.arange(kind.rows), inside)
    mixed = factors.covariance[:, inside][:, :, outside].reshape(len(factors), -1)
    what = f"{kind.what} covariance between what is in the plane and what is not"
    _refuse(graph, what, factors.subject, mixed, (mixed == 0.0).all(axis=1), "0 in two dimensions")


def _check_upright(graph: FactorGraph, what: str, variables: Indices, quaternion: Array) -> None:
    upright = (quaternion[:, 1:3] == 0.0).all(axis=1)
    _refuse(graph, what, variables, quaternion, upright, "a rotation about down in two dimensions")


def _check_length(graph: FactorGraph, what: str, variables: Indices, quaternion: Array) -> None:
    fine = np.abs(lengths(quaternion) - 1.0) <= QUATERNION_TOLERANCE
    _refuse(graph, what, variables, quaternion, fine, "length 1")


def _check_covariance(graph: FactorGraph, factors: Factors) -> None:
    what = factors.kind.what
    variables = factors.subject
    covariance = factors.covariance
    diagonal = np.diagonal(covariance, axis1=1, axis2=2)
    fine = (diagonal >= VARIANCES[0]) & (diagonal <= VARIANCES[1])  # NaN does not pass
    allowed = f"positive finite variances, {VARIANCES[0]:g} to {VARIANCES[1]:g}"
    _refuse(graph, f"{what} variance", variables, diagonal, fine, allowed)
    if np.count_nonzero(covariance) <= diagonal.size:
        return
    full = np.count_nonzero(covariance, axis=(1, 2)) > covariance.shape[1]
    variables = variables[full]
    covariance = covariance[full]
    sigma = np.sqrt(diagonal[full])
    # without units, so that metres and radians do not look like bad conditioning
    with np.errstate(over="ignore"):
        correlation = covariance / sigma[:, :, None] / sigma[:, None, :]
    fine = np.isfinite(correlation).all(axis=(1, 2))
    _refuse(graph, f"{what} covariance", variables, sigma**2, fine, "finite entries")
    skew = np.abs(correlation - np.swapaxes(correlation, 1, 2)).max(axis=(1, 2))
    _refuse(graph, f"{what} covariance's asymmetry", variables, skew[:, None], skew <= 1e-9, "0")
    smallest = np.linalg.eigvalsh(correlation)[:, :1]
    what = f"{what} covariance's eigenvalues, scaled to unit variances,"
    allowed = f"a positive definite matrix, {SMALLEST_EIGENVALUE:g} at least"
    _refuse(graph, what, variables, smallest, smallest[:, 0] >= SMALLEST_EIGENVALUE, allowed)


def _refuse(
    graph: FactorGraph, what: str, variables: Indices, values: Array, fine: Any, allowed: str
) -> None:
    """
    Refuse values (n, k) unless all are fine, (n,) or (n, k), in a line that names the first
    variable concerned.
    """
    if fine.all():
        return
    fine = fine.reshape(len(values), -1).all(axis=1)
    first = int(np.argmin(fine))
    numbers = ", ".join(f"{v:g}" for v in np.atleast_1d(values[first]))
    raise EstimationError(
        f"{graph.variable_name(int(variables[first]))}: {what} is [{numbers}]"
        f" ({np.count_nonzero(~fine)} such in all); allowed: {allowed}"
    )

"""Check of an ocean: a list of all errors and doubts about a data set."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from pymantaray.arrays import Array, Mask
from pymantaray.errors import GeometryError, OceanError
from pymantaray.ocean.local import floor_in_domain
from pymantaray.ocean.names import CurrentsPolicy, Equation
from pymantaray.ocean.open import read_ocean
from pymantaray.ocean.schema import Finding, latitude, longitude, place_of, violations
from pymantaray.ocean.sea_floor_water import sea_floor_notes
from pymantaray.ocean.seawater import (
    SUPERCOOLED,
    UNFROZEN,
    density_fall,
    gridded_water,
    ocean_sound_speed,
    supercooling,
)
from pymantaray.ocean.window import Window, centred, half_sides_within
from pymantaray.quantities.checks import distinct_digits
from pymantaray.records.digits import counted
from pymantaray.records.result_table import ResultTable, notebook_html

_MIN_SPEED = 1_400.0  # m/s; sound speed of sea water
_MAX_SPEED = 1_600.0
# kg/m3; tolerated decrease of density with depth: twice the rounding of HYCOM's packing
_DENSITY_NOISE = 2e-3
_SPIKE = 10.0  # m/s; tolerated difference between a point and all its neighbours, and one neighbour
_JUMP = 40.0
_MAX_GRADIENT = 5.0  # s-1; vertical gradient of sound speed, about 1 K/m
_MIN_LEVELS = 15  # minimum number of levels, and above this depth [m]
_UPPER_DEPTH = 200.0
_MIN_UPPER_LEVELS = 6
# m; a coarser grid loses eddies and fronts; the spacing of HYCOM and GLORYS is at most 9 km
_MAX_SPACING = 12e3
_MIN_NODES = 10  # across the domain
_MAX_SCALE_ERROR = 1e-3  # distortion of lengths by the projection: 1 m in 1 km
# m; a point this far below the sea bed counts as on it, because interpolation rounds
_FLOOR_TOLERANCE = 1e-6
_CHANGES = [
    "carried",
    "extended",
    "extension",
    "added",
    "level",
    "perturbed",
    "replaced",
    "at rest",
    "set to 0",
    "exactly 0",
    "valid range",
    "climatology",
    "interpolated from",
]
_DOUBTS = {  # limit and remedy
    "made up": ("", "do not report it as an ocean from a model or measurements"),
    "currents at rest": ("", "floats do not drift; add u and v if they should"),
    "changed": ("", "check that the change is intended"),
    "density inversions": (
        f"{_DENSITY_NOISE:g} kg/m3, which is rounding",
        "interpolation or assimilation can cause this; look at a section there",
    ),
    "below freezing": (f"{SUPERCOOLED:g} K", UNFROZEN),
    "isolated wet points": (
        "",
        "a hole of one point in the sea bed; interpolation across it is unreliable",
    ),
    "land of one point": ("", "an islet or a gap in the data"),
    "spikes": (f"{_SPIKE:g} m/s", "no front causes this; look for a wrong value"),
    "jumps between neighbours": (
        f"{_JUMP:g} m/s",
        "the grid does not resolve a front this sharp; look for a wrong value",
    ),
    "jumps between levels": (
        f"{_MAX_GRADIENT:g} s-1",
        "look for a wrong value or a misplaced level",
    ),
    "few levels": (
        f"{_MIN_LEVELS} and {_MIN_UPPER_LEVELS}",
        "ducts between the levels are lost; use a source with more levels",
    ),
    "first level carried up": (
        "",
        "the source has no data above it; ducts at the surface depend on it",
    ),
    "coarse grid": (
        f"{_MAX_SPACING / 1e3:g} km and {_MIN_NODES} cells",
        "fronts and eddies are lost; use a finer source or a larger domain",
    ),
    "sea floor": ("", "compare the file with the levels of the ocean"),
    "projection error": (
        f"{1e3 * _MAX_SCALE_ERROR:g} m in 1 km",
        "set half_extent to the domain that the fleet needs",
    ),
}


class Findings(tuple[Finding, ...]):
    """Findings of a check, errors first."""

    __slots__ = ()

    @property
    def wrong(self) -> tuple[Finding, ...]:
        """Errors: findings that make the ocean unusable."""
        return tuple(f for f in self if f.severity == "wrong")

    @property
    def doubtful(self) -> tuple[Finding, ...]:
        """Doubts: findings that a person should look at."""
        return tuple(f for f in self if f.severity == "doubtful")

    @property
    def ok(self) -> bool:
        """True if there are no errors; there may be doubts."""
        return not self.wrong

    def _repr_html_(self) -> str:
        """Table of findings and their counts for a notebook."""
        counts = {"wrong": len(self.wrong), "doubtful": len(self.doubtful)}
        table = ResultTable("findings", pd.DataFrame(asdict(f) for f in self))
        return notebook_html("Findings about an ocean", counts, [table])

    def named(self, what: str) -> Finding | None:
        """
        First finding about a property.

        Parameters
        ----------
        what : str
            The property, as in ``Finding.what``.

        Returns
        -------
        Finding or None
        """
        return next((f for f in self if f.what == what), None)


def check_ocean(
    source: str | Path | Sequence[str | Path] | xr.Dataset,
    *,
    time: str | np.datetime64 | None = None,
    centre: tuple[float, float] | None = None,
    half_extent: tuple[float, float] | None = None,
    fleet: Mapping[str, Array] | None = None,
    existing_trajectories: bool = False,
    sea_floor: xr.DataArray | None = None,
    equation: Equation = "teos-10",
    currents: CurrentsPolicy = "required",
) -> Findings:
    """
    List the errors and doubts about an ocean.

    Parameters
    ----------
    source : str, Path, sequence of them, or xarray.Dataset
        A source of `pymantaray.ocean.open_ocean`. A data set with the attribute ``synthetic`` is
        checked as it is.
    time : str or numpy.datetime64, optional
        Instant, if the source has several.
    centre, half_extent : tuple of float, optional
        Domain that the ocean must cover, as in `pymantaray.ocean.to_local`. [degrees, m]
    fleet : mapping of str to ndarray, shape (n, 3), optional
        Waypoints (north, east, down) of each vehicle; the first is its start. They must be in the
        domain and above the sea bed. [m]
    existing_trajectories : bool
        True if ``fleet`` contains existing trajectories. Ranges fail where they leave the water,
        which is a doubt instead of an error.
    sea_floor : xarray.DataArray, optional
        Sea floor for `to_local`.
    equation : str
        Equation of sound speed.
    currents : {"required", "rest"}
        As in `pymantaray.ocean.open_ocean`.

    Returns
    -------
    Findings
        Errors come first. If the structure is invalid, checks that depend on it are skipped.

    Examples
    --------
    >>> findings = check_ocean("synthetic:fram")
    >>> findings.ok, [f.what for f in findings.doubtful]
    (True, ['made up'])
    """
    if isinstance(source, xr.Dataset) and "synthetic" in source.attrs:  # of this package
        ocean = source
    else:
        try:
            ocean = read_ocean(source, time=time, window=None, currents=currents)
        except OceanError as error:
            return Findings([Finding("wrong", "cannot be opened", str(error))])
    findings = list(violations(ocean))
    if not any(f.severity == "wrong" for f in findings):
        findings += _water(ocean, equation)
        findings += _coverage(
            ocean, centre, half_extent, fleet or {}, existing_trajectories, sea_floor
        )
        findings += [_doubt("sea floor", note) for note in sea_floor_notes(sea_floor)]
        findings += _provenance(ocean)
    return Findings(sorted(findings, key=lambda f: f.severity != "wrong"))


def _doubt(what: str, value: str, where: str = "") -> Finding:
    return Finding("doubtful", what, value, *_DOUBTS[what], where)


def _largest(
    ocean: xr.Dataset, what: str, quantity: str, size: Array, limit: float, unit: str
) -> Iterator[Finding]:
    """Doubt about the points above a limit; its place is the point of the maximum."""
    if count := np.count_nonzero(size > limit):
        at = np.unravel_index(int(np.nanargmax(size)), size.shape)
        value = f"{quantity} at {count} points, the largest {size[at]:.3g} {unit}"
        yield _doubt(what, value, place_of(ocean, at))


def _provenance(ocean: xr.Dataset) -> Iterator[Finding]:
    """Doubts from the attributes of the ocean."""
    if ocean.attrs["synthetic"]:
        yield _doubt("made up", "synthetic = 1")
    still = not any(np.any(np.nan_to_num(ocean[name].values)) for name in ("water_u", "water_v"))
    if still:
        yield _doubt("currents at rest", "0 m/s everywhere")
    for line in str(ocean.attrs.get("history", "")).splitlines():
        if any(word in line.lower() for word in _CHANGES) and not (
            still and "rest" in line.lower()
        ):
            yield _doubt("changed", line.strip())


def _water(ocean: xr.Dataset, equation: Equation) -> Iterator[Finding]:
    """Check sound speed, stability, gaps and jumps."""
    depth = np.asarray(ocean["depth"].values, dtype=float)
    water = (ocean["water_temp"].values, ocean["salinity"].values)
    speed = ocean_sound_speed(ocean, equation=equation)
    wet = np.isfinite(water[0])
    bad = wet & ~((speed >= _MIN_SPEED) & (speed <= _MAX_SPEED))
    if bad.any():
        off = np.nan_to_num(np.abs(speed - 0.5 * (_MIN_SPEED + _MAX_SPEED)), nan=np.inf)
        at = np.unravel_index(int(np.argmax(np.where(bad, off, -np.inf))), speed.shape)
        yield Finding(
            "wrong",
            "sound speed",
            f"{np.count_nonzero(bad)} of {np.count_nonzero(wet)} wet points, the worst"
            f" {speed[at]:.1f} m/s",
            f"{_MIN_SPEED:g} to {_MAX_SPEED:g} m/s",
            "check units and fill values of temperature and salinity",
            place_of(ocean, at),
        )
    fall = density_fall(ocean)
    if (unstable := fall > _DENSITY_NOISE).any():
        at = np.unravel_index(int(np.nanargmax(fall)), fall.shape)
        count = (
            f"{np.count_nonzero(unstable)} of {np.count_nonzero(np.isfinite(fall))} pairs of levels"
        )
        between = f"between {depth[at[0]]:g} and {depth[at[0] + 1]:g} m"
        value = f"{count}, the largest {fall[at]:.3f} kg/m3 {between}"
        yield _doubt("density inversions", value, place_of(ocean, at))
    cold = supercooling(*gridded_water(ocean))
    yield from _largest(
        ocean, "below freezing", "water below its freezing point", cold, SUPERCOOLED, "K"
    )
    yield from _islands(ocean, wet)
    yield from _jumps(ocean, speed, depth)
    yield from _levels(depth, wet, water)


def _islands(ocean: xr.Dataset, wet: Mask) -> Iterator[Finding]:
    beside = np.nansum(_around(wet.astype(float)), axis=0)
    lone = wet & (beside == 0)
    if lone.any():
        value = f"{counted(int(lone.sum()), 'point')} without a wet neighbour at the same level"
        yield _doubt("isolated wet points", value, place_of(ocean, np.argwhere(lone)[0]))
    land = ~wet[0] & (beside[0] == 4)
    if land.any():
        value = counted(int(land.sum()), "column")
        yield _doubt("land of one point", value, place_of(ocean, (0, *np.argwhere(land)[0])))


def _around(field: Array) -> Array:
    """Values at the four horizontal neighbours, shape (4, depth, lat, lon); NaN beyond the edge."""
    wide = np.pad(field, ((0, 0), (1, 1), (1, 1)), constant_values=np.nan)
    return np.stack([wide[:, :-2, 1:-1], wide[:, 2:, 1:-1], wide[:, 1:-1, :-2], wide[:, 1:-1, 2:]])


def _jumps(ocean: xr.Dataset, speed: Array, depth: Array) -> Iterator[Finding]:
    step = speed - _around(speed)
    known = np.isfinite(step)
    above = np.where(known, step, np.inf).min(axis=0)
    below = np.where(known, step, -np.inf).max(axis=0)
    lone = np.where(known.sum(axis=0) >= 3, np.maximum(above, -below), 0.0)
    steps = np.where(known, np.abs(step), 0.0).max(axis=0)
    slope = np.abs(np.diff(speed, axis=0)) / np.diff(depth)[:, None, None]
    yield from _largest(ocean, "spikes", "sound speed", lone, _SPIKE, "m/s")
    yield from _largest(ocean, "jumps between neighbours", "sound speed", steps, _JUMP, "m/s")
    yield from _largest(
        ocean, "jumps between levels", "gradient of sound speed", slope, _MAX_GRADIENT, "s-1"
    )


def _levels(depth: Array, wet: Mask, water: tuple[Array, Array]) -> Iterator[Finding]:
    used = depth[wet.any(axis=(1, 2))]
    upper = int(np.count_nonzero(used <= _UPPER_DEPTH))
    if used.size < _MIN_LEVELS or (used[-1] > _UPPER_DEPTH and upper < _MIN_UPPER_LEVELS):
        value = (
            f"{used.size} levels down to {used[-1]:g} m, {upper} in the upper {_UPPER_DEPTH:g} m"
        )
        yield _doubt("few levels", value)
    both = wet[0] & wet[1]
    if both.any() and all(np.array_equal(field[0][both], field[1][both]) for field in water):
        value = f"temperature and salinity at 0 m equal those at {depth[1]:g} m everywhere"
        yield _doubt("first level carried up", value)


def _coverage(
    ocean: xr.Dataset,
    centre: tuple[float, float] | None,
    half_extent: tuple[float, float] | None,
    fleet: Mapping[str, Array],
    existing_trajectories: bool,
    sea_floor: xr.DataArray | None,
) -> Iterator[Finding]:
    """
    Check that the ocean covers the domain and the fleet, the grid spacing and the projection error.
    """
    try:
        ocean = centred(ocean, centre)
        window = Window.of(ocean, centre)
        largest = window.largest_rectangle()
    except (OceanError, GeometryError) as error:
        remedy = "fetch the window around the centre"
        yield Finding("wrong", "coverage", str(error), "a centre inside the data", remedy)
        return
    half = largest if half_extent is None else half_extent
    if not window.holds(*half):
        yield Finding(
            "wrong",
            "coverage",
            f"domain of +-{half[0] / 1e3:g} km north, +-{half[1] / 1e3:g} km east",
            f"{half_sides_within(largest)} fits",
            "fetch a larger window or shrink the domain",
            f"{latitude(window.frame.latitude_deg)}, {longitude(window.frame.longitude_deg)}",
        )
        return
    yield from _fleet(ocean, window, half, fleet, existing_trajectories, sea_floor)
    yield from _grid(window, half)


def _grid(window: Window, half: tuple[float, float]) -> Iterator[Finding]:
    spacing = window.native_spacing()
    nodes = [2.0 * h / s for h, s in zip(half, spacing, strict=True)]
    if max(spacing) > _MAX_SPACING or min(nodes) < _MIN_NODES:
        size = f"{spacing[0] / 1e3:.1f} km by {spacing[1] / 1e3:.1f} km"
        yield _doubt(
            "coarse grid", f"{size}, {nodes[0]:.0f} by {nodes[1]:.0f} cells across the domain"
        )
    side = np.linspace(-1.0, 1.0, 21)
    north = half[0] * side[:, None]
    east = half[1] * side[None, :]
    error = float(np.max(np.abs(window.frame.scale_factor(north, east) - 1.0)))
    if error > _MAX_SCALE_ERROR:
        value = f"lengths are up to {1e3 * error:.2g} m in 1 km too long at the edge of the domain"
        yield _doubt("projection error", value)


def _fleet(
    ocean: xr.Dataset,
    window: Window,
    half: tuple[float, float],
    fleet: Mapping[str, Array],
    existing_trajectories: bool,
    sea_floor: xr.DataArray | None,
) -> Iterator[Finding]:
    try:
        bed = floor_in_domain(ocean, window, half, sea_floor)
    except OceanError as error:
        yield Finding(
            "wrong", "sea floor", str(error), "the whole domain", "fetch a larger window of it"
        )
        return
    for name, plan in fleet.items():
        where = f"vehicle {name}"
        points = np.atleast_2d(np.asarray(plan, dtype=float))
        outside = np.any(np.abs(points[:, :2]) > np.asarray(half) + 1e-6, axis=1)
        if outside.any():
            place = points[int(np.argmax(outside)), :2] / 1e3
            (north, high), (east, wide) = map(distinct_digits, place, np.asarray(half) / 1e3)
            yield Finding(
                "doubtful" if existing_trajectories and not outside.all() else "wrong",
                "coverage",
                f"{np.count_nonzero(outside)} of {len(points)} planned points outside the domain,"
                f" the first {north} km north, {east} km east",
                f"+-{high} km by +-{wide} km",
                "fetch a larger window, or move the vehicle",
                where,
            )
            continue
        beds = bed(points[:, :2])
        short = points[:, 2] - beds
        if np.any(short > _FLOOR_TOLERANCE):
            worst = int(np.argmax(short))
            floor, depth = distinct_digits(beds[worst], points[worst, 2])
            yield Finding(
                "doubtful" if existing_trajectories else "wrong",
                "sea bed above the vehicle",
                f"sea bed at {floor} m, {'plan' if worst else 'start'} at {depth} m",
                f"above {floor} m",
                "its ranges fail there"
                if existing_trajectories
                else "move it to deeper water or plan a shallower path",
                where,
            )

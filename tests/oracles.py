"""
Independent solvers and closed forms that tests hold the package against; none of them uses its
kernels.
"""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import gtsam
import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray
from scipy.fft import dst
from scipy.integrate import solve_ivp
from scipy.interpolate import (
    AAA,
    CubicSpline,
    NdBSpline,
    RegularGridInterpolator,
    make_interp_spline,
)
from scipy.special import erfc

from pymantaray.estimation import RangeEndpoints

Array = NDArray[np.float64]


def nonlinear_vector_factors(graph, believed, initial):
    """
    The optimum of a graph whose ranges are a model's, by factors that ask the model at every
    evaluation.

    One nonlinear factor for the ranges of each ping, with Jacobians of its own: slow, and
    independent of expansions. Variances that depend on the rays are those of the start. A link that
    is not possible has no residual and no gradient.
    """
    from pymantaray.estimation._gtsam.factors import graph_factors, graph_values, values_of

    values, r = values_of(initial), believed.ranges
    factors = graph_factors(graph.with_factors(range=graph["range"][:0]))
    shared = []
    if believed.n_unknowns:
        shared, size = [graph.n_variables], believed.n_unknowns
        values.insert(shared[0], np.zeros(size))
        unit = gtsam.noiseModel.Unit.Create(size)
        factors.add(gtsam.PriorFactorVector(shared[0], np.zeros(size), unit))
    extra = None
    if believed.uncertainty is not None:
        links = _links_at(values, r, np.arange(r.time.size), graph.n_poses)
        extra = believed.uncertainty.covariances(links, r.epoch)
    for e in range(r.epoch.max() + 1):
        rows = np.flatnonzero(r.epoch == e)
        covariance = np.diag(graph["range"].variance[rows])
        if extra is not None:
            added = r.sound_speed[rows][:, None] * extra[e] * r.sound_speed[rows]
            covariance += added if believed.correlated else np.diag(np.diagonal(added))
        keys = np.unique([r.transmitter[rows], r.receiver[rows]]).tolist() + shared
        error = _asking(believed, rows, keys, np.linalg.cholesky(covariance), graph)
        factors.add(gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(rows.size), keys, error))
    parameters = gtsam.GaussNewtonParams()
    parameters.setRelativeErrorTol(0.0)
    parameters.setAbsoluteErrorTol(1e-9)
    end = gtsam.GaussNewtonOptimizer(factors, values, parameters).optimize()
    return SimpleNamespace(
        **vars(graph_values(end, graph)),
        initial_cost=factors.error(values),
        final_cost=factors.error(end),
        unknowns=np.array(end.atVector(shared[0])) if shared else None,
        unknowns_covariance=gtsam.Marginals(factors, end).marginalCovariance(shared[0])
        if shared
        else None,
    )


def _links_at(values, r, rows, n_poses):
    """Links of some ranges with their ends where GTSAM values have them."""
    ends = (
        [
            values.atPose3(k).translation() if k < n_poses else values.atPoint3(k)
            for k in end[rows].tolist()
        ]
        for end in (r.transmitter, r.receiver)
    )
    return RangeEndpoints(r.time[rows], *map(np.array, ends), r.sound_speed[rows])


def _asking(believed, rows, keys, root, graph):
    """Error function of the ranges in some rows, whitened by the root of their covariance."""
    r, n = believed.ranges, graph.n_poses
    speed = r.sound_speed[rows]

    def error(_factor, at, jacobians):
        u = at.atVector(keys[-1]) if keys[-1] == graph.n_variables else np.empty(0)
        found, by_unknowns = believed.predict(_links_at(at, r, rows, n), rows, u)
        fine = found.possible
        if jacobians is not None:
            gradients = (
                (r.transmitter, found.transmitter_gradient),
                (r.receiver, found.receiver_gradient),
            )
            for i, key in enumerate(keys):
                jacobian = sum((ends[rows] == key)[:, None] * by for ends, by in gradients)
                if key == graph.n_variables:
                    jacobian = by_unknowns
                elif key < n:
                    turned = jacobian @ at.atPose3(key).rotation().matrix()
                    jacobian = np.hstack([np.zeros((rows.size, 3)), turned])
                weighted = np.where(fine, speed, 0.0)[:, None] * np.where(
                    fine[:, None], jacobian, 0.0
                )
                jacobians[i] = np.asfortranarray(np.linalg.solve(root, weighted))
        residual = np.where(fine, speed * (found.travel_time - r.travel_time[rows]), 0.0)
        return np.linalg.solve(root, residual)

    return error


class DenseFan:
    """
    Eigenrays of a vertical section by brute force, sharing no code with the solver.

    Hamilton's equations in range by RK4 with fixed steps, thousands of rays at a time, through
    scipy's splines; a step that crosses the surface or the bed is cut there by the secant method
    and goes on reflected. Intervals of launch angle with a change of sign between rays of the same
    reflections, an extremum of the miss near zero, or a change of reflections are divided by 8,
    three times. Spreading comes from differences of depth between neighbouring rays.

    ``profile`` gives the sound speed as a `PPoly` of depth, by range; with reflections it must be
    the same everywhere. [m]
    """

    # m; a ray that turns this near a boundary may count as in the water, or reflected, or not
    DIVISION, GRAZING = (8, 0.02)

    class Rays(NamedTuple):
        """One row per eigenray; slope is the change of the miss by the launch angle [m/rad]."""

        link: Array
        surface: Array
        bottom: Array
        angle: Array
        time: Array
        spreading: Array
        slope: Array
        grazing: Array

    def __init__(self, profile, bottom, step, most=(0, 0)):
        self.profile, self.bottom, self.step, self.most = profile, bottom, step, most

    def eigenrays(self, depth, receivers, spacing, steepest):
        """From (0, depth) to receivers (n, 2) at whole steps."""
        ends = np.rint(receivers[:, 0] / self.step).astype(int)
        angles = np.arange(-steepest, steepest, spacing)
        link, left = [], []
        for i, (y, _, order, _) in enumerate(self._trace(depth, angles, ends.max()), start=1):
            for j in np.flatnonzero(ends == i):
                here = self._candidates(y[0] - receivers[j, 1], order)
                link.append(np.full(here.size, j))
                left.append(angles[here])
        link, left, width = np.concatenate(link), np.concatenate(left), spacing
        for level in range(3):
            width /= self.DIVISION
            nodes = left[:, None] + width * np.arange(self.DIVISION + 1)
            state = np.full((8, *nodes.shape), np.nan)
            out, owner = state.reshape(8, -1), np.repeat(link, self.DIVISION + 1)
            rays = self._trace(depth, nodes.ravel(), ends.max())
            for i, (y, bounces, order, nearest) in enumerate(rays, start=1):
                here = ends[owner] == i
                if here.any():
                    out[:, here] = np.concatenate([y, bounces, order[None], nearest[None]])[:, here]
            state[0] -= receivers[link, 1][:, None]
            if level < 2:
                hits = [self._candidates(*rows) for rows in zip(state[0], state[6], strict=True)]
                left = np.concatenate([nodes[j, hit] for j, hit in enumerate(hits)])
                link = np.repeat(link, [hit.size for hit in hits])
        with np.errstate(invalid="ignore"):
            same = state[6, :, :-1] == state[6, :, 1:]
            row, at = np.nonzero(same & (state[0, :, :-1] * state[0, :, 1:] <= 0.0))
        a, b = state[:, row, at], state[:, row, at + 1]
        t = a[0] / (a[0] - b[0])
        _, p, time, side = ((1 - t) * a + t * b)[:4]
        link, angle = link[row], nodes[row, at] + t * width
        n = (
            float(self.profile(0.0)(depth))
            / np.array([self.profile(r)(z) for r, z in receivers])[link]
        )
        # tube: |dz| cos(arrival) across the plane's ray, side * h of launch out of the plane
        slope = np.abs(b[0] - a[0]) / width
        area = slope * np.sqrt(n**2 - p**2) / n * side
        length2 = receivers[link, 0] ** 2 + (receivers[link, 1] - depth) ** 2
        spreading = 10.0 * np.log10(area * n / length2)
        grazing = np.minimum(a[7], b[7]) < self.GRAZING
        order = np.lexsort((angle, link))
        twice = (np.diff(angle[order], prepend=np.inf) < 1e-2 * width) & (
            np.diff(link[order], prepend=-1) == 0
        )
        one = order[~twice]  # a root at a node may show on both sides
        bounces = a[4:6, one].astype(int)
        return self.Rays(
            link[one], *bounces, angle[one], time[one], spreading[one], slope[one], grazing[one]
        )

    def _trace(self, depth, angles, steps):
        """
        Yield states, bounces, order of bounces and nearness to a boundary of turning points after
        each step.
        """
        start = self.profile(0.0)
        self._c_source = float(start(depth))
        y = np.array([np.full(angles.size, depth), np.sin(angles), 0.0 * angles, 0.0 * angles])
        bounces, order = (
            np.zeros((2, angles.size), dtype=int),
            np.zeros(angles.size, dtype=np.int64),
        )
        nearest = np.full(angles.size, np.inf)
        with np.errstate(invalid="ignore"):
            for i in range(steps):
                middle, end = (
                    self.profile((i + 0.5) * self.step),
                    self.profile((i + 1.0) * self.step),
                )
                new = self._advance((start, middle, end), y, self.step)
                self._reflect(start, y, new, bounces, order)
                gap = np.minimum(new[0], self.bottom - new[0])
                nearest = np.where(np.abs(new[1]) < 0.01, np.fmin(nearest, gap), nearest)
                y, start = new, end
                yield y, bounces, order, nearest

    def _advance(self, profiles, y, step):
        """
        One RK4 step of depth, its slowness, travel time and lateral spreading; steps (n,) may
        differ by ray.
        """

        def rates(profile, y):
            c, slope = profile(y[0]), profile(y[0], 1)
            n2 = (self._c_source / c) ** 2
            h = np.sqrt(n2 - y[1] ** 2)
            return np.array([y[1] / h, -n2 * slope / (c * h), n2 / (h * self._c_source), 1.0 / h])

        start, middle, end = profiles
        k1 = rates(start, y)
        k2 = rates(middle, y + 0.5 * step * k1)
        k3 = rates(middle, y + 0.5 * step * k2)
        k4 = rates(end, y + step * k3)
        return y + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)

    def _reflect(self, profile, y, new, bounces, order):
        """
        Cut the steps of rays that crossed a boundary, reflect them and finish the step; in place.
        """
        for at, wall, sign in ((0, 0.0, -1.0), (1, self.bottom, 1.0)):
            out = np.flatnonzero(sign * (new[0] - wall) > 0.0)
            if out.size == 0 or not any(self.most):
                continue
            start = y[:, out]
            lo, hi = np.zeros(out.size), np.full(out.size, self.step)
            f_lo, f_hi = start[0] - wall, new[0, out] - wall
            for _ in range(8):  # regula falsi of Illinois kind
                at_step = hi - f_hi * (hi - lo) / (f_hi - f_lo)
                here = self._advance([profile] * 3, start, at_step)
                f = here[0] - wall
                beyond = sign * f > 0.0
                f_lo = np.where(beyond, 0.5 * f_lo, f)
                f_hi = np.where(beyond, f, 0.5 * f_hi)
                lo, hi = np.where(beyond, lo, at_step), np.where(beyond, at_step, hi)
            here[0] = wall
            here[1] *= -1.0
            new[:, out] = self._advance([profile] * 3, here, self.step - at_step)
            bounces[at, out] += 1
            order[out] = 3 * order[out] + 1 + at
        lost = (bounces[0] > self.most[0]) | (bounces[1] > self.most[1]) | (new[0] < 0.0)
        new[:, lost | (new[0] > self.bottom)] = np.nan

    @staticmethod
    def _candidates(miss, order):
        """Indices i of intervals [i, i + 1] in which a root may hide."""
        alive = np.isfinite(miss)
        with np.errstate(invalid="ignore"):
            same = order[:-1] == order[1:]
            change = same & (miss[:-1] * miss[1:] <= 0.0)
            edge = (alive[:-1] != alive[1:]) | (~same & alive[:-1] & alive[1:])
            size = np.abs(miss)
            dip = np.zeros(miss.size, dtype=bool)
            dip[1:-1] = (
                (size[1:-1] <= size[:-2]) & (size[1:-1] <= size[2:]) & (miss[:-2] * miss[2:] > 0.0)
            )
            bend = np.zeros(miss.size)
            bend[1:-1] = np.abs(miss[:-2] - 2.0 * miss[1:-1] + miss[2:])
            dip &= (
                size < bend
            )  # a parabola's vertex lies at most an eighth of this beyond the middle node
        return np.flatnonzero(change | edge | dip[:-1] | dip[1:])


class Shooting:
    """
    Travel times in a smooth medium by a solver of another kind: scipy's DOP853 on the full
    Hamiltonian, with shooting.

    The field is scipy's own tensor-product spline through the same grid values, legs are integrated
    in time and cut where they meet the surface or the bilinear bed, where the slowness is mirrored
    about the normal, and two launch angles are varied by Newton's method until the ray meets its
    receiver: no section, no axis, no variational equations. The package gives first guesses of the
    launch and of the legs' times.
    """

    LONGEST_STEP = 15.0  # m; the spline's third derivative jumps at every level
    SURFACE = 1

    def __init__(self, medium):
        self.medium = medium
        self.speed = field_of(medium)

    def times(self, source, receiver, launch, walls, times):
        """
        Travel times of rays launched about unit vectors that meet walls (n, k), with legs of about
        times (n, k + 1).
        """
        angles = np.stack([np.arctan2(launch[:, 1], launch[:, 0]), np.arcsin(launch[:, 2])])
        n, delta = len(source), 1e-5
        turns = delta * np.array([[[0.0], [0.0]], [[1.0], [0.0]], [[0.0], [1.0]]])
        for _ in range(3):
            trials = np.concatenate([angles + turn for turn in turns], axis=1)
            many = [np.tile(v, (3, 1)) for v in (source, walls, times)]
            ends, total = self._shoot(many[0], trials, *many[1:])
            ray = ends[:n, 3:] / np.linalg.norm(ends[:n, 3:], axis=1, keepdims=True)
            across = np.array([np.linalg.svd(p[None])[2][1:] for p in ray])
            miss = np.einsum("nij,nj->ni", across, ends[:n, :3] - receiver)
            if np.linalg.norm(miss, axis=1).max() < 1e-2:
                break
            slopes = [
                np.einsum("nij,nj->ni", across, ends[k : k + n, :3] - ends[:n, :3]) / delta
                for k in (n, 2 * n)
            ]
            angles = angles - np.linalg.solve(np.stack(slopes, axis=2), miss[..., None])[..., 0].T
        assert np.linalg.norm(miss, axis=1).max() < 1.0, miss
        return total[:n] - np.sum(ends[:n, 3:] * (ends[:n, :3] - receiver), axis=1)

    def _shoot(self, source, angles, walls, times):
        """End states and travel times of rays."""
        azimuth, elevation = angles
        level = np.cos(elevation)
        unit = np.stack(
            [level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=1
        )
        state = np.concatenate([source, unit / self.speed(source)[:, None]], axis=1)
        total, m = np.zeros(len(source)), self.medium
        for leg in range(walls.shape[1]):
            duration = times[:, leg].copy()
            state = self._run(state, duration)
            on_surface = walls[:, leg] == self.SURFACE
            for _ in range(3):
                depth, slope, _ = sheet_under(m.bed.north, m.bed.east, m.bed.depth, state[:, :3])
                normal = np.column_stack([slope, -np.ones(len(slope))])
                normal[on_surface] = [0.0, 0.0, 1.0]
                gap = np.where(on_surface, state[:, 2], depth - state[:, 2])
                rate = np.sum(normal * state[:, 3:], axis=1) * self.speed(state[:, :3]) ** 2
                assert (rate < 0.0).all()  # towards the boundary
                state = self._run(state, -gap / rate)
                duration -= gap / rate
            total += duration
            np.testing.assert_allclose(gap, 0.0, atol=1e-6)
            normal /= np.linalg.norm(normal, axis=1, keepdims=True)
            state[:, 3:] -= 2.0 * np.sum(state[:, 3:] * normal, axis=1, keepdims=True) * normal
        last = times[:, -1]
        return self._run(state, last), total + last

    def _run(self, state, duration):
        """
        Integrate rays (n, 6) of position and slowness for their own times, possibly negative. [s]
        """

        def rates(_, flat):
            y = flat.reshape(len(state), 6)
            c = self.speed(y[:, :3])
            gradient = np.stack(
                [self.speed(y[:, :3], nu=nu) for nu in np.eye(3, dtype=int)], axis=1
            )
            change = np.concatenate([(c * c)[:, None] * y[:, 3:], -gradient / c[:, None]], axis=1)
            return (change * duration[:, None]).ravel()

        longest = np.abs(duration).max() * 1500.0
        step = min(1.0, self.LONGEST_STEP / longest) if longest > 0.0 else 1.0
        ray = solve_ivp(
            rates, (0.0, 1.0), state.ravel(), method="DOP853", rtol=1e-12, atol=1e-12, max_step=step
        )
        return ray.y[:, -1].reshape(len(state), 6)


def direct_travel_time_linear_gradient(source, receiver, *, sound_speed_surface, gradient):
    """
    Travel time [s] of the direct ray where sound speed is ``c0 + g z``, boundaries ignored.

    The metric ds/c is that of the hyperbolic half-space, so t = 2/|g| arcsinh(|g| d / 2 sqrt(c_s
    c_r)) for ends d apart with speeds c_s and c_r; this form keeps its digits for small gradients.
    """
    a, b = np.asarray(source, dtype=float), np.asarray(receiver, dtype=float)
    speeds = [sound_speed_surface + gradient * end[..., 2] for end in (a, b)]
    x = np.linalg.norm(b - a, axis=-1) / (2.0 * np.sqrt(speeds[0] * speeds[1]))
    return 2.0 * x if gradient == 0.0 else 2.0 / abs(gradient) * np.arcsinh(abs(gradient) * x)


def field_of(medium, values=None):
    """
    Scipy's interpolator of a medium's sound speed, or of values (north, east, depth, k), by the
    medium's definition.

    Linear, or cubic not-a-knot splines horizontally and a natural cubic spline in depth; one column
    is the same everywhere.
    """
    values = medium.sound_speed if values is None else values
    if values.shape[0] == 1:
        column = values[0, 0]
        if medium.interpolation == "linear":
            return lambda x: np.interp(x[:, 2], medium.depth, column)
        spline = CubicSpline(medium.depth, column, bc_type="natural")
        return lambda x: spline(x[:, 2])
    if medium.interpolation == "linear":
        return RegularGridInterpolator((medium.north, medium.east, medium.depth), values)
    north = make_interp_spline(medium.north, values, k=3, axis=0)
    east = make_interp_spline(medium.east, north.c, k=3, axis=1)
    depth = make_interp_spline(
        medium.depth, np.moveaxis(east.c, 0, 1), k=3, axis=2, bc_type="natural"
    )
    return NdBSpline((north.t, east.t, depth.t), np.moveaxis(depth.c, 0, 2), 3)


def sheet_under(north, east, sheet, place):
    """
    Bilinear depth under places (n, 2 or more), its slopes (n, 2), and the distance to the lines of
    its grid.
    """
    if sheet.shape == (1, 1):
        return (
            np.full(len(place), sheet[0, 0]),
            np.zeros((len(place), 2)),
            np.full(len(place), np.inf),
        )
    cells = []
    for axis, k in ((north, 0), (east, 1)):
        i = np.clip(np.searchsorted(axis, place[:, k]) - 1, 0, axis.size - 2)
        cells.append((i, (place[:, k] - axis[i]) / (axis[i + 1] - axis[i]), axis[i + 1] - axis[i]))
    (i, u, dn), (j, v, de) = cells
    b00, b10, b01, b11 = (sheet[i + p, j + q] for p, q in ((0, 0), (1, 0), (0, 1), (1, 1)))
    depth = (b00 * (1 - u) + b10 * u) * (1 - v) + (b01 * (1 - u) + b11 * u) * v
    slopes = (
        ((b10 - b00) * (1 - v) + (b11 - b01) * v) / dn,
        ((b01 - b00) * (1 - u) + (b11 - b10) * u) / de,
    )
    edge = np.minimum(np.minimum(u, 1.0 - u) * dn, np.minimum(v, 1.0 - v) * de)
    return depth, np.stack(slopes, axis=-1), edge


def cf_errors(files):
    """
    Errors against the CF conventions, by the checker of the IOOS, in a process of its own: what it
    imports warns.
    """
    pytest.importorskip("compliance_checker", reason="needs compliance-checker")
    command = [
        Path(sys.executable).with_name("compliance-checker"),
        "-t",
        "cf:1.11",
        "-c",
        "lenient",
    ]
    checked = subprocess.run([*command, *files], capture_output=True, text=True, check=False)
    failed = checked.returncode or "exceptions occurred" in checked.stdout + checked.stderr
    return checked.stdout + checked.stderr if failed else ""


class ParabolicEquation:
    """
    Field of a point source in water whose sound speed depends on depth, below a free surface: a
    split-step parabolic equation.

    One step is exp(i k0 dr (sqrt(1 + X) - 1)), approximated by a rational function of X on the axis
    (AAA algorithm), whose poles need one tridiagonal solution each. Second derivatives are compact
    differences of fourth order. The source is its plane-wave spectrum up to 22 degrees from the
    horizontal, the image included; steeper sound is tapered. Below `deepest` a layer absorbs all
    sound.
    """

    def __init__(self, speed, hz, source_depth, deepest, spacing, *, cells=8.0, wavelengths=16.0):
        """
        `speed` is a function of depth; ranges are multiples of `spacing`, depths go to `deepest`.
        [m]
        """
        self.hz, self.spacing = hz, spacing
        c0 = float(speed(np.array([source_depth]))[0])
        self.k0, wavelength = 2.0 * np.pi * hz / c0, c0 / hz
        self.dz, layer = wavelength / cells, max(40.0, 150.0 * wavelength)
        n = int(np.ceil((deepest + layer) / self.dz))
        z = self.dz * np.arange(1, n + 1)
        index = (c0 / speed(z)) ** 2 - 1.0 + 0.03j * np.maximum((z - deepest) / layer, 0.0) ** 2
        self.steps = int(np.ceil(spacing / (wavelengths * wavelength)))
        poles, self.weights, self.error = self._rational(self.k0 * spacing / self.steps)
        self.factors = _tridiagonal_factors(poles, index, 1.0 / (self.dz * self.k0) ** 2)
        self.start = self._spectrum_of_source(source_depth, (n + 1) * self.dz, n)

    def _rational(self, phase):
        """
        Poles of the step's rational function, its constant and residues, and its largest error.
        """
        x = np.concatenate([np.linspace(-14.0, -1.2, 80), np.linspace(-1.2, 0.06, 700)])
        root = np.sqrt(np.maximum(1.0 + x, 0.0)) + 1j * np.sqrt(np.maximum(-1.0 - x, 0.0))
        step = np.exp(1j * phase * (root - 1.0)) * 0.5 * erfc((-0.5 - x) / 0.07)
        poles = AAA(x, step, rtol=1e-9, max_terms=120).poles()
        columns = np.column_stack([np.ones(x.size), 1.0 / (x[:, None] - poles)])
        scale = np.abs(columns).max(axis=0)
        weights = np.linalg.lstsq(columns / scale, step, rcond=1e-15)[0] / scale
        return poles, weights, float(np.abs(columns @ weights - step).max())

    def _spectrum_of_source(self, depth, height, n):
        kz = np.pi * np.arange(1, n + 1) / height
        angle = np.degrees(np.arcsin(np.minimum(kz / self.k0, 1.0)))
        taper = 0.5 * (1.0 + np.cos(np.pi * np.clip((angle - 22.0) / 10.0, 0.0, 1.0)))
        horizontal = np.sqrt(np.maximum(self.k0**2 - kz**2, (0.3 * self.k0) ** 2))
        lines = taper * np.sin(kz * depth) / np.sqrt(horizontal) * 4.0 * np.pi / height
        return 0.25j * np.sqrt(2.0 / np.pi) * np.exp(-0.25j * np.pi) * dst(lines, type=1)

    def pressure(self, n_ranges, depths):
        """
        Pressure re 1 m at `spacing` times 1 to n_ranges (first axis) and some depths, time as
        exp(-i omega t).
        """
        at = np.asarray(depths) / self.dz - 1.0
        first = np.clip(np.floor(at).astype(int) - 2, 0, self.start.size - 6)
        near = np.arange(6)
        share = np.ones((at.size, 6))
        for a in range(6):
            for b in near[near != a]:
                share[:, a] *= (at - first - b) / (a - b)
        u, out = self.start.copy(), np.empty((n_ranges, at.size), complex)
        for row in range(n_ranges):
            _march(u, self.steps, self.weights, *self.factors)
            r = self.spacing * (row + 1)
            out[row] = (
                (u[first[:, None] + near] * share).sum(axis=1)
                * np.exp(1j * self.k0 * r)
                / np.sqrt(r)
            )
        return out


@njit(cache=True)
def _tridiagonal_factors(poles, index, off):
    """
    Factors of one matrix per pole: multipliers below the diagonal, inverse pivots, and what is
    above the diagonal.
    """
    shape = index.size, poles.size
    lower, pivot, upper = (
        np.zeros(shape, np.complex128),
        np.empty(shape, np.complex128),
        np.zeros(shape, np.complex128),
    )
    for j in range(poles.size):
        for i in range(index.size):
            diagonal = 10.0 / 12.0 * (index[i] - poles[j]) - 2.0 * off
            if i > 0:
                lower[i, j] = ((index[i - 1] - poles[j]) / 12.0 + off) * pivot[i - 1, j]
                diagonal -= lower[i, j] * upper[i - 1, j]
            pivot[i, j] = 1.0 / diagonal
            if i < index.size - 1:
                upper[i, j] = (index[i + 1] - poles[j]) / 12.0 + off
    return lower, pivot, upper


@njit(cache=True, fastmath=True)
def _march(u, steps, weights, lower, pivot, upper):
    """Carry a field over some steps in range, in place."""
    n, m = lower.shape
    right, v = np.empty(n, np.complex128), np.empty((n, m), np.complex128)
    for _ in range(steps):
        for i in range(n):
            above = u[i - 1] if i > 0 else 0.0
            below = u[i + 1] if i < n - 1 else 0.0
            right[i] = (above + 10.0 * u[i] + below) / 12.0
        for j in range(m):
            v[0, j] = right[0]
        for i in range(1, n):
            for j in range(m):
                v[i, j] = right[i] - lower[i, j] * v[i - 1, j]
        for j in range(m):
            v[n - 1, j] *= pivot[n - 1, j]
        for i in range(n - 2, -1, -1):
            for j in range(m):
                v[i, j] = (v[i, j] - upper[i, j] * v[i + 1, j]) * pivot[i, j]
        for i in range(n):
            total = weights[0] * u[i]
            for j in range(m):
                total += weights[j + 1] * v[i, j]
            u[i] = total


def image_source(source_depth, distance, depth, wavenumber):
    """Pressure re 1 m of a source and its image below a free surface in water of one speed."""
    straight, mirrored = (
        np.hypot(distance, depth - source_depth),
        np.hypot(distance, depth + source_depth),
    )
    return (
        np.exp(1j * wavenumber * straight) / straight
        - np.exp(1j * wavenumber * mirrored) / mirrored
    )

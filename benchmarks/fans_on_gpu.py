"""
Brute-force fans of rays in three dimensions on a GPU, one from each end of each link: the oracle of
`bench_lost_rays.py` at any range.

Run with ``python benchmarks/fans_on_gpu.py LINKS.npz RAYS.npz`` on a machine with CuPy and SciPy;
the package is not needed. LINKS.npz is written by ``bench_lost_rays.py --write LINKS.npz``, and
``--rays LINKS.npz RAYS.npz`` compares. Nothing here is shared with the solver: SciPy's splines
through the grid values give the field, a fixed-step RK4 integrates the rays, each ray is turned out
of the plane until it ends in it, and every change of sign of the miss between neighbouring rays is
a ray. A fan of ``--rays`` rays covers launch angles up to 0.35 rad on both sides of the horizontal.
"""

import argparse
import time

import cupy as cp
import numpy as np
from scipy.interpolate import CubicSpline, make_interp_spline

STEP = 15.0  # m, at most
PASSES = 4  # attempts to end in the plane
GRAZING = 0.5  # m
WIDEST = 0.35  # rad
COLUMNS = 8
Z, P, T, A, Y, Q, TOP, BED = range(COLUMNS)

SOURCE = r"""
struct Rate { double z, p, t, a, y, q; };

__device__ Rate rates(const double* station, const double* depth, int n, int& k,
                      double z, double p, double y,
                      double q, double c_source, bool& bad) {
  while (k < n - 2 && z >= depth[k + 1]) k++;
  while (k > 0 && z < depth[k]) k--;
  const double* d = station + 12 * k;
  double x = z - depth[k];
  double c = d[0] + x * (d[1] + x * (d[2] + x * d[3]));
  double cz = d[1] + x * (2.0 * d[2] + 3.0 * x * d[3]);
  double cy = d[4] + x * (d[5] + x * (d[6] + x * d[7]));
  double cyz = d[5] + x * (2.0 * d[6] + 3.0 * x * d[7]);
  double cyy = d[8] + x * (d[9] + x * (d[10] + x * d[11]));
  double cyyz = d[9] + x * (2.0 * d[10] + 3.0 * x * d[11]);
  c += y * (cy + 0.5 * y * cyy);
  cz += y * (cyz + 0.5 * y * cyyz);
  cy += y * cyy;
  double ic = 1.0 / c, n2 = c_source * c_source * ic * ic, h2 = n2 - p * p - q * q;
  if (!(h2 > 1e-4)) { bad = true; h2 = 1.0; }
  double ih = rsqrt(h2);
  Rate r = {p * ih, -n2 * cz * ic * ih, n2 * ih / c_source, ih, q * ih, -n2 * cy * ic * ih};
  return r;
}

// one thread a ray, one row of blocks a link
extern "C" __global__ void fans(const double* stations, const long long* first_station,
                                const double* depth, int n_depth,
                                const double* beds, const long long* first_bed,
                                const double* step, const int* steps,
                                const double* z_source, const double* c_source,
                                const double* first_angle,
                                const double* spacing, int n_rays, const double* q0, double* out) {
  int i = blockIdx.x * blockDim.x + threadIdx.x, link = blockIdx.y;
  if (i >= n_rays) return;
  const double* section = stations + first_station[link] * (n_depth - 1) * 12;
  const double* bed = beds + first_bed[link];
  double* o = out + ((long long)link * n_rays + i) * 8;
  double h = step[link], c0 = c_source[link], z = z_source[link];
  double p = sin(first_angle[link] + i * spacing[link]), t = 0, a = 0, y = 0;
  double q = q0[(long long)link * n_rays + i];
  double top = z, floor = bed[0] - z;
  long long row = (long long)(n_depth - 1) * 12;
  int k = 0;
  bool bad = false;
  for (int j = 0; j < steps[link] && !bad; j++) {
    const double* s = section + 2 * j * row;
    Rate r1 = rates(s, depth, n_depth, k, z, p, y, q, c0, bad);
    double g = 0.5 * h;
    Rate r2 = rates(s + row, depth, n_depth, k, z + g * r1.z, p + g * r1.p, y + g * r1.y,
        q + g * r1.q, c0, bad);
    Rate r3 = rates(s + row, depth, n_depth, k, z + g * r2.z, p + g * r2.p, y + g * r2.y,
        q + g * r2.q, c0, bad);
    Rate r4 = rates(s + 2 * row, depth, n_depth, k, z + h * r3.z, p + h * r3.p, y + h * r3.y,
        q + h * r3.q, c0, bad);
    double w = h / 6.0;
    z += w * (r1.z + 2.0 * r2.z + 2.0 * r3.z + r4.z);
    p += w * (r1.p + 2.0 * r2.p + 2.0 * r3.p + r4.p);
    t += w * (r1.t + 2.0 * r2.t + 2.0 * r3.t + r4.t);
    a += w * (r1.a + 2.0 * r2.a + 2.0 * r3.a + r4.a);
    y += w * (r1.y + 2.0 * r2.y + 2.0 * r3.y + r4.y);
    q += w * (r1.q + 2.0 * r2.q + 2.0 * r3.q + r4.q);
    top = fmin(top, z);
    floor = fmin(floor, bed[j + 1] - z);
    if (!(top > -50.0) || floor < -50.0) bad = true;
  }
  o[0] = bad ? nan("") : z; o[1] = p; o[2] = t; o[3] = a; o[4] = y; o[5] = q; o[6] = top;
  o[7] = floor;
}
"""
KERNEL = cp.RawKernel(SOURCE, "fans", options=("--fmad=true",))


class Medium:
    """Splines through the grid values of a medium, on the GPU."""

    def __init__(self, grid, name):
        self.north, self.east, self.depth, speed, self.bed_north, self.bed_east, self.bed = (
            grid[f"{name}_{part}"]
            for part in ("north", "east", "depth", "speed", "bed_north", "bed_east", "bed")
        )
        coefficients = CubicSpline(self.depth, speed, axis=2, bc_type="natural").c
        coefficients = np.moveaxis(coefficients[::-1], (0, 1), (3, 2))  # north, east, layer, power
        self.coefficients = cp.asarray(np.ascontiguousarray(coefficients))

    def _weights(self, nodes, x):
        basis = make_interp_spline(nodes, np.eye(nodes.size), k=min(3, nodes.size - 1))
        return [cp.asarray(basis(x, nu)) for nu in range(3)]

    def stations(self, source, azimuth, r):
        """
        Cubics in depth of the sound speed and its first and second derivative across the track, at
        ranges r; (n, layers, 12).
        """
        un, ue = np.cos(azimuth), np.sin(azimuth)
        wn, we = (
            self._weights(self.north, source[0] + r * un),
            self._weights(self.east, source[1] + r * ue),
        )
        n_north, n_east, layers, _ = self.coefficients.shape
        flat = self.coefficients.reshape(n_north * n_east, layers * 4)

        def value(i, j):
            weights = (wn[i][:, :, None] * we[j][:, None, :]).reshape(r.size, -1)
            return (weights @ flat).reshape(r.size, layers, 4)

        across = un * value(0, 1) - ue * value(1, 0)
        twice = ue * ue * value(2, 0) - 2.0 * ue * un * value(1, 1) + un * un * value(0, 2)
        return cp.concatenate([value(0, 0), across, twice], axis=2)

    def bed_under(self, source, azimuth, r):
        """Bilinear depth of the sea bed at ranges r."""
        if self.bed.size == 1:
            return np.full(r.size, self.bed.flat[0])
        place = source[0] + r * np.cos(azimuth), source[1] + r * np.sin(azimuth)
        cells = []
        for axis, x in zip((self.bed_north, self.bed_east), place, strict=True):
            i = np.clip(np.searchsorted(axis, x) - 1, 0, axis.size - 2)
            cells.append((i, (x - axis[i]) / (axis[i + 1] - axis[i])))
        (i, u), (j, v) = cells
        west = self.bed[i, j] * (1 - u) + self.bed[i + 1, j] * u
        return west * (1 - v) + (self.bed[i, j + 1] * (1 - u) + self.bed[i + 1, j + 1] * u) * v

    def speed(self, layers, z):
        k = int(np.clip(np.searchsorted(self.depth, z, side="right") - 1, 0, self.depth.size - 2))
        d, x = cp.asnumpy(layers[k, :4]), z - self.depth[k]
        return d[0] + x * (d[1] + x * (d[2] + x * d[3]))


class Batch:
    """Sections of some links of one medium on the GPU."""

    def __init__(self, medium, sources, receivers):
        self.medium = medium
        away = (receivers - sources)[:, :2]
        self.distance, azimuth = np.hypot(*away.T), np.arctan2(away[:, 1], away[:, 0])
        self.steps = np.ceil(self.distance / STEP).astype(np.int32)
        self.step = self.distance / self.steps
        sections, beds = [], []
        for source, angle, step, n in zip(sources, azimuth, self.step, self.steps, strict=True):
            sections.append(medium.stations(source, angle, 0.5 * step * np.arange(2 * n + 1)))
            beds.append(medium.bed_under(source, angle, step * np.arange(n + 1)))
        self.z_source, self.z_end = sources[:, 2], receivers[:, 2]
        self.c_source = np.array(
            [medium.speed(s[0], z) for s, z in zip(sections, self.z_source, strict=True)]
        )
        self.c_end = np.array(
            [medium.speed(s[-1], z) for s, z in zip(sections, self.z_end, strict=True)]
        )
        self.first_station = np.concatenate([[0], np.cumsum([len(s) for s in sections])[:-1]])
        self.first_bed = np.concatenate([[0], np.cumsum([len(b) for b in beds])[:-1]])
        self.stations, self.beds = cp.concatenate(sections), cp.asarray(np.concatenate(beds))
        self.depth = cp.asarray(medium.depth)

    def trace(self, links, first_angle, spacing, n_rays):
        """States (links, n_rays, 8) of fans that end in the plane."""
        n = len(links)
        q, out = cp.zeros((n, n_rays)), cp.empty((n, n_rays, COLUMNS))
        arguments = (
            self.stations,
            cp.asarray(self.first_station[links].astype(np.int64)),
            self.depth,
            np.int32(self.depth.size),
            self.beds,
            cp.asarray(self.first_bed[links].astype(np.int64)),
            cp.asarray(self.step[links]),
            cp.asarray(self.steps[links].astype(np.int32)),
            cp.asarray(self.z_source[links]),
            cp.asarray(self.c_source[links]),
            cp.asarray(first_angle),
            cp.asarray(spacing),
            np.int32(n_rays),
        )
        for turn in range(PASSES):
            KERNEL(((n_rays + 127) // 128, n), (128,), (*arguments, q, out))
            if turn < PASSES - 1:
                better = q - out[:, :, Y] / out[:, :, A]
                q = cp.where(cp.isfinite(out[:, :, Z]) & cp.isfinite(better), better, q)
        return out

    def roots(self, links, first_angle, spacing, out):
        """
        Rays at changes of sign: link, angle, travel time, level [dB], slope [m/rad], grazing, and
        cross-track offset [m].
        """
        miss = out[:, :, Z] - cp.asarray(self.z_end[links])[:, None]
        wet = (out[:, :, TOP] > -GRAZING) & (out[:, :, BED] > -GRAZING)
        row, i = cp.nonzero(wet[:, :-1] & wet[:, 1:] & (miss[:, :-1] * miss[:, 1:] <= 0.0))
        n_rays = miss.shape[1]
        four = [cp.asnumpy(miss[row, cp.clip(i + k, 0, n_rays - 1)]) for k in (-1, 0, 1, 2)]
        ends = [cp.asnumpy(out[row, i + k]) for k in (0, 1)]
        row, i = cp.asnumpy(row), cp.asnumpy(i)
        f, width, which = four[1] - four[2], spacing[row], links[row]
        u = np.where(f != 0.0, four[1] / np.where(f != 0.0, f, 1.0), 0.5)
        d0, d1 = (four[2] - four[0]) / (2.0 * width), (four[3] - four[1]) / (2.0 * width)
        slope = np.where(np.isfinite(d0 + d1), (1 - u) * d0 + u * d1, -f / width)
        at = (1 - u)[:, None] * ends[0] + u[:, None] * ends[1]
        n = self.c_source[which] / self.c_end[which]
        area = np.abs(slope) * np.sqrt(np.maximum(n * n - at[:, P] ** 2, 0.0)) / n * at[:, A]
        chord2 = self.distance[which] ** 2 + (self.z_end[which] - self.z_source[which]) ** 2
        level = 10.0 * np.log10(np.maximum(area, 1e-30) * n / chord2)
        grazing = np.minimum(at[:, TOP], at[:, BED]) < GRAZING
        angle = first_angle[row] + (i + u) * width
        return np.column_stack([which, angle, at[:, T], level, np.abs(slope), grazing, at[:, Y]])

    def dips(self, links, out):
        """
        Links and indices of rays about which the miss has an extremum near zero without a change of
        sign.
        """
        miss = out[:, :, Z] - cp.asarray(self.z_end[links])[:, None]
        wet = (out[:, :, TOP] > -GRAZING) & (out[:, :, BED] > -GRAZING)
        size, bend = cp.abs(miss), cp.abs(miss[:, :-2] - 2.0 * miss[:, 1:-1] + miss[:, 2:])
        low = (
            (size[:, 1:-1] <= size[:, :-2])
            & (size[:, 1:-1] <= size[:, 2:])
            & (size[:, 1:-1] < bend)
        )
        one_sign = (miss[:, :-2] * miss[:, 1:-1] > 0.0) & (miss[:, 2:] * miss[:, 1:-1] > 0.0)
        row, i = cp.nonzero(low & one_sign & wet[:, :-2] & wet[:, 1:-1] & wet[:, 2:])
        return links[cp.asnumpy(row)], cp.asnumpy(i) + 1


def fans(medium, sources, receivers, n_rays, size=48, parts=64):
    """Rays of all links of a medium, as `Batch.roots`."""
    rows = []
    for start in range(0, len(sources), size):
        stop = min(start + size, len(sources))
        batch = Batch(medium, sources[start:stop], receivers[start:stop])
        links = np.arange(stop - start)
        width = 2.0 * WIDEST / (n_rays - 1)
        first, spacing = np.full(len(links), -WIDEST), np.full(len(links), width)
        out = batch.trace(links, first, spacing, n_rays)
        found = [batch.roots(links, first, spacing, out)]
        near, i = batch.dips(links, out)
        del out
        if near.size:
            first, spacing = -WIDEST + (i - 1) * width, np.full(near.size, 2.0 * width / parts)
            out = batch.trace(near, first, spacing, parts + 1)
            found.append(batch.roots(near, first, spacing, out))
        table = np.concatenate(found)
        table[:, 0] += start
        rows.append(table)
    return np.concatenate(rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument("links")
    parser.add_argument("out")
    parser.add_argument("--rays", type=int, default=131_072, help="of a fan")
    parser.add_argument("--first", type=int, help="at most this number of links of each medium")
    options = parser.parse_args()
    grid = np.load(options.links)
    results = {}
    for name in grid["media"]:
        medium = Medium(grid, name)
        ends = [grid[f"{name}_{end}"][: options.first] for end in ("source", "receiver")]
        for end, pair in (("source", ends), ("receiver", ends[::-1])):
            start = time.perf_counter()
            rows = fans(medium, *pair, options.rays)
            results[f"{name}_{end}"] = rows[rows[:, 3] < 20.0]
            strong = (rows[:, 3] < 15.0) & (rows[:, 5] == 0.0)
            seconds = time.perf_counter() - start
            print(
                f"{name}, from the {end}: {strong.sum()} rays within 15 dB, {seconds:.1f} s",
                flush=True,
            )
        np.savez_compressed(options.out, **results)


if __name__ == "__main__":
    main()

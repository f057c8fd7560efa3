"""
Set band-limited impulse responses of ray theory beside those of wave theory: times and levels by
frequency.

Run with ``python benchmarks/waves_beside_rays.py``; it needs ``pyram`` (split-step Padé parabolic
equation, BSD) and, for ``--modes``, ``pelagic`` (KRAKEN, GPL; used here only, never by the
package). Links are seeded by name below: places in the synthetic Beaufort Sea and Fram Strait
(their middle columns, and sections through the full fields). The sea bed absorbs all sound, so what
arrives is direct or reflected at the surface.
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from bench_links import arctic, fram
from scipy.interpolate import CubicHermiteSpline

from pymantaray.acoustics import (
    Leakage,
    Medium,
    RayPaths,
    find_eigenrays,
    find_leaks,
    trace_fan,
    transmission_loss,
)
from pymantaray.records import Arrivals

FIGURES = Path(__file__).parent.parent / "docs" / "figures"
PADE_TERMS = 6
CELLS_A_WAVELENGTH = 20.0
WAVELENGTHS_A_STEP = 16.0
ABSORBER = 100.0  # wavelengths of absorbing bed below the water
TIME_WINDOW = 0.16  # s; later arrivals fold back into it
PERIODS_A_WINDOW = 80.0  # at most: no more frequencies at 2 kHz than at 500 Hz
MODE_WINDOW = 0.64  # s; KRAKEN's bed reflects, and echoes of it come for half a second
MAX_SURFACE_BOUNCES = 15
FLOOR = -55.0  # dB; weaker waves are an echo of the bed, -57 dB at 1 and 2 kHz, and of the steps


@dataclass(frozen=True)
class Link:
    """Two places in a vertical section northwards from the middle of a sea."""

    name: str
    sea: str
    distance: float
    source_depth: float
    receiver_depth: float
    water_depth: float


class Band(NamedTuple):
    """
    Hann-weighted band: centre and half-amplitude width [Hz], and the time after which its responses
    repeat [s].
    """

    centre: float
    width: float
    window: float = TIME_WINDOW

    @classmethod
    def around(cls, centre: float) -> "Band":
        """A quarter of its centre wide."""
        return cls(centre, centre / 4.0, min(TIME_WINDOW, PERIODS_A_WINDOW / centre))

    def frequencies(self) -> np.ndarray:
        """Multiples of 1 / window in the band, twice its width from end to end. [Hz]"""
        step = 1.0 / self.window
        first, last = (
            np.ceil((self.centre - self.width) / step),
            np.floor((self.centre + self.width) / step),
        )
        return step * np.arange(first + 1, last)

    def weights(self) -> np.ndarray:
        """Spectrum of a pulse whose envelope has height 1."""
        hann = 0.5 + 0.5 * np.cos(np.pi * (self.frequencies() - self.centre) / self.width)
        return hann / hann.sum()


def middle_column(sea: Medium) -> Medium:
    speed = sea.sound_speed[sea.north.size // 2, sea.east.size // 2]
    return Medium.from_profile(sea.depth, speed, bottom_depth=float(sea.bed.depth.max()))


def ends(link: Link) -> tuple[np.ndarray, np.ndarray]:
    return np.array([0.0, 0.0, link.source_depth]), np.array(
        [link.distance, 0.0, link.receiver_depth]
    )


def section(medium: Medium, link: Link, n_ranges: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depths, ranges and sound speed (depth, range) of the water that a wave runs through."""
    depth = np.linspace(0.0, link.water_depth, round(link.water_depth) + 1)
    ranges = np.linspace(0.0, link.distance, n_ranges) if n_ranges > 1 else np.zeros(1)
    place = np.stack(np.meshgrid(ranges, [0.0], depth, indexing="ij"), axis=-1).reshape(-1, 3)
    place[:, 2] = np.maximum(place[:, 2], 1e-3)
    return depth, ranges, medium.sound_speed_at(place).reshape(n_ranges, depth.size).T


def parabolic(
    frequency: float,
    link: Link,
    water: tuple[np.ndarray, np.ndarray, np.ndarray],
    finer: float = 1.0,
) -> complex:
    """
    Pressure at the receiver of a source of 1 at 1 m, time dependence exp(-i omega t); steps are
    shorter by a factor.
    """
    depth, ranges, speed = water
    wavelength = float(speed.mean()) / frequency
    steps = int(np.ceil(finer * link.distance / (WAVELENGTHS_A_STEP * wavelength)))
    bed = [np.full((2, 1), value) for value in (speed[-1].mean(), 1.0)]
    from pyram.PyRAM import PyRAM  # which compiles for some seconds when it is imported

    model = PyRAM(
        frequency, link.source_depth, link.receiver_depth,
        depth, ranges, speed,
        np.array([0.0, 0.0 + ABSORBER * wavelength]), np.zeros(1), *bed, np.array([[0.0], [1.0]]),
        np.array([[0.0, depth[-1]], [link.distance, depth[-1]]]),
        np=PADE_TERMS, dr=link.distance / steps, dz=wavelength / (finer * CELLS_A_WAVELENGTH),
        rmax=link.distance * (1 + 1e-9), rs=link.distance, ndz=10**4, c0=float(speed.mean()),
        lyrw=10.0,
    )  # fmt: skip
    result = model.run()
    phase = 2.0 * np.pi * frequency / result["c0"] * link.distance + 0.25 * np.pi
    return complex(result["CP Line"][-1] * np.exp(1j * phase) / np.sqrt(link.distance))


def modal(band: Band, link: Link, water: tuple[np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
    """
    Spectrum at the receiver as the sum of KRAKEN's modes over a fast bed, time dependence exp(-i
    omega t).
    """
    from pelagic import kraken

    depth, _, speed = water
    levels = slice(None, None, 5)
    case = kraken.Case.from_dict(
        {
            "pelagic": 2,
            "model": "kraken",
            "title": link.name,
            "frequency": band.frequencies().tolist(),
            "interpolation": "n2_linear",
            "media": [
                {
                    "to": float(depth[-1]),
                    "ssp": np.column_stack([depth, speed[:, 0]])[levels].tolist(),
                }
            ],
            "surface": "vacuum",
            "bottom": {"type": "halfspace", "cp": 1800.0, "rho": 1.0, "ap": 0.5},
            "source": {"depth": [link.source_depth]},
            "receivers": {"depth": [link.receiver_depth], "range": [link.distance]},
            "kraken": {
                "solver": "kraken",
                "phase_speed": [1300.0, 1790.0],
                "max_range": 1e4,
                "mode_limit": 9999,
            },
        }
    )
    spectrum = []
    for result in case.run().to_xarray():
        modes = result["profiles"][0]
        k = modes.wavenumber.to_numpy()
        source, receiver = (
            modes.eigenfunction.sel(sample_depth=z).to_numpy()
            for z in (link.source_depth, link.receiver_depth)
        )
        terms = source * receiver * np.exp(1j * k * link.distance) / np.sqrt(k)
        spectrum.append(np.sqrt(2j * np.pi / link.distance) * terms.sum())
    return np.array(spectrum)


def caustics(medium: Medium, link: Link, arrivals: Arrivals) -> np.ndarray:
    """
    How many caustics each ray has touched: zeros of its unfolded depth's derivative by the launch
    angle.
    """
    source, _ = ends(link)
    at = np.linspace(0.02, 1.0, 4000) * link.distance
    counts = np.zeros(arrivals.link.size, dtype=int)
    for row, angle in enumerate(arrivals.launch_angle):
        beside = angle + np.array([-1e-5, 1e-5])
        most = int(arrivals.surface_bounces[row]) + 1
        paths = trace_fan(
            medium, source, 0.0, beside, link.distance, max_surface_bounces=most, tolerance=1e-6
        )
        difference = unfolded_depth(paths, 1)(at) - unfolded_depth(paths, 0)(at)
        counts[row] = np.count_nonzero(np.diff(np.sign(difference)))
    return counts


def unfolded_depth(paths: RayPaths, ray: int) -> CubicHermiteSpline:
    """Depth of a northward ray over range, its sign changed by every reflection at the surface."""
    rows = np.flatnonzero(paths.arrival == ray)
    reflected = np.cumsum(paths.boundary[rows] == 1) // 2
    rows, reflected = rows[paths.boundary[rows] == 0], reflected[paths.boundary[rows] == 0]
    sign = (-1.0) ** reflected
    slope = paths.slowness[rows, 2] / paths.slowness[rows, 0]
    return CubicHermiteSpline(paths.position[rows, 0], sign * paths.position[rows, 2], sign * slope)


def ray_spectrum(band: Band, medium: Medium, link: Link) -> tuple[Arrivals, np.ndarray]:
    """
    All arrivals of a link, and the spectrum of their sum in the band, caustics and reflections in
    its phases.
    """
    source, receiver = ends(link)
    arrivals = find_eigenrays(medium, source[None], receiver[None], MAX_SURFACE_BOUNCES, 0, None)
    loss = transmission_loss(
        medium, source[None], receiver[None], arrivals, frequency_hz=band.centre
    )
    turns = (
        np.exp(-0.5j * np.pi * caustics(medium, link, arrivals))
        * (-1.0) ** arrivals.surface_bounces
    )
    phase = 2j * np.pi * band.frequencies()[:, None] * arrivals.travel_time
    return arrivals, (10.0 ** (-loss.geometric_db / 20.0) * turns * np.exp(phase)).sum(axis=1)


def envelope(band: Band, spectrum: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Envelope of the band-limited impulse response."""
    turn = np.exp(-2j * np.pi * np.outer(time, band.frequencies() - band.centre))
    return np.abs(turn @ (band.weights() * spectrum))


class Compared(NamedTuple):
    """
    One link in one band, waves and rays: envelopes relative to spherical spreading over the
    straight distance.
    """

    time: np.ndarray
    """After the chord's. [s]"""
    wave: np.ndarray
    ray: np.ndarray
    arrivals: int
    misfit: float
    """Energy of the difference of both responses over the waves' energy."""
    leak: tuple[float, float] | None
    """
    Level [dB] and time after the chord's [s] of what the leakage model lets through where no ray
    goes.
    """

    def row(self, link: Link, band: Band) -> dict[str, Any]:
        """
        The waves' highest peak, NaN below what they resolve, and the rays' highest within half a
        resolved time of it.
        """
        peak = int(np.argmax(self.wave))
        row = {"link": link.name, "frequency_hz": band.centre, "rays": self.arrivals}
        level = 20.0 * np.log10(self.wave[peak])
        row["wave_db"] = level if level > FLOOR else np.nan
        if self.leak is not None and level > FLOOR:
            row["leak_minus_wave_db"] = self.leak[0] - row["wave_db"]
            row["leak_minus_wave_ms"] = 1e3 * (self.leak[1] - self.time[peak])
        if self.arrivals == 0:
            return row | {"resolved_ms": 500.0 / band.width}
        near = int(
            np.argmax(
                np.where(np.abs(self.time - self.time[peak]) < 0.5 / band.width, self.ray, 0.0)
            )
        )
        row["ray_minus_wave_db"] = 20.0 * np.log10(self.ray[near] / self.wave[peak])
        row["ray_minus_wave_ms"] = 1e3 * (self.time[near] - self.time[peak])
        return row | {"resolved_ms": 500.0 / band.width, "misfit": self.misfit}


def leak(band: Band, medium: Medium, link: Link, chord: float) -> tuple[float, float] | None:
    """
    Level relative to spherical spreading [dB] and time after the chord's [s] of what leaks; None
    where no ray is near.
    """
    source, receiver = ends(link)
    leaks = find_leaks(
        medium,
        source[None],
        receiver[None],
        Leakage(),
        band.centre,
        bounces=(MAX_SURFACE_BOUNCES, 0),
    )
    if not leaks.link.size:
        return None
    return -float(leaks.arrivals.spreading_db[0]), float(
        leaks.arrivals.travel_time[0] + leaks.shift[0]
    ) - chord


def compare(sea: Medium, link: Link, band: Band, workers: int = 1, finer: float = 1.0) -> Compared:
    """Both responses of a link in a band, waves with steps shorter by a factor."""
    medium, n_ranges = (sea, 26) if link.name.endswith("section") else (middle_column(sea), 1)
    solve = partial(parabolic, link=link, water=section(medium, link, n_ranges), finer=finer)
    if workers > 1:
        with ProcessPoolExecutor(workers) as pool:
            wave = np.array(list(pool.map(solve, band.frequencies().tolist())))
    else:
        wave = np.array([solve(frequency) for frequency in band.frequencies().tolist()])
    arrivals, ray = ray_spectrum(band, medium, link)
    source, receiver = ends(link)
    distance, chord = float(np.linalg.norm(receiver - source)), float(arrivals.chord_travel_time[0])
    after = np.arange(-0.25, 0.75, 1.0 / (50.0 * band.width * band.window)) * band.window
    waves, rays = (distance * envelope(band, spectrum, chord + after) for spectrum in (wave, ray))
    weights = band.weights()
    misfit = np.sum(np.abs(weights * (wave - ray)) ** 2) / np.sum(np.abs(weights * wave) ** 2)
    leaked = None if arrivals.link.size else leak(band, medium, link, chord)
    return Compared(after, waves, rays, arrivals.link.size, float(misfit), leaked)


def compare_modes(sea: Medium, link: Link, band: Band) -> None:
    """Print the highest peak of KRAKEN's modes beside that of the parabolic equation."""
    medium = middle_column(sea)
    modes = modal(band._replace(window=MODE_WINDOW), link, section(medium, link, 1))
    reference = compare(sea, link, band)
    source, receiver = ends(link)
    chord = find_eigenrays(medium, source, receiver).chord_travel_time[0]
    spectrum = envelope(band._replace(window=MODE_WINDOW), modes, chord + reference.time)
    wave = spectrum * np.linalg.norm(receiver - source)
    peak = int(np.argmax(reference.wave))
    near = int(
        np.argmax(
            np.where(np.abs(reference.time - reference.time[peak]) < 0.5 / band.width, wave, 0.0)
        )
    )
    gap = 20.0 * np.log10(wave[near] / reference.wave[peak])
    late = 1e3 * (reference.time[near] - reference.time[peak])
    print(
        f"{link.name}, {band.centre:.0f} Hz: modes beside the parabolic equation {gap:+.2f} dB,"
        f" {late:+.2f} ms",
        flush=True,
    )


def check(sea: Medium, link: Link, band: Band) -> None:
    """
    Print what steps of half the length, and twice the time, change in the waves' highest peak.
    """
    reference = compare(sea, link, band)
    longer = band._replace(window=2.0 * band.window)
    for label, other in (
        ("half the steps", compare(sea, link, band, finer=2.0)),
        ("twice the time", compare(sea, link, longer)),
    ):
        gap = 20.0 * np.log10(other.wave.max() / reference.wave.max())
        late = 1e3 * (other.time[np.argmax(other.wave)] - reference.time[np.argmax(reference.wave)])
        print(
            f"{link.name}, {band.centre:.0f} Hz, {label}: {gap:+.3f} dB, {late:+.2f} ms", flush=True
        )


LINKS = (
    Link("Beaufort, two arrivals", "beaufort", 3000.0, 100.0, 300.0, 700.0),
    Link("Beaufort, six arrivals in 6 ms", "beaufort", 5000.0, 20.0, 200.0, 700.0),
    Link("Beaufort, surface duct", "beaufort", 5000.0, 20.0, 20.0, 500.0),
    Link("Beaufort, through the duct's lid", "beaufort", 2000.0, 20.0, 80.0, 500.0),
    Link("Beaufort, section", "beaufort", 5000.0, 100.0, 300.0, 700.0),
    Link("Fram, two arrivals", "fram", 5000.0, 100.0, 200.0, 700.0),
    Link("Fram, beside a caustic", "fram", 2000.0, 50.0, 80.0, 500.0),
    Link("Fram, shadow 6 m deep", "fram", 8000.0, 50.0, 120.0, 700.0),
    Link("Fram, shadow 17 m deep", "fram", 2000.0, 20.0, 20.0, 500.0),
    Link("Fram, shadow 150 m deep", "fram", 5000.0, 20.0, 50.0, 500.0),
    Link("Fram, section", "fram", 5000.0, 100.0, 200.0, 700.0),
)


DRAWN = (LINKS[0], LINKS[1], LINKS[6], LINKS[7])
DRAWN_AT = 500.0


def draw(table: pd.DataFrame, seas: dict[str, Medium], path: Path) -> None:
    """Envelopes of four links, and the rays' error in level over frequency of all."""
    from pymantaray.plotting import style

    @style.styled
    def figure() -> object:
        figure = style.new_figure(
            style.DOUBLE,
            5.2,
            f"Middle columns of the synthetic seas; envelopes at {DRAWN_AT:.0f} Hz,"
            f" {DRAWN_AT / 4:.0f} Hz wide",
        )
        grid = figure.add_gridspec(3, 2)
        for place, letter, link in zip(
            ((0, 0), (0, 1), (1, 0), (1, 1)), "abcd", DRAWN, strict=True
        ):
            axes = figure.add_subplot(grid[place])
            compared = compare(seas[link.sea], link, Band.around(DRAWN_AT))
            axes.plot(1e3 * compared.time, compared.wave, color=style.INK, label="Waves")
            axes.plot(
                1e3 * compared.time, compared.ray, color=style.ORANGE, linestyle="--", label="Rays"
            )
            axes.set_xlim(-25.0, 40.0)
            axes.set_ylim(0.0, None)
            style.panel_title(axes, letter, link.name)
            if place[1] == 0:
                axes.set_ylabel("Level re spherical")
            if place[0] == 1:
                axes.set_xlabel("Time after the chord's [ms]")
            if place == (0, 0):
                axes.legend()
        axes = figure.add_subplot(grid[2, :])
        cycle = zip(
            (style.BLUE, style.SKY, style.PINK, style.GREEN, style.ORANGE, style.GREY),
            "osD^v<",
            strict=True,
        )
        rows = table.dropna(subset=["ray_minus_wave_db"])
        names = [
            link.name
            for link in LINKS
            if link.name in set(rows["link"]) and not link.name.endswith("section")
        ]
        for name, (colour, marker) in zip(names, cycle, strict=True):
            mine = rows[rows["link"] == name]
            axes.semilogx(
                mine["frequency_hz"],
                mine["ray_minus_wave_db"],
                color=colour,
                marker=marker,
                label=name,
            )
        axes.axhspan(-3.0, 3.0, color=style.BAND, zorder=0)
        ticks = sorted(set(rows["frequency_hz"]))
        axes.set_xticks(ticks, [f"{tick:.0f}" for tick in ticks])
        axes.minorticks_off()
        axes.set_xlabel("Frequency [Hz]")
        axes.set_ylabel("Rays less waves [dB]")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.32), ncol=3)
        style.panel_title(axes, "e", "Level of the highest peak; grey: 3 dB either way")
        return figure

    path.write_bytes(style.rendered(figure(), ["png"])["png"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--frequencies",
        type=float,
        nargs="+",
        default=[250.0, 500.0, 1000.0, 2000.0],
        help="centres [Hz]",
    )
    parser.add_argument("--links", nargs="+", default=[""], help="parts of names of links")
    parser.add_argument(
        "--modes",
        action="store_true",
        help="only KRAKEN beside the parabolic equation, two links, 250 Hz",
    )
    parser.add_argument(
        "--check",
        action="store_true",
        help="only the waves beside those of half the steps and of twice the time",
    )
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument(
        "--out", type=Path, default=FIGURES, help="folder of waves_beside_rays.csv and .png"
    )
    options = parser.parse_args()
    seas = {"beaufort": arctic(), "fram": fram()}
    if options.modes:
        for link in (LINKS[0], LINKS[5]):
            compare_modes(seas[link.sea], link, Band.around(250.0))
        return
    chosen = [link for link in LINKS if any(part in link.name for part in options.links)]
    if options.check:
        for link in chosen:
            for frequency in options.frequencies:
                check(seas[link.sea], link, Band.around(frequency))
        return
    path = options.out / "waves_beside_rays.csv"
    table = pd.read_csv(path) if path.exists() else pd.DataFrame(columns=["link", "frequency_hz"])
    for frequency in options.frequencies:
        for link in chosen:
            if ((table["link"] == link.name) & (table["frequency_hz"] == frequency)).any():
                continue
            band = Band.around(frequency)
            row = compare(seas[link.sea], link, band, options.workers).row(link, band)
            table = pd.concat([table, pd.DataFrame([row])], ignore_index=True)
            table.round(4).to_csv(path, index=False)
    print(table.to_string(index=False, float_format="{:.3f}".format))
    draw(table, seas, path.with_suffix(".png"))


if __name__ == "__main__":
    main()

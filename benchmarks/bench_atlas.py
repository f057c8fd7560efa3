"""
What an atlas costs: columns a second, where the time goes, memory as it grows, and what a whole
region takes.

    python benchmarks/bench_atlas.py [columns] [memory] [frames]

CPU seconds of one thread count; wall times only where they are named.
"""

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):  # as workers have it
    os.environ.setdefault(name, "1")

import resource
import sys
import tempfile
import time
from itertools import product
from pathlib import Path

import numpy as np

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.apps.atlas import Atlas, AtlasLinks, run_atlas
from pymantaray.apps.atlas.blocks import column_errors, medium_at
from pymantaray.geometry import LocalFrame
from pymantaray.ocean import synthetic_ocean, to_local
from pymantaray.ocean.grid_points import GridPoints
from pymantaray.ocean.window import crop

PLACES = 24  # columns of each region in `frames`
BLOCKS = 4  # blocks of 16 x 16 columns that are timed in each region
LINKS = AtlasLinks()


def places(ocean):
    """Columns spread over a region."""
    rng = np.random.default_rng(5)
    rows = rng.integers(4, ocean.sizes["lat"] - 4, PLACES)
    columns = rng.integers(8, ocean.sizes["lon"] - 8, PLACES)
    return [
        (float(ocean["lat"][i]), float(ocean["lon"][j])) for i, j in zip(rows, columns, strict=True)
    ]


def columns() -> None:
    """
    Water and rays of the columns of whole blocks of each region, as workers compute them, and what
    all columns take.
    """
    for region in ("beaufort", "fram"):
        ocean, blocks = synthetic_ocean(region), Atlas(f"synthetic:{region}", LINKS).blocks
        column_errors(medium_at(GridPoints.of(ocean), places(ocean)[0], LINKS), LINKS)  # compiles
        water = rays = 0.0
        computed = 0
        for block in blocks[len(blocks) // (2 * BLOCKS) :: len(blocks) // BLOCKS][:BLOCKS]:
            begin = time.process_time()
            points = GridPoints.of(crop(ocean, block.window))
            water += time.process_time() - begin
            for place in product(block.lat, block.lon):
                begin = time.process_time()
                medium = medium_at(points, place, LINKS)
                middle = time.process_time()
                water += middle - begin
                if medium is not None:
                    column_errors(medium, LINKS)
                    rays += time.process_time() - middle
                    computed += 1
        each, count = (water + rays) / computed, ocean.sizes["lat"] * ocean.sizes["lon"]
        print(
            f"{region}: {LINKS.count} links a column, {computed} columns; CPU"
            f" {1e3 * water / computed:.2f} ms water, {1e3 * rays / computed:.2f} ms rays;"
            f" {1.0 / each:.1f} columns a second; all {count} columns {count * each / 60.0:.1f} min"
            " of CPU"
        )


def memory() -> None:
    """Largest worker and parent of an atlas of few and of many columns."""
    links = AtlasLinks(
        pairs=((800.0, 800.0),), distances=(2_000.0,), bearings=1
    )  # rays that cost nothing
    with tempfile.TemporaryDirectory(prefix="bench-atlas-") as folder:
        for every in (16, 4):
            atlas = Atlas("synthetic:beaufort", links, every=every)
            begin = time.perf_counter()
            path = run_atlas(atlas, Path(folder, f"{every}.nc"), workers=1)
            worker, parent = (
                resource.getrusage(who).ru_maxrss / 1024
                for who in (resource.RUSAGE_CHILDREN, resource.RUSAGE_SELF)
            )
            n = int(np.prod(atlas.shape))
            print(
                f"{n} columns, {len(atlas.blocks)} blocks: largest worker {worker:.0f} MiB, parent"
                f" {parent:.0f} MiB; {path.stat().st_size / 1e3:.0f} kB,"
                f" {time.perf_counter() - begin:.0f} s of wall time"
            )


def frames() -> None:
    """
    One medium for a block of columns against one for each: what it saves, and how far it is off.
    """
    half = 30_000.0
    for region in ("beaufort", "fram"):
        ocean = synthetic_ocean(region)
        points = GridPoints.of(ocean)
        middle = (float(ocean["lat"][38]), float(ocean["lon"][125]))
        begin = time.process_time()
        local = to_local(ocean, middle, (half + LINKS.half_extent, half + LINKS.half_extent))
        block = Medium.from_dataset(local)
        took = time.process_time() - begin
        frame, (a, b), worst = LocalFrame(*middle), LINKS.ends(), []
        inside = [p for p in places(ocean) if np.abs(frame.to_local(*p)).max() < half] or [middle]
        inside.append((float(ocean["lat"][44]), float(ocean["lon"][137])))
        for place in inside:
            offset, turn = (
                np.array([*frame.to_local(*place), 0.0]),
                float(frame.convergence(*place)),
            )
            rotation = np.array(
                [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
            )
            ends = a @ rotation.T + offset, b @ rotation.T + offset
            first = find_eigenrays(block, *ends, threads=1).first()
            error = first.source_sound_speed * first.travel_time - np.linalg.norm(
                ends[1] - ends[0], axis=-1
            )
            own = column_errors(medium_at(points, place, LINKS), LINKS).range_error[0].ravel()
            worst.append(np.nanmax(np.abs(error - own)))
        print(
            f"{region}: one medium for 60 km x 60 km {1e3 * took:.0f} ms of CPU, scale error"
            f" {local.attrs['scale_error_max']:.1e}; range errors differ by up to {max(worst):.1e}"
            " m"
        )


if __name__ == "__main__":
    for what in sys.argv[1:] or ("columns", "memory", "frames"):
        {"columns": columns, "memory": memory, "frames": frames}[what]()

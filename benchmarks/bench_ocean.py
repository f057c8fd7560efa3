"""
Time and peak memory of opening and preparing an ocean of the paper's size: 251 x 76 points, 40
levels.

Run with ``python benchmarks/bench_ocean.py``. The file has HYCOM's schema and the synthetic
Beaufort Sea's values, once packed as HYCOM packs (NetCDF-3, 16-bit integers), once as NetCDF-4 in
double precision. Each case runs in a process of its own, so that the peak is that of opening and
preparing: `open_ocean`, `to_local` and `Medium.from_dataset`, imports included and apart. A child
process reads NetCDF-4; its peak is told too. The goal is 3 s and 500 MB; on a busy machine look at
the CPU time.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from pymantaray.ocean import synthetic_ocean

QUIET = {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
REPEATS = 5

MEASURED = """
import json, resource, sys, time
def cpu():
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in used)
begin = time.perf_counter()
from pymantaray.acoustics import Medium
from pymantaray.ocean import open_ocean, to_local
imported, started = time.perf_counter(), cpu()
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
ocean = open_ocean(sys.argv[1])
opened = time.perf_counter()
local = to_local(ocean)
regridded = time.perf_counter()
medium = Medium.from_dataset(local)
done = time.perf_counter()
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
child = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
print(json.dumps({
    "imports [s]": imported - begin, "open [s]": opened - imported,
    "to_local [s]": regridded - opened,
    "Medium [s]": done - regridded, "all but imports [s]": done - imported,
    "its CPU time [s]": cpu() - started, "all [s]": done - begin,
    "imports [MB]": before / 1024, "peak [MB]": peak / 1024, "child's peak [MB]": child / 1024,
}))
"""


def write_files(folder: Path) -> dict[str, Path]:
    """Write the two files."""
    ocean = synthetic_ocean("beaufort").expand_dims("time")
    packing = {
        name: {
            "dtype": "i2",
            "scale_factor": 0.001,
            "add_offset": 20.0 if name in ("water_temp", "salinity") else 0.0,
            "_FillValue": -30000,
        }
        for name in ocean.data_vars
    }
    paths = {"packed NetCDF-3": folder / "packed.nc", "double NetCDF-4": folder / "double.nc"}
    ocean.to_netcdf(
        paths["packed NetCDF-3"], engine="scipy", format="NETCDF3_64BIT", encoding=packing
    )
    ocean.to_netcdf(paths["double NetCDF-4"], engine="netcdf4")
    return paths


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        for name, path in write_files(Path(folder)).items():
            runs = []
            for _ in range(REPEATS):
                answer = subprocess.run(
                    [sys.executable, "-c", MEASURED, str(path)],
                    env={**os.environ, **QUIET},
                    capture_output=True,
                    check=True,
                    text=True,
                )
                runs.append(json.loads(answer.stdout))
            print(
                f"{name}, {path.stat().st_size / 1e6:.1f} MB, median of {REPEATS} (and the worst)"
            )
            for key in runs[0]:
                values = [run[key] for run in runs]
                print(f"  {key:<20} {np.median(values):7.2f} ({max(values):.2f})")


if __name__ == "__main__":
    main()

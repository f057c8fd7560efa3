"""
The kernels on CUDA: the simulator's digits, compilation without a device, and workspaces no larger
than needed.
"""

from pathlib import Path

import numpy as np
import pytest
from factories import DUCT, python
from factories import DUCT_DEPTH as Z
from refusals import refused

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.errors import AcousticsError

SOURCE = np.array(
    [[5e3, 5e3, 115.0], [6e3, 6e3, 500.0], [5e3, 5e3, 3000.0], [5e3, 5e3, 20.0], [2e3, 9e3, 60.0]]
)
RECEIVER = np.array(
    [
        [7e3, 5.5e3, 135.0],
        [6e3, 6e3, 500.0],
        [5.5e3, 5e3, 100.0],
        [3e4, 5e3, -1.0],
        [3e3, 9e3, 70.0],
    ]
)
FIELDS = (
    "link",
    "travel_time",
    "launch_angle",
    "spreading_db",
    "source_slowness",
    "status",
    "chord_travel_time",
)
ATOL_TIME = (
    1e-12  # s; both round as IEEE 754 prescribes, elementary functions may differ in the last digit
)

SIMULATE = """
import sys
import numpy as np
sys.path[:0] = sys.argv[2:]
import test_cuda
from pymantaray.acoustics._kernels import cuda
from pymantaray.acoustics import eigenrays
eigenrays._WAVE, cuda._THREADS = 4, 3  # two waves, threads with several links
np.savez(sys.argv[1], **test_cuda.solve("cuda"))
"""

COMPILE = """
import types as python_types
from numba import cuda, types
from numba.cuda import dispatcher

cc = (8, 0)
dispatcher.get_current_device = lambda: python_types.SimpleNamespace(compute_capability=cc)
try:
    cuda.compile_ptx(lambda x: None, (types.float64,), cc=cc)
except Exception as error:
    print("no toolkit:", str(error).splitlines()[0])
    raise SystemExit(77)
from pymantaray.acoustics._kernels import cuda as kernels
from pymantaray.acoustics._kernels import layout
from pymantaray.geometry.boundary_kernels import BoundaryGrid


def array(dimensions, dtype=types.float64):
    return types.Array(dtype, dimensions, "C")


real, whole = types.float64, types.int64
grid = types.NamedTuple([array(2), array(1), array(1)], BoundaryGrid)
field = [whole, array(1), array(1), array(1), array(3), array(1)]
field += [whole, array(1), whole, array(2), real, real]
domain = types.NamedTuple([*field, grid, grid, types.boolean, types.boolean, real], layout.Domain)
settings = types.NamedTuple([real, real, types.boolean, types.boolean], layout.Settings)
work = types.NamedTuple([array(len(shape) + 1) for shape in layout.shapes(16)], layout.Work)
columns = [array(3), array(1, whole), array(1, types.int8), array(2)]
results = types.NamedTuple(columns, layout.Results)
signature = (domain, types.UniTuple(whole, 2), settings, array(2), array(2), work, results)
ptx, _ = cuda.compile_ptx(kernels._solve_wave, signature, cc=cc)
print(ptx.count(".visible .entry"), ptx.count(chr(10)))
"""


def media():
    axis = np.linspace(0.0, 2e4, 9)
    gain = 1.0 + 0.3 * np.sin(axis[:, None, None] / 4e3) * np.cos(axis[None, :, None] / 5e3)
    field = 1440.0 + 0.016 * Z + gain * (DUCT - 1440.0 - 0.016 * Z)
    bottom = np.full((9, 9), 3500.0)
    for kind in ("smooth", "linear"):
        yield Medium.from_profile(Z, DUCT, bottom_depth=3500.0, interpolation=kind)
        yield Medium.from_grid(axis, axis, Z, field, bathymetry=bottom, interpolation=kind)


def solve(device):
    solved = {}
    for i, medium in enumerate(media()):
        arrivals = find_eigenrays(medium, SOURCE, RECEIVER, 1, 1, device=device)
        solved |= {f"{name}_{i}": getattr(arrivals, name) for name in FIELDS}
    return solved


@pytest.mark.slow
def test_simulated_device_gives_the_digits_of_the_processor(tmp_path):
    file = tmp_path / "cuda.npz"
    done = python(
        SIMULATE, file, *Path(__file__).parents[:2], environment={"NUMBA_ENABLE_CUDASIM": "1"}
    )
    assert done.returncode == 0, done.stderr[-2000:]
    simulated = np.load(file)
    for name, expected in solve("cpu").items():
        assert simulated[name].dtype == expected.dtype, name
        atol = ATOL_TIME if "time" in name else 1e-9
        np.testing.assert_allclose(simulated[name], expected, rtol=0.0, atol=atol, err_msg=name)


@pytest.mark.slow
def test_kernel_compiles_for_a_device_without_one():
    pytest.importorskip("numba_cuda", reason="needs numba-cuda")
    done = python(COMPILE)
    if done.returncode == 77:
        pytest.skip(done.stdout)
    assert done.returncode == 0, done.stderr[-2000:]
    entries, lines = (int(word) for word in done.stdout.split())
    assert entries == 1
    assert lines < 100_000  # with the tracer inlined at every call it had 158,000


@pytest.mark.parametrize("dirt", [np.nan, 1e300])
def test_the_smallest_workspaces_suffice_whatever_they_contain(dirt):
    from pymantaray.acoustics._kernels.layout import (
        N_ARRIVAL,
        N_INFO,
        Flights,
        Results,
        Room,
        Settings,
        Work,
        flight_shapes,
        least_shapes,
        shapes,
    )  # fmt: skip
    from pymantaray.acoustics._kernels.link import solve_links

    guard = 64
    longest = np.hypot(*(RECEIVER - SOURCE)[:3, :2].T).max()
    some = np.array([0, 1, 2, 0])
    for medium in media():
        domain = medium.domain()
        results = []
        # of two brackets of one ray the first counts: their order goes with the number of intervals
        # halved at a time
        for sizes in (shapes(Z.size, halved=1), least_shapes(domain, longest)):
            both = (*sizes, *flight_shapes(sizes, 2))
            blocks = [np.full(np.prod(size, dtype=int) + 2 * guard, dirt) for size in both]
            arrays = [b[guard:-guard].reshape(size) for b, size in zip(blocks, both, strict=True)]
            room = Room(Work(*arrays[: len(sizes)]), Flights(*arrays[len(sizes) :]))
            counts, status = np.zeros(4, dtype=np.int64), np.zeros(4, dtype=np.int8)
            out = Results(np.zeros((4, 64, N_ARRIVAL)), counts, status, np.empty((4, N_INFO)))
            for first in (1, 0):
                ends, share = (SOURCE[some], RECEIVER[some]), (first, 2)
                solve_links(
                    domain, (1, 1), Settings(15.0, 1e-3, True, False), *ends, share, room, out
                )
            for name, block in zip((*Work._fields, *Flights._fields), blocks, strict=True):
                edges = np.concatenate([block[:guard], block[-guard:]])
                assert np.array_equal(edges, np.full(2 * guard, dirt), equal_nan=True), name
            results.append(out)
        for full, least in zip(*results, strict=True):
            np.testing.assert_array_equal(full, least)
        np.testing.assert_array_equal(results[0][0][0], results[0][0][3])
        assert results[0][1].sum() > 3


def test_a_thread_of_a_12_km_link_needs_less_than_750_kb():
    from pymantaray.acoustics._kernels.layout import least_shapes

    axis, depth = np.linspace(0.0, 2e4, 9), np.linspace(0.0, 4000.0, 40)
    c = np.full((9, 9, 40), 1500.0)
    domain = Medium.from_grid(axis, axis, depth, c, bathymetry=np.full((9, 9), 4e3)).domain()
    needed = 8 * sum(np.prod(shape) for shape in least_shapes(domain, 12e3))
    assert needed < 0.75e6


def test_device_that_is_not_there_is_one_line(monkeypatch):
    monkeypatch.setattr("pymantaray.installation.find_spec", lambda _: None)
    medium = Medium.from_profile(Z, DUCT, bottom_depth=3500.0)
    says = r"no CUDA device was found; .* pip install 'pymantaray\[cuda\]'"
    refused(AcousticsError, says, find_eigenrays, medium, SOURCE, RECEIVER, device="cuda")

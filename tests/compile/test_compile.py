"""
How kernels are compiled: linked into entries, cached on disk only as long as no source changes, in
memory where no disk can be written.
"""

import importlib.util
import os
import pickle
import signal
import subprocess
import sys
from collections import namedtuple
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from factories import python
from numba import njit, types
from numba.core import serialize
from numba.extending import intrinsic

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.acoustics._kernels.lanes import LANES, MASK
from pymantaray.acoustics._kernels.link import solve_links
from pymantaray.compile import PLAIN, entry, kernel
from pymantaray.geometry import EarthSphere

LINKED = not sys.modules["pymantaray.compile.kernel"]._WHY_PLAIN
"""
Whether kernels are linked into entries, which say that they are compiled; else Numba compiles each
by itself.
"""
INNER = """
from pymantaray.compile import kernel

@kernel
def factor():
    return {factor}
"""
OUTER = """
from pymantaray.compile import entry
from inner import factor

@entry
def scaled(x):
    return factor() * x
"""


@pytest.fixture
def two_files(tmp_path):
    """
    An entry that calls a kernel of another file, run in a process of its own; returns what it
    prints and says.
    """
    (tmp_path / "outer.py").write_text(OUTER)

    def run(factor, before="", **environment):
        (tmp_path / "inner.py").write_text(INNER.format(factor=factor))
        shown = "print(scaled(1.0), scaled.stats.cache_path is not None)"
        code = f"{before}\nfrom outer import scaled\n{shown}"
        environment |= {"PYTHONDONTWRITEBYTECODE": "1"}
        done = python(code, environment=environment, cwd=tmp_path)
        return done.stdout.split(), done.stderr

    return run


SLOW = """
import time
from pathlib import Path

from numba import types
from numba.extending import intrinsic
from pymantaray.compile import entry

@intrinsic
def wait(_context):
    Path("compiling").touch()
    while not Path("go").exists():
        time.sleep(0.01)
    return types.none(), lambda context, *_: context.get_dummy_value()

@entry
def doubled(x):
    wait()
    return 2.0 * x

print("calls", flush=True)
print(doubled(1.0), sum(doubled.stats.cache_hits.values()))
"""


@pytest.mark.slow
@pytest.mark.skipif(PLAIN, reason="nothing is compiled")
def test_one_process_compiles_and_another_waits_for_its_code(tmp_path):
    (tmp_path / "slow.py").write_text(SLOW)
    start = partial(
        subprocess.Popen,
        [sys.executable, "slow.py"],
        cwd=tmp_path,
        env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")},
        stdout=subprocess.PIPE,
        text=True,
    )
    with start() as first:
        while not (tmp_path / "compiling").exists():
            assert first.poll() is None
        with start() as second:
            assert second.stdout.readline() == "calls\n"
            (tmp_path / "go").touch()
            assert second.communicate()[0] == "2.0 1\n"
        assert first.communicate()[0] == "calls\n2.0 0\n"


@pytest.mark.slow
@pytest.mark.skipif(PLAIN, reason="nothing is compiled")
def test_a_process_does_not_wait_for_ever_for_one_that_is_stopped(tmp_path):
    (tmp_path / "slow.py").write_text(SLOW)
    (tmp_path / "short.py").write_text(
        "import sys, pymantaray.compile\nsys.modules['pymantaray.compile.kernel']._LOCK_WAIT ="
        " 1.0\nfrom slow import doubled\n"
    )
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    start = partial(
        subprocess.Popen,
        cwd=tmp_path,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    with start([sys.executable, "-c", "import slow"]) as first:
        while not (tmp_path / "compiling").exists():
            assert first.poll() is None
        first.send_signal(signal.SIGSTOP)
        try:
            (tmp_path / "go").touch()
            with start([sys.executable, "short.py"]) as second:
                printed, said = second.communicate(timeout=120)
            assert printed == "calls\n2.0 0\n", said
            assert (
                "another process has been compiling kernels for 1 s; compiling them in memory"
                in said
            )
        finally:
            first.send_signal(signal.SIGCONT)
        assert first.communicate(timeout=120)[0] == "calls\n2.0 0\n"
    with start([sys.executable, "-c", "import slow"]) as third:  # the first one has saved its code
        assert third.communicate(timeout=120)[0] == "calls\n2.0 1\n"


DAMAGE = {
    "an empty index": (".nbi", lambda content: content[:0]),
    "a random index": (".nbi", lambda content: np.random.default_rng(0).bytes(len(content))),
    "half an index": (".nbi", lambda content: content[: len(content) // 2]),
    "an empty kernel": (".nbc", lambda content: content[:0]),
    "half a kernel": (".nbc", lambda content: content[: len(content) // 2]),
    "a kernel with one wrong bit": (
        ".nbc",
        lambda content: content[:-900] + bytes([content[-900] ^ 1]) + content[-899:],
    ),
    "a random kernel": (".nbc", lambda content: np.random.default_rng(1).bytes(len(content))),
}


def damaged_is_compiled_again(two_files, folder, damage, factor, environment):
    """With a warning, once."""
    ending, change = DAMAGE[damage]
    (file,) = folder.rglob(f"outer.scaled*{ending}")
    file.write_bytes(change(file.read_bytes()))
    printed, said = two_files(factor, **environment)
    assert printed == [str(factor), "True"], said
    assert "compiled kernels are damaged" in said
    assert "Traceback" not in said
    printed, said = two_files(factor, **environment)
    assert (printed, said) == ([str(factor), "True"], "")


@pytest.mark.slow
@pytest.mark.skipif(PLAIN, reason="nothing is compiled")
@pytest.mark.parametrize("damage", DAMAGE)
def test_damaged_kernels_on_disk_are_compiled_again_with_a_warning(two_files, tmp_path, damage):
    environment = {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    two_files(2.0, **environment)
    damaged_is_compiled_again(two_files, tmp_path / "cache", damage, 2.0, environment)


SHARED = """
from pymantaray.compile import entry, kernel, shared

@kernel
def square(x):
    return x * x

@shared
def twice_the_square(x):
    return 2.0 * square(x)

@shared
def half_of_it(x):
    return 0.25 * twice_the_square(x)

@entry
def plain(x):
    return half_of_it(x) + 0.75 * twice_the_square(x)

@entry
def raised(x):
    return twice_the_square(x) + square(x)
"""


@pytest.mark.slow
def test_new_and_cached_entries_find_a_shared_kernel(tmp_path):
    (tmp_path / "both.py").write_text(SHARED)
    for first, second, lines in (
        ("plain", "plain", 1),
        ("plain", "raised", 1),
        ("raised", "plain", 0),
    ):
        code = f"import both\nprint(both.{first}(3.0), both.{second}(3.0))"
        done = python(code, environment={"NUMBA_CACHE_DIR": str(tmp_path / "cache")}, cwd=tmp_path)
        assert done.stdout.split() == [
            {"plain": "18.0", "raised": "27.0"}[x] for x in (first, second)
        ], done.stderr
        assert done.stderr.count("compiling kernels") == lines


@kernel
def square(values, i):
    return values[i] ** 2


@entry
def sum_of_squares(values):
    total = 0.0
    for i in range(values.size):
        total += square(values, i)
    return total


@pytest.mark.skipif(not LINKED, reason="this Numba compiles each kernel by itself")
def test_kernels_are_called_by_entries_and_not_from_python():
    assert sum_of_squares(np.arange(4.0)) == 14.0
    with pytest.raises(KeyError, match="square is called by kernels only"):
        square(np.arange(4.0), 1)


Fields = namedtuple("Fields", "cube across whole truth pair")


def summed(fields, i):
    sizes = (
        fields.cube.size
        + 10 * fields.across.size
        + 100 * fields.whole.size
        + 1000 * fields.pair[1].shape[1]
    )
    values = fields.cube[i, 2, 3] + fields.across[1, i] + fields.whole[i] + fields.pair[0][i, 1]
    return sizes, values, fields.cube[i].strides[0], fields.truth[i]


summed_by_kernel, summed_by_others = kernel(summed), njit(summed)


@entry
def sum_by_kernel(fields, i):
    return summed_by_kernel(fields, i)


@njit
def sum_by_others(fields, i):
    return summed_by_others(fields, i)


def test_kernels_accept_arrays_in_named_tuples():
    cube, square = np.arange(24.0).reshape(2, 3, 4), np.arange(9.0).reshape(3, 3)
    fields = Fields(
        cube, square.T, np.arange(5), np.array([True, False]), (square, square[:, :2].copy())
    )
    assert sum_by_kernel(fields, 1) == sum_by_others(fields, 1) == summed(fields, 1)


@kernel
def first_and_rest(pair, swap):
    if swap:
        pair = pair[1], pair[0]
    return pair, (pair[0], (pair[1], 2.0))


@entry
def walk(values, n):
    """
    Variables that change in loops and branches, tuples in tuples, and views of arrays, whose
    addresses are needed.
    """
    total, last, found = 0.0, -1.0, False
    rows = values.reshape(2, values.size // 2)
    for i in range(n):
        row = rows[i % 2]
        own = (row[0], row[-1])
        for x in row[1:]:
            if x > 2.0:
                found = True
                last = x
            elif found:
                last = -x
            (a, b), (_, (d, two)) = first_and_rest(own, i > 1)
            total += a - 0.5 * b * two + d
        row[0] += last
    return total, last, found, values.sum()


def test_variables_tuples_and_views_have_the_values_of_plain_python():
    values = np.arange(8.0)
    ours, plain = values.copy(), values.copy()
    python_kernel = {
        "first_and_rest": getattr(first_and_rest, "py_func", first_and_rest),
        "range": range,
    }
    body = getattr(walk, "py_func", walk)
    expected = type(body)(body.__code__, python_kernel)(plain, 5)
    assert walk(ours, 5) == expected
    assert np.array_equal(ours, plain)
    assert not np.array_equal(ours, values)


@intrinsic
def twice(_context, kind):
    def generate(_context, builder, _signature, arguments):
        (x,) = arguments
        return (builder.add if isinstance(kind, types.Integer) else builder.fadd)(x, x)

    return kind(kind), generate


@kernel
def twice_of(x):
    return twice(x)


@entry
def call_twice(a, b, c):
    return twice_of(a) + twice_of(b) + twice_of(c)


@pytest.mark.skipif(PLAIN, reason="plain Python has no intrinsics")
def test_instructions_first_needed_in_a_compilation_are_found():
    """
    A first start failed by chance: an instruction is registered for a type when it is first needed,
    without a new module.
    """
    assert call_twice(np.int64(3), np.float64(0.5), np.float32(0.25)) == 7.5


@pytest.mark.skipif(PLAIN, reason="plain Python compiles nothing")
@pytest.mark.parametrize("earth", [None, EarthSphere(6371e3)])
def test_a_medium_from_another_process_needs_no_other_kernels(earth):
    """
    Its arrays can be written, for which Numba compiled all kernels again, in each process of a
    service.
    """
    medium = Medium.from_profile([0.0, 90.0], [1450.0, 1460.0], bottom_depth=90.0, earth=earth)
    ends = [0.0, 0.0, 10.0], [500.0, 0.0, 20.0]
    size = len(pickle.dumps(medium))
    one = find_eigenrays(medium, *ends)
    assert len(pickle.dumps(medium)) == size  # without a second copy for the kernels
    compiled = list(solve_links.signatures)
    other = find_eigenrays(pickle.loads(pickle.dumps(medium)), *ends)
    assert solve_links.signatures == compiled
    assert other.travel_time[0] == one.travel_time[0]


@pytest.mark.parametrize("place", ["beside the source", "NUMBA_CACHE_DIR"])
@pytest.mark.slow
def test_change_in_a_called_file_is_seen_wherever_the_cache_lies(two_files, tmp_path, place):
    """And damage."""
    own = place == "NUMBA_CACHE_DIR"
    folder = tmp_path / ("cache" if own else "__pycache__")
    environment = {"NUMBA_CACHE_DIR": str(folder) if own else ""}
    for factor in (2.0, 3.0):
        printed, said = two_files(factor, **environment)
        assert printed == [str(factor), "True"], said
        assert said.count("compiling kernels") == said.count("\n") == 1
    assert len(list(folder.rglob("outer.scaled*.nbi"))) == 1  # that of the first factor is gone
    if not PLAIN:
        damage = "a kernel with one wrong bit"
        damaged_is_compiled_again(two_files, folder, damage, 3.0, environment)


@pytest.mark.slow
def test_kernels_are_compiled_in_memory_if_no_folder_is_writable(two_files, tmp_path):
    (tmp_path / "__pycache__").touch()
    nowhere = str(tmp_path / "__pycache__" / "nowhere")
    printed, said = two_files(2.0, HOME=nowhere, XDG_CACHE_HOME=nowhere, NUMBA_CACHE_DIR="")
    assert printed == ["2.0", "False"], said
    assert said.count("\n") == 1
    assert "cannot be cached" in said


@pytest.mark.slow
def test_kernels_stay_in_memory_if_the_disk_is_full(two_files, tmp_path):
    full = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (500, 500))"
    printed, said = two_files(2.0, full)
    assert printed == ["2.0", "True"], said
    *first, last = said.splitlines()
    assert [line[:17] for line in first] == ["compiling kernels"]
    assert "cannot be cached: File too large; " in last
    assert not [*(tmp_path / "__pycache__").glob("*.tmp.*")]


def test_types_of_registers_come_back_from_disk_in_another_process(tmp_path):
    """Kernels that take them are kept where each is compiled by itself."""
    lanes = "from pymantaray.acoustics._kernels.lanes import LANES, MASK"
    way = f"from numba.core import serialize\n{lanes}\n"
    (tmp_path / "types").write_bytes(serialize.dumps((LANES, MASK)))
    code = f"{way}print(serialize.loads(open('types', 'rb').read()) == (LANES, MASK))"
    assert python(code, cwd=tmp_path).stdout == "True\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("numba", "named"),
    [
        ("numba.__version__ = '9.0.0'", "9.0.0 was not tried, only 0.63 to 0.68"),
        ("numba.__version__ = '0.62.1'", "0.62.1 was not tried, only 0.63 to 0.68"),
        ("sys.modules['numba.core.typed_passes'] = None", "numba.core.typed_passes"),
        ("import numba.core.codegen as c; del c.JITCodeLibrary", "JITCodeLibrary"),
    ],
)
def test_a_numba_that_was_not_tried_compiles_each_kernel_and_says_so(two_files, numba, named):
    before = f"import sys, numba\n{numba}\nimport inner\ninner.factor()"  # Python may call it then
    printed, said = two_files(2.0, before)
    assert printed == ["2.0", "True"], said
    (line,) = said.splitlines()
    assert line.startswith("compiling kernels one by one: Numba ")
    assert named in line
    assert "takes" in line


@pytest.mark.slow
def test_links_that_are_none_compile_no_rays(tmp_path):
    code = """
import numpy as np
from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.acoustics._kernels.link import solve_links

medium = Medium.from_profile([0.0, 100.0], [1450.0, 1460.0], bottom_depth=100.0)
none = np.empty((0, 3))
print(find_eigenrays(medium, none, none).status.size, len(solve_links.signatures))"""
    assert python(code, environment={"NUMBA_CACHE_DIR": str(tmp_path)}).stdout.split() == ["0", "0"]


SUMS = """
import numpy as np
from pymantaray.compile import compact, entry

def running_sums(values, out):
    for i in range(values.size):
        out[i] = 0.0
        for k in range(4):
            out[i] += values[(i + k) % values.size]
    return out.sum()

def all_passes(values, out):
    for i in range(values.size):
        out[i] = 0.0
        for k in range(4):
            out[i] += values[(i + k) % values.size]
    return out.sum()

values, out = np.random.default_rng(0).normal(size=37), np.empty((2, 37))
both = entry(compact(running_sums)), entry(all_passes)
sums = [compiled(values, row) for compiled, row in zip(both, out)]
print(sums[0] == sums[1], np.array_equal(*out), *(len(*x.inspect_llvm().values()) for x in both))
"""


@pytest.mark.slow
@pytest.mark.skipif(not LINKED, reason="this Numba compiles each kernel by itself")
def test_compact_code_is_smaller_and_has_the_same_results(tmp_path):
    (tmp_path / "sums.py").write_text(SUMS)
    done = python(
        "import sums", environment={"NUMBA_CACHE_DIR": str(tmp_path / "cache")}, cwd=tmp_path
    )
    same_sum, same_values, small, large = done.stdout.split()
    assert (same_sum, same_values) == ("True", "True"), done.stderr
    assert int(small) < 0.8 * int(large)


@pytest.mark.skipif(PLAIN, reason="nothing is compiled")
@pytest.mark.parametrize("kind", ["link", "pipe"])
def test_a_lock_that_is_a_link_or_a_pipe_harms_nothing(tmp_path, kind):
    file, own = tmp_path / "doubling.py", tmp_path / "own"
    file.write_text(
        "from pymantaray.compile import entry\n\n@entry\ndef doubled(x):\n    return 2.0 * x\n"
    )
    own.write_text("kept")
    spec = importlib.util.spec_from_file_location("doubling", file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    digest = sys.modules["pymantaray.compile.kernel"]._digest(tmp_path)
    folder = Path(module.doubled.stats.cache_path)
    folder.mkdir(exist_ok=True)
    lock = folder / f"doubling.doubled-{digest}.lock"
    if kind == "link":
        lock.symlink_to(own)
    else:
        os.mkfifo(lock)
    assert module.doubled(3.0) == 6.0
    assert own.read_text() == "kept"
    assert lock.is_symlink() == (kind == "link")

"""How kernels are compiled: as part of entries, or by themselves where this Numba does not allow it."""

import subprocess
import sys

import numpy as np
import pytest
from numba import njit

from pymantaray.acoustics._kernels.compile import kernel
from pymantaray.acoustics._kernels.keep_code import _KeptLibrary


@kernel
def square(values, i):
    return values[i] ** 2


@njit
def sum_of_squares(values):
    total = 0.0
    for i in range(values.size):
        total += square(values, i)
    return total


def test_kernels_are_called_by_entries_and_not_from_python():
    assert sum_of_squares(np.arange(4.0)) == 14.0
    (compiled,) = square.overloads.values()
    assert isinstance(compiled.library, _KeptLibrary)  # else it was optimized and compiled by itself
    with pytest.raises(KeyError, match="square is called by kernels only"):
        square(np.arange(4.0), 1)


def test_without_the_parts_of_numba_that_this_takes_kernels_compile_by_themselves():
    code = """
import sys
sys.modules["pymantaray.acoustics._kernels.keep_code"] = None
import numpy as np
from pymantaray.acoustics._kernels.cubic import cubic
print(cubic(0.5, 1.0, 0.0, 1.0, 1.0, 1.0))
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=120
    )
    assert done.stdout.strip() == "0.5", done.stderr

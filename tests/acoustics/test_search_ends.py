"""
Ends of the intervals of a search that are moved when a smaller tolerance moves a root beyond them.
"""

import numpy as np
import pytest

from pymantaray.acoustics._kernels import layout as at
from pymantaray.acoustics._kernels.search import _end_to_move
from pymantaray.compile import PLAIN

end_to_move = _end_to_move if PLAIN else _end_to_move.py_func


def ray(angle, miss, slope):
    one = np.zeros(at.N_RAY)
    one[[at.ANGLE, at.MISS, at.SLOPE]] = angle, miss, slope
    return one


@pytest.mark.parametrize("slope", [1e4, -1e4])
@pytest.mark.parametrize(
    ("root", "moved"),
    [
        pytest.param(-0.0999, -1, id="inside, at the first end"),
        pytest.param(0.0999, -1, id="inside, at the second end"),
        pytest.param(-0.1001, 0, id="beyond the first end"),
        pytest.param(0.1001, 1, id="beyond the second end"),
        pytest.param(-0.4, -1, id="too far beyond the first end"),
    ],
)
def test_an_end_is_moved_only_outwards_over_a_root_beyond_it(root, moved, slope):
    """
    The rough rays have their root just inside the interval from -0.1 to 0.1, the accurate ones at
    `root`.
    """
    rough_root = np.copysign(0.0998, root)
    rough, fine = (
        [ray(angle, slope * (angle - zero), slope) for angle in (-0.1, 0.1)]
        for zero in (rough_root, root)
    )
    assert end_to_move(*rough, *fine)[0] == moved


@pytest.mark.parametrize(("codes", "moved"), [((2, 2), 0), ((1, 1), 1), ((1, 2), -1)])
def test_an_end_is_moved_over_a_change_of_reflections(codes, moved):
    """Between two rough rays the reflections change; the accurate ones have these codes."""
    rough, fine = (
        [ray(angle, 5.0 + 1e3 * angle, 1e3) for angle in (-1e-3, 1e-3)] for _ in range(2)
    )
    for rays, both in ((rough, (1, 2)), (fine, codes)):
        for one, code in zip(rays, both, strict=True):
            one[at.CODE] = code
    end, change = end_to_move(*rough, *fine)
    assert end == moved
    if end >= 0:  # by the interval and twice the distance of the nearer ray from the root
        assert change == pytest.approx((-1.0, 1.0)[end] * (2e-3 + 2.0 * 4e-3))

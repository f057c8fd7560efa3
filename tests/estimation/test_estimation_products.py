"""Products of blocks against numpy's, compiled and without compilation."""

import numba
import numpy as np
import pytest
from factories import python

from pymantaray.estimation._kernels import products

EXPECTED = {
    "set_product": lambda _, a, b: a @ b,
    "subtract_product": lambda out, a, b: out - a @ b,
    "add_transposed_product": lambda out, a, b: out + a.T @ b,
    "subtract_transposed_product": lambda out, a, b: out - a.T @ b,
    "subtract_product_transposed": lambda out, a, b: out - a @ b.T,
    "set_product_of_three": lambda _, a, b: a @ b,
    "set_transposed_product_of_three": lambda _, a, b: a.T @ b,
    "subtract_product_of_three": lambda out, a, b: out - a @ b,
    "add_transposed_product_half_empty": lambda out, a, b: out + a.T @ b,
}

EXPECTED_VECTORS = {
    "subtract_from_vector": lambda out, a, x: out - a @ x,
    "subtract_transposed_from_vector": lambda out, a, x: out - a.T @ x,
}

BY_ITSELF = """
import sys
import numpy as np
from pymantaray.estimation._kernels import products

out, a, b = np.load(sys.argv[1])
for name in sys.argv[3:]:
    of = (out[0], b[0]) if name.endswith("vector") else (out, b)
    getattr(products, name)(of[0], 1, a, 2, of[1], 0)
np.save(sys.argv[2], out)
"""


def blocks(name=""):
    of_name = np.random.default_rng(0).normal(size=(3, 3, 6, 6))
    if name.endswith("of_three"):
        return np.ascontiguousarray(of_name[..., :3, 3:])
    if name.endswith("half_empty"):
        of_name[1:, :, :3, 3:] = 0.0
    return of_name


@pytest.mark.parametrize("name", EXPECTED)
def test_a_compiled_product_is_numpys_and_touches_no_other_block(name):
    product = getattr(products, name)
    apply = numba.njit(lambda out, i, a, p, b, q: product(out, i, a, p, b, q))
    out, a, b = blocks(name)
    expected = out.copy()
    expected[1] = EXPECTED[name](out[1], a[2], b[0])
    apply(out, 1, a, 2, b, 0)
    np.testing.assert_allclose(out, expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize("name", EXPECTED_VECTORS)
def test_a_compiled_product_equals_numpy_and_touches_nothing_else(name):
    product = getattr(products, name)
    apply = numba.njit(lambda out, i, a, p, x, k: product(out, i, a, p, x, k))
    out, a, b = blocks()
    out, x = out[0], b[0]
    expected = out.copy()
    expected[1] = EXPECTED_VECTORS[name](out[1], a[2], x[0])
    apply(out, 1, a, 2, x, 0)
    np.testing.assert_allclose(out, expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize("plain", [False, True])
def test_a_solution_with_an_upper_block_is_that_of_its_transpose(plain):
    solve = products._plain_solve if plain else products.solve_transposed
    apply = solve if plain else numba.njit(lambda out, p, u, k: solve(out, p, u, k))
    out, u, _ = blocks()
    u = np.triu(u) + 3.0 * np.eye(6)
    expected = out.copy()
    expected[1] = np.linalg.solve(u[2].T, out[1])
    apply(out, 1, u, 2)
    np.testing.assert_allclose(out, expected, rtol=0, atol=1e-12)


def test_without_compilation_products_are_the_same(tmp_path):
    np.save(tmp_path / "blocks.npy", blocks("half_empty"))
    files = tmp_path / "blocks.npy", tmp_path / "out.npy"
    done = python(
        BY_ITSELF, *files, *EXPECTED, *EXPECTED_VECTORS, environment={"NUMBA_DISABLE_JIT": "1"}
    )
    assert done.returncode == 0, done.stderr
    out, a, b = blocks("half_empty")
    for expected in EXPECTED.values():
        out[1] = expected(out[1], a[2], b[0])
    for expected in EXPECTED_VECTORS.values():
        out[0, 1] = expected(out[0, 1], a[2], b[0, 0])
    np.testing.assert_allclose(np.load(files[1]), out, rtol=0, atol=1e-12)

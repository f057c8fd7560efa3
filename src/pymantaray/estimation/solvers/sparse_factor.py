"""
Sparse factor of a symmetric matrix, in the order of multiple minimum degree and without row
exchanges if pivots allow.
"""

from scipy.sparse import csc_array
from scipy.sparse.linalg import SuperLU, splu


def symmetric_factor(matrix: csc_array) -> SuperLU:
    """Factor a symmetric matrix; raises `RuntimeError` if it is exactly singular."""
    return splu(
        matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )

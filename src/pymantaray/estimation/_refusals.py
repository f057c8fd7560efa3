"""What a graph's numbers have to be, and the lines that say of which variable they are not."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import EstimationError

Array = NDArray[np.float64]

LARGEST = 1e9  # m; the square of more than this, times an ordinary precision, has no digits left to compare
VARIANCES = (1e-30, 1e30)  # m2 or rad2; what is beyond overflows in a solve
QUATERNION_TOLERANCE = 1e-3  # on its length
SMALLEST_EIGENVALUE = 1e-12  # of a correlation matrix; its inverse has no digits left below


class Named(Protocol):
    """What has names for its variables."""

    def variable_name(self, variable: int) -> str:
        """Name of a variable."""


def check_full(graph: Named, what: str, variables: NDArray[np.int32], covariance: Array) -> None:
    """
    Refuse full matrices that are not symmetric or not safely positive definite.

    Parameters
    ----------
    graph : FactorGraph
        Names the variables.
    what : str
    variables : ndarray of int, shape (n,)
    covariance : ndarray, shape (n, k, k)
        With positive diagonals.

    Raises
    ------
    EstimationError
    """
    full = np.count_nonzero(covariance, axis=(1, 2)) > covariance.shape[1]
    if not full.any():
        return
    variables, covariance = variables[full], covariance[full]
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    # free of units, so that metres and radians do not pass for bad conditioning
    with np.errstate(over="ignore"):
        correlation = covariance / sigma[:, :, None] / sigma[:, None, :]
    flat = correlation.reshape(len(correlation), -1)
    fine = np.asarray(np.isfinite(flat).all(axis=1))
    refuse(graph, f"{what} covariance", variables, np.asarray(sigma**2), fine, "finite entries")
    skew = np.abs(correlation - np.swapaxes(correlation, 1, 2)).max(axis=(1, 2))
    refuse(graph, f"{what} covariance's asymmetry", variables, skew[:, None], np.asarray(skew <= 1e-9), "0")
    smallest = np.asarray(np.linalg.eigvalsh(correlation)[:, 0])
    refuse(
        graph,
        f"{what} covariance's eigenvalues, scaled to unit variances,",
        variables,
        smallest[:, None],
        np.asarray(smallest >= SMALLEST_EIGENVALUE),
        f"a positive definite matrix, {SMALLEST_EIGENVALUE:g} at least",
    )


def refuse(
    graph: Named,
    what: str,
    variables: NDArray[np.int32],
    values: Array,
    fine: NDArray[np.bool_],
    allowed: str,
) -> None:
    """
    Refuse values, if one is not fine, in a line that names the first variable concerned.

    Parameters
    ----------
    graph : FactorGraph
        Names the variables.
    what : str
    variables : ndarray of int, shape (n,)
    values : ndarray, shape (n, k)
    fine : ndarray of bool, shape (n,)
    allowed : str

    Raises
    ------
    EstimationError
    """
    if fine.all():
        return
    first = int(np.argmin(fine))
    found = ", ".join(f"{v:g}" for v in np.atleast_1d(values[first]))
    raise EstimationError(
        f"{graph.variable_name(int(variables[first]))}: {what} is [{found}] ({np.count_nonzero(~fine)} such in all);"
        f" needs {allowed}"
    )

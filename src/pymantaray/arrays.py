"""Types of arrays in annotations."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.signedinteger[Any]]  # of any size
Mask = NDArray[np.bool_]
Codes = NDArray[np.int8]  # of a status
Instants = NDArray[np.datetime64]
AnyArray = NDArray[Any]

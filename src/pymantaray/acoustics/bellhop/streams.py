"""Numbers of Bellhop's output, one after the other, from a text or from an unformatted Fortran file."""

from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.io import FortranFile, FortranFormattingError

from pymantaray.errors import AcousticsError

Array = NDArray[np.float64]


class Stream(Protocol):
    """What both kinds of file can give."""

    path: Path

    def take(self, n: int) -> Array:
        """Give the next n numbers."""

    def whole(self) -> int:
        """Give the next count."""

    def vector(self) -> Array:
        """Give a count and that many numbers."""


class TextStream:
    """
    Numbers of a text file, whatever its lines.

    Parameters
    ----------
    path : pathlib.Path
        For messages.
    values : ndarray, shape (n,)
        All of them.
    """

    def __init__(self, path: Path, values: Array) -> None:
        self.path, self.values, self.at = path, values, 0

    def left(self) -> int:
        """Count the numbers not taken yet."""
        return int(self.values.size - self.at)

    def take(self, n: int) -> Array:
        """Give the next n numbers; that there are fewer is an error."""
        if n > self.left():
            raise AcousticsError(
                f"{self.path}: the file ends early: is the run finished, its receiver grid rectilinear?"
            )
        self.at += n
        return self.values[self.at - n : self.at]

    def whole(self) -> int:
        """Give the next number as a count."""
        value = float(self.take(1)[0])
        if not (value.is_integer() and value >= 0.0):
            raise AcousticsError(f"{self.path}: found {value:g} where a count is expected")
        return int(value)

    def vector(self) -> Array:
        """Give a count and that many numbers."""
        return self.take(self.whole())


class RecordStream:
    """
    Numbers of four bytes in the records of an unformatted Fortran file.

    Parameters
    ----------
    path : pathlib.Path
        For messages.
    file : scipy.io.FortranFile
        Open for reading.
    """

    def __init__(self, path: Path, file: FortranFile) -> None:
        self.path, self.file = path, file

    def take(self, n: int) -> Array:
        """Give the reals of the next record, which must be n."""
        return self.record(4 * n).view(np.float32).astype(float)

    def whole(self) -> int:
        """Give the integer of the next record."""
        return int(self.record(4).view(np.int32)[0])

    def vector(self) -> Array:
        """Give the reals of the next record, which starts with their number."""
        found = self.record()
        if found.size < 8 or found.size % 4 or found[:4].view(np.int32)[0] != found.size // 4 - 1:
            raise AcousticsError(f"{self.path}: a list of positions is damaged")
        return found[4:].view(np.float32).astype(float)

    def record(self, size: int | None = None) -> NDArray[np.uint8]:
        """
        Give the bytes of the next record.

        Parameters
        ----------
        size : int, optional
            Bytes it must have.

        Returns
        -------
        ndarray of uint8

        Raises
        ------
        AcousticsError
            If there is none, it is damaged or of another size.
        """
        try:
            found = np.asarray(self.file.read_record(np.uint8), dtype=np.uint8)
        except (FortranFormattingError, TypeError, ValueError, OSError):
            raise AcousticsError(f"{self.path}: the file ends early or is damaged") from None
        if size is not None and found.size != size:
            raise AcousticsError(f"{self.path}: a record of {found.size} bytes where {size} are expected")
        return found

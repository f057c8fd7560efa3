"""NetCDF-3 files (classic, 64-bit offset, 64-bit data): header and blocks of values, sizes checked first."""

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from io import RawIOBase
from pathlib import Path
from typing import BinaryIO, TypeVar

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import OceanError

_TYPES = {1: ">i1", 2: "S1", 3: ">i2", 4: ">i4", 5: ">f4", 6: ">f8"}
_MORE_TYPES = {**_TYPES, 7: ">u1", 8: ">u2", 9: ">u4", 10: ">i8", 11: ">u8"}  # of 64-bit data files
_DIMENSION, _VARIABLE, _ATTRIBUTE = 10, 11, 12
_LONGEST_ATTRIBUTE = 1 << 20  # bytes
_MOST_ENTRIES = 10_000  # of one list in the header
_KEPT_TEXT, _KEPT_NUMBERS = 4000, 64
Attribute = str | int | float | list[int] | list[float]
_T = TypeVar("_T")


@dataclass(frozen=True)
class Variable3:
    """Where a variable lies in the file."""

    dims: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: np.dtype[np.generic]
    attrs: dict[str, Attribute]
    begin: int
    record_stride: int
    """Bytes from one record to the next; 0 without a record dimension."""

    def end(self) -> int:
        """First byte behind the variable."""
        if 0 in self.shape:
            return self.begin
        if not self.record_stride:
            return self.begin + math.prod(self.shape) * self.dtype.itemsize
        one = math.prod(self.shape[1:]) * self.dtype.itemsize
        return self.begin + (self.shape[0] - 1) * self.record_stride + one


def read_header(path: Path) -> tuple[dict[str, Attribute], dict[str, Variable3]]:
    """
    Global attributes and variables of a NetCDF-3 file.

    Parameters
    ----------
    path : pathlib.Path

    Returns
    -------
    attrs : dict
    variables : dict of str to Variable3
        Text has the type S1.

    Raises
    ------
    OceanError
        If the header is damaged, or declares more values than the file holds.

    References
    ----------
    .. [1] The NetCDF Classic Format Specification and its 64-bit variants, Appendix B of the NetCDF
       User's Guide, Unidata.
    """
    size = path.stat().st_size
    with path.open("rb") as stream:
        header = _Header(stream, size, path.name)
        attrs, variables = header.parse()
    for name, variable in variables.items():
        if variable.end() > size:
            raise OceanError(
                f"{path.name}: cannot be read, {name} is declared to end at byte {variable.end()} of"
                f" {size}; the file is cut short, fetch it again"
            )
    return attrs, variables


def read_values(path: Path, variable: Variable3, selection: tuple[slice, ...]) -> NDArray[np.generic]:
    """
    Block of a variable, as stored; only its bytes of the file are read.

    Parameters
    ----------
    path : pathlib.Path
    variable : Variable3
    selection : tuple of slice
        One for each dimension, without steps.

    Returns
    -------
    ndarray
        In the machine's byte order.

    Raises
    ------
    OceanError
        If the file has become shorter since its header was read.
    """
    itemsize = variable.dtype.itemsize
    shape = tuple(s.stop - s.start for s in selection)
    packed = [itemsize * math.prod(variable.shape[i + 1 :]) for i in range(len(shape))]
    strides = [variable.record_stride, *packed[1:]] if variable.record_stride else packed
    # dimensions from `first` inward lie in one piece of the file
    first = max(0, len(shape) - 1)
    while first > 0 and shape[first] == variable.shape[first]:
        first -= 1
    if first == 0 and strides[:1] != packed[:1]:
        first = 1
    piece = itemsize * math.prod(shape[first:])
    block = np.empty(shape, variable.dtype)
    if not block.size:
        return block.astype(variable.dtype.newbyteorder("="))
    target = memoryview(block.reshape(-1).view(np.uint8).data)
    begin = variable.begin + sum(s.start * n for s, n in zip(selection, strides, strict=True))
    with path.open("rb", buffering=0) as stream:
        for i, index in enumerate(np.ndindex(*shape[:first])):
            stream.seek(begin + sum(k * n for k, n in zip(index, strides, strict=False)))
            _fill(stream, target[i * piece : (i + 1) * piece], path.name)
    return block.astype(variable.dtype.newbyteorder("="))


def _fill(stream: RawIOBase, view: memoryview, name: str) -> None:
    while view:
        n = stream.readinto(view)
        if not n:
            raise OceanError(f"{name}: cannot be read, it has become shorter meanwhile; fetch it again")
        view = view[n:]


class _Header:
    """Reader of the header's grammar; each length is checked against what is left of the file."""

    def __init__(self, stream: BinaryIO, size: int, name: str) -> None:
        self.stream, self.size, self.name = stream, size, name
        magic = self._take(4)
        self.wide = magic[3] == 5  # counts and sizes of 8 bytes
        self.wide_offsets = magic[3] in (2, 5)
        self.types = _MORE_TYPES if self.wide else _TYPES

    def parse(self) -> tuple[dict[str, Attribute], dict[str, Variable3]]:
        records = self._count()
        streaming = records == (0xFFFFFFFFFFFFFFFF if self.wide else 0xFFFFFFFF)
        dims = self._list(_DIMENSION, self._dimension)
        attrs = dict(self._list(_ATTRIBUTE, self._attribute))
        raw = self._list(_VARIABLE, lambda: self._variable(dims))
        names = [r[0] for r in raw]
        if len(set(names)) != len(names) or sum(length == 0 for _, length in dims) > 1:
            raise self._damaged("a name or the record dimension is there twice")
        unlimited = next((i for i, (_, length) in enumerate(dims) if length == 0), None)
        recorded = [r for r in raw if unlimited is not None and r[1][:1] == (unlimited,)]
        one = [math.prod(dims[i][1] for i in r[1][1:]) * r[3].itemsize for r in recorded]
        stride = one[0] if len(one) == 1 else sum(-(-n // 4) * 4 for n in one)
        if streaming:
            first = min((r[4] for r in recorded), default=self.size)
            records = max(0, self.size - first) // stride if stride else 0
        variables = {}
        for name, ids, attributes, dtype, begin in raw:
            is_record = ids[:1] == (unlimited,) and unlimited is not None
            if unlimited in ids[1:]:
                raise self._damaged(f"{name} has the record dimension inside")
            shape = tuple(records if i == unlimited else dims[i][1] for i in ids)
            variables[name] = Variable3(
                tuple(dims[i][0] for i in ids), shape, dtype, attributes, begin, stride if is_record else 0
            )
        return attrs, variables

    def _list(self, tag: int, entry: Callable[[], _T]) -> list[_T]:
        found, n = self._integer(4), self._count()
        if found == 0 and n == 0:
            return []
        if found != tag or n > _MOST_ENTRIES:
            raise self._damaged(f"list {found} of {n} entries where list {tag} should be")
        return [entry() for _ in range(n)]

    def _dimension(self) -> tuple[str, int]:
        return self._text(), self._count()

    def _attribute(self) -> tuple[str, Attribute]:
        name, dtype, n = self._text(), self._type(), self._count()
        data = self._padded(n * dtype.itemsize)
        if dtype.kind == "S":
            return name, data[: 4 * _KEPT_TEXT].decode("utf-8", "replace").rstrip("\0")[:_KEPT_TEXT]
        numbers = np.frombuffer(data, dtype)[:_KEPT_NUMBERS].tolist()
        return name, numbers[0] if len(numbers) == 1 else numbers

    def _variable(
        self, dims: list[tuple[str, int]]
    ) -> tuple[str, tuple[int, ...], dict[str, Attribute], np.dtype[np.generic], int]:
        name = self._text()
        n = self._count()
        if n > len(dims) + 1:
            raise self._damaged(f"{name} has {n} dimensions")
        ids = tuple(self._count() for _ in range(n))
        if any(i >= len(dims) for i in ids):
            raise self._damaged(f"{name} has an unknown dimension")
        attrs = dict(self._list(_ATTRIBUTE, self._attribute))
        dtype = self._type()
        self._count()  # its size, which the shape gives too, and which overflows in large files
        return name, ids, attrs, dtype, self._integer(8 if self.wide_offsets else 4)

    def _type(self) -> np.dtype[np.generic]:
        code = self._integer(4)
        if code not in self.types:
            raise self._damaged(f"type {code} does not exist")
        return np.dtype(self.types[code])

    def _text(self) -> str:
        return self._padded(self._count()).decode("utf-8", "replace")

    def _count(self) -> int:
        return self._integer(8 if self.wide else 4)

    def _integer(self, n: int) -> int:
        return int(struct.unpack(">Q" if n == 8 else ">I", self._take(n))[0])

    def _padded(self, n: int) -> bytes:
        if n > _LONGEST_ATTRIBUTE:
            raise self._damaged(f"a text or attribute of {n} bytes in the header")
        return self._take(-(-n // 4) * 4)[:n]

    def _take(self, n: int) -> bytes:
        data = self.stream.read(n)
        if len(data) < n:
            raise self._damaged("it ends inside the header")
        return data

    def _damaged(self, reason: str) -> OceanError:
        return OceanError(f"{self.name}: cannot be read as NetCDF-3, perhaps cut short ({reason})")

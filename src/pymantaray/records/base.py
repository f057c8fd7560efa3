"""One mechanism for all records: array fields with dimensions and units, to and from xarray."""

from dataclasses import Field, dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import RecordError
from pymantaray.records.writing import read_netcdf, write_netcdf

if TYPE_CHECKING:
    import xarray as xr

_WIDTHS = {"axis": 3, "quat": 4, "tangent": 6}
Column = NDArray[Any]  # the declared type of a field made by `column`


def column(dims: str, units: str, long_name: str, dtype: str = "f8", *, may_lack: bool = False) -> Any:
    """Array field of a record: dimensions separated by spaces, units as CF writes them; one that may lack has then no rows."""
    metadata = {"dims": tuple(dims.split()), "units": units, "long_name": long_name, "dtype": dtype}
    if not may_lack:
        return field(metadata=metadata)
    widths = [_WIDTHS[name] for name in metadata["dims"][1:]]
    return field(default_factory=lambda: np.empty((0, *widths)), metadata=metadata)


@dataclass(frozen=True, eq=False)
class Record:
    """Base of all records: every field made by `column` is an array of declared dimensions, each of one length, and type."""

    kind: ClassVar[str] = "record"

    def __post_init__(self) -> None:
        """Convert, check and freeze every field."""
        sizes: dict[str, int] = {}
        for f in self._columns():
            dtype = f.metadata["dtype"]
            try:
                values = np.asarray(getattr(self, f.name))
                with np.errstate(invalid="ignore"):
                    array = np.array(values, dtype=str if dtype == "U" else dtype)
            except (TypeError, ValueError) as error:
                raise RecordError(f"{self.kind}: {f.name} is not an array of type {dtype}: {error}") from None
            if array.dtype.kind == "i" and not np.array_equal(array, values):
                raise RecordError(f"{self.kind}: {f.name} holds values that do not fit type {dtype}")
            dims = f.metadata["dims"]
            if array.ndim != len(dims):
                raise RecordError(f"{self.kind}: {f.name} has shape {array.shape}; needs dimensions {dims}")
            for name, size in zip(dims, array.shape, strict=True):
                if sizes.setdefault(name, size) != size:
                    raise RecordError(
                        f"{self.kind}: {f.name} has {size} along {name!r}, other fields have {sizes[name]}"
                    )
            array.setflags(write=False)
            object.__setattr__(self, f.name, array)

    @classmethod
    def _columns(cls) -> list[Field[Any]]:
        return [f for f in fields(cls) if "dims" in f.metadata]

    def to_dataset(self) -> "xr.Dataset":
        """Give the record as an xarray data set with units and long names."""
        import xarray as xr

        data = {}
        for f in self._columns():
            attrs = {"long_name": f.metadata["long_name"]}
            if f.metadata["units"]:
                attrs["units"] = f.metadata["units"]
            data[f.name] = xr.Variable(f.metadata["dims"], getattr(self, f.name), attrs)
        return xr.Dataset(data, attrs={"Conventions": "CF-1.11", "mantaray_record": self.kind})

    @classmethod
    def from_dataset(cls, dataset: "xr.Dataset") -> Self:
        """Build the record from a data set that `to_dataset` made; another kind, or one that lacks a field, is refused."""
        kind = dataset.attrs.get("mantaray_record")
        if kind != cls.kind:
            raise RecordError(f"data set holds {kind!r}; needs {cls.kind!r}")
        missing = [f.name for f in cls._columns() if f.name not in dataset]
        if missing:
            raise RecordError(f"{cls.kind}: data set lacks {', '.join(missing)}")
        return cls(**{f.name: dataset[f.name].values for f in cls._columns()})

    def save(self, path: Path) -> None:
        """Write the record as NetCDF-4, whole or not at all."""
        write_netcdf(self.to_dataset(), path)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a record that `save` wrote; a file that is missing, unreadable or of another kind is a `RecordError`."""
        try:
            return cls.from_dataset(read_netcdf(path, decode_times=False))
        except RecordError as error:
            raise RecordError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None

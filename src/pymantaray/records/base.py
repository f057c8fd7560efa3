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
    """
    Array field of a record.

    Parameters
    ----------
    dims : str
        Names of the dimensions, separated by spaces.
    units : str
        Units as CF writes them, "1" for none, "" for names.
    long_name : str
        One line for people.
    dtype : str
        numpy type of the array; "U" for text.
    may_lack : bool
        Whether a record made without it has it, of no rows.

    Returns
    -------
    dataclasses.Field
    """
    metadata = {"dims": tuple(dims.split()), "units": units, "long_name": long_name, "dtype": dtype}
    if not may_lack:
        return field(metadata=metadata)
    widths = [_WIDTHS[name] for name in metadata["dims"][1:]]
    return field(default_factory=lambda: np.empty((0, *widths)), metadata=metadata)


@dataclass(frozen=True, eq=False)
class Record:
    """
    Base of all records: every field made by `column` is an array of declared dimensions and type.

    Dimensions of the same name must have the same length in all fields.

    Raises
    ------
    RecordError
        If a field has the wrong number of dimensions, two fields disagree on a length, or a value does not
        fit an integer column.
    """

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
        """
        Give the record as an xarray data set with units and long names.

        Returns
        -------
        xarray.Dataset
        """
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
        """
        Build the record from a data set that `to_dataset` made.

        Parameters
        ----------
        dataset : xarray.Dataset

        Returns
        -------
        Record

        Raises
        ------
        RecordError
            If the data set holds another kind of record or lacks a field.
        """
        kind = dataset.attrs.get("mantaray_record")
        if kind != cls.kind:
            raise RecordError(f"data set holds {kind!r}; needs {cls.kind!r}")
        missing = [f.name for f in cls._columns() if f.name not in dataset]
        if missing:
            raise RecordError(f"{cls.kind}: data set lacks {', '.join(missing)}")
        return cls(**{f.name: dataset[f.name].values for f in cls._columns()})

    def save(self, path: Path) -> None:
        """
        Write the record as NetCDF-4, whole or not at all.

        Parameters
        ----------
        path : pathlib.Path
        """
        write_netcdf(self.to_dataset(), path)

    @classmethod
    def load(cls, path: Path) -> Self:
        """
        Read a record that `save` wrote.

        Parameters
        ----------
        path : pathlib.Path

        Returns
        -------
        Record

        Raises
        ------
        RecordError
            If the file is missing, unreadable or of another kind.
        """
        try:
            return cls.from_dataset(read_netcdf(path, decode_times=False))
        except RecordError as error:
            raise RecordError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None

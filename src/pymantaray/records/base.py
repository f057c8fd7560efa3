"""Base of all records: array fields with dimensions, labels and units, and conversion to xarray."""

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields, replace
from enum import IntEnum
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from pymantaray.arrays import AnyArray
from pymantaray.errors import RecordError
from pymantaray.records.digits import counted
from pymantaray.records.result_table import ResultTable, notebook_html
from pymantaray.records.writing import pack, read_netcdf, temporary_folder, write_netcdf

if TYPE_CHECKING:
    import xarray as xr

LABELS = {
    "axis": ("north", "east", "down"),
    "body_axis": ("forward", "right", "down"),
    "quat": ("w", "x", "y", "z"),
    "tangent": (
        "rotation_forward",
        "rotation_right",
        "rotation_down",
        "translation_forward",
        "translation_right",
        "translation_down",
    ),
}
"""
Dimensions of fixed length and their labels; the name of the second dimension of a matrix ends in
``_column``.
"""
_COLUMN = "_column"
_NOUNS = {"altimeter": "altitude", "dvl": "DVL sample"}
"""Nouns of dimensions whose names are none."""
_SINCE = "seconds since "
_TIME = {
    "standard_name": "time",
    "calendar": "standard",
    "units_metadata": "leap_seconds: none",
    "axis": "T",
}
Column = AnyArray  # the declared type of a field made by `column`


def column(
    dims: str,
    units: str,
    long_name: str,
    dtype: str = "f8",
    *,
    may_lack: bool = False,
    labels: bool = False,
    flags: type[IntEnum] | None = None,
    default: float | None = None,
    step: float | tuple[float, ...] | None = None,
    digits: int = 0,
) -> Any:
    """
    Declare an array field of a record. Spaces separate dimensions; units are in CF notation.

    A column that may lack is empty if it is not given or absent in a file; one with a default that
    is not given has this value everywhere. A column that labels its dimension is the coordinate of
    that name in a data set. Flags are the allowed values of an integer column, with their meanings.
    A file holds the nearest multiples of ``step`` (one, or one for each component), which take a
    fraction of the room of all digits, or ``digits`` significant digits.
    """
    metadata: dict[str, Any] = {"dims": tuple(dims.split()), "units": units, "long_name": long_name}
    metadata |= {"dtype": np.dtype(dtype), "labels": labels, "flags": flags, "default": default}
    metadata |= {"step": step, "digits": digits}
    if default is not None:
        return field(default=None, metadata=metadata)
    if not may_lack:
        return field(metadata=metadata)
    _, *other_dims = metadata["dims"]
    widths = [len(LABELS[name]) for name in other_dims]
    return field(default_factory=lambda: np.empty((0, *widths)), metadata=metadata)


@dataclass(frozen=True, eq=False)
class Record:
    """
    Base of all records.

    Every field from `column` is an array with declared type and dimensions of consistent lengths.
    """

    kind: ClassVar[str] = "record"

    def __init_subclass__(cls) -> None:
        """Give every record the short representation, instead of one with all its numbers."""
        super().__init_subclass__()
        cls.__repr__ = Record.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        """
        Kind, sizes and outcomes, such as ``<Estimates: 3 conditions, 433 epochs, 11 vehicles>``.
        """
        sizes = dict[str, int]()
        for item in self._columns():
            sizes |= zip(item.metadata["dims"], getattr(self, item.name).shape, strict=True)
        texts = (
            _size_in_words(name, n)
            for name, n in sizes.items()
            if name.removesuffix(_COLUMN) == name not in LABELS
        )
        return f"<{type(self).__name__}: {', '.join(texts)}{self._outcomes()}>"

    def _outcomes(self) -> str:
        """Text behind the sizes in the representation."""
        return ""

    @np.errstate(invalid="ignore")  # conversion of NaN to integers, which is checked
    def __post_init__(self) -> None:
        """Convert, check and freeze every field."""
        sizes = {name: len(labels) for name, labels in LABELS.items()}
        shapes = dict[tuple[str, ...], tuple[int, ...]]()
        for item in self._columns():
            name = item.name
            dtype = item.metadata["dtype"]
            dims = item.metadata["dims"]
            array = getattr(self, name)
            if array is None and (default := item.metadata["default"]) is not None:
                # earlier columns define its length
                array = np.full([sizes[dim] for dim in dims], default)
            if not (type(array) is np.ndarray and array.dtype == dtype and _is_constant(array)):
                array = self._read_only(name, array, dtype)
                object.__setattr__(self, name, array)
            # most columns have dimensions and shape of an earlier one
            if array.shape != shapes.get(dims):
                self._check_shape(name, dims, array.shape, sizes)
                shapes[dims] = array.shape

    def _check_shape(
        self, name: str, dims: tuple[str, ...], shape: tuple[int, ...], sizes: dict[str, int]
    ) -> None:
        """Refuse a column whose shape does not fit earlier columns, and add its sizes to theirs."""
        if len(shape) != len(dims):
            raise RecordError(
                f"{self.kind}: {name} has shape {shape}; it must have dimensions {dims}"
            )
        for dim, size in zip(dims, shape, strict=True):
            if (common := sizes.setdefault(dim.removesuffix(_COLUMN), size)) != size:
                raise RecordError(
                    f"{self.kind}: {name} has length {size} along {dim!r}; it must be {common}"
                )

    def _read_only(self, name: str, content: object, dtype: np.dtype[Any]) -> AnyArray:
        """Read-only copy of the content of a column."""
        try:
            values = np.asarray(content)
            array = np.array(values, dtype)
        except (TypeError, ValueError) as error:
            raise RecordError(
                f"{self.kind}: {name} is not an array of type {dtype.str[1:]}: {error}"
            ) from None
        if dtype.kind == "i" and dtype != values.dtype and not (array == values).all():
            raise RecordError(
                f"{self.kind}: {name} has values that do not fit type {dtype.str[1:]}"
            )
        array.setflags(write=False)
        return array

    @classmethod
    @cache
    def _columns(cls) -> list[Field[Any]]:
        return [item for item in fields(cls) if "dims" in item.metadata]

    def _repr_html_(self) -> str:
        """HTML for a notebook: size, unit, values and meaning of each column."""
        import pandas as pd

        rows = [
            {
                "": item.name,
                "size": " x ".join(
                    f"{name} {size}"
                    for name, size in zip(
                        item.metadata["dims"], getattr(self, item.name).shape, strict=True
                    )
                ),
                "unit": item.metadata["units"],
                "values": _summary(getattr(self, item.name), item.metadata["flags"]),
                "meaning": item.metadata["long_name"],
            }
            for item in self._columns()
        ]
        return notebook_html(
            self.kind.replace("_", " ").capitalize(),
            {},
            [ResultTable(self.kind, pd.DataFrame(rows))],
        )

    def to_dataset(self) -> "xr.Dataset":
        """Convert the record to an xarray data set with labels, units and long names."""
        import xarray as xr

        data = {}
        for item in self._columns():
            attrs: dict[str, Any] = {"long_name": item.metadata["long_name"]}
            if item.metadata["units"]:
                attrs["units"] = item.metadata["units"]
            values = getattr(self, item.name)
            if (flags := item.metadata["flags"]) is not None:
                attrs["flag_values"] = np.array(list(flags), dtype=values.dtype)
                attrs["flag_meanings"] = " ".join(member.name for member in flags)
            data[_variable_name(item)] = xr.Variable(item.metadata["dims"], values, attrs)
        title = self.kind.replace("_", " ").capitalize()
        return _label(xr.Dataset(data, attrs={"title": title, "mantaray_record": self.kind}))

    @classmethod
    def from_dataset(cls, dataset: "xr.Dataset") -> Self:
        """
        Build the record from a data set of `to_dataset`.

        Parameters
        ----------
        dataset : xarray.Dataset
            Data set of a record of the same kind.

        Returns
        -------
        Record
            Record of this class.

        Raises
        ------
        RecordError
            If the data set contains another kind of record, or a field is missing.
        """
        kind = dataset.attrs.get("mantaray_record")
        if kind != cls.kind:
            raise RecordError(f"data set contains {kind!r}; it must be {cls.kind!r}")
        names = {item.name: _variable_name(item) for item in cls._columns()}
        names = {
            item.name: names[item.name]
            for item in cls._columns()
            if item.default_factory is MISSING or names[item.name] in dataset.variables
        }
        missing = [name for name, variable in names.items() if variable not in dataset.variables]
        if missing:
            raise RecordError(f"{cls.kind}: the data set has no {', '.join(missing)}")
        return cls(**{name: dataset[variable].values for name, variable in names.items()})

    def at(self, rows: Mapping[str, Any]) -> Self:
        """
        Select rows along dimensions.

        Parameters
        ----------
        rows : Mapping[str, Any]
            Index of the rows of each dimension, such as ``{"arrival": [0, 2]}``. Columns whose
            first dimension is not among them stay as they are.

        Returns
        -------
        Self
        """
        columns = [item for item in self._columns() if item.metadata["dims"][0] in rows]
        return replace(
            self,
            **{
                item.name: getattr(self, item.name)[rows[item.metadata["dims"][0]]]
                for item in columns
            },
        )

    @classmethod
    def stack(cls, records: Sequence[Self]) -> Self:
        """
        Join the rows of records.

        Parameters
        ----------
        records : Sequence[Self]

        Returns
        -------
        Self
        """
        return cls(
            **{
                item.name: np.concatenate([getattr(record, item.name) for record in records])
                for item in cls._columns()
            }
        )

    def save(self, path: Path) -> None:
        """
        Write the record as NetCDF-4, atomically.

        Parameters
        ----------
        path : pathlib.Path
            File; an existing one is replaced.
        """
        dataset = self.to_dataset()
        for item in self._columns():
            variable = dataset.variables[_variable_name(item)]
            if item.metadata["digits"]:
                variable.encoding |= {"significant_digits": item.metadata["digits"]}
                variable.encoding |= {"quantize_mode": "GranularBitRound"}
            if item.metadata["step"] is not None:
                pack(variable, item.metadata["step"])
        write_netcdf(dataset, path)

    def as_saved(self) -> Self:
        """
        Record as it is read from its file, with the precision of the file.

        Returns
        -------
        Record
        """
        with temporary_folder() as folder:
            path = folder / "record.nc"
            self.save(path)
            return self.load(path)

    @classmethod
    def load(cls, path: Path) -> Self:
        """
        Read a record from a file of `save`.

        Parameters
        ----------
        path : pathlib.Path
            File.

        Returns
        -------
        Record
            Record of this class.

        Raises
        ------
        RecordError
            If the file is missing, not readable, or of another kind of record.
        """
        try:
            dataset = read_netcdf(path, decode_times=False)
            for variable in dataset.variables.values():
                values: Any = variable.values
                # nobody else has the array and those of which it is a view: no copy is needed
                while isinstance(values, np.ndarray):
                    values.setflags(write=False)
                    values = values.base
            return cls.from_dataset(dataset)
        except RecordError as error:
            raise RecordError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None


@dataclass(frozen=True, eq=False)
class DatedRecord(Record):
    """A record with times of a mission and the date (UTC) of its start, NaT if unknown."""

    start: np.datetime64 = field(default=np.datetime64("NaT", "us"), kw_only=True)

    def __post_init__(self) -> None:
        """Convert, check and freeze every field."""
        super().__post_init__()
        object.__setattr__(self, "start", np.array(self.start, dtype="M8[us]")[()])

    def to_dataset(self) -> "xr.Dataset":
        """
        Convert the record to an xarray data set.

        Times are seconds since the start, which `xarray.decode_cf` decodes.
        """
        dataset = super().to_dataset()
        if not np.isnat(self.start):
            date = np.datetime_as_string(self.start).removesuffix(".000000")
            dataset[self._time()].attrs |= {"units": _SINCE + date, **_TIME}
        return dataset

    @classmethod
    def from_dataset(cls, dataset: "xr.Dataset") -> Self:
        """
        Build the record from a data set of `to_dataset`, with decoded or raw times.

        Parameters are those of `Record.from_dataset`.
        """
        name = cls._time()
        start = np.datetime64("NaT", "us")
        if name in dataset.variables:
            time = dataset[name]
            units = {**time.encoding, **time.attrs}.get("units", "s")
            if units.startswith(_SINCE):
                start = np.datetime64(units.removeprefix(_SINCE))
            elif units != "s":
                raise RecordError(
                    f"{cls.kind}: {name} is in {units!r}; it must be in seconds since the start"
                )
            if time.dtype.kind == "M":
                seconds = (time.values - start) / np.timedelta64(1, "ns") / 1e9
                dataset = dataset.assign_coords({name: (time.dims, seconds)})
        return replace(super().from_dataset(dataset), start=start)

    @classmethod
    def _time(cls) -> str:
        """Variable with the times in a data set."""
        return next(_variable_name(item) for item in cls._columns() if item.name == "time")


def _is_constant(values: AnyArray) -> bool:
    """True if nobody can write an array, nor the array of which it is a view."""
    base: object = values.base  # or another object with a buffer
    return not values.flags.writeable and (
        base is None or (isinstance(base, np.ndarray) and _is_constant(base))
    )


def _summary(values: AnyArray, flags: type[IntEnum] | None) -> str:
    """Summary of values as text: counts of flags, names, or minimum, maximum and number of NaN."""
    if flags is not None:
        counts = {flag.name: int(np.count_nonzero(values == flag)) for flag in flags}
        return ", ".join(f"{count} {name}" for name, count in counts.items() if count)
    if values.dtype.kind == "U":
        names = ", ".join(values.ravel()[:5].tolist())
        return f"{names}, ..." if values.size > 5 else names
    numbers = values[np.isfinite(values)] if values.dtype.kind == "f" else values
    parts = []
    if numbers.size:
        parts.append(f"{numbers.min():.6g} to {numbers.max():.6g}")
    if numbers.size < values.size:
        parts.append(f"{values.size - numbers.size} NaN")
    return ", ".join(parts)


def _variable_name(item: Field[Any]) -> str:
    """Name of a column in a data set: its dimension if the column labels it."""
    return str(item.metadata["dims"][0] if item.metadata["labels"] else item.name)


def _size_in_words(dimension: str, size: int) -> str:
    """Size of a dimension in words, such as ``2 links``."""
    noun = dimension
    if dimension.startswith("n_"):
        noun = dimension.removeprefix("n_").removesuffix("s")
    noun = _NOUNS.get(noun, noun.replace("_", " "))
    return f"{size:,} fixes" if noun == "fix" and size != 1 else counted(size, noun)


def _label(dataset: "xr.Dataset") -> "xr.Dataset":
    """Add the labels of dimensions; text is encoded as characters (CF rule for coordinates)."""
    for name in dataset.dims:
        root = str(name).removesuffix(_COLUMN)
        if root in LABELS:
            dataset = dataset.assign_coords({name: list(LABELS[root])})
        elif root != name and root in dataset.variables:
            dataset = dataset.assign_coords({name: dataset[root].values})
        if name in dataset.coords and dataset[name].dtype.kind == "U":
            dataset[name].attrs.setdefault("long_name", f"names of {str(name).replace('_', ' ')}")
    return dataset

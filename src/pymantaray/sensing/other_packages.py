"""Sensors of other packages, whose columns are checked before they replace those of this one."""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import Field, dataclass, fields, is_dataclass, replace
from functools import cache
from typing import Any, NoReturn

import numpy as np

from pymantaray.arrays import AnyArray
from pymantaray.entry_points import SENSORS, Extension, extension
from pymantaray.errors import ExtensionError
from pymantaray.records import Measurements
from pymantaray.sensing.sensor import Normal, Scene

_FUNCTIONS = ("measure", "perturb")
_NUMBERS = {"f": "fiu", "i": "iu"}  # kinds of arrays that become a column of a kind
_UNIT_NORM = 1e-6  # of quaternions
_STEPS = ("dvl_sample",)  # samples of the first of two times


OtherNames = Sequence[str] | Mapping[str, Mapping[str, float]]
"""Names of entry points ``pymantaray.sensors``, which may have noise levels."""


def other_sensors(names: OtherNames) -> "tuple[OtherSensor, ...]":
    """
    Sensors of other packages, by the names of their entry points ``pymantaray.sensors``.

    Raises
    ------
    ExtensionError
        If a package is missing, cannot be imported or lacks a function or a noise level.
    """
    levels = names if isinstance(names, Mapping) else {}
    return tuple(OtherSensor.of(extension(SENSORS, name), levels.get(name, {})) for name in names)


@dataclass(frozen=True)
class OtherSensor:
    """Sensor of another package; it gets copies of all records, so it cannot change them."""

    extension: Extension
    module: Any
    levels: Any = None
    """Noise levels, an object of the module's data class ``Levels``; None if it has none."""

    @classmethod
    def of(cls, one: Extension, levels: Mapping[str, float]) -> "OtherSensor":
        """Sensor of an entry point, whose noise levels replace the defaults of its ``Levels``."""
        module = one.load()
        for name in _FUNCTIONS:
            with one.guarded("cannot be used"):
                is_function = callable(getattr(module, name, None))
            if not is_function:
                one.refuse(f"has no function {name!r}; a sensor has {' and '.join(_FUNCTIONS)}")
        own = getattr(module, "Levels", None)
        known = [field.name for field in fields(own)] if is_dataclass(own) else []
        for key in levels:
            if key not in known:
                raise ExtensionError(
                    f"`noise.{one.name}.{key}`: unknown key. Allowed: {', '.join(known) or 'none'}"
                )
        with one.guarded("refuses its noise levels"):
            return cls(one, module, own(**levels) if isinstance(own, type) and known else None)

    def measured(self, measurements: Measurements, scene: Scene, noise: Any) -> Measurements:
        """Measurements without noise, with the columns of the sensor."""
        own = Scene(*(_read_only_copy(part) for part in scene))
        with self.extension.guarded("fails in measure"):
            columns = self.module.measure(
                own, deepcopy(noise if self.levels is None else self.levels)
            )
            return replace(measurements, **self._checked("measure", columns, measurements))

    def perturbed(
        self, noisy: Measurements, measurements: Measurements, normal: Normal
    ) -> Measurements:
        """Measurements with noise, with the columns that the sensor draws from those without."""
        own = _read_only_copy(measurements)
        levels = () if self.levels is None else (deepcopy(self.levels),)
        with self.extension.guarded("fails in perturb"):
            columns, again = (
                self._checked("perturb", self.module.perturb(own, normal, *levels), measurements)
                for _ in range(2)
            )
        for name in columns:
            if columns[name].shape != getattr(measurements, name).shape:
                self._refuse("perturb", f"{name} with another shape than measure returned")
            if name not in again or not np.array_equal(columns[name], again[name]):
                self._refuse(
                    "perturb",
                    f"other values of {name} in a second call; all noise must come from `normal`",
                )
        return replace(noisy, **columns)

    def _checked(self, what: str, columns: Any, measurements: Measurements) -> dict[str, Any]:
        """Columns as copies of the right types, with allowed names and values."""
        if not isinstance(columns, Mapping):
            self._refuse(what, f"{type(columns).__name__}, not a dictionary of columns")
        items = _columns()
        out: dict[str, Any] = {}
        for name, values in columns.items():
            if name not in items:
                self._refuse(
                    what, f"the column {str(name)[:60]!r}; allowed: {', '.join(sorted(items))}"
                )
            array = np.array(values)
            fault = _fault(items[name], array, measurements)
            if np.ma.is_masked(values):
                fault = "masked values"
            if fault:
                self._refuse(what, f"{name} with {fault}")
            array = array.astype(items[name].metadata["dtype"])
            array.setflags(write=False)
            out[name] = array
        return out

    def _refuse(self, what: str, fault: str) -> NoReturn:
        self.extension.refuse(f"returns from {what} {fault}")


@cache
def _columns() -> dict[str, Field[Any]]:
    """Columns that a sensor may have: all but labels, times and ranges."""
    return {
        item.name: item
        for item in Measurements._columns()
        if not (item.metadata["labels"] or item.name == "time")
        and item.metadata["dims"][0] != "range"
    }


def _fault(item: Field[Any], array: AnyArray, measurements: Measurements) -> str:
    """Fault of the values of a column; empty if they are allowed."""
    name = item.name
    kind = item.metadata["dtype"].kind
    if array.dtype.kind not in _NUMBERS[kind]:
        return f"values of type {array.dtype}"
    if not np.isfinite(array).all():
        return "values that are not finite"
    if name.endswith("_sigma") and not np.all(
        array >= 0.0 if name.endswith("bias_sigma") else array > 0.0
    ):
        return "standard deviations that are not positive"
    if name == "dvl_beam_loss" and not np.all((array >= 0.0) & (array <= 1.0)):
        return "probabilities outside 0 to 1"
    if item.metadata["dims"][-1] == "quat" and not np.allclose(
        np.linalg.norm(array, axis=-1), 1.0, rtol=0.0, atol=_UNIT_NORM
    ):
        return "quaternions whose norm is not 1"
    if kind == "i":
        n = measurements.name.size
        if not name.endswith("_vehicle"):
            n = measurements.time.size - (name in _STEPS)
        if not np.all((array >= 0) & (array < n)):
            return f"indices outside 0 to {n - 1}"
    return ""


def _read_only_copy(part: Any) -> Any:
    """Deep copy of a record, a list or an array, whose arrays cannot be written to."""
    own = deepcopy(part)
    for one in own if isinstance(own, list | tuple) else [own]:
        arrays = [one] if isinstance(one, np.ndarray) else getattr(one, "__dict__", {}).values()
        for array in arrays:
            if isinstance(array, np.ndarray):
                array.setflags(write=False)
    return own

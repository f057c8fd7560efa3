"""Water with everything that ranging needs: medium, currents, reception and position."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from threading import Lock
from typing import Any

import numpy as np
import xarray as xr

from pymantaray.acoustics import Currents, Medium
from pymantaray.arrays import Array
from pymantaray.errors import WaterError
from pymantaray.geometry import EarthSphere, LocalFrame
from pymantaray.records.result_table import notebook_html
from pymantaray.sensing.timing import OneWay, Timing
from pymantaray.sensing.transmission import ReceptionOptions

_PROJ_LOCK = Lock()  # PROJ objects are not thread-safe


@dataclass(frozen=True, eq=False)
class Water:
    """
    Medium, currents, reception and geographic position of water; `open_water` makes it.

    Attributes
    ----------
    medium, currents, reception, timing
        Arguments for `pymantaray.sensing.measure_ranges`; functions of time [s] if the ocean
        varies.
    local : xarray.Dataset or None
        Local ocean, at the start if it varies; None for a medium.
    span : tuple of float
        Time span of the water; infinite if it does not vary. [s]
    start : str or None
        Time 0 in UTC.
    name : str
        Name of a cast, by which events select it.
    time : numpy.datetime64
        Time of a cast, by which events select it; NaT if it is unknown.
    uniform : bool
        True if the water is horizontally uniform, so only depths and distances matter.
    record : dict
        Description of the water for files.
    notes : tuple of str
        Doubts about the water.
    frame : LocalFrame or None
        Local frame; None if the water has no geographic position.

    Examples
    --------
    >>> from pymantaray import open_water
    >>> water = open_water("synthetic:fram", half_extent=15e3)
    >>> medium, currents = water.at_start
    >>> print(f"{medium.sound_speed_at([0.0, 0.0, 100.0])[0]:.1f} m/s")
    1449.5 m/s
    """

    medium: Medium | Callable[[float], Medium]
    currents: Currents | Callable[[float], Currents] | None = None
    reception: ReceptionOptions = field(default_factory=ReceptionOptions)
    timing: Timing = field(default_factory=OneWay)
    local: xr.Dataset | None = None
    span: tuple[float, float] = (-np.inf, np.inf)
    start: str | None = None
    name: str = ""
    time: np.datetime64 = field(default_factory=lambda: np.datetime64("NaT", "ns"))
    uniform: bool = False
    record: dict[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    frame: LocalFrame | None = None

    def to_local(self, places: Array, velocities: Array) -> tuple[Array, Array]:
        """
        Convert geographic positions and velocities to the local frame.

        Parameters
        ----------
        places : ndarray, shape (n, 3)
            Latitude, longitude [degrees] and depth [m].
        velocities : ndarray, shape (n, 3)
            Components along true north, true east and down. [m/s]

        Returns
        -------
        position, velocity : ndarray, shape (n, 3)
            North, east, down. [m, m/s]
        """
        if self.frame is None:
            raise WaterError(
                "geographic positions: this water has no geographic position; give positions"
                " north, east, down, or give `centre`"
            )
        with _PROJ_LOCK:
            north, east = self.frame.to_local(places[:, 0], places[:, 1])
            bearing = self.frame.convergence(places[:, 0], places[:, 1])
        if not np.isfinite([north, east]).all():
            raise WaterError(
                f"geographic positions: latitudes are {places[:, 0].min():g} to"
                f" {places[:, 0].max():g}; they must be -90 to 90, and no position may be antipodal"
                " to the frame's centre"
            )
        cos = np.cos(bearing)
        sin = np.sin(bearing)
        v_north, v_east, v_down = velocities.T
        along = [v_north * cos - v_east * sin, v_north * sin + v_east * cos, v_down]
        return np.stack([north, east, places[:, 2]], axis=-1), np.stack(along, axis=-1)

    def on_sphere(self, latitude_deg: float) -> "Water":
        """
        Return the same water on a sphere, or this water if it is on a sphere already.

        Parameters
        ----------
        latitude_deg : float
            Latitude of its radius if the water has no frame. [degrees]

        Returns
        -------
        Water
        """
        if self.at_start[0].earth is not None:
            return self
        latitude = latitude_deg if self.frame is None else self.frame.latitude_deg
        on_earth = partial(_on_earth, self.medium, EarthSphere.at_latitude(latitude))
        return replace(self, medium=on_earth if callable(self.medium) else on_earth(0.0))

    def require(self, time: float) -> None:
        """
        Raise an error if there is no water at a time.

        Parameters
        ----------
        time : float
            [s]
        """
        if not self.span[0] <= time <= self.span[1]:
            raise WaterError(
                f"time is {time:g} s; it must be {self.span[0]:g} to {self.span[1]:g} s after"
                f" {self.start} UTC"
            )

    def at(self, time: float) -> tuple[Medium, Currents | None]:
        """
        Medium and currents at a time.

        Parameters
        ----------
        time : float
            [s]

        Returns
        -------
        medium : Medium
        currents : Currents or None
        """
        medium = self.medium(time) if callable(self.medium) else self.medium
        return medium, self.currents(time) if callable(self.currents) else self.currents

    @property
    def at_start(self) -> tuple[Medium, Currents | None]:
        """Medium and currents at time 0, or at the first time of the span."""
        return self.at(max(self.span[0], 0.0))

    @property
    def varies(self) -> bool:
        """True if the water varies in time."""
        return callable(self.medium)

    def __repr__(self) -> str:
        """Source and medium in one line."""
        return f"<{self._title}: {self.at_start[0]!r}>"

    def _repr_html_(self) -> str:
        """HTML for a notebook: source, facts of the medium and notes."""
        notes = {f"note {k}": note for k, note in enumerate(self.notes, start=1)}
        return notebook_html(self._title, {**self.at_start[0].facts(), **notes}, [])

    @property
    def _title(self) -> str:
        title = "medium" if self.local is None else self.local.attrs.get("title", "local ocean")
        return f"Water {title}{', varying' if self.varies else ''}"


def _on_earth(
    medium: Medium | Callable[[float], Medium], earth: EarthSphere, time: float
) -> Medium:
    """Medium at a time [s] on a sphere; a module's function, because processes receive it."""
    return (medium(time) if callable(medium) else medium).with_earth(earth)

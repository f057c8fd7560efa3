"""Results of the two-point solver: all arrivals of links, and the first arrival of each link."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self

import numpy as np

from pymantaray.errors import RecordError
from pymantaray.records.base import Column, Record, column
from pymantaray.records.status import ARRIVES, RAY_STATUS_WORDS, RayAxis, RayStatus

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

_SIDE_SAMPLES = 16  # of a response before its first and after its last arrival


class LossOfArrivals(Protocol):
    """Loss of arrivals, such as `pymantaray.acoustics.TransmissionLoss`."""

    @property
    def link(self) -> Column:
        """Link of each arrival."""

    @property
    def total_db(self) -> Column:
        """Loss re 1 m. [dB]"""

    @property
    def boundary_phase(self) -> Column:
        """Phase that the reflections add. [rad]"""


def _without_arrival(status: Column) -> str:
    """Links without an arrival by their status in words, such as `` (2 shadow, 1 too weak)``."""
    counts = {
        words.label: int(np.count_nonzero(status == outcome))
        for outcome, words in RAY_STATUS_WORDS.items()
        if outcome not in ARRIVES
    }
    texts = [f"{count:,} {label}" for label, count in counts.items() if count]
    return f" ({', '.join(texts)})" if texts else ""


@dataclass(frozen=True, eq=False)
class FirstArrivals(Record):
    """Earliest admitted arrival of each link, one row per link; NaN without an arrival."""

    kind: ClassVar[str] = "first_arrivals"

    status: Column = column("link", "1", "outcome of the link", "i1", flags=RayStatus)
    travel_time: Column = column("link", "s", "travel time of the earliest admitted arrival")
    chord_travel_time: Column = column("link", "s", "travel time along the straight chord")
    source_sound_speed: Column = column("link", "m s-1", "sound speed at the source")
    receiver_sound_speed: Column = column("link", "m s-1", "sound speed at the receiver")
    shadow_margin: Column = column(
        "link",
        "m",
        "smallest miss distance of any ray; 0 with an arrival, NaN if all rays are reflected at"
        " the surface",
    )
    source_slowness: Column = column(
        "link axis", "s m-1", "slowness vector at the source, along the ray"
    )
    receiver_slowness: Column = column(
        "link axis", "s m-1", "slowness vector at the receiver, along the ray"
    )

    def _outcomes(self) -> str:
        return _without_arrival(self.status)


@dataclass(frozen=True, eq=False, kw_only=True)
class Arrivals(Record):
    """
    All admitted arrivals, one row per eigenray, and outcomes per link.

    Rows are sorted by link and travel time.

    Launch and arrival angles are from the horizontal, positive down, along the direction of travel.

    Examples
    --------
    >>> from pymantaray import Medium, find_eigenrays
    >>> medium = Medium.from_profile([0, 100, 1000], [1450.0, 1460.0, 1475.0], bottom_depth=1000.0)
    >>> arrivals = find_eigenrays(medium, [[0, 0, 50], [0, 0, 50]], [[3000, 0, 400], [0, 0, 2000]])
    >>> arrivals
    <Arrivals: 1 arrival, 2 links (1 outside the domain)>
    >>> first = arrivals.first()
    >>> print(first.travel_time.round(4), first.status)
    [2.0659    nan] [0 3]
    """

    kind: ClassVar[str] = "arrivals"

    link: Column = column("arrival", "1", "index of the link", "i8")
    travel_time: Column = column("arrival", "s", "travel time")
    surface_bounces: Column = column("arrival", "1", "reflections at the surface", "i2")
    bottom_bounces: Column = column("arrival", "1", "reflections at the sea bed", "i2")
    turning_points: Column = column(
        "arrival", "1", "vertical turning points, without reflections", "i2"
    )
    caustics: Column = column(
        "arrival", "1", "caustics on the way, in the vertical plane of the ray", "i2"
    )
    launch_angle: Column = column(
        "arrival", "rad", "angle from the horizontal at the source, positive down"
    )
    arrival_angle: Column = column(
        "arrival", "rad", "angle from the horizontal at the receiver, positive down"
    )
    spreading_db: Column = column("arrival", "1", "geometric spreading beyond spherical, in dB")
    source_slowness: Column = column("arrival axis", "s m-1", "slowness vector at the source")
    receiver_slowness: Column = column("arrival axis", "s m-1", "slowness vector at the receiver")
    ray_axis: Column = column("arrival", "1", "axis of integration of the ray", "i1", flags=RayAxis)
    status: Column = column("n_links", "1", "outcome of each link", "i1", flags=RayStatus)
    chord_travel_time: Column = column("n_links", "s", "travel time along the straight chord")
    source_sound_speed: Column = column("n_links", "m s-1", "sound speed at the source")
    receiver_sound_speed: Column = column("n_links", "m s-1", "sound speed at the receiver")
    shadow_margin: Column = column(
        "n_links",
        "m",
        "smallest miss distance of any ray; 0 with an arrival, NaN if all rays are reflected at"
        " the surface",
    )
    complete: Column = column(
        "n_links",
        "1",
        "1 if the search resolved all launch angles, from at least one end",
        "?",
        default=True,
    )

    def _outcomes(self) -> str:
        return _without_arrival(self.status)

    def first(self) -> FirstArrivals:
        """Earliest arrival of each link; NaN if the status is not OK."""
        links, rows = np.unique(self.link, return_index=True)
        first = self.of_links(links, rows, self.travel_time[rows])
        if np.any(np.isnan(first.travel_time) != (self.status != RayStatus.OK)):
            raise AssertionError("a link's status and its arrivals disagree")
        return first

    def incomplete_note(self) -> list[str]:
        """
        Describe links whose search is not complete.

        Returns
        -------
        list[str]
            One line, or none.
        """
        count = int(np.count_nonzero(~self.complete))
        if not count:
            return []
        return [
            f"{count} of {self.status.size} links may have more rays: their search is not complete"
        ]

    def with_more(self, more: Mapping[str, Any]) -> Self:
        """
        Add arrivals, in order of link and travel time.

        Parameters
        ----------
        more : Mapping[str, Any]
            Columns of the added arrivals by name; columns of the links are ignored.

        Returns
        -------
        Self
        """
        names = [item.name for item in self._columns() if item.metadata["dims"][0] == "arrival"]
        rows = {name: np.concatenate([getattr(self, name), more[name]]) for name in names}
        order = np.lexsort((rows["travel_time"], rows["link"]))
        return replace(self, **{name: values[order] for name, values in rows.items()})

    def impulse_response(
        self, sampling_rate: float, loss: "LossOfArrivals | None" = None
    ) -> "xr.DataArray":
        r"""
        Return the impulse response of each link, band-limited to half the sampling rate.

        Parameters
        ----------
        sampling_rate : float
            Samples per second. [Hz]
        loss : TransmissionLoss, optional
            Loss of these arrivals, from `pymantaray.acoustics.transmission_loss`: spreading,
            absorption, and size and phase of reflections. Default: amplitudes re spherical
            spreading, with reflections that lose nothing and reverse the sign at the surface.

        Returns
        -------
        xarray.DataArray, shape (n_links, n_samples), complex
            Coordinates ``delay`` [s] from the first arrival of each link, and its ``travel_time``
            [s], NaN without an arrival, where the response is 0. The received signal is the real
            part of the analytic signal convolved with the response.

        Notes
        -----
        Each arrival adds :math:`a\, e^{-i \phi} \operatorname{sinc}(f_s (t - T))`. The phase
        :math:`\phi` is that of its reflections minus a quarter of a cycle for each caustic, for
        time as :math:`e^{-i \omega t}`, as in Bellhop's arrivals.

        Raises
        ------
        RecordError
            If the sampling rate is not positive, or the loss has other arrivals.
        """
        import xarray as xr

        if not (np.isfinite(sampling_rate) and sampling_rate > 0.0):
            raise RecordError(f"sampling_rate is {sampling_rate!r} Hz; it must be positive")
        amplitude, phase = 10.0 ** (-self.spreading_db / 20.0), np.pi * self.surface_bounces
        if loss is not None:
            if not np.array_equal(loss.link, self.link):
                raise RecordError("loss is of other arrivals; compute it from these")
            amplitude, phase = 10.0 ** (-loss.total_db / 20.0), loss.boundary_phase
        size = amplitude * np.exp(-1j * (phase - 0.5 * np.pi * self.caustics))
        start = np.full(self.status.size, np.inf)
        np.minimum.at(start, self.link, self.travel_time)
        delay = self.travel_time - start[self.link]
        count = int(np.ceil(sampling_rate * delay.max(initial=0.0))) + _SIDE_SAMPLES + 1
        samples = np.arange(-_SIDE_SAMPLES, count)
        response = np.zeros((start.size, samples.size), dtype=complex)
        for row, link in enumerate(self.link.tolist()):
            response[link] += size[row] * np.sinc(samples - sampling_rate * delay[row])
        return xr.DataArray(
            response,
            {
                "delay": ("delay", samples / sampling_rate, {"units": "s"}),
                "travel_time": (
                    "link",
                    np.where(np.isfinite(start), start, np.nan),
                    {"units": "s"},
                ),
            },
            ("link", "delay"),
            name="impulse_response",
            attrs={
                "units": "1",
                "long_name": "pressure re 1 m" if loss else "re spherical spreading",
            },
        )

    def to_dataframe(self) -> "pd.DataFrame":
        """
        Return one row per arrival; names of columns end in their units.

        Returns
        -------
        pandas.DataFrame
            ``link`` and ``arrival`` (number within the link, from 0), ``travel_time_s``,
            ``surface_bounces``, ``bottom_bounces``, ``turning_points``, ``caustics``,
            ``launch_angle_deg``, ``arrival_angle_deg``, ``spreading_db``, and the slowness vectors
            at both ends.
        """
        import pandas as pd

        columns = {
            "link": self.link,
            "arrival": np.arange(self.link.size) - np.searchsorted(self.link, self.link),
            "travel_time_s": self.travel_time,
            "surface_bounces": self.surface_bounces,
            "bottom_bounces": self.bottom_bounces,
            "turning_points": self.turning_points,
            "caustics": self.caustics,
            "launch_angle_deg": np.degrees(self.launch_angle),
            "arrival_angle_deg": np.degrees(self.arrival_angle),
            "spreading_db": self.spreading_db,
        }
        for end, slowness in (
            ("source", self.source_slowness),
            ("receiver", self.receiver_slowness),
        ):
            for k, axis in enumerate(("north", "east", "down")):
                columns[f"{end}_slowness_{axis}_s_m"] = slowness[:, k] + 0.0  # no -0
        return pd.DataFrame(columns)

    def of_links(self, links: Column, rows: Column, travel_time: Column) -> FirstArrivals:
        """
        Select one arrival for each of several links.

        Parameters
        ----------
        links : ndarray of int, shape (n,)
            Links with an arrival.
        rows : ndarray of int, shape (n,)
            Row of the arrival of each of these links.
        travel_time : ndarray, shape (n,)
            Travel times of these arrivals. [s]

        Returns
        -------
        FirstArrivals
            All links; NaN for links without an arrival.
        """
        n = self.status.size
        time = np.full(n, np.nan)
        source = np.full((n, 3), np.nan)
        receiver = np.full((n, 3), np.nan)
        time[links] = travel_time
        source[links] = self.source_slowness[rows]
        receiver[links] = self.receiver_slowness[rows]
        return FirstArrivals(
            status=self.status,
            travel_time=time,
            chord_travel_time=self.chord_travel_time,
            source_sound_speed=self.source_sound_speed,
            receiver_sound_speed=self.receiver_sound_speed,
            shadow_margin=self.shadow_margin,
            source_slowness=source,
            receiver_slowness=receiver,
        )

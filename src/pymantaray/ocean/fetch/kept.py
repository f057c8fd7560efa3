"""Answers taken from the cache where they are sound, else from the server and kept."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pymantaray.ocean.fetch.cache import Cache
from pymantaray.ocean.fetch.transport import Transport

T = TypeVar("T")
Report = Callable[[str, int, int], None]
Array = NDArray[np.float64]


@dataclass(frozen=True)
class WindowFields:
    """Fields of one step on a window, as both services give them."""

    depth: Array
    """Shape (depth,). [m]"""
    lat: Array
    """Shape (lat,), rising. [degrees]"""
    lon: Array
    """Shape (lon,), rising. [degrees]"""
    fields: dict[str, Array]
    """Shape (depth, lat, lon) each, by HYCOM's names; NaN below the sea bed."""


@dataclass
class Source:
    """
    Connection and cache of one fetch.

    Parameters
    ----------
    transport : Transport
    cache : Cache, optional
        None: nothing is kept and nothing kept is used.
    progress : callable, optional
        Takes the stage's name, the parts done and the parts there are.
    """

    transport: Transport
    cache: Cache | None = None
    progress: Report | None = None
    kept: int = field(default=0, init=False)
    """Answers that came from the cache."""

    def get(
        self,
        url: str,
        request: Mapping[str, object],
        largest: int,
        parse: Callable[[bytes], T],
        oldest_s: float | None = None,
    ) -> T:
        """
        Meaning of the answer to a request.

        Parameters
        ----------
        url : str
            Where to ask.
        request : mapping
            What is asked for, as JSON can write it; the key of the cache.
        largest : int
            Bytes after which an answer is given up.
        parse : callable
            Gives the meaning of the bytes; what it refuses is asked for again.
        oldest_s : float, optional
            Age of a kept answer that may still be used. [s]

        Returns
        -------
        object

        Raises
        ------
        OceanError
            If the server gives no answer that `parse` takes.
        """
        if self.cache is not None and (body := self.cache.get(request, oldest_s)) is not None:
            try:
                parsed = parse(body)
            except Exception:  # noqa: BLE001  whole but not understood: of another version, so ask again
                self.cache.remove(request)
            else:
                self.kept += 1
                return parsed
        body, parsed = self.transport.get(url, largest, parse)
        if self.cache is not None:
            self.cache.put(request, body)
        return parsed

    def report(self, done: int, total: int) -> None:
        """
        Tell how far the fetch is.

        Parameters
        ----------
        done, total : int
            Blocks.
        """
        if self.progress is not None:
            self.progress("fetch", done, total)

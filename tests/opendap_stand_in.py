"""
A THREDDS stand-in on loopback: pydap's server for OPeNDAP with HYCOM's schema, and one that breaks
HTTP itself.

The fields are closed forms of depth, place and time, packed as HYCOM packs them; the axes are those
of HYCOM's global grids and are never held in memory as a whole.
"""

import gzip
import logging
import os
import re
import socket
import threading
from contextlib import suppress
from dataclasses import dataclass
from typing import ClassVar

import netCDF4
import numpy as np
import waitress
from pydap.handlers.lib import BaseHandler
from pydap.model import BaseType, DatasetType, GridType

DEPTHS = np.fromstring(  # metres
    "0 2 4 6 8 10 12 15 20 25 30 35 40 45 50 60 70 80 90 100 125 150 200 250 300 350 400 500 600"
    " 700 800 900 1000 1250 1500 2000 2500 3000 4000 5000",
    sep=" ",
)
FILL = -30000
SCALE = 0.001
OFFSETS = {"water_temp": 20.0, "salinity": 20.0, "water_u": 0.0, "water_v": 0.0}
UNITS = {
    "time": "hours since 2000-01-01 00:00:00",
    "depth": "m",
    "lat": "degrees_north",
    "lon": "degrees_east",
}
EPOCH = np.datetime64("2000-01-01T00:00:00")


def glbv_latitudes():
    """GLBv0.08: 0.04 degree poleward of 40, 0.08 between; off the exact grid as HYCOM's are."""
    south, middle = -80.0 + 0.04 * np.arange(1000), -40.0 + 0.08 * np.arange(1000)
    north = 40.0 + 0.04 * np.arange(1251)
    return np.concatenate([south, middle, north]).astype("f4").astype(float)


def longitudes(first):
    return (first + 0.08 * np.arange(4500)).astype("f4").astype(float)


def hours(instants):
    return (np.asarray(instants, dtype="datetime64[s]") - EPOCH) / np.timedelta64(3600, "s")


def three_hourly(start, stop):
    first, last = np.datetime64(start, "s"), np.datetime64(stop, "s")
    return np.arange(first, last, np.timedelta64(3 * 3600, "s"))


def truth(name, hour, depth, lat, lon):
    """Closed form of a variable; NaN on land and below the sea bed. Arguments broadcast."""
    hour, depth, lat, lon = np.broadcast_arrays(hour, depth, lat, lon)
    east = np.radians(lon)
    if name == "water_temp":
        value = 8.0 * np.exp(-depth / 300.0) * np.cos(np.radians(lat)) + np.sin(7 * east)
    elif name == "salinity":
        value = 34.0 + 0.5 * np.tanh(depth / 200.0) + 0.2 * np.cos(5 * east)
    elif name == "water_u":
        value = 0.3 * np.cos(9 * east) * np.exp(-depth / 800.0)
    else:
        value = 0.2 * np.sin(11 * east) * np.exp(-depth / 800.0) + 0.001 * np.radians(lat)
    value = value + 0.01 * np.sin(hour / 3.0)
    floor = (
        2600.0
        + 3600.0 * np.sin(3 * east + 1.0) * np.cos(np.radians(2 * lat))
        + 300 * np.sin(200 * east)
    )
    return np.where(depth <= floor, value, np.nan)


@dataclass
class Packed:
    """One packed variable of a data set, computed where it is sliced."""

    name: str
    axes: tuple

    dtype: ClassVar = np.dtype("i2")
    ndim: ClassVar = 4

    @property
    def shape(self):
        return tuple(a.size for a in self.axes)

    def __getitem__(self, key):
        value = truth(self.name, *np.ix_(*(a[k] for a, k in zip(self.axes, key, strict=True))))
        packed = np.round((np.nan_to_num(value) - OFFSETS[self.name]) / SCALE)
        return np.where(np.isnan(value), FILL, packed).astype("i2")


@dataclass
class Model:
    """A data set of HYCOM: its axes and the variables it holds."""

    instants: np.ndarray
    lat: np.ndarray
    lon: np.ndarray
    variables: tuple = tuple(OFFSETS)

    def dap(self):
        """The data set as THREDDS serves it: grids with maps."""
        data = DatasetType("hycom")
        axes = {"time": hours(self.instants), "depth": DEPTHS, "lat": self.lat, "lon": self.lon}
        fill, scale = np.int16(FILL), np.float32(SCALE)
        packing = {"_FillValue": fill, "missing_value": fill, "scale_factor": scale}
        for name in self.variables:
            grid = GridType(name)
            attributes = packing | {"add_offset": np.float32(OFFSETS[name])}
            grid[name] = BaseType(
                name, Packed(name, tuple(axes.values())), dims=tuple(axes), **attributes
            )
            grid.attributes.update(attributes)
            for axis, values in axes.items():
                grid[axis] = BaseType(axis, values, dims=(axis,))
            data[name] = grid
        for axis, values in axes.items():
            data[axis] = BaseType(axis, values, dims=(axis,), units=UNITS[axis])
        since = np.zeros(self.instants.size)
        data["tau"] = BaseType("tau", since, dims=("time",), units="hours since analysis")
        return BaseHandler(data)


def file_dap(path):
    """A NetCDF file as it is, packed; pydap's own handler of files cannot cut windows (3.5.9)."""
    data = DatasetType(path.name)
    with netCDF4.Dataset(path) as held:
        held.set_auto_maskandscale(False)
        for name, variable in held.variables.items():
            attributes = {key: variable.getncattr(key) for key in variable.ncattrs()}
            data[name] = BaseType(name, variable[:], dims=variable.dimensions, **attributes)
    return BaseHandler(data)


class Thredds:
    """An OPeNDAP service that counts what it is asked and misbehaves on request."""

    def __init__(self, models):
        self.models = models
        self.faults = []  # (text in the address, what happens); each is used once
        self.asked = []
        self.release = threading.Event()
        self.account = None

    def __call__(self, environ, start_response):
        address = environ["PATH_INFO"] + (
            "?" + environ["QUERY_STRING"] if environ["QUERY_STRING"] else ""
        )
        self.asked.append(address)
        if self.account and environ.get("HTTP_AUTHORIZATION") != self.account:
            start_response("401 Unauthorized", [])
            return [b""]
        fault = next((f for f in self.faults if f[0] in address), None)
        if fault is not None:
            self.faults.remove(fault)
            return self.misbehave(fault[1], environ, start_response)
        return self.answer(environ, start_response)

    def answer(self, environ, start_response):
        dataset, suffix = environ["PATH_INFO"].removeprefix("/thredds/dodsC/").rsplit(".", 1)
        if dataset not in self.models:
            start_response("404 Not Found", [("Content-Type", "text/html")])
            return [b"<html><body>No such <b>data set</b>\n</body></html>"]
        model = self.models[dataset]
        handler = file_dap(model) if isinstance(model, os.PathLike) else model.dap()
        environ["SCRIPT_NAME"] = ""
        environ["PATH_INFO"] = f"/data.{suffix}"
        return handler(environ, start_response)

    def misbehave(self, what, environ, start_response):
        plain = {  # status, body, header
            "500": (
                "500 Internal Server Error",
                b"<html>\n<h1>java.lang.NullPointerException</h1></html>",
            ),
            "page": ("200 OK", b"<html><body>down for maintenance</body></html>"),
            "error": (
                "200 OK",
                b'Error {\n    code = 500;\n    message = "timeout in reader";\n};\n',
            ),
            "garbage": ("200 OK", np.random.default_rng(0).bytes(5000)),
            "loop": ("302 Found", b"", ("Location", environ["PATH_INFO"])),
        }
        if what.startswith("503"):
            plain[what] = ("503 Service Unavailable", b"", ("Retry-After", what[4:] or "0"))
        if what in plain:
            status, body, *headers = plain[what]
            start_response(status, [("Content-Type", "text/html"), *headers])
            return [body]
        if what == "hang":
            self.release.wait(20.0)
            start_response("504 Gateway Timeout", [])
            return [b""]
        head = {}
        whole = b"".join(self.answer(environ, lambda *words: head.update(status=words[0])))
        half = whole[: len(whole) // 2]
        body, length, *gzipped = {
            "drip": lambda: (self.drip(whole), len(whole)),
            "cut": lambda: (
                [half],
                len(whole),
            ),  # fewer bytes than announced, then the connection closes
            "chunk": lambda: (self.broken(half), None),  # chunked without an end
            "short": lambda: ([half], len(half)),  # honest about its length, not about its content
            "flood": lambda: ([whole, b"\0" * (65 << 20)], len(whole) + (65 << 20)),
            "shift": lambda: (
                [
                    re.sub(rb"(?<=Data:\n)....", b"\0\0\0\1", whole, count=1, flags=re.DOTALL)
                ],  # one element
                len(whole),
            ),
            "gzip": lambda: ([gzip.compress(whole)], None, ("Content-Encoding", "gzip")),
            "gzip cut": lambda: ([gzip.compress(whole)[:-100]], None, ("Content-Encoding", "gzip")),
        }[what]()
        start_response(
            head["status"], [*gzipped, *([("Content-Length", str(length))] if length else [])]
        )
        return body

    def broken(self, half):
        yield half
        raise ConnectionAbortedError("on purpose")

    def drip(self, whole):
        for i in range(len(whole)):
            if self.release.wait(0.02):
                return
            yield whole[i : i + 1]


class Running:
    """A server in a thread, on a free port of loopback."""

    def __init__(self, app):
        logging.getLogger("waitress").setLevel(logging.CRITICAL)
        self.app = app
        self.map = {}
        self.server = waitress.server.create_server(
            app, map=self.map, host="127.0.0.1", port=0, threads=4
        )
        self.root = f"http://127.0.0.1:{self.server.effective_port}/thredds/dodsC"
        self.thread = threading.Thread(target=self.serve, daemon=True)
        self.thread.start()

    def serve(self):
        while self.map:
            waitress.wasyncore.loop(timeout=0.05, map=self.map, count=1)

    def stop(self):
        self.app.release.set()
        waitress.wasyncore.close_all(map=self.map)
        self.map.clear()
        self.thread.join(5.0)
        self.server.task_dispatcher.shutdown()


def reanalysis(year):
    """
    53.X as served: a year from 12Z to 09Z, -180 to 180, with the run of 31 December missing and
    other gaps.
    """
    steps = three_hourly(f"{year}-01-01T12", f"{year + 1}-01-01T12")
    gaps = ["2014-07-05T12", "2014-12-31T12", "2014-12-31T15", "2015-01-01T09", "2014-03-03T03"]
    gaps = [*np.array(gaps, steps.dtype), *three_hourly("2014-06-28T12", "2014-06-29T12")]
    return Model(steps[~np.isin(steps, gaps)], glbv_latitudes(), longitudes(-180.0))


class Endless:
    """
    A server that never comes to the end of an answer: of its headers, of its promises or of its
    text.
    """

    def __init__(self, what):
        self.first, self.again, self.pause = {
            "headers": (b"HTTP/1.1 200 OK\r\nX-A: ", b"a", 0.02),
            "continue": (b"", b"HTTP/1.1 100 Continue\r\n\r\n", 0.001),
            "text": (b"HTTP/1.1 200 OK\r\n\r\nDataset {", b" " * 1024, 0.001),
        }[what]
        self.ended = threading.Event()
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.root = f"http://127.0.0.1:{self.listener.getsockname()[1]}/thredds/dodsC"
        threading.Thread(target=self.serve, daemon=True).start()

    def serve(self):
        with suppress(OSError):
            while True:
                connection, _ = self.listener.accept()
                threading.Thread(target=self.talk, args=(connection,), daemon=True).start()

    def talk(self, connection):
        with connection, suppress(OSError):
            connection.recv(65536)
            connection.sendall(self.first)
            while not self.ended.wait(self.pause):
                connection.sendall(self.again)

    def stop(self):
        self.ended.set()
        self.listener.close()

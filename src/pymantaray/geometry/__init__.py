"""Frames, rotations and random streams, used by all other folders."""

from pymantaray.geometry.frames import LocalFrame
from pymantaray.geometry.sphere import EarthSphere
from pymantaray.geometry.streams import stream

__all__ = ["EarthSphere", "LocalFrame", "stream"]

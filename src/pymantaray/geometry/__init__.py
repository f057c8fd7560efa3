"""Frames, rotations and random streams: what every other folder stands on."""

from pymantaray.geometry.frames import LocalFrame
from pymantaray.geometry.streams import stream

__all__ = ["LocalFrame", "stream"]

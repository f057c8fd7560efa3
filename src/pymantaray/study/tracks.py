"""Trajectories of other programs as the fleet of a study, and the ranges alone that an ocean gives them."""

import datetime as dt
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import StudyError
from pymantaray.exchange.read import Source, files_of, read_trajectories
from pymantaray.exchange.tracks import SAME_TIME, Tracks, union_of_times, with_times
from pymantaray.geometry import LocalFrame
from pymantaray.records import Trajectories
from pymantaray.sensing import PingSchedule, Schedule, SlotSchedule
from pymantaray.study.config import FleetSection, StudyConfig
from pymantaray.study.load import parse_study
from pymantaray.study.mission import simulate_mission
from pymantaray.study.manifest import Stopwatch
from pymantaray.study.store import Run, run_in_memory

Array = NDArray[np.float64]

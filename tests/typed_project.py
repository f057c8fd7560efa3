"""Ranges, a study, a table and positions, as a package of a user has them."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pymantaray import (
    Arrivals,
    Estimates,
    LocalFrame,
    MantaRayError,
    Measurements,
    Medium,
    StudyConfig,
    Trajectories,
    Water,
    find_eigenrays,
    load_study,
    open_ocean,
    open_water,
    open_waters,
    read_trajectories,
    to_local,
)
from pymantaray.acoustics import Absorption, RayPaths, select, trace_paths, transmission_loss
from pymantaray.apps.graphs import GraphResult, open_graph, solve_graph
from pymantaray.apps.locate import LocateOptions, Location, ReadOptions, locate, read_survey
from pymantaray.apps.online import Beacon, OnlineEstimator, StartPose
from pymantaray.apps.plan import load_plan, search_designs
from pymantaray.apps.ranges import measure
from pymantaray.apps.replay import read_events, replay_events
from pymantaray.apps.service import Ping, RangingService
from pymantaray.apps.study import Run, citation, open_run, run_study
from pymantaray.apps.sweep import Sweep, run_sweep
from pymantaray.apps.table import TravelTimeTable, open_table
from pymantaray.evaluation import error_table, ping_error_table

Array = NDArray[np.float64]


def travel_time(depth: Array, sound_speed: Array, source: Array, receiver: Array) -> Array:
    medium: Medium = Medium.from_profile(depth, sound_speed, bottom_depth=3000.0)
    arrivals: Arrivals = find_eigenrays(medium, source, receiver, max_surface_bounces=1)
    paths: RayPaths = trace_paths(medium, source, receiver, arrivals)
    loss = transmission_loss(
        medium, source, receiver, arrivals, 12e3, absorption=Absorption.thorp()
    )
    print(paths.position.shape, loss.total_db, select(arrivals, "strongest"))
    return arrivals.first().travel_time


def water_of(source: str) -> tuple[Water, LocalFrame]:
    water = open_water(source, half_extent=20e3)
    local = to_local(open_ocean(source), centre=(74.5, -140.0), half_extent=(20e3, 20e3))
    print(local.sizes, open_waters(source))
    return water, LocalFrame(74.5, -140.0)


def rmse(folder: Path) -> float:
    config: StudyConfig = load_study("quick", realizations=1)
    run: Run = run_study(config)
    again = open_run(folder)
    estimates: Estimates = run.estimates
    truth: Trajectories = run.truth
    measurements: Measurements = again.measurements
    print(citation(config), error_table(truth, estimates), measurements)
    print(ping_error_table(truth, estimates, measurements, run.bounds))
    error = np.linalg.norm(estimates.position - truth.position, axis=-1)
    return float(np.sqrt(np.mean(error**2)))


def at_sea(folder: Path) -> None:
    table: TravelTimeTable = open_table(folder / "table.nc")
    estimator = OnlineEstimator(
        StartPose((0.0, 0.0, 50.0), sigma=[0.01, 0.01, 0.02, 5.0, 5.0, 1.0]),
        {"B1": Beacon((1000.0, 0.0, 50.0))},
        table,
        lag=60.0,
    )
    print(estimator.add_depth(10.0, 50.1, 0.1).name, estimator.position())
    survey = read_survey(folder / "pings.csv", ReadOptions(nodes=folder / "nodes.csv"))
    water = Medium.from_profile([0.0, 3000.0], [1500.0, 1510.0], bottom_depth=3000.0)
    located: Location = locate(survey, water, LocateOptions(speed_model="time"))
    solved: GraphResult = solve_graph(open_graph(folder / "graph.pyfg"))
    waters = open_waters(folder / "cast.csv", bathymetry=3000.0)
    replay = replay_events(read_events(folder / "events.csv"), waters, rule="within:6")
    print(located.nodes, solved.solution.status.name, replay.summary)


def fleets(folder: Path) -> None:
    run = measure(read_trajectories([folder / "mission.csv"]), "synthetic:beaufort", 300.0)
    print(run.ranges())
    sweep = Sweep("quick", cross={"noise.range_sigma": [0.5, 1.0]}, seeds=[1, 2])
    print(run_sweep(sweep, folder / "sweep", workers=2).table())
    print(search_designs(load_plan(folder / "mission.toml")).table)


def answer(source: str) -> float | None:
    try:
        with RangingService(source) as service:
            ping: Ping = service.ping(60.0, (0.0, 0.0, 50.0), [(1500.0, -400.0, 120.0)])
    except MantaRayError as error:
        print(error)
        return None
    return float(ping.arrival_time[0])

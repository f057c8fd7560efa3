"""What is in a graph and what an estimator made of it, for the terminal."""

import numpy as np
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from pymantaray.estimation.pyfg import GraphFile
from pymantaray.study.external import ExternalResult


def describe(file: GraphFile) -> list[tuple[str, str]]:
    """
    Say how many of each kind a graph has.

    Parameters
    ----------
    file : GraphFile

    Returns
    -------
    list of (str, str)
        Name and text of each line.
    """
    g = file.graph
    agent, number = g.pose_agent, g.pose_number.astype(int)
    same = agent[g.edge_from] == agent[g.edge_to]
    odometry = same & (number[g.edge_to] - number[g.edge_from] == 1)
    with_landmark = g.range_second >= g.n_poses
    between = g.range_first >= g.n_poses
    time = g.pose_time
    vehicles = (f"{name} ({np.count_nonzero(agent == a)} poses)" for a, name in enumerate(g.agent_name))
    closures = f"{np.count_nonzero(same & ~odometry)} of one vehicle, {np.count_nonzero(~same)} between two"
    ranges = (
        f"{np.count_nonzero(~with_landmark)} between poses,"
        f" {np.count_nonzero(with_landmark & ~between)} to landmarks, {np.count_nonzero(between)} between landmarks"
    )
    priors = (
        f"{g.prior_pose.size} of poses, {g.fix_pose.size} fixes, {g.depth_pose.size} depths,"
        f" {g.survey_landmark.size} of landmarks"
    )
    lines = [
        ("vehicles", ", ".join(vehicles)),
        ("landmarks", ", ".join(g.landmark_name.tolist()) or "none"),
        ("times", f"{time.min():g} to {time.max():g} s"),
        ("odometry", f"{np.count_nonzero(odometry)}"),
        ("loop closures", closures),
        ("ranges", ranges),
        ("priors", priors),
        ("degrees of freedom", f"{g.degrees_of_freedom}"),
    ]
    return lines + [("left out", f"{count} {what}") for what, count in file.left_out.items()]


def print_result(result: ExternalResult) -> None:
    """
    Print status and costs of a solve, and trajectory errors where there is a truth.

    Parameters
    ----------
    result : ExternalResult
    """
    console = Console(soft_wrap=True)
    s = result.solution
    expected = f", expected {s.expected_cost:g}" if np.isfinite(s.expected_cost) else ""
    console.print(
        f"{escape(result.estimator)}, start {result.start}: [bold]{s.status.name}[/bold], {s.iterations} iterations,"
        f" cost {s.initial_cost:.6g} to {s.final_cost:.6g}{expected}"
    )
    for what, count in result.left_out.items():
        console.print(f"left out: {count} {escape(what)}")
    if result.anchored.size:
        names = ", ".join(result.graph.variable_name(int(pose)) for pose in result.anchored)
        console.print(f"given a prior at the file's value: {escape(names)}")
    if result.taken:
        console.print(f"started at the file's value for want of a prior: {result.taken} variables")
    errors = result.trajectory_errors(result.values)
    if not errors or not s.usable:
        return
    table = Table(
        title="Trajectory error, no alignment", title_justify="left", box=box.SIMPLE, pad_edge=False
    )
    table.add_column("vehicle", no_wrap=True)
    for name in ("poses", "start RMSE [m]", "mean [m]", "RMSE [m]", "95 % [m]", "max [m]"):
        table.add_column(name.replace("[", r"\["), justify="right")
    before = result.trajectory_errors(result.initial)
    for vehicle, row in errors.items():
        numbers = (before[vehicle]["rmse_m"], row["mean_m"], row["rmse_m"], row["p95_m"], row["max_m"])
        table.add_row(escape(vehicle), f"{row['n']}", *(f"{v:.3f}" for v in numbers))
    console.print(table)

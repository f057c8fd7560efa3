"""The diagram of the stages is that of the code."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

from pymantaray.apps.study.figures.pipeline import STAGES, columns, flows, pipeline


@dataclass
class Water:
    depth: float


class Echo(NamedTuple):
    water: Water
    time: float


Water.__module__ = Echo.__module__ = "pymantaray.made_up"


def fill() -> Water:
    raise NotImplementedError


def ping(water: Water | None, power: float) -> dict[str, Echo]:
    raise NotImplementedError


def hear(echoes: list[Echo], water: Water) -> float:
    raise NotImplementedError


def test_an_arrow_joins_the_maker_of_a_record_and_who_takes_it():
    between = flows([fill, ping, hear])
    assert set(between) == {(0, 1, "Water"), (1, 2, "Echo"), (0, 2, "Water")}
    assert columns(3, between) == [0, 1, 2]


def test_data_of_a_study_flows_one_way_and_reaches_every_stage():
    names = [function.__name__ for *_, function in STAGES]
    between = {(names[f.source], names[f.target], f.record) for f in flows([f for *_, f in STAGES])}
    assert ("simulate_fleet", "range_fleet", "Trajectories") in between
    assert ("perturb", "solve_conditions", "Measurements") in between
    assert not any(
        target == "solve_conditions" and record == "Trajectories" for _, target, record in between
    )
    assert {target for _, target, _ in between} == set(names) - {"mission_ocean"}
    for folder, _, function in STAGES:
        homes = {
            "ocean": "config",
            "fleet": "apps",
            "water": "acoustics",
            "acoustics": "apps",
        }  # stages that others put together from these folders
        assert function.__module__.split(".")[1] == homes.get(folder, folder)


def test_every_stage_is_named_on_the_figure(look):
    words = {text.get_text() for text in look.draw(pipeline("")).axes[0].texts}
    assert {folder for folder, *_ in STAGES} | {
        "Trajectories",
        "Measurements",
        "Estimates",
    } <= words


def test_no_arrow_passes_behind_a_box(look, as_stored):
    figure = look.draw(pipeline(""))
    as_stored(figure)
    axes = figure.axes[0]
    boxes = [patch for patch in axes.patches if isinstance(patch, FancyBboxPatch)]
    arrows = [patch for patch in axes.patches if isinstance(patch, FancyArrowPatch)]
    assert len(boxes) == len(STAGES)
    assert len(arrows) == len({(f.source, f.target) for f in flows([f for *_, f in STAGES])})
    part = np.linspace(0.0, 1.0, 401)[:, None]
    for arrow in arrows:
        vertices = arrow._path_original.vertices  # of a straight line, or of a cubic Bézier curve
        weights = (1 - part, part)
        if len(vertices) == 4:
            weights = (
                (1 - part) ** 3,
                3 * (1 - part) ** 2 * part,
                3 * (1 - part) * part**2,
                part**3,
            )
        points = sum(weight * vertex for weight, vertex in zip(weights, vertices, strict=True))
        for box in boxes:
            half = np.array([box.get_width(), box.get_height()]) / 2.0
            centre = np.array([box.get_x(), box.get_y()]) + half
            assert not (np.abs(points - centre) < half - 1e-6).all(axis=1).any(), (arrow, box)

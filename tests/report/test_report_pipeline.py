"""The diagram of the stages is that of the code."""

from dataclasses import dataclass
from typing import NamedTuple

from pymantaray.report.figures_pipeline import STAGES, columns, flows, pipeline


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
    assert not any(target == "solve_conditions" and record == "Trajectories" for _, target, record in between)
    assert {target for _, target, _ in between} == set(names) - {"mission_ocean"}
    for folder, _, function in STAGES:
        homes = {
            "ocean": "water",
            "fleet": "study",
            "acoustics": "study",
        }  # stages that study puts together from these folders
        assert function.__module__.split(".")[1] == homes.get(folder, folder)


def test_every_stage_is_named_on_the_figure(look):
    words = {text.get_text() for text in look.draw(pipeline("")).axes[0].texts}
    assert {folder for folder, *_ in STAGES} | {"Trajectories", "Measurements", "Estimates"} <= words

"""Noisy factor graphs of a realization, and their PyFG files."""

import logging
from pathlib import Path
from typing import TYPE_CHECKING

from pymantaray.estimation import CONDITIONS, FactorGraph, GraphValues, build_graph
from pymantaray.estimation.graph.pyfg import not_in_text, write_pyfgs
from pymantaray.records import Measurements

if TYPE_CHECKING:
    from pymantaray.apps.study.store import Run

_DIGITS = 12  # 1e-7 m at 100 km, in three quarters of the room of 17 digits
LOG = logging.getLogger(__name__)


def noisy_graphs(run: "Run", noisy: Measurements) -> dict[str, FactorGraph]:
    """Graphs of a run's standard conditions that have ranges."""
    conditions = {c.name: CONDITIONS[c.name] for c in run.study.conditions if c.standard}
    return {
        name: build_graph(noisy, c.ranges, c.links)
        for name, c in conditions.items()
        if c.ranges is not None
    }


def write_graphs(
    run: "Run", realization: int, folder: Path, before: str = "", *, compact: bool = False
) -> None:
    """
    Write a realization's graphs as PyFG text with the true poses as values, or as NetCDF if the
    text cannot hold them.

    File names begin with ``before``. Compact text has 12 significant digits and is compressed.
    """
    noisy = run.noisy_measurements(realization)
    truth = GraphValues(
        position=run.truth.position.reshape(-1, 3),
        quaternion=run.truth.quaternion.reshape(-1, 4),
        landmark_position=noisy.landmark_position,
    )
    texts = {}
    ending, digits = (".pyfg.gz", _DIGITS) if compact else (".pyfg", 17)
    for name, graph in noisy_graphs(run, noisy).items():
        if lost := not_in_text(graph):
            path = folder / f"{before}{name}.nc"
            LOG.warning("%s: NetCDF, because PyFG text cannot hold %s", path, ", ".join(lost))
            graph.save(path)
        else:
            texts[folder / f"{before}{name}{ending}"] = graph
    write_pyfgs(texts, initial=truth, digits=digits)

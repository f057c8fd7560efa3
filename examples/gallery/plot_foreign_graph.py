"""
An existing factor graph
========================

Two vehicles on a square with ranges between them, in PyFactorGraph's text format: read, solved and
drawn.
"""

import tempfile
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

from pymantaray.apps.graphs import open_graph, solve_graph

rng, lines = np.random.default_rng(1), list[str]()
corners = [[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1]]
square = 50.0 * np.array(corners)
for name, path in (("A", square), ("B", np.roll(square, 4, axis=0))):
    lines += [f"VERTEX_SE2 {k} {name}{k} {x} {y} 0" for k, (x, y) in enumerate(path)]
    lines += [f"VERTEX_SE2:PRIOR 0 {name}0 {path[0, 0]} {path[0, 1]} 0 1e-4 0 0 1e-4 0 1e-4"]
    steps = np.diff(path, axis=0) + rng.normal(0.0, 4.0, (7, 2))
    lines += [
        f"EDGE_SE2 {k} {name}{k} {name}{k + 1} {x} {y} 0 16 0 0 16 0 1e-4"
        for k, (x, y) in enumerate(steps)
    ]
for k, distance in enumerate(np.linalg.norm(square - np.roll(square, 4, axis=0), axis=1)):
    lines += [f"EDGE_RANGE {k} A{k} B{k} {distance + rng.normal()} 1"]
with tempfile.TemporaryDirectory() as folder:
    (Path(folder) / "graph.pyfg").write_text("\n".join(lines))
    result = solve_graph(open_graph(Path(folder) / "graph.pyfg"), start="dead-reckoning")
figure, panels = plt.subplots(1, 2, figsize=(8, 4), sharey=True, layout="constrained")
places = {"dead reckoning": result.initial, "estimate with ranges": result.values}
for axes, (title, values) in zip(panels, places.items(), strict=True):
    for k, vehicle in enumerate((slice(0, 8), slice(8, 16))):
        axes.plot(*result.truth.position[vehicle, :2].T, color="lightgrey", lw=5)
        axes.plot(*values.position[vehicle, :2].T, "o-", color=f"C{k}", label=f"vehicle {'AB'[k]}")
    axes.set(title=title, xlabel="x [m]", ylabel="y [m]", aspect="equal")
panels[0].legend()

"""
Generated graph files with several minima: rings, tori and spheres with noise, a survey, and
landmarks that may be mirrored in depth.
"""

import numpy as np
from scipy.spatial.transform import Rotation


def upper(matrix):
    return " ".join(f"{v:.9g}" for v in matrix[np.triu_indices(len(matrix))])


def line(*fields):
    return " ".join(
        f if isinstance(f, str) else " ".join(f"{v:.12g}" for v in np.atleast_1d(f)) for f in fields
    )


def ring(n, twist, seed, rotation_sigma, translation_sigma):
    """A g2o ring of poses; the vertices turn ``twist`` times too often on the way round."""
    rng = np.random.default_rng(seed)
    angle = 2.0 * np.pi * np.arange(n) / n
    place = np.column_stack([10.0 * np.cos(angle), 10.0 * np.sin(angle), np.zeros(n)])
    about_down = np.array([0.0, 0.0, 1.0])
    true = Rotation.from_rotvec((angle + np.pi / 2)[:, None] * about_down)
    twisted = Rotation.from_rotvec((angle * (1 + twist) + np.pi / 2)[:, None] * about_down)
    sigma = np.repeat([translation_sigma, rotation_sigma], 3)
    lines = [line("VERTEX_SE3:QUAT", k, place[k], twisted[k].as_quat()) for k in range(n)]
    for k in range(n):
        j = (k + 1) % n
        step = true[k].inv().apply(place[j] - place[k]) + translation_sigma * rng.normal(size=3)
        turn = true[k].inv() * true[j] * Rotation.from_rotvec(rotation_sigma * rng.normal(size=3))
        lines.append(line("EDGE_SE3:QUAT", k, j, step, turn.as_quat(), upper(np.diag(sigma**-2.0))))
    return "\n".join(lines) + "\n"


def drone(seed=3, *, wave=2.0, landmark=(40.0, 30.0, 25.0)):
    """
    PyFactorGraph text of a nearly level path with ranges to a landmark, whose vertex is mirrored in
    depth.
    """
    rng = np.random.default_rng(seed)
    n, sigma = 40, np.repeat([0.02, 1e-3], 3)
    angle = np.linspace(0.0, 1.5 * np.pi, n)
    place = np.column_stack([60 * np.cos(angle), 60 * np.sin(angle), wave * np.sin(5 * angle)])
    landmark, level = np.array(landmark), np.array([0.0, 0.0, 0.0, 1.0])
    lines = [line("VERTEX_SE3:QUAT", k, f"A{k}", place[k], level) for k in range(n)]
    lines.append(line("VERTEX_XYZ L0", landmark * [1, 1, -1]))
    lines.append(line("VERTEX_SE3:QUAT:PRIOR 0 A0", place[0], level, upper(np.diag(sigma**2))))
    for k in range(1, n):
        noise = sigma * rng.normal(size=6)
        turn = Rotation.from_rotvec(noise[3:]).as_quat()
        step = place[k] - place[k - 1] + noise[:3]
        lines.append(
            line("EDGE_SE3:QUAT", k, f"A{k - 1} A{k}", step, turn, upper(np.diag(sigma**2)))
        )
    for k in range(0, n, 2):
        distance = np.linalg.norm(place[k] - landmark) + rng.normal()
        lines.append(line("EDGE_RANGE", k, f"A{k} L0", distance, 1.0))
    return "\n".join(lines) + "\n", landmark


def pose_graph(place, rotation, pairs, start, sigma, rng):
    """
    g2o text of relative poses with noise: sigma of translation [m] and rotation [rad]; vertices are
    the start.
    """
    spread = np.repeat(sigma, 3)
    lines = [line("VERTEX_SE3:QUAT", k, place[k], start[k].as_quat()) for k in range(len(place))]
    for a, b in pairs:
        noise = spread * rng.normal(size=6)
        step = rotation[a].inv().apply(place[b] - place[a]) + noise[:3]
        turn = rotation[a].inv() * rotation[b] * Rotation.from_rotvec(noise[3:])
        lines.append(
            line("EDGE_SE3:QUAT", a, b, step, turn.as_quat(), upper(np.diag(spread**-2.0)))
        )
    return "\n".join(lines) + "\n"


def torus(seed, sigma, *, twist=0, around=12, across=6):
    """
    A torus of poses; the vertices of the file turn ``twist`` times too often on the way round.
    """
    rng = np.random.default_rng(seed)
    k = np.arange(around * across)
    a, b = 2.0 * np.pi * (k // across) / around, 2.0 * np.pi * (k % across) / across
    radius = 10.0 + 3.0 * np.cos(b)
    place = np.column_stack([radius * np.cos(a), radius * np.sin(a), 3.0 * np.sin(b)])
    true, twisted = (
        Rotation.from_rotvec(np.outer(turns * a, [0.0, 0.0, 1.0])) for turns in (1, 1 + twist)
    )
    pairs = [(i, (i // across) * across + (i + 1) % across) for i in k]
    pairs += [(i, (i + across) % k.size) for i in k]
    return pose_graph(place, true, pairs, twisted, sigma, rng)


def sphere(seed, sigma, *, rings=6, each=10):
    """
    A spiral of poses over a sphere, with edges between neighbours on successive turns; vertices are
    level.
    """
    rng = np.random.default_rng(seed)
    k = np.arange(rings * each)
    polar, a = np.pi * (k + 0.5) / k.size, 2.0 * np.pi * k / each
    place = 10.0 * np.column_stack(
        [np.sin(polar) * np.cos(a), np.sin(polar) * np.sin(a), np.cos(polar)]
    )
    true = Rotation.from_rotvec(np.outer(a, [0.0, 0.0, 1.0])) * Rotation.from_rotvec(
        np.outer(polar, [0.0, 1.0, 0.0])
    )
    pairs = [(i, i + 1) for i in k[:-1]] + [(i, i + each) for i in k[:-each]]
    return pose_graph(place, true, pairs, [Rotation.identity()] * k.size, sigma, rng)


def survey(seed, factor=1.0, *, lines=6, each=8):
    """
    Parallel survey lines; odometry has 0.02 m and 2 mrad a step times a factor, crossings 0.1 m and
    0.02 rad.
    """
    rng = np.random.default_rng(seed)
    n = lines * each
    row, along = np.divmod(np.arange(n), each)
    along = np.where(row % 2, each - 1 - along, along)
    place = np.column_stack([5.0 * along, 5.0 * row, 0.2 * rng.normal(size=n)])
    true = Rotation.from_rotvec(np.outer(np.where(row % 2, np.pi, 0.0), [0.0, 0.0, 1.0]))
    steps = [(k, k + 1) for k in range(n - 1)]
    start = [Rotation.identity()] * n
    odometry = pose_graph(place, true, steps, start, (0.02 * factor, 2e-3 * factor), rng)
    crossings = [(k, (r + 1) * each + (each - 1 - k % each)) for k, r in enumerate(row[: n - each])]
    some = [pair for pair in crossings if rng.random() < 0.3]
    ties = pose_graph(place, true, some, start, (0.1, 0.02), rng)
    return odometry + "".join(text + "\n" for text in ties.splitlines() if text.startswith("EDGE"))


def cooperative(seed, factor=1.0, *, vehicles=3, n=25):
    """
    PyFactorGraph text of vehicles that measure ranges to each other and to a landmark; noise of
    odometry times a factor.
    """
    rng = np.random.default_rng(seed)
    sigma, level = factor * np.repeat([0.05, 2e-3], 3), np.array([0.0, 0.0, 0.0, 1.0])
    first = np.array([[0.0, 0.0, 0.0], [60.0, 0.0, 10.0], [0.0, 60.0, -10.0]])[:vehicles]
    step = np.cumsum(rng.normal(0, 0.3, (vehicles, n, 3)), axis=1) + rng.normal(
        0, 1.5, (vehicles, 1, 3)
    )
    place = first[:, None] + np.concatenate(
        [np.zeros((vehicles, 1, 3)), np.cumsum(step, axis=1)[:, :-1]], axis=1
    )
    landmark, lines = np.array([35.0, 35.0, 25.0]), []
    for v in range(vehicles):
        name = "ABC"[v]
        lines += [line("VERTEX_SE3:QUAT", k, f"{name}{k}", place[v, k], level) for k in range(n)]
        prior = upper(np.diag(np.repeat([0.05, 1e-2], 3) ** 2))
        lines.append(line(f"VERTEX_SE3:QUAT:PRIOR 0 {name}0", place[v, 0], level, prior))
        for k in range(1, n):
            noise = sigma * rng.normal(size=6)
            moved = place[v, k] - place[v, k - 1] + noise[:3]
            turn = Rotation.from_rotvec(noise[3:]).as_quat()
            ends = f"{name}{k - 1} {name}{k}"
            lines.append(line("EDGE_SE3:QUAT", k, ends, moved, turn, upper(np.diag(sigma**2))))
    lines.append(line("VERTEX_XYZ L0", landmark * [1, 1, -1]))
    for k in range(0, n, 2):
        for v in range(vehicles):
            distance = np.linalg.norm(place[v, k] - landmark) + 0.3 * rng.normal()
            lines.append(line("EDGE_RANGE", k, f"{'ABC'[v]}{k} L0", distance, 0.09))
            for w in range(v):
                distance = np.linalg.norm(place[v, k] - place[w, k]) + 0.3 * rng.normal()
                lines.append(line("EDGE_RANGE", k, f"{'ABC'[w]}{k} {'ABC'[v]}{k}", distance, 0.09))
    return "\n".join(lines) + "\n"


FILES = {
    # eight with ranges
    "mirrored.pyfg": lambda: drone(wave=0.3)[0],
    "drone.pyfg": lambda: drone(wave=2.0)[0],
    "drone-5.pyfg": lambda: drone(5, wave=4.0)[0],
    "cooperative.pyfg": lambda: cooperative(1),
    "cooperative-2.pyfg": lambda: cooperative(2),
    "cooperative-10.pyfg": lambda: cooperative(1, 10.0),
    "cooperative-10-2.pyfg": lambda: cooperative(2, 10.0),
    "cooperative-2-vehicles.pyfg": lambda: cooperative(3, vehicles=2),
    # fifteen of relative poses
    "ring.g2o": lambda: ring(24, 0, 0, 0.1, 0.5),
    "ring-twisted.g2o": lambda: ring(24, 1, 0, 0.1, 20.0),
    "ring-twice.g2o": lambda: ring(24, 2, 0, 0.05, 5.0),
    "ring-two-minima.g2o": lambda: ring(6, 1, 9, 0.9, 20.0),
    "torus.g2o": lambda: torus(1, (0.1, 0.02)),
    "torus-twisted.g2o": lambda: torus(1, (0.1, 0.02), twist=1),
    "torus-noise.g2o": lambda: torus(2, (0.3, 0.2), twist=1),
    "torus-big-noise.g2o": lambda: torus(3, (0.5, 0.5), twist=1),
    "sphere.g2o": lambda: sphere(1, (0.1, 0.02)),
    "sphere-noise.g2o": lambda: sphere(2, (0.3, 0.2)),
    "sphere-big-noise.g2o": lambda: sphere(3, (0.5, 0.5)),
    "sphere-big-noise-4.g2o": lambda: sphere(4, (0.5, 0.5)),
    "survey.g2o": lambda: survey(1),
    "survey-10.g2o": lambda: survey(1, 10.0),
    "survey-100.g2o": lambda: survey(1, 100.0),
}
"""Text of each generated file, by name."""

"""Generated graph files with two minima: a twisted ring, and a landmark that may be mirrored in depth."""

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
    """PyFactorGraph text of a nearly level path with ranges to a landmark, whose vertex is mirrored in depth."""
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
        lines.append(line("EDGE_SE3:QUAT", k, f"A{k - 1} A{k}", step, turn, upper(np.diag(sigma**2))))
    for k in range(0, n, 2):
        distance = np.linalg.norm(place[k] - landmark) + rng.normal()
        lines.append(line("EDGE_RANGE", k, f"A{k} L0", distance, 1.0))
    return "\n".join(lines) + "\n", landmark

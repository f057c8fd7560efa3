"""Files of the paper's authors' program, written by hand for tests."""

import json
from pathlib import Path

import numpy as np

X, Y = np.array([-9e3, -4e3, 0.0, 2e3, 9e3]), np.array([-8e3, -1e3, 3e3, 8e3])
Z = np.array([0.0, 50.0, 200.0, 1000.0, 2000.0])
FLOOR = 1900.0


def sound_speed(x, y, z):
    """A field that trilinear interpolation reproduces. [m/s]"""
    return 1450.0 + 0.016 * z + 1e-4 * x - 2e-4 * y


def currents(x, y, z):
    """Eastward and northward current, linear in each coordinate. [m/s]"""
    return 0.1 + 1e-6 * x - 2e-5 * z, -0.05 + 2e-6 * y + 0.0 * x


def arrays():
    """Arrays of the program by section and key; x is slowest, z fastest."""
    at = np.meshgrid(X, Y, Z, indexing="ij")
    u, v = currents(*at)
    axes = {"x": X, "y": Y, "z": Z}
    return {
        "bathymetry": {"x": X, "y": Y, "data": np.full((X.size, Y.size), FLOOR)},
        "ssp": {**axes, "data": sound_speed(*at)},
        "current": {**axes, "u": u, "v": v},
    }


def write_environment(folder: Path, sections=None, **keys):
    """Write ``environment.json`` and its arrays; ``keys`` replace those of the file."""
    tree = {"source_dir": "data"}
    for section, fields in (arrays() if sections is None else sections).items():
        (folder / "data" / section).mkdir(parents=True, exist_ok=True)
        tree[section] = {key: f"{section}/{key}.npy" for key in fields}
        for key, values in fields.items():
            np.save(folder / "data" / section / f"{key}.npy", values.ravel())
    path = folder / "environment.json"
    path.write_text(json.dumps(tree | keys))
    return path


def simulation():
    """A configuration with one robot of each kind and one landmark."""
    return {
        "run_name": "two",
        "output_dir": "output",
        "env_config_file": "environment.json",
        "rng_seed": 3,
        "bellhop_memory_mib": 80,
        "timing": {"end_time_hours": 2.0, "physics_dt": 0.5, "ping_interval_min": 30.0},
        "acoustics": {
            "tof_mode": "one_way",
            "num_beams": 100,
            "max_beams": 400,
            "beam_spread_deg": 15,
        },
        "sensors": {
            "gt_freq_hz": 0.01,
            "odom_freq_hz": 0.01,
            "gps_freq_hz": 0.01,
            "odom_noise_stddev": 0.02,
            "gps_xy_noise_stddev": 0.2,
            "gps_z_noise_stddev": 0.05,
        },
        "robots": [
            {
                "type": "current_drift",
                "position": [500.0, -700.0, 0.01],
                "target_depth": 300.0,
                "hold_seconds": 1200.0,
                "surface_hold_seconds": 600.0,
            },
            {
                "type": "constant_vel",
                "position": [2000.0, 1000.0, 100.0],
                "velocity": [-0.3, 0.2, 0.01],
            },
        ],
        "landmarks": [[-1000.0, 1500.0, 400.0]],
        "pfg": {
            "range_variance": 4.0,
            "odom_rotation_variance": 1e-6,
            "pose_prior_cov_diag": [0.01, 0.01, 0.01, 1e-4, 1e-4, 1e-4],
            "landmark_prior_cov_diag": [0.04, 0.04, 0.04],
        },
    }


def write_simulation(folder: Path, tree=None):
    """Write ``sim.json`` and its water."""
    write_environment(folder)
    path = folder / "sim.json"
    path.write_text(json.dumps(simulation() if tree is None else tree))
    return path

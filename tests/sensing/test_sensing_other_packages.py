"""What a sensor of another package returns is checked, and its faults have the package's name."""

import numpy as np
import pytest
from other_package import NOTHING, install

from pymantaray.apps.study import open_run
from pymantaray.errors import ExtensionError
from pymantaray.sensing import NoiseModel
from pymantaray.sensing.other_packages import other_sensors
from pymantaray.sensing.sensor import Scene

__all__ = ["install"]
DEPTH = "scene.truth.position[..., 2]"


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        ("raise ValueError('a\\nb')", "fails in measure: ValueError: a b;"),
        ("sys.exit(0)", "fails in measure: SystemExit: 0;"),
        ("return None", "returns from measure NoneType, not a dictionary of columns;"),
        ("return {'salinity': 1.0}", "returns from measure the column 'salinity'; allowed:"),
        ("return {'name': scene.truth.name[::-1]}", "returns from measure the column 'name';"),
        ("return {'range_status': [99]}", "returns from measure the column 'range_status';"),
        (f"return {{'depth': {DEPTH} * 1j}}", "depth with values of type complex128;"),
        (f"return {{'depth': {DEPTH} * np.nan}}", "depth with values that are not finite;"),
        (f"return {{'depth': np.ma.masked_less({DEPTH}, 9)}}", "depth with masked values;"),
        ("return {'depth': np.zeros(3)}", "fails in measure: RecordError: measurements: depth"),
        ("return {'depth_sigma': [0.0]}", "depth_sigma with standard deviations that are not"),
        ("return {'dvl_beam_loss': [1.5]}", "dvl_beam_loss with probabilities outside 0 to 1;"),
        ("return {'first_quaternion': np.ones((4, 4))}", "quaternions whose norm is not 1;"),
        ("return {'gnss_vehicle': [99]}", "gnss_vehicle with indices outside 0 to"),
        (
            "return {'dvl_sample': [len(scene.truth.time) - 1]}",
            "dvl_sample with indices outside 0 to",
        ),
        ("scene.truth.position[:] = 0.0", "fails in measure: ValueError: assignment destination"),
    ],
)
def test_a_sensor_that_measures_wrongly_is_named(install, tiny_run_folder, body, fault):
    install(NOTHING + f"def measure(scene, noise):\n    {body}\n")
    run = open_run(tiny_run_folder)
    (sensor,) = other_sensors(["bad"])
    with pytest.raises(ExtensionError, match=r"^package 'other': ") as error:
        sensor.measured(run.measurements, Scene(run.truth, [], 0.1), NoiseModel())
    assert fault in str(error.value)


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        ("raise KeyError('x')", "fails in perturb: KeyError: 'x';"),
        ("return None", "returns from perturb NoneType"),
        ("return {'range_status': measurements.range_status * 0 + 99}", "the column 'range_s"),
        ("return {'depth': measurements.depth[:, :2]}", "depth with another shape than measure"),
        ("return {'depth': measurements.depth * 1j}", "depth with values of type complex128;"),
        (
            "return {'depth': measurements.depth + np.random.default_rng().normal()}",
            "other values of depth in a second call; all noise must come from `normal`;",
        ),
        ("measurements.depth[:] = 0.0", "fails in perturb: ValueError: assignment destination"),
    ],
)
def test_a_sensor_that_draws_wrongly_is_named(install, tiny_run_folder, body, fault):
    install(NOTHING + f"def perturb(measurements, normal):\n    {body}\n")
    m = open_run(tiny_run_folder).measurements
    (sensor,) = other_sensors(["bad"])
    with pytest.raises(ExtensionError, match=r"^package 'other': ") as error:
        sensor.perturbed(m, m, lambda shape, *_: np.zeros(shape))
    assert fault in str(error.value)

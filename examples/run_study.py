"""Run the quick preset from Python and print what refraction does to ranges and positions."""

import numpy as np

from pymantaray import load_study
from pymantaray.apps.study import run_study
from pymantaray.records import RayStatus


def main() -> None:
    """Run, then read a few numbers off the results."""
    run = run_study(load_study("quick"), workers=1)
    seen = run.measurements
    heard = seen.range_status == RayStatus.OK
    error = seen.refracted_range[heard] - seen.straight_range[heard]
    print(f"{run.path}: {heard.sum()} of {heard.size} ranges heard")
    print(f"range error {error.mean():+.2f} m on average, {error.std():.2f} m spread")
    for condition, position in zip(run.estimates.condition, run.estimates.position, strict=True):
        distance = np.linalg.norm(position - run.truth.position, axis=-1)
        print(f"{condition:<10} ATE {np.sqrt((distance**2).mean()):6.2f} m")


if __name__ == "__main__":
    main()

"""Noise of a run's measurements, which is drawn again from the same streams."""

from typing import NamedTuple

from pymantaray.arrays import Array
from pymantaray.records import Measurements, RangingTruth
from pymantaray.sensing import Candidates, RangingDraws, perturb
from pymantaray.sensing.other_packages import OtherNames
from pymantaray.sensing.timing import ClockModel, Timing


class NoiseSource(NamedTuple):
    """All that the measurements of a run's realizations are drawn from."""

    measurements: Measurements
    """Without noise."""
    ranging_truth: RangingTruth
    draws: RangingDraws | None
    """Ranges of every realization, if each has its own ice."""
    probability: Array | None
    """Detection probability of each range attempt; None if every arrival is detected."""
    candidates: Candidates | None
    """Arrivals that receivers may mistake for the direct one; None if they do not."""
    seed: int
    timing: Timing
    clocks: ClockModel | None
    pick_correlation_time: float
    """Correlation time of the choice of an arrival. [s]"""
    sensors: OtherNames
    """Sensors of other packages, and their noise levels."""

    def noisy(self, realization: int) -> Measurements:
        """Measurements of one realization."""
        measurements, probability = self.measurements, self.probability
        if self.draws is not None:
            measurements = self.draws.measurements(measurements, self.ranging_truth, realization)
            probability = self.draws.probability[realization]
        return perturb(
            measurements,
            root_seed=self.seed,
            realization=realization,
            timing=self.timing,
            clocks=self.clocks,
            ranging_truth=self.ranging_truth_in(realization),
            detection=probability if self.candidates is None else self.candidates,
            correlation_time=self.pick_correlation_time,
            sensors=self.sensors,
        )

    def ranging_truth_in(self, realization: int | None) -> RangingTruth:
        """True values of all range attempts in a realization; in the first for None."""
        if self.draws is None or realization is None:
            return self.ranging_truth
        return self.draws.ranging_truth(self.ranging_truth, realization)

"""Range models along straight lines on a spherical Earth."""

import numpy as np

from pymantaray.arrays import Array
from pymantaray.estimation.ranges.range_models import (
    ConstantSpeed,
    MeanSlowness,
    Prediction,
    RangeEndpoints,
    RangeModel,
    TransmitterSpeed,
)
from pymantaray.geometry.sphere import EarthSphere

ALONG_CHORDS = ConstantSpeed, TransmitterSpeed, MeanSlowness


class OnSphere(RangeModel):
    """
    Range model along straight lines, with the chord through the Earth instead of the distance in
    the flat frame.

    Gradients omit the derivative of the ratio of both distances, which is below 0.1 % of them up to
    10 km.
    """

    def __init__(self, model: RangeModel, earth: EarthSphere) -> None:
        self._model = model
        self._earth = earth
        self.needs_sound_speed = model.needs_sound_speed

    def predict(self, links: RangeEndpoints) -> Prediction:
        """
        Predict travel times, and their gradients, of the model times the ratio of the chord to the
        distance in the frame.
        """
        flat = self._model.predict(links)
        distance = np.linalg.norm(links.receiver - links.transmitter, axis=1)
        chord = self._earth.straight_distance(links.transmitter, links.receiver)
        ratio = np.divide(chord, distance, out=np.ones_like(chord), where=distance > 0.0)
        return flat.scaled(ratio)

    def frame_scale(self, links: RangeEndpoints) -> Array:
        """
        Factor from each measured range to the distance in the flat frame of the same travel time.

        It depends on depth and on the distance from the frame's centre, and changes by less than
        1e-6 if an end moves 1 km horizontally within 50 km of the centre, or 5 m vertically.
        """
        distance = np.linalg.norm(links.receiver - links.transmitter, axis=1)
        measured = links.sound_speed * self.predict(links).travel_time
        return np.asarray(
            np.divide(distance, measured, out=np.ones_like(distance), where=measured > 0.0)
        )

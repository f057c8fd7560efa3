"""Images of the receivers of reflected paths, behind the mirrors at which sound is reflected."""

from typing import NamedTuple, Self

import numpy as np

from pymantaray.arrays import Array, Indices, Mask
from pymantaray.estimation.ranges.range_models import Prediction, RangeEndpoints


class Images(NamedTuple):
    """
    Positions in which receivers appear to transmitters, from which the curvature of reflected
    travel times follows.

    The image lies in the direction in which sound leaves the transmitter, at the length of the
    path. If the receiver moves, its image moves in the same way, but up instead of down if the
    number of reflections is odd. That of a direct path is the receiver itself. All of this is exact
    for horizontal mirrors in uniform water.
    """

    position: Array  # (n, 3) [m]
    receiver: Array  # (n, 3) [m]
    mirror: Array  # signs of a displacement of the image, (n, 3)
    reflected: Mask

    @classmethod
    def of(cls, prediction: Prediction, links: RangeEndpoints, bounces: Indices) -> Self:
        """Images of the receivers of links, whose paths have some numbers of reflections."""
        reflected = prediction.possible & (bounces > 0)
        slowness = np.linalg.norm(prediction.transmitter_gradient, axis=1)
        reflected &= slowness > 0.0
        square = np.where(reflected, slowness, 1.0) ** 2
        path = -(prediction.travel_time / square)[:, None] * prediction.transmitter_gradient
        mirror = np.ones_like(links.receiver)
        mirror[reflected & (bounces % 2 == 1), 2] = -1.0
        position = np.where(reflected[:, None], links.transmitter + path, links.receiver)
        return cls(position, links.receiver, mirror, reflected)

    def at(self, receiver: Array) -> Array:
        """Positions of the images of moved receivers."""
        image = self.position + self.mirror * (receiver - self.receiver)
        return np.where(self.reflected[:, None], image, receiver)

"""Options of predictions; few imports, because the command line reads them."""

from dataclasses import dataclass
from typing import Literal, get_args

from pymantaray.errors import ReplayError
from pymantaray.quantities.checks import check_number

_MAX_DRAWS = 1000
Learning = Literal["causal", "smooth"]


@dataclass(frozen=True)
class PredictionOptions:
    """
    Draws of rough ice, and errors of predictions.

    Parameters
    ----------
    draws : int
        Number of draws of rough ice whose arrivals are merged.
    position_sigma : float
        Standard deviation of the position of each end along the path, for the error of predictions.
        [m]
    sound_speed_sigma : float
        Standard deviation of the mean sound speed along the path, for the error of predictions.
        [m/s]
    wind_speed : float
        Wind at 10 m over open water, whose waves spread the times of reflections at the surface,
        for the error of predictions. [m/s]
    water_interval : float
        Water that varies in time is evaluated at the multiple of this interval that is nearest to
        an event. [s]
    learn : {"causal", "smooth"}, optional
        Learn slow errors of water, positions and clocks from the events: from earlier events only,
        or from all others. By default nothing is learned.

    Examples
    --------
    >>> from pymantaray.apps.replay import PredictionOptions
    >>> PredictionOptions(draws=16, learn="causal").draws
    16
    """

    draws: int = 1
    position_sigma: float = 0.0
    sound_speed_sigma: float = 0.0
    wind_speed: float = 0.0
    water_interval: float = 600.0
    learn: Learning | None = None

    def __post_init__(self) -> None:
        """Check the numbers."""
        if self.draws not in range(1, _MAX_DRAWS + 1):
            raise ReplayError(
                f"draws is {self.draws}; allowed are whole numbers from 1 to {_MAX_DRAWS}"
            )
        if self.learn is not None and self.learn not in get_args(Learning):
            raise ReplayError(
                f"learn is {self.learn!r}; allowed are {' and '.join(get_args(Learning))}"
            )
        units = {"position_sigma": "m", "sound_speed_sigma": "m/s", "wind_speed": "m/s"}
        for name, unit in units.items():
            check_number(ReplayError, name, getattr(self, name), unit)
        check_number(ReplayError, "water_interval", self.water_interval, "s", positive=True)


DEFAULT_OPTIONS = PredictionOptions()
"""One draw, and no errors of position and sound speed."""

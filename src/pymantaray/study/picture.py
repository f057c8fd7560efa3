"""The one link that a study draws: the section of the water between two vehicles, and its rays."""

from collections.abc import Callable

import numpy as np
import xarray as xr

from pymantaray.acoustics import Medium, ray_picture
from pymantaray.acoustics.selection import select
from pymantaray.records import Arrivals, RayStatus, Trajectories
from pymantaray.sensing import Links

FAN = np.radians(np.linspace(-15.0, 15.0, 41))
"""Launch angles of the fan behind the eigenrays, about the chord: the paper's cone. [rad]"""


def picture_of_most_bent_link(
    medium: Medium | Callable[[float], Medium],
    truth: Trajectories,
    links: Links,
    arrivals: Arrivals,
    *,
    spreading_cutoff_db: float | None,
) -> xr.Dataset | None:
    """
    Ray picture of the link whose first direct arrival gains most on the straight chord.

    Parameters
    ----------
    medium : Medium or callable
        A function of time [s] where the water varies; it is drawn as it is at the link's ping.
    truth : Trajectories
    links : Links
        Between vehicles or from a vehicle to a landmark; landmarks are not drawn.
    arrivals : Arrivals
        Of these links.
    spreading_cutoff_db : float or None
        As the study's.

    Returns
    -------
    xarray.Dataset or None
        See `pymantaray.acoustics.ray_picture`; attributes ``source`` and ``receiver`` are the vehicles'
        names, ``time_h`` is the ping's time. None if no link between vehicles has a direct arrival.
    """
    first = select(arrivals, "direct")
    gain = first.chord_travel_time - first.travel_time
    n_agents = truth.name.size
    drawn = (first.status == RayStatus.OK) & (links.first < n_agents) & (links.second < n_agents)
    if not np.any(drawn & (first.travel_time > 0.0)):
        return None
    row = int(np.nanargmax(np.where(drawn & (first.travel_time > 0.0), gain, np.nan)))
    sample, a, b = int(links.sample[row]), int(links.first[row]), int(links.second[row])
    source, receiver = truth.position[a, sample], truth.position[b, sample]
    step = receiver - source
    slope = float(np.arctan2(step[2], np.hypot(step[0], step[1])))
    water = medium(float(truth.time[sample])) if callable(medium) else medium
    picture = ray_picture(
        water, source, receiver, fan_angles=slope + FAN, spreading_cutoff_db=spreading_cutoff_db
    )
    return picture.assign_attrs(
        source=str(truth.name[a]), receiver=str(truth.name[b]), time_h=float(truth.time[sample]) / 3600.0
    )

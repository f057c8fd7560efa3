"""One door to all oceans: files or the name of a synthetic region."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from pymantaray.errors import OceanError
from pymantaray.ocean.hycom import open_hycom
from pymantaray.ocean.synthetic import EPOCH, synthetic_ocean

_SYNTHETIC = "synthetic:"


def open_ocean(
    source: str | Path | Sequence[str | Path], *, time: str | np.datetime64 | None = None
) -> xr.Dataset:
    """
    Open an ocean and check it.

    Parameters
    ----------
    source : str, Path or sequence of them
        A NetCDF file with HYCOM's variables, several that belong together, or ``"synthetic:beaufort"``
        or ``"synthetic:fram"``.
    time : str or numpy.datetime64, optional
        Instant (UTC). For files by default their only time; for synthetic oceans 15 July 2014, 12 h.

    Returns
    -------
    xarray.Dataset
        Valid in the sense of `pymantaray.ocean.schema.validate_ocean`; ``attrs["synthetic"]`` says
        whether it is made up.

    Raises
    ------
    OceanError
        If the source cannot be opened or is not a valid ocean.

    Examples
    --------
    >>> ocean = open_ocean("synthetic:fram")
    >>> dict(ocean.sizes)
    {'depth': 40, 'lat': 75, 'lon': 237}
    """
    sources = [source] if isinstance(source, str | Path) else list(source)
    made_up = [str(s) for s in sources if str(s).startswith(_SYNTHETIC)]
    if not made_up:
        return open_hycom(sources, time)
    if len(sources) > 1:
        raise OceanError(f"ocean: {made_up[0]} cannot be combined with other sources; give it alone")
    return synthetic_ocean(made_up[0].removeprefix(_SYNTHETIC), EPOCH if time is None else time)

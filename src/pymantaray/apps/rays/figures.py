"""Figure of the rays of links in sections of the sound speed."""

from collections.abc import Sequence
from pathlib import Path

import xarray as xr

from pymantaray.errors import ReportError
from pymantaray.plotting.style import COLUMN, DOUBLE, rendered
from pymantaray.plotting.water import rays_of_links
from pymantaray.records import whole_file


def write_ray_plot(
    pictures: Sequence[xr.Dataset],
    out: str | Path,
    *,
    titles: Sequence[str],
    header: str = "",
    one_column: bool = False,
) -> Path:
    """
    Draw the rays of links in panels below each other, with a common scale of sound speed.

    Parameters
    ----------
    pictures : sequence of xarray.Dataset
        Sections from `pymantaray.acoustics.ray_picture`, one per link.
    out : str or pathlib.Path
        File with the suffix ``.png`` or ``.pdf``; an existing file is replaced.
    titles : sequence of str
        Titles of the panels; the function adds the time of the first arrival, or the reason for its
        absence.
    header : str
        Small line on top that describes the water.
    one_column : bool
        True for the layout for one column of a journal, 84 mm wide.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    ReportError
        If the file has another suffix.
    WriteError
        If the file cannot be written.

    Examples
    --------
    >>> from pymantaray import Medium
    >>> from pymantaray.acoustics import ray_picture
    >>> from pymantaray.apps.rays import write_ray_plot
    >>> medium = Medium.from_profile([0, 100, 1000], [1450.0, 1460.0, 1475.0], bottom_depth=1000.0)
    >>> picture = ray_picture(medium, [0, 0, 50], [3000, 0, 400])
    >>> write_ray_plot([picture], "rays.png", titles=["A to B"]).name
    'rays.png'
    """
    out = Path(out)
    kind = out.suffix.removeprefix(".")
    if kind not in ("png", "pdf"):
        raise ReportError(f"{out.name}: a figure must have the suffix .png or .pdf")
    width = COLUMN if one_column else DOUBLE
    content = rendered(rays_of_links(pictures, titles, header, width=width), (kind,))[kind]
    with whole_file(out) as temporary:
        temporary.write_bytes(content)
    return out

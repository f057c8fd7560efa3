"""Rays of links over the sound speed that they run through, as a figure of their own."""

from collections.abc import Sequence
from pathlib import Path

import xarray as xr

from pymantaray.errors import ReportError
from pymantaray.records import whole_file
from pymantaray.report.figures_ocean import rays_of_links
from pymantaray.report.style import rendered


def write_ray_plot(
    pictures: Sequence[xr.Dataset], out: str | Path, *, titles: Sequence[str], header: str = ""
) -> Path:
    """
    Draw rays of links below each other, over one scale of sound speed.

    Parameters
    ----------
    pictures : sequence of xarray.Dataset
        From `pymantaray.acoustics.ray_picture`, one a link.
    out : str or pathlib.Path
        PNG or PDF by its ending; replaced if it is there.
    titles : sequence of str
        What is written above each; when its first ray arrives, or why none does, is added.
    header : str
        Small line on top, which says what water it is.

    Returns
    -------
    pathlib.Path

    Raises
    ------
    ReportError
        If the ending is another.
    WriteError
        If it cannot be written.
    """
    out = Path(out)
    kind = out.suffix.removeprefix(".")
    if kind not in ("png", "pdf"):
        raise ReportError(f"{out.name}: a figure ends in .png or .pdf")
    content = rendered(rays_of_links(pictures, titles, header), (kind,))[kind]
    with whole_file(out) as temporary:
        temporary.write_bytes(content)
    return out

"""Commands of `mantaray ocean` that make oceans: from a cast, corrected by casts, perturbed."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pymantaray.cli.output import check_output
from pymantaray.errors import OceanError

if TYPE_CHECKING:
    import xarray as xr

_M_PER_KM = 1e3
_S_PER_DAY = 86_400.0
_DONE = ("cast ", "corrected by ", "sound speed perturbed ", "replaced by ")  # of a history's lines


class Below(StrEnum):
    """What lies below the deepest sample of a cast."""

    refuse = "refuse"
    constant = "constant"


class Equation(StrEnum):
    """Equation of sound speed."""

    teos_10 = "teos-10"
    del_grosso = "del-grosso"
    unesco = "unesco"


class Perturbation(StrEnum):
    """How an ocean is changed."""

    eof = "eof"
    gaussian_process = "gaussian-process"
    mean = "mean"
    column = "column"


Cast = Annotated[Path, typer.Argument(metavar="CAST", help="CSV table or Argo NetCDF file.")]
Casts = Annotated[list[Path], typer.Argument(metavar="CASTS...", help="CSV tables or Argo NetCDF files.")]
Ocean = Annotated[
    str, typer.Argument(metavar="OCEAN", help="NetCDF file, or synthetic:beaufort, synthetic:fram.")
]
Out = Annotated[Path, typer.Argument(metavar="OUT.nc", help="The ocean to write.")]
Lat = Annotated[
    float | None, typer.Option("--lat", help="The cast's latitude, if its file has none, in degrees.")
]
Lon = Annotated[
    float | None, typer.Option("--lon", help="The cast's longitude, if its file has none, in degrees.")
]
Time = Annotated[str | None, typer.Option("--time", help="Instant (UTC), as 2014-07-24T19:20.")]
Name = Annotated[str | None, typer.Option("--name", help="The cast to take, if the file holds several.")]
Formula = Annotated[Equation, typer.Option("--equation", help="Equation of sound speed.")]
Overwrite = Annotated[bool, typer.Option("--force", help="Replace OUT.nc if it exists.")]


def register(app: typer.Typer) -> None:
    """
    Add the commands to an application.

    Parameters
    ----------
    app : typer.Typer
    """
    app.command("from-cast")(from_cast)
    app.command("correct")(correct)
    app.command("perturb")(perturb)


def from_cast(
    cast: Cast,
    out: Out,
    bottom: Annotated[
        float | None,
        typer.Option("--bottom", help="Depth of the sea bed, in m. Default: what the file tells."),
    ] = None,
    half_extent: Annotated[
        tuple[float, float], typer.Option("--half-extent", help="Half sides north and east, in km.")
    ] = (60.0, 60.0),
    below: Annotated[
        Below, typer.Option("--below", help="Below the deepest sample: an error, or its water.")
    ] = Below.refuse,
    below_cast: Annotated[
        Path | None, typer.Option("--below-cast", help="A deeper cast for below the deepest sample.")
    ] = None,
    lat: Lat = None,
    lon: Lon = None,
    time: Time = None,
    name: Name = None,
    equation: Formula = Equation.teos_10,
    force: Overwrite = False,
) -> None:
    """Make a horizontally uniform ocean at rest from one cast."""
    check_output(out, [".nc"], inputs=[cast], force=force)
    from pymantaray.ocean.cast_ocean import cast_ocean
    from pymantaray.ocean.casts import read_cast

    if below_cast is not None and below is not Below.refuse:
        raise OceanError("--below and --below-cast exclude each other; give one")
    taken = read_cast(cast, lat=lat, lon=lon, time=time, name=name)
    ocean = cast_ocean(
        taken,
        bottom_depth=bottom,
        half_extent=(half_extent[0] * _M_PER_KM, half_extent[1] * _M_PER_KM),
        below=below.value if below_cast is None else read_cast(below_cast),
        equation=equation.value,
    )
    _write(ocean, out)


def correct(
    ocean: Ocean,
    casts: Casts,
    out: Out,
    scale: Annotated[
        float, typer.Option("--scale", help="Horizontal scale of the background's error, in km.")
    ] = 50.0,
    noise_ratio: Annotated[
        float, typer.Option("--noise-ratio", help="Variance of the casts' errors over the background's.")
    ] = 0.1,
    vertical_scale: Annotated[
        float, typer.Option("--vertical-scale", help="Decay below the deepest sample, in m.")
    ] = 100.0,
    time_scale: Annotated[
        float | None,
        typer.Option("--time-scale", help="Scale in time, in days. Default: casts count in full."),
    ] = None,
    time: Time = None,
    force: Overwrite = False,
) -> None:
    """Correct a gridded ocean by casts (optimal interpolation)."""
    check_output(out, [".nc"], inputs=[Path(ocean), *casts], force=force)
    from pymantaray.ocean import open_ocean
    from pymantaray.ocean.casts import read_casts
    from pymantaray.ocean.objective_analysis import correct_with_casts

    made = correct_with_casts(
        open_ocean(ocean, time=time),
        read_casts(casts),
        horizontal_scale=scale * _M_PER_KM,
        noise_ratio=noise_ratio,
        vertical_scale=vertical_scale,
        time_scale=None if time_scale is None else time_scale * _S_PER_DAY,
    )
    _write(made, out)


def perturb(
    ocean: Ocean,
    out: Out,
    method: Annotated[Perturbation, typer.Option("--method", help="How it is changed.")] = Perturbation.eof,
    rms: Annotated[float | None, typer.Option("--rms", help="Of sound speed, in m/s.")] = None,
    scale: Annotated[
        float | None,
        typer.Option("--scale", help="Horizontal scale of the error, in km; inf for one everywhere."),
    ] = None,
    vertical_scale: Annotated[
        float | None, typer.Option("--vertical-scale", help="Vertical scale, for gaussian-process, in m.")
    ] = None,
    down_to: Annotated[
        float | None,
        typer.Option("--down-to", help="Depth down to which rms is meant, in m. Default: the sea bed."),
    ] = None,
    mode_casts: Annotated[
        list[Path] | None, typer.Option("--mode-cast", help="For eof: casts whose modes are taken.")
    ] = None,
    place: Annotated[
        tuple[float, float] | None, typer.Option("--place", help="For column: latitude and longitude.")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="One member for each seed.")] = 0,
    time: Time = None,
    equation: Formula = Equation.teos_10,
    force: Overwrite = False,
) -> None:
    """Make an ocean that is believed instead of the true one."""
    check_output(out, [".nc"], inputs=[Path(ocean), *(mode_casts or [])], force=force)
    from pymantaray.geometry.streams import stream
    from pymantaray.ocean import open_ocean
    from pymantaray.ocean.casts import read_casts
    from pymantaray.ocean.modes import vertical_modes
    from pymantaray.ocean.perturb import perturb_ocean
    from pymantaray.ocean.schema import with_history

    random = method in (Perturbation.eof, Perturbation.gaussian_process)
    made = perturb_ocean(
        open_ocean(ocean, time=time),
        method.value,
        rms=rms,
        horizontal_scale=None if scale is None else scale * _M_PER_KM,
        vertical_scale=vertical_scale,
        down_to=down_to,
        modes=vertical_modes(read_casts(mode_casts), equation=equation.value) if mode_casts else None,
        place=place,
        rng=stream(seed, 0, "ocean", "perturb") if random else None,
        equation=equation.value,
    )
    _write(with_history(made, f"seed {seed}") if random else made, out)


def _write(ocean: "xr.Dataset", out: Path) -> None:
    """Whole or not at all, and one line for people on what was done last."""
    import numpy as np

    from pymantaray.records import write_netcdf

    write_netcdf(ocean, out)
    size = " x ".join(str(ocean.sizes[name]) for name in ("depth", "lat", "lon"))
    bottom = float(
        np.asarray(ocean["depth"].values)[np.isfinite(ocean["water_temp"].values).any(axis=(1, 2))][-1]
    )
    done = [line for line in str(ocean.attrs["history"]).splitlines() if line.startswith(_DONE)]
    typer.echo(
        f"{out}: {size} levels, latitudes, longitudes to {bottom:g} m" + (f"; {done[-1]}" if done else "")
    )

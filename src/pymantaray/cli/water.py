"""Water for commands from their options: files, a profile or cast, a configuration or a run."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from pymantaray.cli.options import AnySourceOptions, ArrivalOptions, WaterOptions
from pymantaray.errors import WaterError

if TYPE_CHECKING:
    from pymantaray.acoustics.medium import Interpolation
    from pymantaray.sensing.water import Water


OF_THE_SOURCE = {
    "bathymetry": "--bathymetry",
    "thin": "--thin",
    "smooth": "--smooth",
    "names": "--name",
    "half_extent": "--half-extent",
    "ice_slope_deg": "--ice-slope",
    "ice_length": "--ice-length",
    **{name: f"--{name}" for name in ("ice", "equation", "centre", "time")},
}
"""Options of water that a run's ocean defines already, with their names on the command line."""


def load_water(
    source: AnySourceOptions,
    options: WaterOptions,
    search: ArrivalOptions | None = None,
    *,
    default: "Interpolation | None" = None,
) -> "Water":
    """Open the water of a source with one cast at most; otherwise as `load_waters`."""
    from pymantaray.acoustics.profiles import only_one

    waters = load_waters(source, options, search, default=default)
    return only_one(source.words[0] if source.words else source.run, waters, WaterError)


def load_waters(
    source: AnySourceOptions,
    options: WaterOptions,
    search: ArrivalOptions | None = None,
    *,
    default: "Interpolation | None" = None,
    sections: dict[str, Any] | None = None,
    changes: dict[str, Any] | None = None,
) -> "list[Water]":
    """
    Open one water per cast of a source; the record of each contains the source.

    Without an option, the interpolation is ``default``, or that of a run or configuration, or
    smooth. Options override ``sections``, which are keys of a file. ``changes`` are values by
    dotted key, which override both.
    """
    from pymantaray.config.door.water import open_waters

    arrivals = {} if search is None else search.keys
    keys = (sections or {}) | options.keys | arrivals | (changes or {})
    if source.run is not None:
        return [_of_run(source.run, keys, default)]
    if options.interpolation is None and default is not None:
        keys["interpolation"] = default
    return open_waters(source.words, **keys)


def _of_run(folder: Path, keys: dict[str, Any], default: "Interpolation | None") -> "Water":
    """Open the water of a finished study at its start."""
    from dataclasses import replace

    fixed = [key for key in keys if key in OF_THE_SOURCE]
    if fixed:
        raise WaterError(
            f"{OF_THE_SOURCE[fixed[0]]} does not apply to --run; remove it, or use --ocean or"
            " --profile"
        )
    from pymantaray.config import load_study
    from pymantaray.config.door.ocean import build_mission_ocean
    from pymantaray.config.door.water import open_local
    from pymantaray.jobs.run_folder import CONFIG, OCEAN, checked_file, checked_manifest
    from pymantaray.records import read_netcdf

    manifest = checked_manifest(folder)
    place = folder.resolve()
    config = load_study(checked_file(place, manifest, CONFIG))
    keys.setdefault("interpolation", default or config.acoustics.interpolation)
    geographic = build_mission_ocean(config).geographic_start() if keys.get("detection") else None
    ocean = read_netcdf(checked_file(place, manifest, OCEAN))
    water = open_local(ocean, geographic=geographic, **keys)
    return replace(water, record={"run": str(folder), **water.record})


def search_record(water: "Water") -> dict[str, Any]:
    """Search options of eigenrays in a water, for files."""
    reception = water.reception
    return {
        "max_surface_bounces": reception.max_surface_bounces,
        "max_bottom_bounces": reception.max_bottom_bounces,
        "cutoff_db": "none"
        if reception.spreading_cutoff_db is None
        else reception.spreading_cutoff_db,
    }


def water_notes(water: "Water") -> list[str]:
    """Notes about a water for the user: its domain if it has sides, and doubts."""
    if water.uniform or water.local is None or water.frame is None:
        return list(water.notes)
    import numpy as np

    from pymantaray.ocean.schema import latitude, longitude

    medium, _ = water.at_start
    named = " ".join(water.record.get("ocean") or [water.record.get("run", "")])
    low = f"{medium.bed.depth.min():.0f}"
    high = f"{medium.bed.depth.max():.0f}"
    depths = low if low == high else f"{low} to {high}"
    domain = (
        f"{named}: {np.ptp(medium.north) / 1e3:.4g} km (north) by {np.ptp(medium.east) / 1e3:.4g}"
        f" km (east) around {latitude(water.frame.latitude_deg)},"
        f" {longitude(water.frame.longitude_deg)}; sea bed at {depths} m"
    )
    return [domain, *water.notes]

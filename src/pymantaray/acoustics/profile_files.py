"""Writers of profiles for other programs: Kongsberg's ``.asvp``, and CF data sets of profiles."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pymantaray.acoustics.profiles import Profile
from pymantaray.errors import AcousticsError
from pymantaray.records import whole_file, write_netcdf

_DEEPEST = 12_000.0  # m; to where Kongsberg's systems want a profile extended
_MAX_LEVELS = 1000  # of EM 122 and later, by the description of the format in SIS


def write_asvp(path: str | Path, profile: Profile) -> None:
    r"""
    Write a profile of sound speed as Kongsberg's ``.asvp``, which SIS and Sound Speed Manager read.

    Depths have a resolution of 1 cm, and sound speeds of 1 cm/s. The format ends at 12,000 m, where
    the last sound speed is repeated.

    Parameters
    ----------
    path : str or pathlib.Path
        New or existing file, which is replaced; its folder must exist.
    profile : Profile
        Profile with position (`Profile.place`) and time (`Profile.time`), which the format
        requires.

    Raises
    ------
    AcousticsError
        If the position or the time is unknown, two levels differ by less than 1 cm, or there are
        more than 1000 levels.

    Examples
    --------
    >>> from pathlib import Path
    >>> import numpy as np
    >>> from pymantaray.acoustics import read_profile, write_asvp
    >>> _ = Path("cast.csv").write_text("depth,sound_speed\n0,1450\n100,1460\n1000,1475\n")
    >>> profile = read_profile("cast.csv", place=(74.5, -140.0))
    >>> write_asvp("cast.asvp", profile._replace(time=np.datetime64("2026-03-10T12:00", "ns")))
    >>> print(read_profile("cast.asvp").sound_speed)
    [1450. 1460. 1475. 1475.]
    """
    lat, lon = _profile_position(path, profile)
    if np.isnat(profile.time):
        raise AcousticsError(f"{path}: the time of {profile.name} is unknown; the format needs one")
    depth = np.round(profile.depth, 2)
    speed = np.round(profile.sound_speed, 2)
    if np.any(np.diff(depth) <= 0.0):
        raise AcousticsError(
            f"{path}: {profile.name} has levels that differ by less than 1 cm; thin it first"
        )
    if depth[0] > 0.0:
        depth = np.append(0.0, depth)
        speed = np.append(speed[0], speed)
    if depth[-1] < _DEEPEST:
        depth = np.append(depth, _DEEPEST)
        speed = np.append(speed, speed[-1])
    if depth.size > _MAX_LEVELS:
        raise AcousticsError(
            f"{path}: {depth.size} levels; echo sounders accept at most {_MAX_LEVELS}; thin it"
            " first with `thin_profile`"
        )
    stamp = profile.time.astype("datetime64[s]").item()
    head = (
        f"( SoundVelocity  1.0 0 {stamp:%Y%m%d%H%M} {lat:.8f} {lon:.8f} -1 0 0 MantaRay P"
        f" {depth.size:04d} )"
    )
    with whole_file(path) as file:
        lines = (f"{z:.2f} {c:.2f}" for z, c in zip(depth.tolist(), speed.tolist(), strict=True))
        file.write_text("\n".join([head, *lines, ""]), encoding="ascii")


def write_profiles(path: str | Path, profiles: Sequence[Profile]) -> None:
    r"""
    Write profiles as a CF data set (incomplete multidimensional arrays) that `read_profiles` and
    `read_casts` can read.

    Parameters
    ----------
    path : str or pathlib.Path
        New or existing NetCDF file, which is replaced; its folder must exist.
    profiles : sequence of Profile
        One or more profiles. The file contains temperature and salinity if all profiles do.

    Raises
    ------
    AcousticsError
        If there is no profile, or the position of one is unknown.

    Examples
    --------
    >>> from pathlib import Path
    >>> from pymantaray.acoustics import read_profile, read_profiles, write_profiles
    >>> _ = Path("cast.csv").write_text("depth,sound_speed\n0,1450\n100,1460\n1000,1475\n")
    >>> write_profiles("casts.nc", [read_profile("cast.csv", place=(74.5, -140.0))])
    >>> [profile.name for profile in read_profiles("casts.nc")]
    ['cast']
    """
    import xarray as xr

    if not profiles:
        raise AcousticsError(f"{path}: no profile to write")
    levels = max(p.depth.size for p in profiles)
    columns = {
        "depth": ([p.depth for p in profiles], "depth", "m"),
        "sound_speed": ([p.sound_speed for p in profiles], "speed_of_sound_in_sea_water", "m s-1"),
    }
    water = [p.water for p in profiles if p.water is not None]
    if len(water) == len(profiles):
        columns["temperature"] = ([w[0] for w in water], "sea_water_temperature", "degC")
        columns["salinity"] = ([w[1] for w in water], "sea_water_practical_salinity", "1")
    data = xr.Dataset(
        {"profile": ("profile", [p.name for p in profiles], {"cf_role": "profile_id"})},
        attrs={"featureType": "profile", "title": f"{len(profiles)} profiles"},
    )
    for name, (values, standard, unit) in columns.items():
        padded = np.full((len(profiles), levels), np.nan)
        for k, column in enumerate(values):
            padded[k, : column.size] = column
        data[name] = ("profile", "z"), padded, {"standard_name": standard, "units": unit}
    data["depth"].attrs |= {"positive": "down", "axis": "Z"}
    places = np.array([_profile_position(path, p) for p in profiles])
    for k, (name, unit) in enumerate(
        {"latitude": "degrees_north", "longitude": "degrees_east"}.items()
    ):
        data[name] = "profile", places[:, k], {"standard_name": name, "units": unit}
    since = np.datetime64("1970-01-01", "ns")
    seconds = [
        np.nan if np.isnat(p.time) else (p.time - since) / np.timedelta64(1, "s") for p in profiles
    ]
    attrs = {"standard_name": "time", "units": "seconds since 1970-01-01", "calendar": "standard"}
    data["time"] = "profile", np.array(seconds, dtype=float), attrs
    write_netcdf(data.set_coords(["time", "latitude", "longitude", "depth"]), Path(path))


def _profile_position(path: str | Path, profile: Profile) -> tuple[float, float]:
    if profile.place is None:
        reason = next((f" ({note})" for note in profile.notes if note.startswith("position ")), "")
        raise AcousticsError(
            f"{path}: the position of {profile.name} is unknown{reason}; give latitude and"
            " longitude"
        )
    return profile.place

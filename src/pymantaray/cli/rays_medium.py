"""The medium that the options of `mantaray rays` ask for, and a record of how it was made."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from pymantaray.cli.options import MediumOptions
from pymantaray.errors import AcousticsError

if TYPE_CHECKING:
    from pymantaray.acoustics import Medium
    from pymantaray.acoustics.medium import Interpolation
    from pymantaray.acoustics.profiles import Profile
    from pymantaray.geometry import LocalFrame

_GAP = 100.0  # m; a profile that ends higher above the sea bed is worth a note
_ONLY = {
    "profile": ("bottom", "thin", "smooth", "position"),
    "ocean": ("centre", "half_extent", "time"),
    "run": (),
}


class LoadedMedium(NamedTuple):
    """A medium, how it was made for the files, and what of that to tell the user."""

    medium: "Medium"
    record: dict[str, Any]
    notes: list[str]
    attrs: dict[str, Any]
    """Title, time and whether it is synthetic, as an ocean has them."""

    @property
    def frame(self) -> "LocalFrame | None":
        """Frame of the medium; None of a profile, which has no place."""
        from pymantaray.geometry import LocalFrame

        return LocalFrame(*self.record["centre_deg"]) if "centre_deg" in self.record else None


def load_medium(options: MediumOptions, *, default: "Interpolation | None" = None) -> LoadedMedium:
    """
    Medium from the one source that is given.

    The interpolation, if none is asked for, is ``default``, or else a run's own, or else smooth.
    """
    kind = source_kind(options)
    interpolation = options.interpolation or default
    if options.profile:
        if len(options.profile) > 1:
            raise AcousticsError(f"--profile: {len(options.profile)} files; one is needed")
        from pymantaray.acoustics import read_profile

        profile = read_profile(options.profile[0], options.position)
        return from_profile(options.profile[0], profile, options, interpolation or "smooth")
    from pymantaray.acoustics import Medium

    if options.run is not None:
        from pymantaray.study import open_run

        run = open_run(options.run)
        interpolation = interpolation or run.config.acoustics.interpolation
        local, named = run.ocean, str(options.run)
    else:
        from pymantaray.ocean import open_ocean, to_local, with_ice

        local = to_local(
            open_ocean(options.ocean or [], time=options.time),
            centre=options.centre,
            half_extent=options.half_extent,
        )
        if options.ice is not None:
            local = with_ice(local, options.ice_cover)
        named = " ".join(options.ocean or [])
    medium = Medium.from_dataset(local, interpolation=interpolation or "smooth")
    centre = [float(local.attrs[f"centre_{name}_deg"]) for name in ("latitude", "longitude")]
    reach = [float(medium.north[-1]), float(medium.east[-1])]
    record: dict[str, Any] = {
        kind: named,
        "centre_deg": centre,
        "half_extent_m": reach,
        "interpolation": medium.interpolation,
    }
    if options.ice is not None:
        record["ice"] = options.ice_cover
    note = (
        f"{named}: north +-{reach[0]:.0f} m, east +-{reach[1]:.0f} m about {centre[0]:g} N {centre[1]:g} E,"
        f" sea bed {medium.bathymetry.min():.0f} to {medium.bathymetry.max():.0f} m"
    )
    return LoadedMedium(medium, record, [note], {str(key): value for key, value in local.attrs.items()})


def source_kind(options: MediumOptions) -> str:
    """Which of profile, ocean and run is given; none, several, or options that go with another are refused."""
    kinds = [kind for kind in _ONLY if getattr(options, kind)]
    if len(kinds) != 1:
        named = " and ".join(f"--{kind}" for kind in sorted(kinds)) or "no ocean"
        raise AcousticsError(f"{named} given; exactly one of --ocean, --profile and --run is needed")
    if options.ice is not None and kinds == ["run"]:
        raise AcousticsError("--ice: goes with --ocean and --profile; a run has its own")
    for kind, names in _ONLY.items():
        for name in names:
            if kind != kinds[0] and getattr(options, name) is not None:
                raise AcousticsError(f"--{name.replace('_', '-')}: goes with --{kind}, not with --{kinds[0]}")
    return kinds[0]


def from_profile(
    path: Path, profile: "Profile", options: MediumOptions, interpolation: "Interpolation"
) -> LoadedMedium:
    """Medium of a profile of a file, thinned or smoothed as the options say."""
    from pymantaray.acoustics import Medium, smooth_profile, thin_profile
    from pymantaray.acoustics.profiles import is_raw_cast

    bottom = options.bottom
    if bottom is None:
        raise AcousticsError("--profile and --bottom: the one needs the other")
    if not 0.0 < bottom < float("inf"):
        raise AcousticsError(f"--bottom {bottom:g}: a positive depth in metres is needed")
    ice = options.ice_cover
    if isinstance(ice, str):
        raise AcousticsError(f"--ice {ice}: over a profile it is a draft in metres; a file goes with --ocean")
    if options.thin is not None and options.smooth is not None:
        raise AcousticsError("--thin and --smooth exclude each other; give one")
    depth, speed = profile.depth, profile.sound_speed
    first, last = float(depth[0]), float(depth[-1])
    record: dict[str, Any] = {"profile": str(path), "raw_levels": depth.size}
    if profile.position is not None:
        record |= {"position_deg": list(profile.position), "computed": "TEOS-10"}
    if interpolation == "smooth" and is_raw_cast(depth) and options.thin is options.smooth is None:
        raise AcousticsError(
            f"{path}: {depth.size} levels less than 2 m apart are a raw cast; thin it, as by --thin 0.1 (m/s),"
            " smooth it, as by --smooth 10 (m), or take --interpolation linear"
        )
    notes = [f"{path}: {note}" for note in profile.notes]
    try:
        reduced = None
        if options.thin is not None:
            reduced = thin_profile(depth, speed, tolerance=options.thin, interpolation=interpolation)
        elif options.smooth is not None:
            reduced = smooth_profile(depth, speed, length=options.smooth, interpolation=interpolation)
        if reduced is not None:
            depth, speed = reduced.depth, reduced.sound_speed
            record[reduced.method] = {
                "tolerance_m_s" if reduced.method == "thinned" else "length_m": reduced.parameter,
                "rms_change_m_s": reduced.rms_change,
                "greatest_change_m_s": reduced.greatest_change,
            }
            notes.append(f"{path}: {reduced}")
        medium = Medium.from_profile(
            depth, speed, bottom_depth=bottom, interpolation=interpolation, ice_draft=ice
        )
    except AcousticsError as error:
        raise AcousticsError(f"{path}: {error}") from None
    if first > 0.0:
        notes.append(f"{path}: starts at {first:g} m; the sound speed there is taken up to the surface")
    if bottom > last + _GAP:
        notes.append(
            f"{path}: ends at {last:g} m, above the sea bed at {bottom:g} m; sound speed is continued from there"
            " to a constant within some 400 m, so add levels if rays go that deep"
        )
    record |= {"levels": int(depth.size), "bottom_depth_m": bottom, "interpolation": interpolation}
    record |= {"last_level_m": last} | ({"ice": ice} if ice else {})
    return LoadedMedium(medium, record, notes, {"title": path.name})

"""The water of a run: its sound-speed profile, and rays through one section."""

from pymantaray.apps.study.figures.register import RunResults, both_widths, register
from pymantaray.jobs.run_folder import RAY_PICTURE
from pymantaray.plotting.water import ray_picture, sound_speed_profiles


def _caption_of_rays(results: RunResults) -> str:
    ice = results.run.ray_picture.get("sea_ice_draft")
    cover = " ice (blank)," if ice is not None and ice.any() else ""
    return (
        f"Sound on the link with the most curved ray: sound speed (blue),{cover} sea bed (brown, if"
        " it is not far below), direct eigenrays (orange), the straight chord (dashed) and other"
        " rays from the same source (grey)."
    )


register(
    "sound_speed",
    place=100,
    paper="Figure 4",
    of_mission=True,
    caption="Sound speed against depth over the study's domain: mean of each level (line), minimum"
    " to maximum (shaded); (a) all depths, (b) the upper part.",
    draw=lambda r: sound_speed_profiles([(r.region, r.run.profile)], r.header),
    column=lambda r: sound_speed_profiles([(r.region, r.run.profile)], r.header),
)
register(
    "ray_picture",
    place=110,
    paper="Figures 1 and 2A",
    of_mission=True,
    caption=_caption_of_rays,
    **both_widths(lambda r, width: ray_picture(r.run.ray_picture, r.header, width=width)),
    needs=lambda r: r.run.has_file(RAY_PICTURE),
)

"""
Count the rays that the two-point solver loses at ranges to 30 km, and time it.

Run with ``python benchmarks/bench_lost_rays.py [MEDIUM ...]``. The media are ``0`` to ``9``,
synthetic water with several extrema of the sound speed that vary horizontally, and ``gulf``, the
Gulf Stream file in ../shared/data beside the repository. Rays within 14.5 dB are counted in one of
three ways, whose tables list links by range:

- By default, ``--links`` random links per medium are solved from one end, from the other
  (``canonical=False``), and as by default. A
  search loses a ray that another one finds. This needs no oracle, and counts no ray that all
  searches lose. ``--bounces 1 --depth 0.01`` counts rays with a reflection at the surface, from a
  depth of 1 cm.
- ``--write LINKS.npz`` writes these links for `fans_on_gpu.py` and ends. ``--rays LINKS.npz
  RAYS.npz`` compares the solver with the result:
  fans of 131,072 rays in three dimensions, one from each end of each link. A ray counts as lost if
  a finer fan (`tests/section_fan.py`, which shares no code with the solver) finds it as well.
- ``--fans N`` needs no GPU: N fans of 131,072 rays per medium go to 480 receivers each, in the
  vertical section from one end. The rest
  is as above.
"""

import argparse
import sys
import time
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from lost_rays import (
    GULF_STREAM,
    SECTION,
    SPACE,
    Links,
    Lost,
    found_rays,
    gulf_stream,
    is_strong,
    lost_after_a_second_look,
    lost_rays,
    missing,
    random_fans,
    random_links,
    rays_of,
    several_extrema,
)
from section_fan import Rays, SectionFan

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.records import Arrivals

MEDIA = (*(str(k) for k in range(10)), "gulf")
EDGES = np.array([1e3, 6e3, 12e3, 18e3, 25e3, 30e3 + 1.0])  # m


class Count(NamedTuple):
    """
    Links of a medium: distance [m], whether a ray exists, whether the search is complete, lost
    rays, and CPU time [s].
    """

    distance: NDArray[np.float64]
    has_ray: NDArray[np.bool_]
    complete: NDArray[np.bool_]
    lost: list[Lost]
    seconds: float


def solved(
    medium: Medium, links: Links, bounces: int = 0, *, canonical: bool = True
) -> tuple[Arrivals, float]:
    """Arrivals of links, and the CPU time of one thread."""
    find_eigenrays(medium, links.source[:1], links.receiver[:1], bounces)  # compiles
    start = time.process_time()
    arrivals = find_eigenrays(medium, *links, bounces, canonical=canonical, threads=1)
    return arrivals, time.process_time() - start


def count(
    links: Links, rays: list[Rays], solution: tuple[Arrivals, float], lost: list[Lost]
) -> Count:
    """Count of one search; rays are those of all searches and fans."""
    has_ray = np.zeros(len(links.source), dtype=bool)
    for part in rays:
        has_ray[part.link[is_strong(part)]] = True
    arrivals, seconds = solution
    return Count(links.distance, has_ray, arrivals.complete, lost, seconds)


def both_ends(medium: Medium, links: Links, bounces: int) -> dict[str, Count]:
    """Rays of links that a search loses and another one finds."""
    solutions = {
        "from one end": solved(medium, links, bounces, canonical=False),
        "from the other": solved(medium, links.exchanged(), bounces, canonical=False),
        "by default": solved(medium, links, bounces),
    }
    rays = {key: found_rays(arrivals) for key, (arrivals, _) in solutions.items()}
    counts = {}
    for key, solution in solutions.items():
        others = [other for name, other in rays.items() if name not in (key, "by default")]
        lost = [ray for other in others for ray in lost_rays(other, rays[key])]
        counts[key] = count(links, list(rays.values()), solution, lost)
    return counts


def against_rays(
    name: str, medium: Medium, links: Links, table: dict[str, NDArray]
) -> dict[str, Count]:
    """Rays of both fans of each link that the solver loses."""
    solution, fan, lost = solved(medium, links), SectionFan(medium), []
    found = found_rays(solution[0])
    rays = [rays_of(table[f"{name}_{end}"]) for end in ("source", "receiver")]
    for part, ends in zip(rays, (links, links.exchanged()), strict=True):
        lost += lost_after_a_second_look(fan, ends, part, found, SPACE)
    limits = SPACE.time, SPACE.level
    apart = [len(missing(a, b, *limits)) for a, b in (rays, rays[::-1])]
    number = sum(int(is_strong(part).sum()) for part in rays)
    print(
        f"{name}: {number} rays of fans, {sum(apart)} of which only the fan from one end finds",
        flush=True,
    )
    return {"by default, against fans from both ends": count(links, rays, solution, lost)}


def against_fans(medium: Medium, number: int) -> dict[str, Count]:
    """Rays of fans in the vertical section that the solver loses."""
    fan, counts = SectionFan(medium), []
    for each in random_fans(fan, number):
        solution = solved(medium, each.links)
        lost = lost_after_a_second_look(
            fan, each.links, each.rays, found_rays(solution[0]), SECTION
        )
        counts.append(count(each.links, [each.rays], solution, lost))
    return {"by default, against fans in the section": joined(counts)}


def joined(counts: list[Count]) -> Count:
    """Count of the links of all media."""
    first, lost = 0, []
    for part in counts:
        lost += [ray._replace(link=ray.link + first) for ray in part.lost]
        first += part.distance.size
    columns = (
        np.concatenate(column) for column in zip(*(part[:3] for part in counts), strict=True)
    )
    return Count(*columns, lost, sum(part.seconds for part in counts))


def print_table(title: str, c: Count) -> None:
    """Links by range as a table in Markdown."""
    kinds = (
        {x.link for x in c.lost},
        {x.link for x in c.lost if x.level < 12.0},
        {x.link for x in c.lost if x.dropout},
        {x.link for x in c.lost if x.first},
    )
    print(f"\n{title}: {1e6 * c.seconds / c.distance.size:.0f} us of CPU per link\n")
    print(
        "| range [km] | links | with rays | not complete | lose one | within 12 dB | false"
        " dropouts | lose the first |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for low, high in pairwise(EDGES):
        mine = (c.distance >= low) & (c.distance < high)
        numbers = [sum(mine[link] for link in links) for links in kinds]
        here = [mine.sum(), (mine & c.has_ray).sum(), (mine & ~c.complete).sum(), *numbers]
        print(
            f"| {low / 1e3:.0f} to {high / 1e3:.0f} | " + " | ".join(f"{n:,}" for n in here) + " |"
        )


def print_lost(name: str, lost: list[Lost]) -> None:
    for ray in sorted(lost):
        kind = "false dropout" if ray.dropout else "first arrival" if ray.first else ""
        print(
            f"  {name} link {ray.link}: {ray.time:.7f} s, {ray.level:.1f} dB, {ray.angle:.6f} rad"
            f" {kind}",
            flush=True,
        )


def write(path: Path, media: dict[str, Medium], links: dict[str, Links]) -> None:
    """Write grids and links for `fans_on_gpu.py`."""
    out = {"media": np.array(list(media))}
    for name, m in media.items():
        columns = {
            "north": m.north,
            "east": m.east,
            "depth": m.depth,
            "speed": m.sound_speed,
            "bed_north": m.bed.north,
            "bed_east": m.bed.east,
            "bed": m.bed.depth,
            "source": links[name].source,
            "receiver": links[name].receiver,
        }
        out |= {f"{name}_{key}": values for key, values in columns.items()}
    np.savez_compressed(path, **out)


def parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "media", nargs="*", metavar="MEDIUM", help=f"of {', '.join(MEDIA)}; default: all"
    )
    parser.add_argument("--links", type=int, default=900, help="random links per medium")
    parser.add_argument("--seed", type=int, default=1, help="of the random links")
    parser.add_argument("--bounces", type=int, default=0, help="reflections at the surface")
    parser.add_argument("--depth", type=float, metavar="METRES", help="of one end of all links")
    way = parser.add_mutually_exclusive_group()
    way.add_argument("--write", type=Path, metavar="LINKS.npz", help="only write the links")
    way.add_argument("--rays", type=Path, nargs=2, metavar=("LINKS.npz", "RAYS.npz"))
    way.add_argument("--fans", type=int, help="fans per medium")
    options = parser.parse_args()
    options.media = options.media or list(MEDIA)
    if unknown := set(options.media) - set(MEDIA):
        parser.error(f"unknown media: {', '.join(sorted(unknown))}; allowed: {', '.join(MEDIA)}")
    return options


def main() -> None:
    options = parsed()
    if "gulf" in options.media and not GULF_STREAM.is_file():
        print(f"gulf: nothing done, no {GULF_STREAM}")
        options.media.remove("gulf")
    grid, table = (np.load(path) for path in options.rays) if options.rays else (None, None)
    media, links, results = {}, {}, {}
    for name in options.media:
        media[name] = medium = gulf_stream() if name == "gulf" else several_extrema(int(name))
        if options.rays:
            links[name] = Links(grid[f"{name}_source"], grid[f"{name}_receiver"])
            counts = against_rays(name, medium, links[name], table)
        elif options.fans:
            counts = against_fans(medium, options.fans)
        else:
            links[name] = random_links(medium, options.links, [options.seed, MEDIA.index(name)])
            if options.depth is not None:
                links[name].source[:, 2] = options.depth
            counts = {} if options.write else both_ends(medium, links[name], options.bounces)
        for key, part in counts.items():
            results.setdefault(key, []).append(part)
            print_lost(f"{key}, {name}", part.lost)
    if options.write:
        write(options.write, media, links)
    for key, parts in results.items():
        print_table(key, joined(parts))


if __name__ == "__main__":
    main()

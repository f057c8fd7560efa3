"""Count the direct rays that the two-point solver loses, by comparison with brute-force fans, and time the solver on the same links.

Run with ``python benchmarks/bench_lost_rays.py [MEDIUM ...]``. The media are ``0`` to ``9``, synthetic water with several extrema of the sound
speed that vary horizontally, and ``gulf``, the Gulf Stream file in ../shared/data beside the repository. In each medium, ``--fans`` fans of
100,000 rays go to 480 receivers each (`tests/section_fan.py`, which shares no code with the solver). The table lists, for each medium, links,
rays of the fans within 15 dB, how many of these the solver loses within 12 and within 15 dB, and the solver's CPU time per link.
With ``--keep FILE`` each finished fan is appended to a file, and a later run with the same file continues after the last one.
"""

import argparse
import json
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from lost_rays import GULF_STREAM, ends, gulf_stream, lost_rays, random_fans, several_extrema
from section_fan import SectionFan

from pymantaray.acoustics import find_eigenrays

MEDIA = (*(str(k) for k in range(10)), "gulf")


def count_fan(name: str, fan: SectionFan, number: int) -> dict:
    """Count and time the links of one fan."""
    (links,) = random_fans(fan, 1, number)
    both = ends(links.source, links.azimuth, links.receivers)
    find_eigenrays(fan.medium, both[0][:1], both[1][:1])  # compiles
    start = time.process_time()
    find_eigenrays(fan.medium, *both, threads=1)
    seconds = time.process_time() - start
    lost = [level for _, _, level in lost_rays(fan, links)]
    return {
        "medium": name,
        "fan": number,
        "links": len(links.receivers),
        "rays": int(links.strong.sum()),
        "lost": [float(level) for level in lost],
        "seconds": seconds,
    }


def print_medium(name: str, fans: list[dict]) -> None:
    total = {key: sum(fan[key] for fan in fans) for key in ("links", "rays", "seconds")}
    lost = [level for fan in fans for level in fan["lost"]]
    strong = sum(level < 12.0 for level in lost)
    print(
        f"{name:6} {len(fans):3d} fans {total['links']:6d} links {total['rays']:6d} rays within 15 dB: lost {strong} within 12 dB,"
        f" {len(lost)} within 15 dB; {1e6 * total['seconds'] / total['links']:6.0f} us of CPU a link",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("media", nargs="*", choices=[*MEDIA, []], default=list(MEDIA))
    parser.add_argument("--fans", type=int, default=2, help="fans per medium")
    parser.add_argument("--keep", type=Path, help="file of finished fans")
    options = parser.parse_args()
    lines = options.keep.read_text().splitlines() if options.keep and options.keep.is_file() else []
    done = [json.loads(line) for line in lines]
    table = []
    for name in options.media:
        if name == "gulf" and not GULF_STREAM.is_file():
            print(f"gulf: nothing done, no {GULF_STREAM}")
            continue
        fan = SectionFan(gulf_stream() if name == "gulf" else several_extrema(int(name)))
        fans = [row for row in done if row["medium"] == name and row["fan"] < options.fans]
        for number in range(options.fans):
            if number in {row["fan"] for row in fans}:
                continue
            fans.append(count_fan(name, fan, number))
            if options.keep:
                with options.keep.open("a") as file:
                    file.write(json.dumps(fans[-1]) + "\n")
        print_medium(name, fans)
        table += fans
    print_medium("all", table)


if __name__ == "__main__":
    main()

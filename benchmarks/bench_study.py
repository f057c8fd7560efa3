"""
What a study costs: wall clock and CPU of its stages and processes, and its report figure by figure.

Run with ``python benchmarks/bench_study.py [STUDY] [OPTIONS of mantaray study run]``; ``--fresh``
before them compiles all kernels again, in a folder of its own. The command itself runs, and says by
its progress where it is; its CPU time and that of its processes are read from ``/proc`` twenty
times a second. A row of blocks a process shows how much of a core it had. Other work on the machine
disturbs the wall clock more than the CPU time.
"""

import contextlib
import io
import os
import subprocess
import sys
import tempfile
import threading
import time
from itertools import pairwise
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

TICK = os.sysconf("SC_CLK_TCK")
PERIOD = 0.05  # s between two looks
COLUMNS = 100  # of the picture
BLOCKS = " ▁▂▃▄▅▆▇█"
COMMAND = """
import sys
from contextlib import nullcontext
import pymantaray.apps.study.command as study
from pymantaray.__main__ import main
def told(stage, done, total):
    print("stage", stage, flush=True, file=sys.stderr)
study.progress_bars = lambda **_: nullcontext(told)
sys.argv = ["mantaray", "study", "run", *sys.argv[1:]]
main()
"""


def cpu_times(root: int) -> dict[int, float]:
    """CPU seconds so far of a process and of its descendants."""
    parents, used = dict[int, int](), dict[int, float]()
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with contextlib.suppress(OSError):
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
                parents[int(entry.name)] = int(fields[1])
                used[int(entry.name)] = (int(fields[11]) + int(fields[12])) / TICK
    own, found = [root], dict[int, float]()
    while own:
        pid = own.pop()
        if pid in used:
            found[pid] = used[pid]
        own += [child for child, parent in parents.items() if parent == pid]
    return found


def watch(arguments: list[str], environment: dict[str, str]) -> tuple[list, list, float]:
    """Stages of a run with their beginnings, looks at its processes, and when it ended."""
    stages, looks = [("start", 0.0)], []
    begin = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-c", COMMAND, *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    )

    def listen() -> None:
        for line in process.stderr:
            word, _, stage = line.strip().partition(" ")
            if word != "stage":
                print(line, end="")
            elif stage != stages[-1][0]:
                stages.append((stage, time.perf_counter() - begin))

    listener = threading.Thread(target=listen)
    listener.start()
    while process.poll() is None:
        looks.append((time.perf_counter() - begin, cpu_times(process.pid)))
        time.sleep(PERIOD)
    listener.join()
    if process.returncode:
        raise SystemExit(process.returncode)
    return stages, looks, time.perf_counter() - begin


def used(looks: list, pid: int, low: float, high: float) -> float:
    """CPU seconds of a process between two instants."""
    until = [[cpu.get(pid, 0.0) for t, cpu in looks if t <= end] for end in (low, high)]
    return max(until[1], default=0.0) - max(until[0], default=0.0)


def print_run(stages: list, looks: list, end: float) -> None:
    """Table of the stages, and the picture."""
    main, *others = dict.fromkeys(pid for _, cpu in looks for pid in cpu)
    short = [pid for pid in others if used(looks, pid, -1.0, end) < 0.2]
    names = {main: "main"} | {
        pid: f"process {i + 1}" for i, pid in enumerate(p for p in others if p not in short)
    }
    print(
        f"{'stage':<14}{'from [s]':>9}{'wall [s]':>9}"
        + "".join(f"{n:>12}" for n in names.values())
        + "  CPU [s]"
    )
    for (stage, low), (_, high) in zip(stages, [*stages[1:], ("", end)], strict=True):
        cpu = "".join(f"{used(looks, pid, low, high):12.2f}" for pid in names)
        print(f"{stage:<14}{low:9.2f}{high - low:9.2f}{cpu}")
    cpu = [used(looks, pid, -1.0, end) for pid in names]
    print(
        f"{'all':<14}{0.0:9.2f}{end:9.2f}"
        + "".join(f"{x:12.2f}" for x in cpu)
        + f"  sum {sum(cpu):.2f}\n"
    )
    edges = [end * i / COLUMNS for i in range(COLUMNS + 1)]
    marks = [" "] * COLUMNS
    for stage, begin in stages:
        place = min(int(begin / end * COLUMNS), COLUMNS - 1)
        marks[place] = stage[0]
    print(
        f"{'':<12}{''.join(marks)}  first letters of the stages; a column is {end / COLUMNS:.2f} s"
    )
    for pid, name in names.items():
        share = [used(looks, pid, a, b) / (b - a) for a, b in pairwise(edges)]
        print(f"{name:<12}" + "".join(BLOCKS[min(int(s * 8 + 0.5), 8)] for s in share))
    print()


def print_figures(folder: Path) -> None:
    """CPU time of each figure of a run: made, as the page's PNG, as PDF."""
    start = time.process_time()
    from pymantaray.apps.study import open_run
    from pymantaray.apps.study.figures.register import RunResults, run_figure_specs

    results, now = RunResults(open_run(folder)), time.process_time
    imports = now() - start
    start = now()
    specs = run_figure_specs(results)
    _ = list(results.tables.values())
    print(f"report: imports {imports:.2f}, tables {now() - start:.2f} s of CPU")
    print(f"{'figure':<20}{'made':>8}{'PNG':>8}{'PDF':>8}  CPU [s]")
    total = [0.0, 0.0, 0.0]
    for spec in specs:
        times = [now()]
        figure = spec.draw()
        times.append(now())
        for kind in ("png", "pdf"):
            figure.savefig(io.BytesIO(), format=kind)
            times.append(now())
        each = [b - a for a, b in pairwise(times)]
        total = [a + b for a, b in zip(total, each, strict=True)]
        print(f"{spec.name:<20}" + "".join(f"{x:8.2f}" for x in each))
    print(f"{'all':<20}" + "".join(f"{x:8.2f}" for x in total))


def main() -> None:
    arguments = sys.argv[1:]
    fresh = "--fresh" in arguments
    arguments = [a for a in arguments if a != "--fresh"] or ["quick"]
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | ({"NUMBA_CACHE_DIR": f"{folder}/kernels"} if fresh else {})
        print(f"mantaray study run {' '.join(arguments)}{', kernels compiled' if fresh else ''}\n")
        print_run(*watch([*arguments, "--quiet", "--out", f"{folder}/run"], environment))
        print_figures(Path(folder, "run"))


if __name__ == "__main__":
    main()

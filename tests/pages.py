"""
Pages of the documentation as a reader follows them: each block that can run does, in order, in a
folder of the page.

Blocks of python, sh and console run unless a comment on the line above says why not; what it can
say is in `MARKS`. A block of text, or without a language, behind one that ran is what that prints.
"""

import contextlib
import gzip
import io
import os
import re
import runpy
import shlex
import subprocess
import sys
from collections.abc import Callable
from itertools import groupby
from math import isclose
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from pymantaray.cli.main import main

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
MARKS = {
    "not run": "the block is not run, for the reason that follows",
    "not compared": "what is printed differs from the block, for the reason that follows",
    "file": "the block is written to this file",
    "add to": "the block is written at the end of this file",
}
RUNS = ("python", "sh", "console")
_BLOCK = re.compile(
    r"(?:^<!-- (?P<mark>[a-z ]+): (?P<said>.+?) -->\n)?^```(?P<language>\w*)\n(?P<text>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)
_PLAIN = re.compile(r"mantaray [^|<>$&;\\#]*(#.*)?$")
_NUMBER = r"[-+−]?\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+)?"


class Block(NamedTuple):
    """A fenced block, and what the comment above it says."""

    line: int
    language: str
    text: str
    mark: str | None
    said: str | None


def blocks_of(page: str) -> list[Block]:
    """Fenced blocks of a page's text."""
    return [
        Block(page.count("\n", 0, m.start("text")), m["language"], m["text"], m["mark"], m["said"])
        for m in _BLOCK.finditer(page)
    ]


def follow(
    page: Path, folder: Path, languages: tuple[str, ...] = RUNS, own_process: bool = True
) -> dict[str, Any]:
    """
    Run a page in a folder; the names that its Python leaves behind. Plain calls of `mantaray` have
    a process of their own, or are made in this one.
    """
    text = page.read_text(encoding="utf-8")
    for name in ("examples", "benchmarks", "src"):
        (folder / name).symlink_to(ROOT / name)
    (folder / ".venv").symlink_to(Path(sys.prefix))
    blocks = blocks_of(text)
    runnable = "".join(b.text for b in blocks if b.language in languages and b.mark != "not run")
    written = {b.said for b in blocks if b.mark == "file"}
    for name, build in STAND_INS.items():
        if name in runnable and name not in written and not (folder / name).exists():
            build(folder)
    names: dict[str, Any] = {"__name__": "__main__"}
    printed = ""
    for block in blocks:
        place = f"{page.name}, line {block.line}"
        assert block.mark is None or block.mark in MARKS, (
            f"{place}: {block.mark!r} is none of {', '.join(MARKS)}"
        )
        if block.mark in ("file", "add to"):
            with (folder / block.said).open(
                "w" if block.mark == "file" else "a", encoding="utf-8"
            ) as file:
                file.write(block.text)
        if block.language in languages and block.mark != "not run":
            printed = run_block(block, folder, names, place, own_process)
            continue
        if block.language in ("", "text") and block.mark is None and printed:
            compare(block.text, printed, place)
        printed = ""  # what follows another block is not its output
    return names


def run_block(
    block: Block, folder: Path, names: dict[str, Any], place: str, own_process: bool
) -> str:
    """
    Run a block; what it prints. Output within a console block is compared with what its commands
    print.
    """
    if block.language == "python":
        out = io.StringIO()
        with contextlib.chdir(folder), contextlib.redirect_stdout(out):
            exec(compile(block.text, place, "exec"), names)  # noqa: S102
        return out.getvalue()
    if block.language == "sh":
        parts = groupby(
            block.text.splitlines(keepends=True),
            lambda line: not own_process and _PLAIN.match(line) is not None,
        )
        return "".join(
            (call if plain else shell)("".join(lines), folder, place) for plain, lines in parts
        )
    for part in re.split(r"^\$ ", block.text, flags=re.MULTILINE)[1:]:
        command, *shown = re.split(r"(?<!\\)\n", part, maxsplit=1)
        printed = shell(command, folder, place)
        if shown and shown[0].strip():
            compare(shown[0], printed, place)
    return ""


def call(text: str, folder: Path, place: str) -> str:
    """Make calls of `mantaray` in this process; what they print."""
    with (
        io.StringIO() as out,
        contextlib.chdir(folder),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(out),
    ):
        for line in text.splitlines():
            code = exit_code(shlex.split(line, comments=True)[1:])
            assert not code, f"{place}: exit code {code}\n{line}\n{out.getvalue()}"
        return out.getvalue()


def exit_code(words: list[str]) -> int | str | None:
    """Code with which a command of `mantaray` ends this process."""
    try:
        main(words)
    except SystemExit as end:
        return end.code
    return "the command returns instead of ending the process"


def shell(text: str, folder: Path, place: str) -> str:
    """Run lines of a shell, as in an environment that is activated; what they print."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = os.environ | {"PATH": path, "COLUMNS": "160", "PYTHONWARNINGS": "default"}
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", text],
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{place}: exit code {done.returncode}\n{text}\n{done.stdout}"
    return done.stdout


def compare(shown: str, printed: str, place: str) -> None:
    """Require that lines shown come in what is printed, in this order; dots stand for anything."""
    lines = iter(printed.splitlines())
    for expected in filter(str.strip, shown.splitlines()):
        if expected.strip() != "...":
            assert any(agree(expected, line) for line in lines), (
                f"{place}: not printed:\n{expected}\nbut:\n{printed}"
            )


def agree(expected: str, line: str) -> bool:
    """
    Whether a printed line is as shown: words equal, numbers to a millionth, spaces however many.
    """
    parts = re.split(rf"({_NUMBER}|\.\.\.|\s+)", expected.strip())
    kinds = {"...": ".*"}
    pattern = "".join(
        kinds.get(p)
        or (r"\s+" if p.isspace() else f"({_NUMBER})" if re.fullmatch(_NUMBER, p) else re.escape(p))
        for p in parts
        if p
    )
    match = re.fullmatch(pattern, line.strip())
    numbers = [p for p in parts if re.fullmatch(_NUMBER, p)]
    return match is not None and all(
        isclose(as_float(a), as_float(b), rel_tol=1e-6)
        for a, b in zip(numbers, match.groups(), strict=True)
    )


def as_float(text: str) -> float:
    """A number as it is printed."""
    return float(text.replace(",", "").replace("−", "-"))


def _gulf_stream(folder: Path) -> None:
    """Two files of one ocean, as HYCOM's servers give them."""
    runpy.run_path(str(ROOT / "examples" / "gulf_stream.py"))["main"](folder / "both.nc")
    with xr.open_dataset(folder / "both.nc") as both:
        both[["water_temp", "salinity"]].to_netcdf(folder / "ts3z.nc")
        both[["water_u", "water_v"]].to_netcdf(folder / "uv3z.nc")
        both.to_zarr(folder / "model.zarr", consolidated=False)


def _run(folder: Path) -> None:
    """The latest run: the preset quick with one realization."""
    from pymantaray.apps.study import run_study
    from pymantaray.config import load_study

    run_study(load_study("quick", realizations=1), folder / "runs" / "quick", workers=1)
    (folder / "runs" / "latest").symlink_to("quick")


def _cast(name: str, latitude: float, deepest: float) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        depth = np.arange(0.0, deepest + 1.0, 5.0)
        rows = "".join(
            f"{z:g},{-1.0 + z / 2000.0:.3f},{30.0 + 5.0 * (1 - np.exp(-z / 200.0)):.3f}\n"
            for z in depth
        )
        (folder / name).write_text(
            f"# {name}, lat {latitude}, lon"
            f" -140\ndepth_m,temperature_degC,practical_salinity\n{rows}"
        )

    return write


def _graph(folder: Path) -> None:
    """A factor graph of the latest run."""
    if not (folder / "runs").exists():
        _run(folder)
    graph = folder / "runs" / "latest" / "pyfg" / "realization-0-refracted.pyfg.gz"
    (folder / "graph.pyfg").write_bytes(gzip.decompress(graph.read_bytes()))


def _study(folder: Path) -> None:
    from pymantaray.config import preset_text

    (folder / "my_study.toml").write_text(preset_text("quick"))


def _sea_floor(folder: Path) -> None:
    """A sea floor as GEBCO gives it."""
    lat, lon = np.linspace(33.5, 36.0, 151), np.linspace(-76.0, -73.5, 151)
    elevation = -(3200.0 + 100.0 * (lon + 76.0) + 0.0 * lat[:, None])
    xr.Dataset(
        {
            "elevation": (
                ("lat", "lon"),
                elevation.astype("f4"),
                {"units": "m", "standard_name": "height_above_mean_sea_level"},
            )
        },
        {
            "lat": ("lat", lat, {"units": "degrees_north"}),
            "lon": ("lon", lon, {"units": "degrees_east"}),
        },
    ).to_netcdf(folder / "GEBCO_2024.nc")


def _tables(folder: Path) -> None:
    """Links and profile of the page on travel times."""
    for block in blocks_of((DOCS / "how-to" / "travel-times.md").read_text(encoding="utf-8")):
        if block.mark == "file":
            (folder / block.said).write_text(block.text)


STAND_INS: dict[str, Callable[[Path], None]] = {
    "ts3z.nc": _gulf_stream,
    "model.zarr": _gulf_stream,
    "runs/latest": _run,
    "graph.pyfg": _graph,
    "my_study.toml": _study,
    "GEBCO_2024.nc": _sea_floor,
    "links.csv": _tables,
    "profile.csv": _tables,
    "cast.csv": _cast("cast.csv", 74.5, 1000.0),
    "deeper.csv": _cast("deeper.csv", 74.5, 3700.0),
    "drop_74N.csv": _cast("drop_74N.csv", 74.0, 1000.0),
    "drop_75N.csv": _cast("drop_75N.csv", 75.0, 1000.0),
}
"""What readers have of their own, by the name that pages give it."""

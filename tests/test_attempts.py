"""
Attempts with names, numbers, dates and texts that no command can use: one line each, and
no traceback.

Every value is put into each place of each kind of file, every path that is no file into each
argument and each option that takes a file; rows are truncated, doubled and emptied; headers have
thousands of names, and the files of surveys dates that do not exist.
"""

import contextlib
import io
import itertools
import json
import os
import random
import re
import shutil
import time

import pytest
from campaigns import make_campaign, write_garpos, write_gnatss, write_obsrange

from pymantaray.cli.main import main, tree

FILES = {  # name, and content with marked places
    "p.csv": "depth,sound_speed\n0,1500\n<10>,<1490>\n200,1500\n",
    "cast.csv": "depth,temperature,salinity,lat,lon,time\n1,4,34,70,<0>,<2014-07-15T12:00>\n"
    "<90>,4,<34>,70,0,2014-07-15T12:00\n",
    "links.csv": "source_north,source_east,source_depth,receiver_north,receiver_east,"
    "receiver_depth\n0,0,10,<100>,0,<20>\n",
    "pings.csv": "time,node,two_way_time_s,north_m,east_m,depth_m\n"
    + "".join(f"{k},N,0.2,{50 * (k % 3)},{40 * (k % 4)},2\n" for k in range(11))
    + "<12>,<N>,<0.2>,0,<9>,2\n",
    "tracks.csv": "time,vehicle,north,east,depth\n0,A,0,0,10\n<60>,A,<9>,0,10\n0,B,500,0,10\n"
    "60,<B>,509,0,<10>\n",
    "a.tum": "0 0 0 10 0 0 0 1\n<60> 9 0 <10> 0 0 0 1\n",
    "g.pyfg": "VERTEX_SE2 0 A0 0 0 0\nVERTEX_SE2 1 A1 1 0 0\nEDGE_SE2 1 A0 A1 <1> 0 0 <0.1> 0 0"
    " 0.1 0 0.1\n",
    "g.g2o": "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 <1> 1 0 0\nEDGE_SE2 0 1 <1> 0 0 <10> 0 0 10 0 10\n",
    "s.toml": 'base = "quick"\n[study]\nname = "<x>"\nseed = <1>\n[mission]\nduration_h ='
    ' <8>\n[ocean]\ntime = "<2014-07-15T12:00:00>"\n',
    "sweep.toml": 'base = "quick"\nseeds = [<1>]\n[cross]\n"noise.range_sigma" = [<1.0>, 2.0]\n',
}
COMMANDS = {
    "p.csv": ["rays times links.csv o.csv --profile {} --bathymetry 200 --force"],
    "cast.csv": [
        "ocean from-cast {} o.nc --force --bathymetry 90",
        "ocean convert-cast {} o.asvp --force",
    ],
    "links.csv": [
        "rays eigen {} o.csv --profile p.csv --bathymetry 200 --force",
        "rays times {} o.csv --profile p.csv --bathymetry 200 --force",
    ],
    "pings.csv": ["locate {} --depth 150 --profile p.csv --sound-speed known"],
    "tracks.csv": ["ranges {} --profile p.csv --bathymetry 200 --interval 30 --out run"],
    "a.tum": ["ranges {} a2.tum --profile p.csv --bathymetry 200 --interval 30 --out run"],
    "g.pyfg": ["graph solve {}", "graph convert {} o.g2o --leave-out all --force"],
    "g.g2o": ["graph solve {}", "graph show {}"],
    "s.toml": ["ocean show {}"],
    "sweep.toml": ["sweep show {}"],
}
VALUES = [
    "1" * 400,
    "9" * 5000,
    "-1e400",
    "1e-320",
    "nan",
    "inf",
    "",
    "0x10",
    "1_000",
    "\u0663",
    "0000-01-01T00:00:00",
    "2263-01-01T00:00:00",
    "2018-13-45T00:00:00",
    "\x1b[31mred\x1b[0m",
    "\x00",
    "\xff\udcff",
    "x" * 300,
]
SEED = 44


ROWS = {  # what becomes of the last row of a table
    "half": lambda row: row[: len(row) // 2],
    "one cell less": lambda row: row.rpartition(",")[0],
    "twice": lambda row: f"{row},{row}",
    "a quote": lambda row: f'"{row}',
    "commas": lambda row: "," * row.count(","),
    "bytes": lambda row: row[:5] + "\udcff\udcfe" + row[5:],
    "\x1b": lambda row: f"\x1b[2J{row}\x07",
    "long": lambda row: row + "0" * 100_000,
}
PATHS = ("pipe", "loop", "sub", "/dev/zero", "n" * 300, "\x1b[2Jz", "none")
DATES = (
    "2018-13-45",
    "0000-00-00",
    "2263-05-01",
    "9999-12-31",
    "-0001-01-01",
    "\x1b[31m",
    "9" * 400,
)


def of_rows():
    """Tables whose last row is damaged."""
    for name, text in FILES.items():
        if not name.endswith(".csv"):
            continue
        *rows, last = whole(text).rstrip("\n").split("\n")
        for what, damage in ROWS.items():
            for command in COMMANDS[name]:
                changed = "\n".join([*rows, damage(last)]) + "\n"
                yield name, changed, command.format(name), f"{name} row {what!r}"
                yield (
                    name,
                    "\n".join([*rows, last, damage(last)]),
                    command.format(name),
                    f"{name} more {what!r}",
                )


def of_options():
    """Options that take a file, with paths of everything that is none."""
    root = tree()
    for commands in COMMANDS.values():
        for command in commands:
            node, words = root, command.split()
            for word in words:
                if word not in getattr(node, "commands", {}):
                    break
                node = node.commands[word]
            for option in node.params:
                meta = f"{option.metavar} {getattr(option, 'type_descriptor', '')}"
                if not (
                    option.opts[0].startswith("--") and re.search("FILE|FOLDER|CSV|TOML|path", meta)
                ):
                    continue
                for path in PATHS:
                    name = next(name for name, own in COMMANDS.items() if command in own)
                    line = f"{command.format(name)} {option.opts[0]} {path}"
                    yield None, None, line, f"{option.opts[0]} {path[:20]!r}"


def of_headers():
    """Thousands of names where a few are known."""
    names = [f"k{k}" for k in range(30_000)]
    table = f"{','.join(names)}\n{','.join('1' for _ in names)}\n"
    for name, commands in COMMANDS.items():
        if name.endswith(".csv"):
            yield from (
                (name, table, command.format(name), f"{name} header") for command in commands
            )
    keys = "\n".join(f"{name} = 1" for name in names)
    for name, head in (
        ("s.toml", 'base = "quick"\n'),
        ("s.toml", "[noise]\n"),
        ("sweep.toml", 'base = "quick"\n[cross]\n'),
    ):
        yield name, head + keys, COMMANDS[name][0].format(name), f"{name} keys"
    sections = "\n".join(f"[{name}]" for name in names)
    yield "s.toml", sections, COMMANDS["s.toml"][0].format("s.toml"), "sections"


def of_surveys(folder):
    """Dates that do not exist in survey text of OBSrange and in files of GARPOS and GNATSS."""
    campaign = make_campaign(4, pings=12)
    ways = {
        "garpos": (write_garpos, r"(?<=Date\(UTC\)).*", " = {}"),
        "gnatss": (write_gnatss, r"\d\d-[A-Z]{3}-\d\d", "{}"),
        "obsrange": (lambda _, own: write_obsrange(own)[0], r"\d{4}:\d{3}(?=:)", "{}"),
    }
    for name, (make, pattern, form) in ways.items():
        for k, date in enumerate(DATES):
            for count in (0, 1):
                own = folder / f"{name}{k}{count}"
                own.mkdir()
                path = make(campaign, own)
                for file in own.rglob("*"):
                    if file.is_file():
                        text = file.read_text()
                        file.write_text(
                            re.sub(pattern, form.format(date).replace("\\", ""), text, count=count)
                        )
                yield None, None, f"locate {path}", f"{name} {date[:12]!r}"


def attempts(folder):
    """Words of a command and what was tried, after the files of an attempt are written."""
    rng = random.Random(SEED)
    yield from of_rows()
    yield from of_options()
    yield from of_headers()
    yield from of_surveys(folder)
    for name, text in FILES.items():
        places = len(re.findall(r"<[^>]*>", text))
        for place in range(places):
            for value in VALUES:
                count = iter(range(places))
                changed = re.sub(
                    r"<([^>]*)>",
                    lambda m, c=count, p=place, v=value: v if next(c) == p else m[1],
                    text,
                )
                yield (
                    name,
                    changed,
                    rng.choice(COMMANDS[name]).format(name),
                    f"{name} {place} {value[:20]!r}",
                )
    odd = [
        "pipe",
        "loop",
        "sub",
        "/dev/zero",
        "/dev/full",
        "n" * 300,
        "m/" * 60 + "x",
        "\x1b[2Jz",
        "none",
        "/proc/self/mem",
    ]
    for name, commands in COMMANDS.items():
        for command in commands:
            for path in odd:
                ending = "" if path.startswith("/") or path == "sub" else os.path.splitext(name)[1]  # noqa: PTH122
                yield (
                    None,
                    None,
                    command.format(path + ending),
                    f"{command.split()[0]} {path[:20]!r}",
                )
                words = command.format(name).split()
                out = next(
                    (k for k, w in enumerate(words) if w.startswith("o.") or w == "run"), None
                )
                if out is not None:
                    words[out] = path + os.path.splitext(words[out])[1]  # noqa: PTH122
                    yield None, None, " ".join(words), f"output {words[0]} {path[:20]!r}"


def whole(text):
    return re.sub(r"<([^>]*)>", r"\1", text)


def test_attempts_end_in_one_line_or_a_result(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    for name, text in FILES.items():
        (tmp_path / name).write_text(whole(text))
    (tmp_path / "a2.tum").write_text(whole(FILES["a.tum"]).replace(" 9 ", " 900 "))
    (tmp_path / "sub").mkdir()
    for ending in (".csv", ".toml", ".tum", ".pyfg", ".g2o"):
        (tmp_path / f"loop{ending}").symlink_to(tmp_path / f"loop{ending}")
        os.mkfifo(tmp_path / f"pipe{ending}")
    failed, log = [], []
    for name, commands in COMMANDS.items():  # without a change, all succeed
        for command in commands:
            with contextlib.redirect_stdout(io.StringIO()), pytest.raises(SystemExit) as end:
                main(command.format(name).split())
            assert end.value.code == 0, command
            shutil.rmtree(tmp_path / "run", ignore_errors=True)
    for name, text, command, what in itertools.islice(attempts(tmp_path), 0, None, 8):
        if name is not None:
            (tmp_path / name).write_bytes(text.encode("utf-8", "surrogateescape"))
        out, err, begin = io.StringIO(), io.StringIO(), time.monotonic()
        code = "traceback"
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            try:
                main(command.split(" "))
            except SystemExit as end:
                code = end.code
            except BaseException as error:  # noqa: BLE001
                err.write(f"{type(error).__name__}: {error}"[:300])
        said = err.getvalue()
        shutil.rmtree(tmp_path / "run", ignore_errors=True)
        if name is not None:
            (tmp_path / name).write_text(whole(FILES[name]))
        seconds = time.monotonic() - begin
        log.append(
            {
                "what": what,
                "command": command[:200],
                "code": code,
                "seconds": seconds,
                "line": said[-200:],
            }
        )
        fine = (
            code in (0, 1, 2)
            and not re.search(r"[\x00-\x08\x0b-\x1f\x7f]", said)
            and seconds < 120.0
        )
        fine = fine and max(map(len, said.split("\n"))) < 2100 and "Traceback" not in said
        if not fine:
            failed.append(log[-1])
    (tmp_path / "attempts.json").write_text(json.dumps(log))
    print(len(log), "attempts,", sum(one["code"] == 2 for one in log), "refused")
    assert len(log) >= 120
    assert not failed, "\n".join(
        f"{f['what']}: {f['code']} {f['seconds']:.0f} s {f['line']!r}" for f in failed
    )


test_attempts_end_in_one_line_or_a_result = pytest.mark.slow(
    test_attempts_end_in_one_line_or_a_result
)

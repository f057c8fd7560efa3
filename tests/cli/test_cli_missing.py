"""A file that is not there: one line, before a command loads the library."""

import json

from factories import python

WATER = "--profile no.csv --bathymetry 200"
TABLE = "--source-depth 10:30 --receiver-depth 10:30 --range 100:400 --error 5 --out t.nc"
COMMANDS = [
    "atlas run no.nc --out a.nc",
    "atlas show no.nc",
    "atlas plot no.nc",
    "export no --to tum --out o",
    "graph show no.pyfg",
    "graph solve no.g2o",
    "locate survey no.csv --profile there.csv --bathymetry 200 --depth 150",
    f"locate survey there.csv {WATER} --depth 150",
    "locate survey there.csv --ocean no.nc --depth 150",
    "ocean show there.nc no.nc",
    "ocean correct no.nc there.csv o.nc",
    "ocean correct there.nc no.csv o.nc",
    "ocean perturb there.nc o.nc --mode-cast no.csv",
    "plan no.toml",
    "ranges no.csv --ocean synthetic:fram --out r",
    f"rays times there.csv o.csv {WATER}",
    "rays times no.csv o.csv --profile there.csv --bathymetry 200",
    "rays times there.csv o.csv --run no",
    f"rays plot r.png --source 0,0,10 --receiver 1,0,10 {WATER}",
    "replay no.csv --profile there.csv --bathymetry 200 --out x",
    "serve no.csv --bathymetry 200 --port 0",
    "study compare there no",
    "authors import no.json",
    "study report no",
    "study tables no",
    "sweep run no.toml s",
    f"table no.csv --bathymetry 200 {TABLE}",
]
RUN = """
import json, sys
from pymantaray.cli.main import main
for command in json.loads(sys.argv[1]):
    print("command", command, file=sys.stderr)
    try:
        main(command.split())
    except SystemExit as end:
        print("exit", end.code, file=sys.stderr)
print("loaded", *{"scipy", "numba", "xarray", "pandas", "matplotlib"} & set(sys.modules))
"""


def test_a_missing_file_is_told_before_the_library_is_loaded(tmp_path):
    for name in ("there", "there.csv", "there.nc"):
        (tmp_path / name).mkdir() if name == "there" else (tmp_path / name).touch()
    done = python(RUN, json.dumps(COMMANDS), cwd=tmp_path)
    answers = done.stderr.split("command ")[1:]
    for command, answer in zip(COMMANDS, answers, strict=True):
        name = next(word for word in command.split() if word.startswith("no"))
        what = "file" if "." in name else "folder"
        if command.startswith("export"):  # a run, or the file of an atlas
            what = "file or folder"
        expected = f"error: {name}: no such {what}; name an existing {what}"
        assert answer.splitlines() == [command, expected, "exit 2"]
    assert done.stdout == "loaded\n"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["there", "there.csv", "there.nc"]

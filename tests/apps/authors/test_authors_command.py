"""The commands `mantaray authors`."""

from pathlib import Path

from authors_files import write_simulation
from factories import names_in

from pymantaray import load_study
from pymantaray.config.text import commented_toml


def test_export_takes_a_study_or_a_run_and_import_reads_it(mantaray, tmp_path):
    write_simulation(tmp_path)
    done = mantaray("authors", "import", tmp_path / "sim.json", "--out", tmp_path / "study.toml")
    assert done.code == 0
    assert "without meaning here: output_dir" in done.err
    assert "output_dir" in (tmp_path / "study.toml").read_text()
    run = tmp_path / "run"
    words = ("--realizations", 1, "--no-figures", "--out", run)
    assert mantaray("study", "run", tmp_path / "study.toml", *words).code == 0
    for source, folder in ((tmp_path / "study.toml", "one"), (run, "two")):
        done = mantaray("authors", "export", source, tmp_path / folder)
        assert (done.code, done.out) == (0, f"{tmp_path / folder}\n"), done.err
        assert names_in(tmp_path / folder) == ["environment", "environment.json", "sim.json"]
    assert mantaray("authors", "import", tmp_path / "two" / "sim.json").code == 0


def test_a_study_from_a_file_of_the_program_says_how_to_convert_it(mantaray, tmp_path):
    write_simulation(tmp_path)
    done = mantaray("study", "run", tmp_path / "sim.json")
    assert done.code == 2
    assert done.err.endswith(f"with mantaray authors import {tmp_path / 'sim.json'}\n")


def test_every_option_reaches_the_import(mantaray, spied, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("sim.json").write_text("{}")
    imported = (load_study("quick"), ["one", "two"])
    function = "pymantaray.apps.authors.import_authors"
    (given,), printed = spied(function, imported, "authors", "import", "sim.json")
    assert given == {0: Path("sim.json")}
    assert printed.err == "sim.json: one\nsim.json: two\n"
    assert printed.out == commented_toml(imported[0])
    done = mantaray("authors", "import", "sim.json", "--out", "mine.toml")
    assert (done.code, done.err) == (0, printed.err)
    assert done.out == (
        "mine.toml: written from sim.json; edit it, then: mantaray study run mine.toml\n"
    )
    assert Path("mine.toml").read_text() == f"# one\n# two\n\n{printed.out}"
    again = mantaray("authors", "import", "sim.json", "--out", "mine.toml")
    assert (again.code, again.out) == (2, "")
    assert again.err.endswith("error: mine.toml: already exists; give another name\n")


def test_every_option_reaches_the_export(mantaray, monkeypatch):
    monkeypatch.setattr(
        "pymantaray.apps.authors.export_authors",
        lambda study, folder: (f"{folder}/made of {study}", ("one", "two")),
    )
    done = mantaray("authors", "export", "quick", "new")
    assert (done.code, done.out) == (0, "new/made of quick\n")
    assert done.err == "quick: one\nquick: two\n"

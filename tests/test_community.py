"""Files for hosts, archives and contributors: valid, and in agreement with the package."""

import json
import re
import tomllib

import pytest
from packaging.requirements import Requirement
from pages import ROOT

yaml = pytest.importorskip("yaml")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
REFERENCES = tomllib.loads((ROOT / "src/pymantaray/references.toml").read_text(encoding="utf-8"))


def read(name):
    return (ROOT / name).read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["bug", "question", "feature"])
def test_issue_forms_ask_in_fields_that_the_host_knows(name):
    form = yaml.safe_load(read(f".github/ISSUE_TEMPLATE/{name}.yml"))
    assert {"name", "description", "body"} <= form.keys()
    fields = [field for field in form["body"] if field["type"] != "markdown"]
    assert {field["type"] for field in fields} <= {"textarea", "input", "dropdown", "checkboxes"}
    assert all(field["attributes"]["label"] for field in fields)
    assert any(field.get("validations", {}).get("required") for field in fields)
    ids = [field["id"] for field in fields]
    assert len(set(ids)) == len(ids)


def test_hooks_have_versions_that_the_project_allows():
    hooks = yaml.safe_load(read(".pre-commit-config.yaml"))["repos"]
    allowed = {
        requirement.name: requirement.specifier
        for requirement in map(Requirement, PROJECT["dependency-groups"]["lint"])
    }
    tools = {"ruff-check": "ruff", "codespell": "codespell", "nbstripout": "nbstripout"}
    versions = {tools[repo["hooks"][0]["id"]]: repo["rev"].removeprefix("v") for repo in hooks}
    assert versions.keys() == {"ruff", "codespell", "nbstripout"}
    assert all(version in allowed[name] for name, version in versions.items())


def test_codespell_checks_the_files_of_make_lint():
    line = re.search(r"codespell (src.*)", read("Makefile"))[1].split()
    (hook,) = next(
        repo["hooks"]
        for repo in yaml.safe_load(read(".pre-commit-config.yaml"))["repos"]
        if repo["hooks"][0]["id"] == "codespell"
    )
    for name in line:
        path = f"{name}/a.py" if (ROOT / name).is_dir() else name
        assert re.search(hook["files"], path), name
    assert not re.search(hook["files"], "LICENSE")


def test_hosts_use_targets_of_make_and_a_supported_python():
    container = json.loads(read(".devcontainer/devcontainer.json"))
    hosted = yaml.safe_load(read(".readthedocs.yaml"))
    makefile = read("Makefile")
    for word in container["postCreateCommand"].split()[1:]:
        assert f"$(VENV){word.removeprefix('.venv')}:" in makefile
    assert hosted["build"]["commands"][0] == "make docs"
    assert "build/docs/." in hosted["build"]["commands"][-1].split()[-2]
    versions = {
        container["image"].rpartition(":")[2],
        hosted["build"]["tools"]["python"],
        read(".binder/runtime.txt").strip().removeprefix("python-"),
    }
    for version in versions:
        assert f"Programming Language :: Python :: {version}" in PROJECT["project"]["classifiers"]


def test_binder_installs_the_package_and_what_notebooks_need():
    lines = read(".binder/requirements.txt").split()
    assert lines[0] == "."
    docs = {Requirement(r).name: r for r in PROJECT["dependency-groups"]["docs"]}
    assert docs["ipykernel"] in lines


def test_zenodo_and_the_citation_file_agree():
    zenodo = json.loads(read(".zenodo.json"))
    assert zenodo["title"] == CITATION["title"]
    assert zenodo["license"] == CITATION["license"] == PROJECT["project"]["license"]
    assert zenodo["keywords"] == CITATION["keywords"]
    assert zenodo["upload_type"] == CITATION["type"]
    assert [c["name"] for c in zenodo["creators"]] == [a["name"] for a in CITATION["authors"]]
    assert zenodo["description"] == PROJECT["project"]["description"]
    (related,) = zenodo["related_identifiers"]
    assert related["identifier"] in CITATION["references"][0]["notes"]


def test_the_studied_paper_has_one_citation_everywhere():
    (stated,) = CITATION["references"]
    known = REFERENCES["kogucki-papalia"]
    names = " and ".join(f"{a['family-names']}, {a['given-names']}" for a in stated["authors"])
    assert (names, stated["title"]) == (known["author"], known["title"])
    assert (stated["year"], stated["url"]) == (known["year"], known["url"])
    assert known["note"] in stated["notes"]


def bibtex(text):
    """Fields of each entry."""
    entries = re.findall(r"^@(\w+)\{(\w+),\n(.*?)^\}$", text, re.MULTILINE | re.DOTALL)
    return {key: dict(re.findall(r"(\w+) *= \{(.*)\},", fields)) for _, key, fields in entries}


def test_the_article_cites_what_its_bibliography_has():
    text = read("paper/paper.md")
    head, body = text.split("---\n", 2)[1:]
    front = yaml.safe_load(head)
    assert front["title"] == CITATION["title"]
    assert front["bibliography"] == "paper.bib"
    entries = bibtex(read("paper/paper.bib"))
    assert set(re.findall(r"@(\w+)", body)) == set(entries)
    assert {"author", "title", "year"} <= set.intersection(*map(set, entries.values()))
    assert len(body.split()) <= 1000
    headings = [line[2:] for line in body.splitlines() if line.startswith("# ")]
    assert headings == [
        "Summary",
        "Statement of need",
        "State of the field",
        "Software design",
        "Research impact statement",
        "AI usage disclosure",
        "Acknowledgements",
        "References",
    ]
    for figure in re.findall(r"\]\((\.\./[^)]+)\)", body):
        assert (ROOT / "paper" / figure).is_file()


def test_articles_in_journals_and_conferences_have_a_doi():
    """Except a newsletter and a preprint, which have none."""
    entries = bibtex(read("paper/paper.bib"))
    with_pages = {key for key, fields in entries.items() if {"pages", "volume"} & set(fields)}
    lacking = {key for key in with_pages if "doi" not in entries[key]}
    assert lacking == {"chassignet2008"}
    assert len(with_pages) >= 6
    for key, fields in entries.items():
        assert re.fullmatch(r"10\.\d{4,}/\S+", fields.get("doi", "10.1000/none")), key


def test_commands_and_scripts_of_the_article_are_there():
    body = read("paper/paper.md")
    for words in re.findall(r"`([^`]+)`", body):
        if words.startswith("mantaray "):
            name = words.split()[1]
            assert re.search(
                rf"^mantaray {name}\b", read("docs/reference/at-a-glance.md"), re.MULTILINE
            )
        elif "/" in words:
            assert (ROOT / words).is_file(), words


def test_one_comment_lists_what_only_the_maintainers_can_fill_in():
    """As long as a field has no content of theirs, it is in the list, which CONTRIBUTING names."""
    _, head, body = read("paper/paper.md").split("---\n", 2)
    listed = "".join(line for line in head.splitlines(keepends=True) if line.startswith("#"))
    authors = yaml.safe_load(head)["authors"]
    assert ("- authors" in listed) == any("orcid" not in author for author in authors)
    assert ("DOI" in listed) == ("doi" not in CITATION)
    assert ("Acknowledgements" in listed) == ("None stated yet" in body)
    assert "paper/paper.md" in read("CONTRIBUTING.md").partition("**Releases.**")[2]


def test_numbers_of_the_article_are_those_of_the_documentation():
    body = read("paper/paper.md")
    pages = read("README.md") + read("docs/paper.md") + read("docs/theory/accuracy.md")
    numbers = re.findall(r"-?\d[\d,]*\.\d+|\d,\d{3}|\d+e-\d+|\b36 µs", body.split("\n---\n")[1])
    assert len(numbers) > 15
    for number in numbers:
        plain = number.lstrip("-").removesuffix(" µs")
        assert plain in pages or re.search(rf"{re.escape(plain)}\d", pages), number


def test_only_one_list_of_authors_is_incomplete():
    """No source with the authors of the journal's version was found."""
    short = [key for key, entry in REFERENCES.items() if "others" in entry.get("author", "")]
    assert short == ["rudels2005"]

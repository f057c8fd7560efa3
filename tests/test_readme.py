"""The first page on a package index: absolute links that lead into this tree, and numbers that are those of the paper's page."""

import re
import tomllib

from pages import DOCS, ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
URLS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["urls"]
HOME = URLS["Repository"]
RAW = HOME.replace("https://github.com/", "https://raw.githubusercontent.com/") + "/main/"


def test_every_link_is_absolute_and_leads_to_a_file():
    targets = re.findall(r"\]\(([^)]+)\)", README)
    assert len(targets) > 10
    for target in targets:
        path = re.sub(f"^({re.escape(RAW)}|{re.escape(HOME)}/(blob|tree)/main/)", "", target)
        assert path != target, f"{target}: not a file of {HOME}"
        assert (ROOT / path.partition("#")[0]).exists(), target


def test_the_same_address_everywhere():
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f'url: "{HOME}"' in citation
    assert f"git clone {HOME}" in README
    for url in URLS.values():
        assert url.startswith(HOME)


def test_numbers_beside_the_paper_are_those_of_its_page():
    page = (DOCS / "paper.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (.*) \|$", README.partition("## Beside the paper")[2], re.MULTILINE)
    assert len(rows) == 6
    shown = [row.split(" | ") for row in rows[1:]]
    by_paper = {name: re.search(rf"^\| {re.escape(name)} \|(.*)\|$", page, re.MULTILINE) for name in
                ("N", "mean [m]", "station-keeping to float")}  # fmt: skip
    for cells, name in zip(shown, by_paper, strict=False):
        assert cells[1:] == [cell.strip() for cell in by_paper[name][1].split("|")], name
    for cells, condition in zip(shown[3:], ("straight", "refracted"), strict=True):
        for cell, region in ((cells[2], "Beaufort"), (cells[4], "Fram")):
            assert re.search(rf"^\| {region}, {condition} \| {cell} \|", page, re.MULTILINE), (
                region,
                condition,
            )

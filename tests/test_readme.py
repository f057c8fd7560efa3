"""
The first page on a package index: absolute links that lead into this tree, and numbers that are
those of the paper's page.
"""

import re
import subprocess
import tomllib

import pytest
from pages import DOCS, ROOT

from pymantaray import load_study
from pymantaray.apps.study import citation

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


def test_files_agree_on_the_address_of_the_repository():
    """It is defined in `[project.urls]`; no other file of the repository contains it."""
    name = HOME.rpartition("/")[2]
    address = re.compile(rf"https://(?:github|raw\.githubusercontent)\.com/[\w-]+/{name}\b")
    listed = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False
    ).stdout
    texts = {
        path: (ROOT / path).read_text(encoding="utf-8")
        for path in listed.split()
        if path.endswith((".md", ".toml", ".cff", ".yaml", ".yml", ".py", ".html", ".rst"))
    }
    found = {
        path: set(address.findall(text)) for path, text in texts.items() if address.search(text)
    }
    expected = {HOME, HOME.replace("github.com", "raw.githubusercontent.com")}
    assert all(addresses <= expected for addresses in found.values()), found
    assert set(found) <= {"pyproject.toml", "README.md", "CITATION.cff", "conda/recipe.yaml"}
    assert all(url.startswith(HOME) for url in URLS.values())
    assert f"git clone {HOME}" in README


def test_numbers_beside_the_paper_are_those_of_its_page():
    page = (DOCS / "paper.md").read_text(encoding="utf-8")
    rows = re.findall(
        r"^\| (.*) \|$", README.partition("## Comparison with the paper")[2], re.MULTILINE
    )
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


def test_numbers_of_scripts_and_lines_are_those_of_the_gallery():
    words = ("eight", "nine", "ten", "eleven", "twelve", "thirteen", "fourteen", "fifteen")
    scripts = sorted((ROOT / "examples" / "gallery").glob("plot_*.py"))
    assert f", {words[len(scripts) - 8]} short scripts in" in README
    lines = (ROOT / "examples" / "gallery" / "plot_bent_ray.py").read_text("utf-8").count("\n")
    assert f"plot_bent_ray.py) has {lines} lines" in README


def test_the_lost_links_of_the_beacon_are_those_of_the_first_page():
    plan = (DOCS / "how-to" / "plan.md").read_text(encoding="utf-8")
    (lost,) = re.findall(r"beacon A at the surface loses ([\d.]+) % of its links", plan)
    row = re.search(r"^\| lost on the station's links \[%\] \|(.*)\|$", README, re.MULTILINE)
    assert lost == row[1].split("|")[-1].strip()


def test_mantaray_is_cited_as_readme_and_citation_file_do():
    yaml = pytest.importorskip("yaml")
    entry = next(
        reference for reference in citation(load_study("quick")) if reference.key == "mantaray"
    )
    stated = re.search(r"^@software\{mantaray,$.*?^\}$", README, re.MULTILINE | re.DOTALL)
    fields = [dict(re.findall(r"(\w+) *= \{(.*)\}", text)) for text in (stated[0], entry.bibtex)]
    assert fields[0] == fields[1]
    released = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert fields[1]["url"] == released["url"]
    assert fields[1]["year"] == released.get("date-released", fields[1]["year"])[:4]
    assert fields[1]["title"] == released["title"]


def test_before_the_first_release_no_file_claims_one():
    """The changelog has a dated section for each release."""
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    is_released = bool(re.search(r"^## \[\d[^]]*\] - \d", changelog, re.MULTILINE))
    citation_file = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert ("date-released" in citation_file) == is_released
    assert ("pip install pymantaray" in README) == is_released
    assert ".venv/bin/mantaray" in README


def test_actions_are_pinned_and_lower_bounds_have_no_known_holes():
    for workflow in (ROOT / ".github" / "workflows").glob("*.yml"):
        used = re.findall(r"uses: (\S+)", workflow.read_text(encoding="utf-8"))
        assert used
        assert all(re.fullmatch(r"[\w./-]+@[0-9a-f]{40}", one) for one in used), used
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert '"jinja2>=3.1.6"' in project
    assert project.count('"waitress>=3.0.1"') == 2
    assert (ROOT / "SECURITY.md").is_file()

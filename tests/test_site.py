"""
The documentation as a site, built from nothing: links and anchors, and names that lead to the
nomenclature.
"""

import posixpath
import re
import runpy
import subprocess
import sys
from html import unescape
from urllib.parse import unquote, urldefrag

import pytest
from browser import BROWSER, faults, overflow
from pages import DOCS

pytest.importorskip("sphinx", reason="needs the group docs")
BeautifulSoup = pytest.importorskip("bs4", reason="needs the group docs").BeautifulSoup
pytestmark = pytest.mark.slow

EXAMPLES = DOCS.parent / "examples"
PAGES = runpy.run_path(str(DOCS / "site" / "reference_pages.py"))


@pytest.fixture(scope="module")
def html(once):
    """Folder of the site. Of the gallery one script runs; tests/test_gallery.py runs all."""
    options = ["-q", "-W", "--keep-going", "-c", DOCS / "site"]
    one = ["-D", "sphinx_gallery_conf.filename_pattern=plot_bent_ray"]

    def build(folder):
        for words in (
            [DOCS / "site" / "stage.py", folder / "source"],
            ["-m", "sphinx", *options, *one, folder / "source", folder / "html"],
        ):
            done = subprocess.run(
                [sys.executable, *words], capture_output=True, text=True, check=False
            )
            assert done.returncode == 0, done.stdout + done.stderr

    return once("site", build) / "html"


@pytest.fixture(scope="module")
def pages(html):
    """Articles and anchors by the place of their page; what is around them is on every page."""
    texts = {
        p.relative_to(html).as_posix(): p.read_text(encoding="utf-8") for p in html.rglob("*.html")
    }
    articles = {
        page: re.search(r"<article.*</article>", text, re.DOTALL) for page, text in texts.items()
    }
    return {
        page: (
            BeautifulSoup(articles[page][0] if articles[page] else text, "html.parser"),
            {unescape(anchor) for anchor in re.findall(r'\sid="([^"]+)"', text)},
        )
        for page, text in texts.items()
    }


def links(page, article):
    """Place and anchor of each link and image of a page that leads into the site."""
    for element in article.select("a[href], img[src]"):
        place, anchor = urldefrag(unquote(element.get("href") or element["src"]))
        if not place.startswith(("http:", "https:", "mailto:", "data:")):
            folder = posixpath.dirname(page)
            yield posixpath.normpath(posixpath.join(folder, place)) if place else page, anchor


def test_every_link_leads_to_a_page_and_an_anchor(html, pages):
    dead = [
        f"{page}: {place}#{anchor}"
        for page, (article, _) in pages.items()
        if not page.startswith("_")  # sources and templates of the theme
        for place, anchor in links(page, article)
        if not (html / place).is_file()
        or (anchor and place in pages and anchor not in pages[place][1])
    ]
    assert not dead, "\n".join(dead)


def test_equations_have_no_command_that_the_converter_does_not_know(pages):
    """It writes unknown commands and separators of columns as they are."""
    formulas = {
        page: [formula.get_text() for formula in article.select("math")]
        for page, (article, _) in pages.items()
    }
    assert formulas["theory/rays.html"]
    assert [text for texts in formulas.values() for text in texts if set(text) & set("\\&")] == []


def test_the_contents_do_not_list_decision_records(pages):
    """They are for contributors; the first page has one link to their index."""
    article, _ = pages["index.html"]
    records = {link["href"] for link in article.select("a") if "design/" in link["href"]}
    assert records == {"design/README.html"}


def test_names_of_quantities_lead_to_the_nomenclature(pages):
    """In parameters, columns and keys, each to the entry's anchor; other names lead nowhere."""
    _, anchors = pages["nomenclature.html"]
    seen = set()
    for page, (article, _) in pages.items():
        if not page.startswith("reference/"):
            continue
        keys = (
            article.select("td:first-child code") if page == "reference/configuration.html" else ()
        )
        for names in (*article.select("dt > strong"), *keys):
            linked = {a.get_text(): a["href"] for a in names.select("a")}
            for name in names.get_text().split(", "):
                entry = PAGES["quantity"](name)
                assert (name in linked) == (entry is not None), f"{page}: {name}"
                if entry:
                    place, anchor = urldefrag(linked[name])
                    assert place.endswith("nomenclature.html"), f"{page}: {name}"
                    assert anchor in anchors, f"{page}: {name} leads to {anchor}"
                    seen.add(entry)
    assert {"sound_speed", "travel_time", "range_sigma", "odometry_..._fraction"} <= seen


def test_a_continued_example_leads_to_that_of_its_package(pages):
    continued = [
        (posixpath.normpath(posixpath.join(posixpath.dirname(page), link["href"])), link.get_text())
        for page, (article, _) in pages.items()
        for words in article.select("p")
        if words.get_text().startswith("Continues the example of")
        for link in words.select("a")
    ]
    assert len(continued) > 80
    for place, package in continued:
        assert place == f"reference/api/{package.removeprefix('pymantaray.')}.html"
        assert ">>> " in pages[place][0].get_text(), package


def test_words_of_the_glossary_show_their_meaning(pages):
    """The first occurrence on a page links to the entry; the tooltip is the text of that entry."""
    glossary, anchors = pages["reference/glossary.html"]
    meanings = {
        term["id"]: term.find_next("dd").get_text(strip=True).replace("’", "'")
        for term in glossary.select("dt[id]")
    }
    seen = set()
    for page, (article, _) in pages.items():
        here = []
        for link in article.select("a.term"):
            place, anchor = urldefrag(link["href"])
            assert place.endswith("glossary.html"), page
            assert link["title"] == meanings[anchor], f"{page}: {link.get_text()}"
            here.append(anchor)
        assert len(here) == len(set(here)), f"{page}: a word is explained twice"
        seen |= set(here)
    assert seen <= anchors
    words = {"shadow", "weak", "blocked", "condition", "NEES", "lower-bound"}
    assert seen == {f"term-{word}" for word in words}


def test_notebooks_show_what_their_cells_print(pages):
    for name in ("study", "travel_times", "locate"):
        article, _ = pages[f"notebooks/{name}.html"]
        assert article.select("div.cell_output img"), name
        assert article.select("div.cell_output")[0].get_text(strip=True), name
        assert not article.select("div.stderr"), name


CUT = """() => {
  const links = document.querySelectorAll(".bd-sidebar-primary a, .bd-sidebar-secondary a");
  const isCut = (link) => {
    const sidebar = link.closest(".bd-sidebar-primary, .bd-sidebar-secondary");
    const margin = sidebar.getBoundingClientRect();
    const parts = [link, ...link.querySelectorAll("*")];
    const boxes = parts.flatMap((part) => [...part.getClientRects()]);
    return link.checkVisibility() && boxes.some((box) => box.right > margin.right + 1);
  };
  return [...links].filter(isCut).map((link) => link.textContent.trim());
}"""


@pytest.fixture(scope="module")
def chromium():
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if BROWSER is None:
        pytest.skip("no Chromium on this machine")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.mark.parametrize("width", [1100, 1440])
def test_contents_beside_a_page_are_not_cut(html, chromium, width):
    generated = html / "reference" / "api" / "generated"
    pages = [html / "reference" / "configuration.html", *sorted(generated.glob("*.html"))[::20]]
    page = chromium.new_page(viewport={"width": width, "height": 900})
    cut = {}
    for file in pages:
        page.goto(file.as_uri())
        cut[file.name] = page.evaluate(CUT)
    page.close()
    assert {name: links for name, links in cut.items() if links} == {}


KINDS_OF_PAGES = (
    "index",
    "how-to/own-trajectories",
    "theory/rays",
    "paper",
    "scripts/index",
    "scripts/plot_bent_ray",
    "notebooks/study",
    "reference/configuration",
    "reference/commands",
    "reference/glossary",
    "reference/api/generated/pymantaray.acoustics.find_eigenrays",
)


@pytest.mark.parametrize(("width", "scheme"), [(1440, "light"), (390, "dark")])
def test_pages_of_every_kind_are_accessible_and_fit_the_width(html, chromium, width, scheme):
    pytest.importorskip("axe_playwright_python", reason="axe-playwright-python is not installed")
    context = chromium.new_context(
        viewport={"width": width, "height": 900}, color_scheme=scheme, reduced_motion="reduce"
    )
    page = context.new_page()
    wrong = {}
    for name in KINDS_OF_PAGES:
        page.goto((html / f"{name}.html").as_uri())
        wrong[name] = (faults(page), max(0, overflow(page)))
        page.keyboard.press("Tab")  # the first stop leads past the navigation
        assert page.evaluate("document.activeElement.getAttribute('href')") == "#main-content", name
    context.close()
    assert {name: found for name, found in wrong.items() if found != ([], 0)} == {}


def test_scripts_of_the_gallery_are_in_their_order(pages):
    """Each of the ten is on the index; the bent ray is first."""
    article, _ = pages["scripts/index.html"]
    order = [link["href"] for link in article.select(".sphx-glr-thumbcontainer a")]
    assert order[0] == "plot_bent_ray.html"
    assert sorted(order) == sorted(
        f"{path.stem}.html" for path in (EXAMPLES / "gallery").glob("plot_*.py")
    )

"""
Lay out the sources of the built documentation: the Markdown pages as they are, an index of each
folder, the reference.

Run as ``python docs/site/stage.py build/docs-source``, a new folder.
"""

import re
import shutil
import sys
import tomllib
from pathlib import Path
from urllib.parse import urlsplit

import reference_pages

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
TITLES = {
    "tutorials": "Tutorials",
    "how-to": "How-to guides",
    "theory": "Theory",
    "reference": "Reference",
}
GENERATED = {"reference": ["api/index", "configuration", "choices", "commands", "glossary"]}
EXAMPLES = ROOT / "examples"


def stage(target: Path) -> None:
    """Write all sources below a folder."""
    pages = {
        path.relative_to(DOCS).as_posix(): path.read_text(encoding="utf-8") for path in own_pages()
    }
    entrances, contents = pages.pop("README.md"), pages.pop("contents.md")
    pages |= (
        reference_pages.configuration() | reference_pages.commands() | reference_pages.interface()
    )
    pages |= (
        reference_pages.choices() | reference_pages.glossary() | {"notebooks/index.md": notebooks()}
    )
    ordered = re.findall(r"\]\(([\w./-]+\.md)", contents)
    for folder, title in TITLES.items():
        pages[f"{folder}/index.md"] = index_page(folder, title, ordered, pages)
    pages["design/README.md"] = records(pages)
    pages["changelog.md"] = (
        (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").replace("](docs/", "](")
    )
    pages["index.md"] = landing(entrances, pages)
    for name, words in pages.items():
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        (target / name).write_text(without_outside_links(name, words), encoding="utf-8")
    without_pages = shutil.ignore_patterns("*.md")
    shutil.copytree(DOCS / "figures", target / "figures", ignore=without_pages, dirs_exist_ok=True)
    shutil.copytree(EXAMPLES / "notebooks", target / "notebooks", dirs_exist_ok=True)
    (target / "examples").mkdir(exist_ok=True)
    shutil.copy2(EXAMPLES / "locate_survey.py", target / "examples")  # a notebook runs it


def notebooks() -> str:
    """Index of the notebooks."""
    entries = sorted(path.stem for path in (EXAMPLES / "notebooks").glob("*.ipynb"))
    words = (
        "The build of this site runs these notebooks. They are in `examples/notebooks`."
        f" [Run them on Binder]({binder()})."
    )
    return f"# Notebooks\n\n{words}\n\n" + reference_pages.toctree(entries, "titlesonly")


def binder() -> str:
    """Address at which Binder runs the notebooks in the environment of ``.binder``."""
    name = urlsplit(repository()).path.strip("/")
    return f"https://mybinder.org/v2/gh/{name}/main?urlpath=lab/tree/examples/notebooks"


def without_outside_links(name: str, words: str) -> str:
    """Page whose links to files beside docs, which the site does not have, are their words."""
    out = "../" * (name.count("/") + 1)
    return re.sub(rf"(?<!!)\[([^]]*)\]\({re.escape(out)}[^)]*\)", r"\1", words)


def own_pages() -> list[Path]:
    """Markdown files of the documentation."""
    return sorted(path for path in DOCS.rglob("*.md") if "site" not in path.relative_to(DOCS).parts)


def index_page(folder: str, title: str, ordered: list[str], pages: dict[str, str]) -> str:
    """
    List of a folder's pages: in the order of docs/contents.md, others behind, by name.
    """
    there = [page for page in pages if page.startswith(f"{folder}/") and page.count("/") == 1]
    there.sort(key=lambda page: (ordered.index(page) if page in ordered else len(ordered), page))
    entries = [page.removeprefix(f"{folder}/").removesuffix(".md") for page in there]
    made = GENERATED.get(folder, [])
    own = [entry for entry in entries if entry not in made]
    return f"# {title}\n\n" + reference_pages.toctree([*made, *own], "titlesonly")


def records(pages: dict[str, str]) -> str:
    """Index of the decision records, outside the contents and the navigation of the site."""
    entries = [Path(page).stem for page in pages if page.startswith("design/0")]
    index = pages["design/README.md"]
    return f"---\norphan: true\n---\n\n{index}\n" + reference_pages.toctree(entries)


def landing(entrances: str, pages: dict[str, str]) -> str:
    """First page: how README begins, and where each reader starts."""
    begin = on_the_site((ROOT / "README.md").read_text(encoding="utf-8").split("\n## ")[0])
    top = [page.removesuffix(".md") for page in pages if "/" not in page and page != "changelog.md"]
    folders = [f"{folder}/index" for folder in TITLES]
    made = ", ".join(
        f"[{heading(pages[page])}]({page})"
        for page in (
            *(f"reference/{entry}.md" for entry in GENERATED["reference"]),
            "figures/README.md",
        )
    )
    rest = entrances.split("\n", 1)[1] + f"\nGenerated pages: {made}.\n"
    for folder, title in TITLES.items():  # the site has an index of each folder
        rest = rest.replace(f"contents.md#{title.lower().replace(' ', '-')}", f"{folder}/index.md")
    entries = [
        *folders,
        "scripts/index",
        "notebooks/index",
        "figures/README",
        *top,
        "changelog",
    ]
    return f"{begin}\n{rest}\n" + reference_pages.toctree(entries)


def on_the_site(words: str) -> str:
    """README with links to pages and figures of the site; links to other files stay as they are."""
    home = repository()
    raw = home.replace("github.com", "raw.githubusercontent.com")
    return words.replace(f"]({home}/blob/main/docs/", "](").replace(f"]({raw}/main/docs/", "](")


def repository() -> str:
    """Address of the repository."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return project["urls"]["Repository"]


def heading(page: str) -> str:
    """Title of a page."""
    return re.search(r"^# (.*)", page, re.MULTILINE)[1]


if __name__ == "__main__":
    stage(Path(sys.argv[1]))

"""
Lay out the sources of the built documentation: the Markdown pages as they are, an index of each
folder, the reference.

Run as ``python docs/site/stage.py build/docs-source``; files that do not change are not touched.
"""

import json
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
    """Write all sources below a folder, and take away what is no source any more."""
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
        write(target / name, without_outside_links(name, words))
    for figure in (DOCS / "figures").iterdir():
        (target / "figures").mkdir(exist_ok=True)
        if figure.suffix in {".png", ".csv"}:
            shutil.copy2(figure, target / "figures")
    for name in notebook_names():
        write(
            target / "notebooks" / name, (EXAMPLES / "notebooks" / name).read_text(encoding="utf-8")
        )
    script = "locate_survey.py"  # a notebook runs it
    write(target / "examples" / script, (EXAMPLES / script).read_text(encoding="utf-8"))
    for path in target.rglob("*.md"):
        if path.relative_to(target).as_posix() not in pages:
            path.unlink()


def notebook_names() -> list[str]:
    """Files of the notebooks."""
    return sorted(path.name for path in (EXAMPLES / "notebooks").glob("*.ipynb"))


def notebooks() -> str:
    """Index of the notebooks."""
    entries = [name.removesuffix(".ipynb") for name in notebook_names()]
    words = (
        "The build of this site runs these notebooks. They are in `examples/notebooks`."
        f" [Run them on Binder]({binder()})."
    )
    listing = "\n".join(f"- [{notebook_title(entry)}]({entry}.ipynb)" for entry in entries)
    return f"# Notebooks\n\n{words}\n\n{listing}\n\n" + reference_pages.toctree(entries)


def binder() -> str:
    """Address at which Binder runs the notebooks in the environment of ``.binder``."""
    name = urlsplit(repository()).path.strip("/")
    return f"https://mybinder.org/v2/gh/{name}/main?urlpath=lab/tree/examples/notebooks"


def notebook_title(name: str) -> str:
    """Title of a notebook, in its first cell."""
    cells = json.loads((EXAMPLES / "notebooks" / f"{name}.ipynb").read_text(encoding="utf-8"))[
        "cells"
    ]
    return heading("".join(cells[0]["source"]))


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
    own = [entry for entry in entries if entry not in GENERATED.get(folder, ())]
    listing = "\n".join(
        f"- [{heading(pages[f'{folder}/{entry}.md'])}]({entry}.md)"
        for entry in [*GENERATED.get(folder, ()), *own]
    )
    return f"# {title}\n\n{listing}\n\n" + reference_pages.toctree(
        [*GENERATED.get(folder, ()), *own]
    )


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


def write(path: Path, words: str) -> None:
    """Write a file unless it is there as it should be."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists() or path.read_text(encoding="utf-8") != words:
        path.write_text(words, encoding="utf-8")


if __name__ == "__main__":
    stage(Path(sys.argv[1]))

"""Chromium for tests of pages, and the faults that axe-core finds in a page."""

import shutil
from typing import Any

BROWSER = next(
    (
        path
        for name in ("chromium", "chromium-browser", "google-chrome")
        if (path := shutil.which(name))
    ),
    None,
)
"""Program of the browser, if there is one on this machine."""


def faults(page: Any) -> list[tuple[str, list[Any]]]:
    """Rules of accessibility that an open page violates, each with its first elements."""
    from axe_playwright_python.sync_playwright import Axe

    violations = Axe().run(page).response["violations"]
    return [(rule["id"], [node["target"] for node in rule["nodes"]][:3]) for rule in violations]


def overflow(page: Any) -> int:
    """Number of pixels by which an open page is wider than the window."""
    width: int = page.evaluate(
        "document.documentElement.scrollWidth - document.documentElement.clientWidth"
    )
    return width

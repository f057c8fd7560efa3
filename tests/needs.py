"""Applications that modules of tests need, so that they go with a deleted application."""

import re
from functools import cache
from pathlib import Path

TESTS = Path(__file__).parent
APPLICATIONS = TESTS.parent / "src" / "pymantaray" / "apps"
_IMPORT = re.compile(
    r"^(?:from|import) (?:pymantaray\.apps\.(?P<application>\w+)|(?P<own>\w+))", re.MULTILINE
)


def missing_applications(module: Path) -> set[str]:
    """Applications that a module of tests imports and that are not there."""
    return {name for name in _needed(module) if not (APPLICATIONS / name).is_dir()}


@cache
def _needed(module: Path) -> frozenset[str]:
    """Applications that a module imports at its top, itself or by other modules of the tests."""
    found = set[str]()
    for match in _IMPORT.finditer(module.read_text("utf-8")):
        if match["application"]:
            found.add(match["application"])
        elif (own := TESTS / f"{match['own']}.py").is_file() and own != module:
            found |= _needed(own)
    return frozenset(found)

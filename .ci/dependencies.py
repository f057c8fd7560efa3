"""
List the packages that `pip install pymantaray` brings, and those of each extra, with sizes and
licences from the metadata of the installed distributions.

    python .ci/dependencies.py [SECONDS]      SECONDS: processor time of the installation

All extras must be installed beside the package. The page goes to standard output.
"""

import argparse
import datetime as dt
import platform
import re
import sys
from importlib.metadata import Distribution, PackageNotFoundError, distribution

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

PACKAGE = "pymantaray"
COPYLEFT = re.compile(r"GPL|General Public|Lesser|MPL|Mozilla|EUPL|European Union Public")
GPL = re.compile(r"(?<!L)GPL|(?<!Lesser )General Public")
OWN_TITLES = {
    "Apache Software License": "Apache-2.0",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "BSD License": "BSD",
    "ISC License (ISCL)": "ISC",
    "MIT License": "MIT",
    "The MIT License (MIT)": "MIT",
    "Python Software Foundation License": "PSF",
    "GNU General Public License v3 (GPLv3)": "GPL-3.0",
}
"""Short names of licences that classifiers and files spell out."""

WRITER = "`.ci/dependencies.py` writes this page, also for `make release-check ARGS=--write`"
EXTRAS = (
    "Size and copyleft licences of what each extra adds. Whoever distributes a program together"
    " with a package under the GPL or EUPL must comply with that licence. MantaRay imports these"
    " packages only for what the extra is needed for."
)


def main() -> None:
    """Print the page."""
    parser = argparse.ArgumentParser(description=__doc__.strip().partition("\n")[0])
    parser.add_argument("seconds", nargs="?", type=float)
    print(page(parser.parse_args().seconds), end="")


def page(seconds: float | None) -> str:
    """Text of docs/reference/dependencies.md."""
    base = closure()
    where = f"{platform.system()} {platform.machine()}, Python {platform.python_version()}"
    lines = [
        "# Dependencies: sizes and licences",
        "",
        f"{WRITER} ({where}, {dt.datetime.now(dt.UTC).date()}).",
        "",
        f"`pip install pymantaray` brings {len(base) - 1} packages: {total(base)} MB on disk"
        + (f", {seconds:.0f} s of a processor after the download." if seconds else "."),
        weak_sentence(base),
        "",
        "| package | version | MB | licence |",
        "|---|---|---|---|",
        *(row(name) for name in sorted(base)),
        "",
        "## Extras",
        "",
        EXTRAS,
        "",
        "| extra | packages | MB | copyleft |",
        "|---|---|---|---|",
    ]
    for extra in sorted(distribution(PACKAGE).metadata.get_all("Provides-Extra") or []):
        more = closure(extra) - base
        found = ", ".join(f"{name}: {licence(name)}" for name in sorted(more) if copyleft(name))
        lines.append(f"| `{extra}` | {len(more)} | {total(more)} | {found or '-'} |")
    return "\n".join(lines) + "\n"


def weak_sentence(names: set[str]) -> str:
    """Sentence on the copyleft among packages, none of which may have the GPL."""
    strict = sorted(name for name in names if GPL.search(licence(name)))
    if strict:
        sys.exit(f"dependencies: {', '.join(strict)}: GPL; the package must do without them")
    weak = ", ".join(f"{name} ({licence(name)})" for name in sorted(names) if copyleft(name))
    return f"By their metadata, none has the GPL; weak copyleft: {weak or 'none'}."


def row(name: str) -> str:
    """One package of the table."""
    return f"| {name} | {distribution(name).version} | {size(name)} | {licence(name)} |"


def closure(extra: str = "") -> set[str]:
    """Installed packages that the package, with an extra, needs on this platform."""
    found, left = set(), [(PACKAGE, extra)]
    while left:
        name, wanted = left.pop()
        if (name, wanted) in found:
            continue
        found.add((name, wanted))
        for text in distribution(name).requires or []:
            requirement = Requirement(text)
            if requirement.marker and not requirement.marker.evaluate({"extra": wanted}):
                continue
            needed = canonicalize_name(requirement.name)
            left += [(needed, more) for more in ("", *requirement.extras)]
        left.append((name, ""))
    return {name for name, _ in found}


def copyleft(name: str) -> bool:
    """True if the licence of a package requires that changes to it are published."""
    return COPYLEFT.search(licence(name)) is not None


def licence(name: str) -> str:
    """
    Licence of an installed package: the expression of its metadata, else its classifiers, else the
    first line of its text.
    """
    of = distribution(name)
    if of.metadata.get("License-Expression"):
        return of.metadata["License-Expression"]
    titles = [
        text.rpartition(" :: ")[2]
        for text in of.metadata.get_all("Classifier") or []
        if text.startswith("License :: ")
    ]
    titles = titles or [(of.metadata.get("License") or first_line(of)).strip().partition("\n")[0]]
    if not titles[0]:
        sys.exit(f"dependencies: {name}: the metadata has no licence")
    return " or ".join(OWN_TITLES.get(title, title) for title in titles)


def first_line(of: Distribution) -> str:
    """First line of the licence file of a distribution; empty if it has none."""
    for path in of.files or []:
        if re.match(r"(LICEN[CS]E|COPYING)", path.name):
            return path.read_text().strip().partition("\n")[0]
    return ""


def size(name: str) -> float:
    """Size of the files of a package, with bytecode, to a tenth. [MB]"""
    files = [path.locate() for path in distribution(name).files or []]
    return round(sum(path.stat().st_size for path in files if path.exists()) / 1e6, 1)


def total(names: set[str]) -> int:
    """Size of several packages. [MB]"""
    return round(sum(size(name) for name in names))


if __name__ == "__main__":
    try:
        main()
    except PackageNotFoundError as missing:
        sys.exit(f"dependencies: {missing.name} is not installed; install all extras")

"""
Make the figures of the documentation again, by the commands that docs/figures/README.md shows
beneath each.

    python benchmarks/gallery.py [all | NAME...]     names of figures, such as atlas_fram; all:
    those marked as not run too
"""

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
GALLERY = ROOT / "docs" / "figures" / "README.md"
_SHELL = re.compile(r"^(<!-- not run: .* -->\n)?```sh\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def commands(page: str) -> list[tuple[list[str], bool, str]]:
    """Figures of each section of the gallery, whether they take long, and their commands."""
    sections = [(section, _SHELL.search(section)) for section in page.split("\n## ")[1:]]
    return [(re.findall(r"\]\((\w+)\.png\)", s), bool(m[1]), m[2]) for s, m in sections if m]


def main(names: list[str]) -> None:
    """Run the commands, each at most once."""
    environment = os.environ | {
        "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    }
    for figures, long, text in commands(GALLERY.read_text(encoding="utf-8")):
        asked = "all" in names or set(figures) & set(names)
        if asked or not (names or long):
            print("\n".join(f"docs/figures/{figure}.png" for figure in figures), flush=True)
            subprocess.run(
                ["bash", "-euo", "pipefail", "-c", text], cwd=ROOT, env=environment, check=True
            )


if __name__ == "__main__":
    main(sys.argv[1:])

"""
Draw the maps of docs/how-to/atlas.md: both synthetic regions, every fourth column.

    python benchmarks/atlas_figures.py [FOLDER]

The atlases go into a folder, by default ``runs/atlas``; one that is there already is drawn as it
is. About 3 minutes of CPU.
"""

import sys
from pathlib import Path

from pymantaray.apps.atlas import Atlas, open_atlas, run_atlas
from pymantaray.apps.atlas.figures import error_maps
from pymantaray.plotting.style import rendered
from pymantaray.records import whole_file

FIGURES = Path(__file__).resolve().parents[1] / "docs" / "figures"
MEAN, MIDDLE = 2, 1  # convention and distance


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for region in ("beaufort", "fram"):
        path = run_atlas(Atlas(f"synthetic:{region}", every=4), folder / f"{region}.nc")
        with open_atlas(path) as atlas:
            content = rendered(error_maps(atlas, MEAN, MIDDLE), ["png"])["png"]
        with whole_file(FIGURES / f"atlas_{region}.png") as temporary:
            temporary.write_bytes(content)
        print(FIGURES / f"atlas_{region}.png")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "runs/atlas"))

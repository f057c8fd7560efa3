"""
Draw the figures of scripts of the gallery.

    python benchmarks/gallery_figures.py examples/gallery/plot_bent_ray.py docs/figures/bent_ray.png
"""

import runpy
import sys

import matplotlib as mpl
from matplotlib.figure import Figure


def main(script: str, out: str) -> None:
    """Run a script and save the figure that it leaves in ``figure``."""
    mpl.use("agg")
    figure = runpy.run_path(script)["figure"]
    assert isinstance(figure, Figure)
    figure.savefig(out, dpi=200)


if __name__ == "__main__":
    main(*sys.argv[1:])

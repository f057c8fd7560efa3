"""
Draw the stages of a study for the documentation.

    python benchmarks/pipeline_figure.py docs/figures/pipeline.png
"""

import sys
from pathlib import Path

from pymantaray.apps.study.figures.pipeline import pipeline
from pymantaray.plotting.style import rendered

if __name__ == "__main__":
    Path(sys.argv[1]).write_bytes(rendered(pipeline(""), ("png",), dpi=200)["png"])

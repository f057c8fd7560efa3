"""
What moves on each page: its own script after what all share, the places that it fills, and the
numbers that it reads.
"""

import base64
import gzip
import json
import re
from html.parser import HTMLParser
from importlib.resources import files

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from plotly.offline import get_plotlyjs

from pymantaray.apps.atlas import write_atlas_page
from pymantaray.apps.replay.page import _explorer
from pymantaray.apps.study.comparison_page import _page, comparison_tables
from pymantaray.apps.study.figures.register import RunResults
from pymantaray.apps.study.page import run_page
from pymantaray.apps.sweep import write_sweep_page
from pymantaray.pages.page import Page

TEMPLATES = files("pymantaray.pages") / "templates"
SCRIPTS = {
    "run": "run.js",
    "comparison": "table.js",
    "sweep": "table.js",
    "replay": "table.js",
    "atlas": "atlas.js",
}
PACKAGES = {"run": "apps.study", "atlas": "apps.atlas"}


class Parts(HTMLParser):
    """
    Names of a page's elements in their order, those that are hidden, its links to them, and its
    scripts by their names.
    """

    def __init__(self, text):
        super().__init__()
        self.names, self.scripts, self.within = [], [], None
        self.hidden, self.links, self.text = set(), [], text
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        name = dict(attrs).get("id")
        self.names += [name] if name else []
        self.hidden |= {name or tag} if "hidden" in dict(attrs) else set()
        link = dict(attrs).get("href", "")
        self.links += [link[1:]] if link.startswith("#") and "hidden" not in dict(attrs) else []
        self.within = (name, dict(attrs).get("type")) if tag == "script" else None

    def handle_endtag(self, tag):
        self.within = None if tag == "script" else self.within

    def handle_data(self, data):
        if self.within is not None:
            self.scripts.append((*self.within, data))


def unpacked(text):
    return gzip.decompress(base64.b64decode(text)).decode()


def sweep_page(_, folder):
    table = pd.DataFrame(
        {"x": [1.0, 2.0], "condition": "straight", "point": [0, 1], "status": "done"}
    )
    table = table.assign(error="", rmse_m=[3.0, 4.0], key="k")
    return write_sweep_page(table, ["x"], folder, title="made up").read_text(encoding="utf-8")


def atlas_page(_, folder):
    error = ("time", "lat", "lon", "convention", "pair", "distance"), np.ones((1, 2, 2, 1, 1, 1))
    depths = {"transmitter_depth": ("pair", [20.0]), "receiver_depth": ("pair", [200.0])}
    axes = {"lat": [77.0, 78.0], "lon": [0.0, 1.0], "convention": ["chord"], "distance": [2e3]}
    time = {"time": [np.datetime64("2014-07-15", "ns")]}
    attrs = {"title": "Atlas of Test Sea", "ocean": "Test Sea", "synthetic": 1}
    atlas = xr.Dataset({"worst_range_error": error}, axes | time | depths, attrs)
    return write_atlas_page(atlas, [], folder).read_text(encoding="utf-8")


def replay_page(*_):
    numbers = {
        "time_s": [0.0, 45.0, 90.0],
        "distance_m": 3e3,
        "residual_m": 1.0,
        "residual_s": 1e-3,
        "measured_s": 2.0,
    }
    names = {"pair": "A and B", "source": "A", "receiver": "B"}
    bounces = {"surface_bounces": [0, 1, None], "bottom_bounces": [0, 0, None]}
    events = pd.DataFrame(numbers | names).assign(**pd.DataFrame(bounces, dtype="Int64"))
    return Page("Replay", explorer=_explorer(events)).html()


def comparison_page(results, _):
    runs = {"one": results, "other": results}
    return _page(runs, comparison_tables(runs), []).html()


PAGES = {
    "run": lambda results, _: run_page(results, "[]").html(),
    "comparison": comparison_page,
    "sweep": sweep_page,
    "atlas": atlas_page,
    "replay": replay_page,
}


@pytest.fixture(params=PAGES)
def page(request, run, tmp_path):
    """Name of a page and its parts."""
    return request.param, Parts(PAGES[request.param](RunResults(run), tmp_path))


def test_a_page_has_its_own_script_after_what_all_share(page):
    name, parts = page
    (_, _, numbers), (_, _, library), (_, _, script), (_, _, tables) = parts.scripts
    assert [(n, t) for n, t, _ in parts.scripts] == [
        ("explorer", "text/plain"), ("library", "text/plain"), (None, None), (None, None),
    ]  # fmt: skip
    assert tables.strip() == (TEMPLATES / "tables.js").read_text(encoding="utf-8").strip()
    assert unpacked(library) == get_plotlyjs()
    expected = [
        (files(f"pymantaray.{package}") / "templates" / file).read_text(encoding="utf-8").rstrip()
        for package, file in (
            ("pages", "plots.js"),
            *([("apps.study", "run_scene.js")] if name == "run" else []),
            (PACKAGES.get(name, "pages"), SCRIPTS[name]),
        )
    ]
    assert script.strip() == "".join(expected)
    assert json.loads(unpacked(numbers))


def test_all_that_a_script_fills_and_reads_is_on_its_page(page):
    _, parts = page
    script = parts.scripts[2][2]
    places = set(re.findall(r'\b(?:at|draw|fill|unpacked)\("([\w-]+)"', script))
    assert places
    assert len(parts.names) == len(set(parts.names))
    assert places <= set(parts.names)
    taken = re.findall(r"const \{([^}]*)\} = data\b", script)
    read = {word.strip() for words in taken for word in words.split(",")}
    read |= set(re.findall(r"\bdata\.(\w+)", script))
    assert read == set(json.loads(unpacked(parts.scripts[0][2])))


def test_bounces_of_a_replay_are_words():
    values = json.loads(unpacked(Parts(replay_page()).scripts[0][2]))["columns"]["bounces"]
    assert values == ["0 bounces", "1 bounce", "none predicted"]


def test_without_a_script_nothing_is_dead(page):
    """The interactive part and the link to it are hidden until the script shows them."""
    _, parts = page
    assert "look" in parts.hidden
    assert set(parts.links) <= set(parts.names) - {"look"}
    assert "<noscript>" in parts.text
    own = parts.text.partition('<section id="look"')
    rest = own[0] + own[2].partition("</section>")[2].partition("<script")[0]
    assert not re.search("<(button|select|input|canvas)", rest)
    assert all(" open" in part for part in re.findall('<details class="part"[^>]*>', rest))

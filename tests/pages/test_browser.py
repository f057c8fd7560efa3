"""
Every kind of page in a real browser: it draws without a word on the console, and every control does
what it says.
"""

import shutil
from functools import partial
from io import BytesIO
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from browser import BROWSER, faults, overflow
from PIL import Image

from pymantaray.apps.atlas import write_atlas_page
from pymantaray.apps.locate import write_location_page
from pymantaray.apps.plan import write_plan_page
from pymantaray.apps.replay import write_replay
from pymantaray.apps.study import write_comparison, write_report
from pymantaray.apps.sweep import write_sweep_page

pytest.importorskip(
    "axe_playwright_python.sync_playwright", reason="axe-playwright-python is not installed"
)
playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine"),
]
HARMLESS = ("GPU stall", "Canvas2D: Multiple readback")  # what software drawing says of its speed


@pytest.fixture(scope="module")
def page_file(tiny_run_folder, once):
    def build(folder):
        shutil.copytree(tiny_run_folder, folder)
        write_report(folder, formats=["84mm"])

    return once("browser", build) / "index.html"


@pytest.fixture(scope="module")
def table_file(tmp_path_factory):
    """A sweep over two fields whose first number is their sum."""
    rows = [
        (x, y, c)
        for x in (0.5, 1.0, 2.0)
        for y in ("near", "far")
        for c in ("straight", "refracted")
    ]
    table = pd.DataFrame(rows, columns=["noise.range_sigma", "place", "condition"])
    table = table.assign(
        point=table.index // 2, status="done", error="", rmse_m=np.arange(12.0) + 1.0, key="k"
    )
    folder = tmp_path_factory.mktemp("sweep")
    return write_sweep_page(table, ["noise.range_sigma", "place"], folder, title="made up")


DRAWN = "document.getElementById('chart').data.map((t) => [t.name, t.x, t.y])"
ATLAS = 1.0 + np.arange(2 * 3 * 4 * 2 * 2 * 2.0).reshape(2, 3, 4, 2, 2, 2)


@pytest.fixture(scope="module")
def atlas_file(tmp_path_factory):
    """An atlas whose errors count its links, with one place without a path."""
    error = ATLAS.copy()
    error[:, 1, 1] = np.nan
    places = {"lat": 77.0 + 0.5 * np.arange(3), "lon": -2.0 + np.arange(4)}
    atlas = xr.Dataset(
        {"worst_range_error": (("time", "lat", "lon", "convention", "pair", "distance"), error)},
        places
        | {
            "time": np.datetime64("2014-07-15T12", "ns") + np.timedelta64(1, "D") * np.arange(2),
            "convention": ["transmitter", "chord"],
            "distance": [2e3, 5e3],
            "transmitter_depth": ("pair", [20.0, 20.0]),
            "receiver_depth": ("pair", [20.0, 800.0]),
        },
        {"title": "Atlas of Test Sea", "ocean": "Test Sea", "synthetic": 1},
    )
    return write_atlas_page(atlas, [], tmp_path_factory.mktemp("atlas"))


@pytest.fixture(scope="module")
def comparison_file(run_folder, made_run, once):
    """Of two runs that differ in the number of their realizations."""

    def build(folder):
        folder.mkdir()
        other = made_run(realizations=2).write(folder / "other")
        write_comparison([run_folder, other], folder / "both", formats=["84mm"])

    return once("comparison", build) / "both" / "index.html"


@pytest.fixture(scope="module")
def replay_file(made_replay, once):
    return once("replay-page", partial(write_replay, made_replay, formats=["84mm"])) / "index.html"


@pytest.fixture(scope="module")
def plan_file(made_plan, once):
    build = partial(write_plan_page, made_plan, formats=["84mm"])
    return once("plan-page", build) / "index.html"


@pytest.fixture(params=[(1440, "light"), (390, "dark")], ids=["wide", "narrow and dark"])
def plan_opened(request, chromium, plan_file):
    yield from open_page(chromium, plan_file, *request.param)


@pytest.fixture(params=[(1440, "light"), (390, "dark")], ids=["wide", "narrow and dark"])
def comparison_opened(request, chromium, comparison_file):
    yield from open_page(chromium, comparison_file, *request.param)


@pytest.fixture(params=[(1440, "light"), (390, "dark")], ids=["wide", "narrow and dark"])
def replay_opened(request, chromium, replay_file):
    yield from open_page(chromium, replay_file, *request.param)


@pytest.fixture(params=[(1440, "light"), (390, "dark")], ids=["wide", "narrow and dark"])
def atlas_opened(request, chromium, atlas_file):
    yield from open_page(chromium, atlas_file, *request.param)


@pytest.fixture(scope="module")
def chromium():
    with playwright.sync_playwright() as driver:
        drawing = [
            "--no-sandbox",
            "--use-gl=angle",
            "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader",
        ]
        browser = driver.chromium.launch(executable_path=BROWSER, args=drawing)
        yield browser
        browser.close()


@pytest.fixture(params=[(1440, "light"), (390, "dark")], ids=["wide", "narrow and dark"])
def opened(request, chromium, page_file):
    yield from open_page(chromium, page_file, *request.param)


WIDE = pytest.mark.parametrize("opened", [(1440, "light")], ids=["wide"], indirect=True)
"""Of what does not depend on the width: controls are the same elements at each."""


@pytest.fixture(scope="module")
def atlas_page(chromium, atlas_file):
    """Page whose functions can be called."""
    for opened in open_page(chromium, atlas_file, 1440, "light"):
        yield opened.page


@pytest.fixture(params=[(1440, "light"), (390, "dark")], ids=["wide", "narrow and dark"])
def table_opened(request, chromium, table_file):
    yield from open_page(chromium, table_file, *request.param)


SIDEWAYS = (
    "[...document.querySelectorAll('.wide')].filter(e => e.scrollWidth > e.clientWidth).map(e =>"
    " [e.innerText.slice(0, 40), e.scrollWidth, e.clientWidth])"
)


UNFOLD = "document.querySelectorAll('.part').forEach((part) => { part.open = true; })"


def open_page(chromium, file, width, scheme):
    context = chromium.new_context(
        viewport={"width": width, "height": 900}, color_scheme=scheme, reduced_motion="reduce"
    )
    page, said, asked = context.new_page(), [], []
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(file.as_uri())
    page.wait_for_selector("html[data-ready=yes]", timeout=120_000)
    page.evaluate(UNFOLD)
    yield SimpleNamespace(page=page, said=said, asked=asked)
    context.close()


def fleet_markers(page):
    """East of the vehicles as drawn."""
    return page.evaluate(
        "document.getElementById('fleet').data.find((t) => t.mode === 'markers+text').x"
    )


def check_quiet_and_fitting(opened, page_file):
    assert [line for line in opened.said if not any(known in line for known in HARMLESS)] == []
    assert [url for url in opened.asked if not url.startswith(("data:", "blob:"))] == [
        page_file.as_uri()
    ]
    assert page_file.stat().st_size < 10e6
    assert overflow(opened.page) <= 0


def check_keyboard(page):
    """Every control of the moving part is reached by tabulator, in the page's order."""
    controls = (
        "[...document.querySelectorAll('#look :is(select, input, button)')].filter((c) =>"
        " c.checkVisibility())"
    )
    count = page.evaluate(f"{controls}.length")
    page.evaluate("document.body.tabIndex = -1; document.body.focus()")
    order = []
    for _ in range(count + 60):  # besides links and tables that scroll
        page.keyboard.press("Tab")
        at = page.evaluate(f"{controls}.indexOf(document.activeElement)")
        order += [at] if at >= 0 and at not in order else []
    page.evaluate("document.body.removeAttribute('tabindex')")
    assert order == list(range(count))


def check_dark(page):
    """Charts have the ink and paper of the page's scheme, and follow when it changes."""
    for scheme in ("dark", "light"):
        page.emulate_media(color_scheme=scheme)
        page.wait_for_function(
            """() => {
              const own = getComputedStyle(document.body);
              const { paper_bgcolor, font } = document.getElementById("chart").layout;
              const part = (hex, i) => parseInt(hex.slice(i, i + 2), 16);
              const rgb = (hex) => `rgb(${[1, 3, 5].map((i) => part(hex, i)).join(", ")})`;
              return rgb(paper_bgcolor) === own.backgroundColor && rgb(font.color) === own.color;
            }"""
        )


def contrast(*colours):
    """Ratio of the luminances of two colours, as WCAG 2 defines it."""

    def luminance(colour):
        rgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
        linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
        return float(linear @ [0.2126, 0.7152, 0.0722])

    dim, bright = sorted(map(luminance, colours))
    return (bright + 0.05) / (dim + 0.05)


def check_page(opened, page_file):
    """
    A page draws without errors, requests and faults of axe, by keyboard, and in both schemes;
    return it.
    """
    check_quiet_and_fitting(opened, page_file)
    assert faults(opened.page) == []
    check_keyboard(opened.page)
    check_dark(opened.page)
    return opened.page


def test_it_draws_without_errors_or_requests_and_fits_the_width(opened, page_file):
    check_quiet_and_fitting(opened, page_file)
    assert faults(opened.page) == []
    check_keyboard(opened.page)


def test_a_sweep_draws_without_errors_and_by_keyboard(table_opened, table_file):
    page = check_page(table_opened, table_file)
    # the other key is fixed, so that each line has one point at each place
    assert {name: y for name, _, y in page.evaluate(DRAWN)} == {
        "straight": [1, 5, 9],
        "refracted": [2, 6, 10],
    }
    modes = "document.getElementById('chart').data.map((t) => t.mode)"
    assert page.evaluate(modes) == ["lines+markers"] * 2
    assert page.inner_text("#per") == "One line per"
    menu = page.locator("#only select")
    assert menu.evaluate("(m) => [...m.options].map((o) => o.text)") == ["all", "near", "far"]
    menu.select_option("all")
    assert page.inner_text("#per") == "One colour per"  # several points at one place are no line
    assert {name: y for name, _, y in page.evaluate(DRAWN)} == {
        "straight": [1, 3, 5, 7, 9, 11],
        "refracted": [2, 4, 6, 8, 10, 12],
    }
    page.focus("#each")
    page.keyboard.press("End")
    assert [(name, y) for name, _, y in page.evaluate(DRAWN)] == [
        ("near", [1, 5, 9]),
        ("far", [3, 7, 11]),
    ]
    page.focus("#only select")
    page.keyboard.press("End")
    assert page.inner_text("#told") == "6 of 12 rows"
    assert page.evaluate(DRAWN)[1] == ["far", [0.5, 1, 2], [4, 8, 12]]
    assert page.evaluate(modes) == ["lines+markers"] * 2


def test_a_comparison_draws_without_errors_and_by_keyboard(comparison_opened, comparison_file):
    page = check_page(comparison_opened, comparison_file)
    table = pd.read_csv(comparison_file.parent / "tables" / "ate_pooled.csv").set_index(
        ["condition", "quantity"]
    )
    runs = list(table.columns)

    def expected(quantity):
        return {
            condition: [runs, pytest.approx(list(table.loc[condition, quantity]), rel=1e-5)]
            for condition in ("odometry", "straight", "refracted")
        }

    def drawn():
        return {name: [x, y] for name, x, y in page.evaluate(DRAWN)}

    assert drawn() == expected("mean_m")
    page.focus("#up")
    page.keyboard.press("End")
    assert drawn() == expected("p95_m")
    page.focus("#logarithmic")
    page.keyboard.press("Space")
    assert page.evaluate("document.getElementById('chart').layout.yaxis.type") == "log"
    page.focus("#across")
    page.keyboard.press("End")
    assert {tuple(x) for x, _ in drawn().values()} == {(2, 3)}  # realizations


def test_a_replay_draws_without_errors_and_by_keyboard(replay_opened, replay_file):
    page = check_page(replay_opened, replay_file)
    direct, bounced = page.evaluate(DRAWN)
    assert (direct[0], bounced[0]) == ("0 bounces", "1 bounce")
    np.testing.assert_allclose(direct[2], 3.0 * np.arange(20))
    np.testing.assert_allclose(bounced[1], 45.0 * (2.0 * np.arange(20) + 1.0) / 3600.0, rtol=1e-5)
    page.focus("#up")
    page.keyboard.press("ArrowDown")
    np.testing.assert_allclose(page.evaluate(DRAWN)[0][2], 2e-3 * np.arange(20))
    page.focus("#each")
    page.keyboard.press("End")
    assert [name for name, _, _ in page.evaluate(DRAWN)] == ["A", "B"]
    page.focus("#only select")
    page.keyboard.press("End")
    assert page.inner_text("#told") == "20 of 40 rows"
    if page.viewport_size["width"] == 1440:
        assert page.evaluate(SIDEWAYS) == []


def test_a_plan_draws_without_errors_and_by_keyboard(plan_opened, plan_file):
    page = check_page(plan_opened, plan_file)
    assert (
        page.evaluate("[...document.images].filter((i) => i.complete && i.naturalWidth > 0).length")
        >= 4
    )
    table = pd.read_csv(plan_file.parent / "tables" / "designs.csv")

    def expected(column, across):
        hours = sorted(table["mission.ping_interval_h"].unique())
        rows = [
            table[table["mission.ping_interval_h"] == h].sort_values("landmarks.T.depth")
            for h in hours
        ]
        return [(sorted(part[across]), sorted(part[column])) for part in rows]

    def drawn():
        return [(sorted(x), sorted(y)) for _, x, y in page.evaluate(DRAWN)]

    for control, column, across in (
        (None, "error_m", "landmarks.T.depth"),
        ("#across", "error_m", "lost_percent"),
    ):
        if control:
            page.select_option(control, across)
        assert drawn() == [
            (pytest.approx(x, rel=1e-5), pytest.approx(y, rel=1e-5))
            for x, y in expected(column, across)
        ]
    page.focus("#up")
    page.keyboard.press("ArrowDown")
    assert drawn() == [
        (pytest.approx(x, rel=1e-5), pytest.approx(y, rel=1e-5))
        for x, y in expected("rmse_m", "lost_percent")
    ]


@pytest.fixture(scope="module")
def location_file(made_location, once):
    build = partial(write_location_page, made_location, formats=["84mm"])
    return once("located-page", build) / "index.html"


@pytest.mark.parametrize("width", [1440, 390])
def test_located_nodes_are_readable_at_any_width(chromium, location_file, width):
    """The page has no script, so that nothing has to be waited for."""
    context = chromium.new_context(viewport={"width": width, "height": 900})
    page, said, asked = context.new_page(), [], []
    page.on("console", lambda message: said.append(message.text))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(location_file.as_uri())
    check_quiet_and_fitting(SimpleNamespace(page=page, said=said, asked=asked), location_file)
    assert faults(page) == []
    assert page.locator("img").count() == 3
    context.close()


NAMES = [
    "constructor",
    "<b>bold</b>",
    '<a href="//b">A&amp;B</a>',
    "%{y}",
    *("n" * 63 + c for c in "ab"),
]


def test_names_of_others_are_plain_and_short_in_figures(chromium, tmp_path):
    """Plotly reads tags, entities and templates, and long names would leave no room."""
    rows = pd.DataFrame({"vehicle": NAMES, "condition": "straight", "point": range(len(NAMES))})
    table = rows.assign(status="done", error="", rmse_m=np.arange(1.0, len(NAMES) + 1.0), key="k")
    file = write_sweep_page(table, ["vehicle"], tmp_path, title="made up")
    for opened in open_page(chromium, file, 390, "light"):
        page = opened.page
        page.select_option("#each", "vehicle")
        check_quiet_and_fitting(opened, file)
        legend = page.locator("#chart .legendtext").all_text_contents()
        plain = [text.replace("\u200b", "") for text in legend]
        assert sorted(plain[:4]) == sorted(NAMES[:4])
        assert len(set(plain)) == len(NAMES)
        assert max(map(len, plain)) <= 34
        assert page.locator("#chart svg a").count() == 0
        assert page.evaluate("document.getElementById('chart')._fullLayout._size.h") > 100
        # the scene of a fleet looks letters up by these names
        named = page.evaluate(f"{NAMES}.map((name) => namesInFigure([name]).get(name) in {{}})")
        assert named == [False] * len(NAMES)


def test_narrow_tables_are_beside_each_other_on_a_wide_screen(chromium, replay_file):
    tops = (
        "[...document.querySelectorAll('#tables > .table')].map((e) =>"
        " e.getBoundingClientRect().top)"
    )
    for width, beside in ((1440, False), (2560, True)):
        for opened in open_page(chromium, replay_file, width, "light"):
            places = opened.page.evaluate(tops)
            assert len(places) > 3
            assert (len(set(places)) < len(places)) == beside
            assert overflow(opened.page) <= 0


def test_more_results_are_beside_the_lead_on_a_wide_screen(chromium, page_file):
    place = "document.querySelector('.answer {}').getBoundingClientRect()"
    for width, beside in ((1440, False), (2560, True)):
        for opened in open_page(chromium, page_file, width, "light"):
            table, figure = (
                opened.page.evaluate(place.format(one)) for one in ("table", "figure img")
            )
            assert (table["left"] > figure["right"]) == beside
            assert (table["top"] > figure["bottom"]) != beside
            assert table["right"] > 0.85 * width or not beside


def test_a_replay_printed_at_once_has_all_its_figures(chromium, replay_file, tmp_path):
    page = chromium.new_page()
    page.goto(replay_file.as_uri())
    printed = page.pdf()
    page.close()
    names = sorted((replay_file.parent / "figures").glob("*.png"))
    assert printed.count(b"/Subtype /Image") >= len(names) == 4


def test_a_browser_that_cannot_unpack_says_so_and_shows_the_rest(chromium, table_file):
    page, said = chromium.new_page(), []
    page.on("pageerror", lambda error: said.append(str(error)))
    page.add_init_script("delete window.DecompressionStream")
    page.goto(table_file.as_uri())
    page.wait_for_selector("p.note:has-text('newer browser')")
    assert said == []
    assert page.locator("table").count() > 0
    page.close()


def test_an_atlas_draws_without_errors_and_by_keyboard(atlas_opened, atlas_file):
    check_quiet_and_fitting(atlas_opened, atlas_file)
    page = atlas_opened.page
    assert faults(page) == []
    check_keyboard(page)

    def drawn():
        return np.array(
            page.evaluate("document.getElementById('map').data[0].customdata"), dtype=float
        )

    scale = page.evaluate(
        "['xaxis', 'yaxis'].map((a) => document.getElementById('map')._fullLayout[a]"
        ").map((a) => a._length / Math.abs(a.range[1] - a.range[0]))"
    )
    assert scale[1] / scale[0] == pytest.approx(1.0 / np.cos(np.radians(77.5)), rel=1e-3)
    expected = ATLAS.max(axis=4)  # the worst of all depths
    known = np.isfinite(drawn())
    assert (~known).sum() == 1
    np.testing.assert_array_equal(drawn()[known], expected[0, :, :, 0, 0][known])
    for control in ("#distance", "#convention", "#time"):
        page.focus(control)
        page.keyboard.press("End")
    np.testing.assert_array_equal(drawn()[known], expected[1, :, :, 1, 1][known])
    page.focus("#pair")
    page.keyboard.press("ArrowDown")
    np.testing.assert_array_equal(drawn()[known], ATLAS[1, :, :, 1, 0, 1][known])
    for control in ("#lat", "#lon"):
        page.focus(control)
        page.keyboard.press("Home")
    assert page.inner_text("#here").endswith(f"{ATLAS[1, 0, 0, 1, 0, 1]:.2f} m")
    lines = page.evaluate("document.getElementById('over-time').data.map((t) => t.y)")
    np.testing.assert_array_equal(lines, ATLAS[:, 0, 0, :, 0, 1].T)


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (0.3, 40.0, [0.5, 1, 2, 5, 10, 20]),
        (2.1, 4.9, [2.5, 3, 3.5, 4, 4.5]),
        (51.2, 51.9, [51.2, 51.4, 51.6, 51.8]),
        (900.0, 30000.0, [1000, 2000, 5000, 10000, 20000]),
        (3.0, 3.0, [3]),
    ],
)
def test_the_scale_of_an_atlas_has_numbers_whatever_its_span(atlas_page, low, high, expected):
    ticks = atlas_page.evaluate(f"logTicks({low}, {high})")
    if len(ticks) == len(expected):
        np.testing.assert_allclose(ticks, expected)
    assert all(low * (1 - 1e-9) <= tick <= high * (1 + 1e-9) for tick in ticks)
    assert min(3, len(expected)) <= len(ticks) <= 9


def test_the_map_of_an_atlas_has_numbers_beside_its_colours(atlas_opened):
    bar = atlas_opened.page.evaluate("document.getElementById('map').data[0].colorbar")
    assert len(bar["tickvals"]) >= 3
    np.testing.assert_allclose(
        10.0 ** np.array(bar["tickvals"]), np.array(bar["ticktext"], dtype=float), rtol=5e-3
    )


@pytest.mark.parametrize(
    ("hours", "words"),
    [
        ([0.0, 1 / 12, 0.25, 24.0], ["0 h 00 min", "0 h 05 min", "0 h 15 min", "24 h 00 min"]),
        ([0.0, 0.005556, 1.999722], ["0 h 00 min 00 s", "0 h 00 min 20 s", "1 h 59 min 59 s"]),
        ([1.999999, 167.99999], ["2 h 00 min", "168 h 00 min"]),
    ],
)
def test_times_are_as_fine_as_in_the_data(atlas_page, hours, words):
    assert atlas_page.evaluate(f"{hours}.map(clock({hours}))") == words


def test_the_slider_begins_at_the_first_ping_with_rays(opened):
    first = opened.page.evaluate(
        "(async () => { const data = JSON.parse(await unpacked('explorer'));"
        " const pings = data.rays.map((ray) => data.links.ping[ray.link]);"
        " return data.fleet.ping[Math.min(...pings)]; })()"
    )
    assert int(opened.page.input_value("#time")) == first


@pytest.mark.parametrize("kind", ["page", "comparison", "replay", "plan", "location"])
def test_every_figure_fits_a_narrow_screen(chromium, request, kind):
    """It has its layout for one column there, and its own in print."""
    page = chromium.new_page(viewport={"width": 390, "height": 844})
    page.goto(request.getfixturevalue(f"{kind}_file").as_uri())
    page.evaluate("document.querySelectorAll('details').forEach((part) => { part.open = true; })")
    sizes = "[...document.images].map((image) => [image.width, image.naturalWidth])"
    page.wait_for_function("[...document.images].every((image) => image.complete)")
    narrow = page.evaluate(sizes)
    assert len(narrow) >= 3
    assert all(200 < width <= 360 and pixels < 800 for width, pixels in narrow), narrow
    page.emulate_media(media="print")  # the browser changes its images soon
    page.wait_for_function("[...document.images].some((image) => image.naturalWidth > 1200)")
    page.close()


@WIDE
def test_the_slider_moves_the_fleet_by_keyboard(opened):
    page = opened.page
    page.focus("#time")
    page.keyboard.press("Home")
    before, hour = fleet_markers(page), page.inner_text("#hour")
    for _ in range(5):
        page.keyboard.press("ArrowRight")
    assert fleet_markers(page) != before
    assert page.inner_text("#hour") != hour
    assert page.get_attribute("#time", "aria-valuetext") == page.inner_text("#hour")


@WIDE
def test_play_and_pings_by_keyboard(opened):
    page = opened.page
    page.focus("#time")
    page.keyboard.press("Home")
    start = page.input_value("#time")
    page.focus("#play")
    page.keyboard.press("Enter")
    assert page.get_attribute("#play", "aria-pressed") == "true"
    page.wait_for_function(f"document.getElementById('time').value > {start}")
    page.keyboard.press("Enter")
    assert page.inner_text("#play") == "Play"
    page.focus("#after")
    page.keyboard.press("Enter")
    ping = page.inner_text("#hour")
    page.focus("#before")
    page.keyboard.press("Enter")
    assert page.inner_text("#hour") != ping or page.input_value("#time") != start


@WIDE
def test_a_link_chosen_by_keyboard_shows_its_rays_and_numbers(opened):
    page = opened.page
    page.select_option("#which", "rays")
    assert page.locator("#links option").count() > 1
    page.focus("#links")
    page.keyboard.press("Home")
    page.keyboard.press("ArrowDown")
    chosen = page.locator("#links option:checked").inner_text()
    pair = chosen.strip("* ").split(":")[0]
    assert page.inner_text("#link").startswith(pair)
    assert "Ray 1:" in page.inner_text("#link")
    traces = page.evaluate("document.getElementById('rays').data.map((t) => t.type)")
    assert traces[0] == "heatmap"
    assert traces.count("scatter") >= 2  # a ray and the sea bed


@WIDE
def test_every_link_of_a_small_run_has_its_rays_at_one_hour(opened):
    page = opened.page
    stars = page.locator("#links option").all_inner_texts()
    assert not any(text.startswith("*") for text in stars)
    for step in ("Home", "End"):
        page.focus("#time")
        page.keyboard.press(step)
        page.focus("#after")
        page.keyboard.press("Enter")
        page.focus("#links")
        page.keyboard.press(step)
        assert not page.locator("#command").is_visible()
        assert page.inner_text("#link").split(", ")[1].startswith(page.inner_text("#hour") + ":")
        assert page.evaluate("document.getElementById('rays').data[0].type") == "heatmap"
    page.select_option("#which", "rays")
    page.focus("#links")
    for step in ("Home", "End"):
        page.keyboard.press(step)
        assert page.inner_text("#link").split(", ")[1].startswith(page.inner_text("#hour") + ":")


def pixels_of(points, camera, height):
    """
    Places of points in the picture from its middle, for a camera that sees 45 degrees over its
    height.
    """
    eye, center = (np.array([camera[name][k] for k in "xyz"]) for name in ("eye", "center"))
    forward = (center - eye) / np.linalg.norm(center - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    away = points - eye
    screen = (
        np.stack([away @ right, -(away @ np.cross(right, forward))], axis=-1)
        / (away @ forward)[:, None]
    )
    return screen * height / 2.0 / np.tan(np.radians(22.5))


def scene_of(page):
    """Scene of the fleet as it is laid out, and width and height of its panel."""
    return page.evaluate(
        "(() => { const { scene, margin } = at('fleet').layout; return { scene, width:"
        " at('fleet').clientWidth, height: at('fleet').clientHeight - margin.b, ranges: ['xaxis',"
        " 'yaxis', 'zaxis'].map((a) => scene[a].range), traces: at('fleet').data.filter((t) =>"
        " t.mode === 'markers+text').map((t) => [t.x, t.y, t.z, t.text, t.textposition]) }; })()"
    )


def test_the_scene_of_the_fleet_fills_its_panel(opened):
    shown = scene_of(opened.page)
    sides = np.array([shown["scene"]["aspectratio"][k] for k in "xyz"])
    corners = (
        np.stack(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5]), axis=-1).reshape(-1, 3)
    ) * sides
    pixels = pixels_of(corners, shown["scene"]["camera"], shown["height"])
    size = np.ptp(pixels, axis=0) / [shown["width"], shown["height"]]
    assert (size < 1.0).all()
    assert size.max() > 0.65
    np.testing.assert_allclose(
        pixels.min(axis=0) + pixels.max(axis=0), 0.0, atol=5.0
    )  # in the middle


def test_names_of_vehicles_stand_apart(opened):
    """
    Boxes of the names as plotly writes them: beside, above or below a marker, at twelve pixels.
    """
    shown = scene_of(opened.page)
    sides = np.array([shown["scene"]["aspectratio"][k] for k in "xyz"])
    low, high = np.array(shown["ranges"]).T
    boxes = []
    for x, y, z, texts, sides_of_names in shown["traces"]:
        part = (np.stack([x, y, z], axis=1) - low) / (high - low) - 0.5
        for (u, v), text, side in zip(
            pixels_of(part * sides, shown["scene"]["camera"], shown["height"]),
            texts,
            sides_of_names,
            strict=True,
        ):
            vertical, horizontal = side.split()
            half = 3.5 * len(text)
            u += {"left": -half - 8.0, "center": 0.0, "right": half + 8.0}[horizontal]
            v += {"top": -14.0, "middle": 0.0, "bottom": 14.0}[vertical]
            boxes.append((u - half, v - 6.0, u + half, v + 6.0))
    assert len(boxes) > 2
    for i, one in enumerate(boxes):
        for other in boxes[i + 1 :]:
            assert one[0] > other[2] or other[0] > one[2] or one[1] > other[3] or other[1] > one[3]


def test_without_webgl_all_is_drawn_in_the_plane(chromium, page_file):
    flat = ["--no-sandbox", "--disable-gpu", "--disable-3d-apis"]
    browser = chromium.browser_type.launch(executable_path=BROWSER, args=flat)
    for opened in open_page(browser, page_file, 1440, "dark"):
        check_quiet_and_fitting(opened, page_file)
        page = opened.page
        assert "no WebGL" in page.inner_text("#shown")
        kinds = page.evaluate(
            "[...document.querySelectorAll('.plot')].flatMap((p) => (p.data ?? []).map((t) =>"
            " t.type))"
        )
        assert {"scatter", "contour"} <= set(kinds) <= {"scatter", "contour", "heatmap"}
        x, colour, scale = page.evaluate(
            "(() => { const t = document.getElementById('fleet').data.find((t) => t.mode ==="
            " 'markers+text' && Array.isArray(t.marker.color)); return [t.x, t.marker.color,"
            " t.marker.showscale]; })()"
        )
        assert len(colour) == len(x) > 1
        assert scale
    browser.close()


def test_the_chord_and_its_legend_stand_out(opened):
    """WCAG asks for a contrast of 3 of graphics, of 4.5 of text."""
    chord, legend = opened.page.evaluate(
        "(() => { const p = document.getElementById('rays'); return [p.data.find((t) => t.name ==="
        " 'chord').line.color, p.layout.legend]; })()"
    )
    assert contrast(chord, legend["bgcolor"]) > 4.5
    assert contrast(legend["font"]["color"], legend["bgcolor"]) > 4.5
    water = opened.page.evaluate(
        "document.getElementById('rays').data[0].colorscale.map((c) => c[1])"
    )
    assert min(contrast(chord, colour) for colour in water) > 3.0


def test_figures_are_dark_where_the_page_is(opened):
    dark = opened.page.viewport_size["width"] == 390
    corner = opened.page.locator("#range_error img").screenshot()
    with Image.open(BytesIO(corner)) as image:
        level = np.asarray(image.convert("L"), dtype=float)
    assert (np.median(level) < 60) == dark
    assert (np.median(level) > 230) == (not dark)
    opened.page.emulate_media(media="print")
    style = "getComputedStyle(document.querySelector('figure img')).filter"
    assert opened.page.evaluate(style) == "none"


@WIDE
def test_a_click_on_a_range_error_chooses_its_link(opened):
    page = opened.page
    page.locator("#by-distance").scroll_into_view_if_needed()
    spot = page.evaluate(
        """() => {
          const plot = document.getElementById("by-distance"), box = plot.getBoundingClientRect();
          const trace = plot.data.find((t) => t.x.length);
          const { xaxis, yaxis, _size } = plot._fullLayout;
          const last = trace.x.length - 1;
          return [box.x + _size.l + xaxis.d2p(trace.x[last]),
              box.y + _size.t + yaxis.d2p(trace.y[last]), trace.text[last]];
        }"""
    )
    page.mouse.move(spot[0], spot[1])
    page.wait_for_timeout(300)
    page.mouse.click(spot[0], spot[1])
    page.wait_for_function(f"document.getElementById('link').textContent.startsWith({spot[2]!r})")


@WIDE
def test_tables_sort_and_filter_by_keyboard(opened):
    page = opened.page
    table = page.locator("table", has=page.locator("caption", has_text="condition and vehicle"))
    cells = (
        "(t) => [...t.tBodies[0].rows].filter((r) => !r.hidden).map((r) =>"
        " [r.cells[0].textContent, r.cells[2].textContent])"
    )
    before = table.evaluate(cells)
    assert len(before) > 3
    table.locator("th button").nth(2).focus()
    for way in (1, -1):
        page.keyboard.press("Enter")
        means = [float(mean.replace(",", "")) for _, mean in table.evaluate(cells)]
        assert means == sorted(means, reverse=way < 0)
        assert table.locator("th").nth(2).get_attribute("aria-sort") == (
            "ascending" if way > 0 else "descending"
        )
    assert sorted(table.evaluate(cells)) == sorted(before)
    box = page.locator(".filter input").first
    box.focus()
    page.keyboard.type("refracted")
    folded = box.evaluate(
        "(i) => [...i.closest('label').nextElementSibling.querySelectorAll('tbody tr')].map((r) =>"
        " [r.hidden, r.textContent])"
    )
    assert all(hidden == ("refracted" not in text.lower()) for hidden, text in folded)


SECTIONS = ("figures", "tables", "origin", "cite")


def seen(page):
    """Sections of a page whose content can be seen."""
    return [name for name in SECTIONS if page.locator(f"#{name} > *").first.is_visible()]


@pytest.mark.parametrize("width", [390, 1440])
def test_sections_fold_and_a_link_unfolds_its_own(chromium, page_file, width):
    page = chromium.new_page(viewport={"width": width, "height": 900})
    page.goto(page_file.as_uri())
    page.wait_for_selector("html[data-ready=yes]", timeout=120_000)
    assert seen(page) == []
    assert page.evaluate("document.documentElement.scrollHeight") < (5000 if width > 999 else 7500)
    for name in SECTIONS[:2]:
        page.click(f".contents a[href='#{name}']")
        assert name in seen(page)
        bar = page.locator(".contents").bounding_box()
        assert abs(bar["y"]) < 2, "contents stay in sight"
        assert bar["height"] < 50
        assert bar["height"] <= page.locator(f"#{name}").bounding_box()["y"] + 1 < 450
    page.emulate_media(media="print")
    assert seen(page) == list(SECTIONS)
    page.emulate_media(media="screen")
    page.goto("about:blank")
    page.goto(f"{page_file.as_uri()}#range_error")
    page.wait_for_selector("html[data-ready=yes]", timeout=120_000)
    assert seen(page) == ["figures"]
    assert 0 < page.locator("#range_error").bounding_box()["y"] < 450
    page.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize(
    "kind", ["page", "table", "atlas", "comparison", "replay", "plan", "location"]
)
def test_without_javascript_all_that_is_static_shows(chromium, request, kind, scheme):
    file = request.getfixturevalue(f"{kind}_file")
    context = chromium.new_context(java_script_enabled=False, color_scheme=scheme)
    page = context.new_page()
    page.goto(file.as_uri())
    assert page.locator("#look").is_visible() is False
    assert page.locator(":is(button, select, input):visible").count() == 0
    assert page.locator("main noscript .note").count() == (kind != "location")
    assert all(
        image.is_visible() for image in page.locator("figure:not(details.words *) img").all()
    )
    folded = page.locator("details:not(.part) table").count()
    assert page.locator("table:visible").count() == page.locator("table").count() - folded
    assert page.locator("table:visible, figure img:visible").count() > 0 or kind == "atlas"
    for link in page.locator(".contents a:visible").all():
        assert page.locator(link.get_attribute("href")).count() == 1
    context.close()


@pytest.mark.parametrize("kind", ["page", "table", "comparison", "replay", "plan", "location"])
def test_heads_of_tables_have_one_line_and_tables_the_width(chromium, request, kind):
    page = chromium.new_page(viewport={"width": 2560, "height": 900})
    page.goto(request.getfixturevalue(f"{kind}_file").as_uri())
    page.evaluate("document.querySelectorAll('details').forEach((part) => { part.open = true; })")
    heads = page.evaluate(
        "[...document.querySelectorAll('thead tr')].map((r) => [r.offsetHeight,"
        " 2 * parseFloat(getComputedStyle(r).lineHeight)])"
    )
    assert heads
    assert all(height < two for height, two in heads)
    assert page.evaluate("document.querySelector('main').offsetWidth") > 2200
    assert page.evaluate(SIDEWAYS) == []
    page.close()


@WIDE
def test_in_print_the_figures_stay_and_the_controls_go(opened):
    opened.page.emulate_media(media="print")
    assert not opened.page.locator("#look").is_visible()
    assert opened.page.locator("figure img").first.is_visible()


def test_a_figure_with_a_narrow_layout_has_its_legend_once(opened):
    figure = opened.page.locator("#range_error")
    assert figure.locator(".keys").count() == 0
    assert figure.locator(".sideways").count() == 0
    assert figure.locator("picture source").count() == 1

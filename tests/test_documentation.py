"""
What the generated reference has to hold: every key of every configuration, every command, every
exported name.
"""

import importlib
import inspect
import re
import runpy
import sys
import tomllib
from pathlib import Path
from typing import Annotated, get_args, get_origin

import numpy as np
import pytest
from pages import DOCS, blocks_of
from pydantic import BaseModel, BeforeValidator, ConfigDict, TypeAdapter, ValidationError

from pymantaray.apps.plan.definition import PlanFile
from pymantaray.apps.sweep.definition import KEYS
from pymantaray.config import StudyConfig
from pymantaray.config.checks import finding_lines
from pymantaray.config.common import Section
from pymantaray.config.meanings import meaning
from pymantaray.ocean.fetch.catalogue import Catalogue

PAGES = runpy.run_path(str(DOCS / "site" / "reference_pages.py"))
MARKUP = re.compile(r"\[[a-z#/@]")  # what Rich takes for a style
SUFFIXES = {"_h": "h", "_s": "s", "_hz": "Hz", "_db": "dB", "_deg": "degrees", "_m": "m"}


def models_within(annotation):
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for argument in get_args(annotation) for model in models_within(argument)]


def reachable(root):
    found, left = [], [root]
    while left:
        model = left.pop()
        if model not in found:
            found.append(model)
            left += [m for f in model.model_fields.values() for m in models_within(f.annotation)]
    return found


WITH_TOML = [page for page in sorted(DOCS.rglob("*.md")) if "```toml" in page.read_text()]
MODELS = [*reachable(StudyConfig), *reachable(Catalogue), *reachable(PlanFile)]


def is_quantity(annotation):
    return annotation is float or any(is_quantity(argument) for argument in get_args(annotation))


def tables_of(page):
    """Rows by heading: key, meaning, unit, default, type."""
    out = {}
    for heading, body in re.findall(
        r"^### `([^`]+)`\n(.*?)(?=^##|\Z)", page, re.MULTILINE | re.DOTALL
    ):
        rows = [
            re.split(r"(?<!\\) *\| ", line.strip("| "))
            for line in body.splitlines()
            if line.startswith("| `")
        ]
        out[heading] = {row[0].strip("`"): row for row in rows}
    return out


@pytest.fixture(scope="module")
def tables():
    (page,) = PAGES["configuration"]().values()
    return tables_of(page)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
def test_every_key_says_what_it_means_and_a_quantity_its_unit(model, tables):
    keys = [f for f in model.model_fields if model not in (StudyConfig, Catalogue, PlanFile)]
    assert not keys or any(set(rows) == set(keys) for rows in tables.values()), (
        f"no table has {keys}"
    )
    for name, field in model.model_fields.items():
        text = meaning(model, name)
        assert text, f"{model.__name__}.{name}"
        unit = re.search(r"\[([^][]+)\]$", text)
        assert unit or not is_quantity(field.annotation), f"{model.__name__}.{name} has no unit"
        for suffix, expected in SUFFIXES.items():
            if name.endswith(suffix):
                assert re.match(rf"{expected}\b", unit[1]), f"{model.__name__}.{name}: [{unit[1]}]"


def test_the_page_shows_types_defaults_and_allowed_values(tables):
    assert tables["[ocean]"]["source"][2:] == ["", "must be given", "text or list of text"]
    assert tables["[mission]"]["duration_h"][2:] == [
        "h",
        "`168.0`",
        "number > 0 or text with a unit",
    ]
    assert tables["[acoustics]"]["arrival"][4] == (
        '`"direct"`, `"first"`, `"strongest"`, `"direct-or-first"`'
    )
    assert tables["[detection]"]["shipping"][2:] == ["-", "-", "number ≥ 0 ≤ 1"]
    assert (
        tables['[[fleet.vehicles]] kind = "waypoints"']["points"][4] == "list of list of 3 numbers"
    )
    assert set(tables["[noise]"]) >= {"range_sigma", "attitude_tilt_sigma"}


TEXTS = (
    "1 h",
    "1 m",
    "1 m/s",
    "1 deg",
    "1 deg/s",
    "1 Hz",
    "file.nc",
    "A-1",
    "temp=sea_water_temperature",
    "2014-07-15T12:00:00",
)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
def test_a_key_takes_text_if_and_only_if_the_page_says_so(model, tables):
    for rows in tables.values():
        if set(rows) != set(model.model_fields):
            continue
        for name, field in model.model_fields.items():
            if models_within(field.annotation) or "kind" in name:
                continue
            key = TypeAdapter(
                Annotated[field.annotation, *field.metadata, "as the field"],
                config=ConfigDict(strict=True),
            )
            alone = rows[name][4].partition("list of")[0]  # what follows are kinds of its entries
            kinds = alone.removesuffix(" or ").split(" or ")
            words = re.findall(r'`"(.*?)"`', " ".join(kinds))
            takes = any(accepts(key, text) for text in [*TEXTS, *words])
            assert takes == bool(words or {"text", "text with a unit"} & set(kinds)), (
                name,
                rows[name][4],
            )


def accepts(key, value):
    try:
        key.validate_python(value)
    except ValidationError:
        return False
    return True


UNITS = {
    "m": ("1500 mm", 1.5),
    "m/s": ("9 km/h", 2.5),
    "s": ("2 min", 120.0),
    "h": ("90 min", 1.5),
    "days": ("36 h", 1.5),
    "degrees": ("0.1 rad", 5.729577951308232),
    "rad": ("90 deg", 1.5707963267948966),
    "degrees/s": ("360 deg/min", 6.0),
    "rad/s": ("180 deg/s", 3.141592653589793),
    "Hz": ("25 kHz", 25_000.0),
}  # by the unit of the page: text in another unit, and its number
OF_ANOTHER_KIND = ("3 kg", "25 kHz", "10 min", "2 km")
QUANTITIES = [
    (model, name, unit[1])
    for model in MODELS
    for name, field in model.model_fields.items()
    if (unit := re.search(r"\[([^][]+)\]$", meaning(model, name))) and unit[1] in UNITS
]


def lists_of(annotation):
    """Values per list, from the outermost list inwards: none for a number."""
    if get_origin(annotation) is tuple:
        inner = get_args(annotation)
        return [1 if inner[-1] is ... else len(inner), *lists_of(inner[0])]
    return next((lists for argument in get_args(annotation) if (lists := lists_of(argument))), [])


def in_lists(value, lists):
    for length in reversed(lists):
        value = (value,) * length
    return value


def findings_of(model, name, value):
    try:
        model.model_validate({name: value}, context={"folder": Path("/nowhere")})
    except ValidationError as error:
        lines = finding_lines(error, model)
        return [line for line in lines if re.match(rf"`?{name}[`:.[]", line)]
    return []


def test_all_quantities_are_walked_over():
    assert {unit for _, _, unit in QUANTITIES} == set(UNITS)
    assert len(QUANTITIES) > 100


@pytest.mark.parametrize(
    ("model", "name", "unit"), QUANTITIES, ids=lambda value: getattr(value, "__name__", value)
)
def test_a_quantity_takes_text_with_its_unit_and_no_other(model, name, unit):
    field = model.model_fields[name]
    if field.annotation is int:
        pytest.skip("a whole number of hours of a year")
    text, number = UNITS[unit]
    lists = lists_of(field.annotation)
    conversions = [
        part for part in field.metadata if isinstance(part, BeforeValidator)
    ]  # not the limits
    key = TypeAdapter(
        Annotated[field.annotation, *conversions, "as the field"], config=ConfigDict(strict=True)
    )
    accepted = key.validate_python(in_lists(text, lists))
    assert np.allclose(np.array(accepted, dtype=float), number, rtol=1e-15, atol=0.0)
    own = {re.split(r"[\s\d.]+", text)[-1], unit}
    for wrong in OF_ANOTHER_KIND:
        kinds = {"25 kHz": {"Hz"}, "10 min": {"s", "h", "days"}, "2 km": {"m"}}.get(wrong, set())
        if own & kinds:
            continue
        lines = findings_of(model, name, in_lists(wrong, lists))
        assert len(lines) == np.prod(lists, dtype=int), (wrong, lines)
        assert all(f"found {wrong!r}; allowed: a number of " in line for line in lines), lines


@pytest.mark.parametrize(
    "model", [m for m in MODELS if issubclass(m, Section)], ids=lambda m: m.__name__
)
def test_every_key_that_may_have_no_value_takes_the_word_none(model):
    for name, field in model.model_fields.items():
        if models_within(field.annotation):
            may_lack = field.default in (None, ())
        else:
            key = TypeAdapter(
                Annotated[field.annotation, *field.metadata, "as the field"],
                config=ConfigDict(strict=True),
            )
            may_lack = accepts(key, None)
        if may_lack and not field.is_required():
            assert findings_of(model, name, "none") == [], name
            assert field.default in (None, ()), f"{name}: without a value is not the default"


def test_every_key_that_is_a_duration_takes_text(quick_tree):
    from pymantaray.config import parse_study

    quick_tree["mission"] |= {"duration_h": "1 d", "sampling_period_s": "200 s"}
    quick_tree["ocean"]["internal_tide"] = {"amplitude": 10.0, "period_h": "745.2 min"}
    config = parse_study(quick_tree)
    assert (config.mission.duration_h, config.ocean.internal_tide.period_h) == (24.0, 12.42)


@pytest.fixture
def quick_tree():
    import tomllib

    from pymantaray.config import preset_text

    return tomllib.loads(preset_text("quick"))


def test_every_command_is_there_with_all_its_options():
    (page,) = PAGES["commands"]().values()
    sections = dict(re.findall(r"^## `([^`]+)`\n(.*?)(?=^## |\Z)", page, re.MULTILINE | re.DOTALL))
    tree = PAGES["command_tree"]()
    assert set(sections) == {" ".join(words) for words, _ in tree}
    assert {"mantaray study run", "mantaray rays times", "mantaray serve"} <= set(sections)
    assert not re.search(r"`[^`\n]*<[a-z]", page)  # words instead of types
    for words, command in tree:
        section = sections[" ".join(words)]
        assert command.help.split()[0] in section
        assert not MARKUP.search(command.help), f"{words}: --help swallows part of {command.help!r}"
        for parameter in command.params:
            if parameter.name != "help" and not getattr(parameter, "hidden", False):
                assert parameter.opts[-1] in section or parameter.metavar in section, (
                    words,
                    parameter.name,
                )
                assert parameter.help, f"{' '.join(words)}: {parameter.name} has no help"
                assert not MARKUP.search(parameter.help), (
                    f"{' '.join(words)}: --help swallows part of {parameter.help!r}"
                )


@pytest.mark.parametrize("folder", PAGES["FOLDERS"])
def test_every_exported_name_is_described(folder):
    module = importlib.import_module(f"pymantaray.{folder}")
    pages = PAGES["interface"]()
    for name in module.__all__:
        thing = getattr(module, name)
        homes = [
            f
            for f in PAGES["FOLDERS"]
            if getattr(importlib.import_module(f"pymantaray.{f}"), name, None) is thing
        ]
        home = folder if folder not in PAGES["FOLDERS"] or not homes else homes[0]
        assert f"pymantaray.{home}.{name}\n" in pages[f"reference/api/{home}.md"]
        if inspect.isclass(thing) or inspect.isfunction(thing):
            assert thing.__doc__, name
            assert not thing.__doc__.startswith(f"{name}("), (
                f"{name} has only what dataclass gives it"
            )
        else:
            homes = [m for m in sys.modules if m.startswith(f"pymantaray.{folder}.")]
            sources = [Path(sys.modules[m].__file__).read_text() for m in homes]
            assert any(
                re.search(rf"^{name}\b.*?\n(.*\n)*?\"\"\"", source, re.MULTILINE)
                for source in sources
            )


def test_all_top_folders_that_export_are_listed():
    package = Path(importlib.import_module("pymantaray").__file__).parent
    exporting = {
        ".".join(path.parent.relative_to(package).parts)
        for pattern in ("*/__init__.py", "apps/*/__init__.py")
        for path in package.glob(pattern)
        if "__all__" in path.read_text()
    }
    assert exporting == set(PAGES["FOLDERS"]) - {"config.door", "ocean.fetch"}


def keys_of_configurations():
    own = {name for model in MODELS for name in model.model_fields}
    return own | set(KEYS) | {"count", "spacing", "labels", "id", "lat", "lon"}


def keys_in(tree):
    if isinstance(tree, list):
        return {key for entry in tree for key in keys_in(entry)}
    if isinstance(tree, dict):
        return {key for name, value in tree.items() for key in (name, *keys_in(value))}
    return set()


@pytest.mark.parametrize("page", WITH_TOML, ids=lambda page: page.name)
def test_configurations_in_pages_have_no_unknown_key(page):
    known = keys_of_configurations()
    for block in blocks_of(page.read_text()):
        if block.language == "toml":
            tree = tomllib.loads(block.text)
            tree.pop("cross", None)  # paths to fields of a base
            tree.get("plan", {}).pop("free", None)  # the same
            if isinstance(tree.get("conditions"), dict):  # by name
                tree["conditions"] = list(tree["conditions"].values())
            unknown = keys_in(tree) - known
            assert not unknown, f"line {block.line}: {unknown}"


def test_four_entrances_and_contents_of_all_pages():
    def links(page):
        return re.findall(r"\]\(([\w./-]+\.md)[#)]", page)

    entrances = re.split(r"^## ", (DOCS / "README.md").read_text("utf-8"), flags=re.MULTILINE)[1:]
    assert [len(set(links(entrance))) for entrance in entrances] == [5, 5, 5, 5, 2]
    pages = {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")}
    listed = set(links((DOCS / "contents.md").read_text("utf-8")))
    others = {"README.md", "contents.md"}
    assert {page for page in pages - others if not page.startswith(("design/", "site/"))} == listed


RECORDS = [*sorted((DOCS / "design").glob("*.md")), *sorted((DOCS / "theory").glob("*.md"))]
PATH = re.compile(
    r"(?:src|tests|benchmarks|examples|acoustics|apps|estimation|evaluation|geometry|ocean|records"
    r"|sensing|cli)/[\w./]+\w"
)


@pytest.mark.parametrize("page", RECORDS, ids=lambda page: page.name)
def test_files_commands_and_options_that_a_record_names_are_there(page):
    root = DOCS.parent
    literals = re.findall(r"`([^`\n]+)`", page.read_text())
    tree = {" ".join(words): command for words, command in PAGES["command_tree"]()}
    for words in literals:
        for path in PATH.findall(words):
            homes = (root / path, root / "src" / "pymantaray" / path)
            assert any(home.exists() or home.with_suffix(".py").exists() for home in homes), path
        if re.fullmatch(r"\w+\.py|test_\w+", words):
            name = words if words.endswith(".py") else f"def {words}("
            code = [
                path
                for folder in ("src", "tests", "benchmarks")
                for path in (root / folder).rglob("*.py")
            ]
            assert any(path.name == name or name in path.read_text() for path in code), words
        script = re.search(r"benchmarks/\w+\.py", words)
        command = re.match(r"mantaray(?: [a-z][\w-]*)*", words)
        known = (root / script[0]).read_text() if script else ""
        if command:
            parts = command[0].split()
            head = next(
                " ".join(parts[:n]) for n in range(len(parts), 0, -1) if " ".join(parts[:n]) in tree
            )
            assert len(head.split()) > 1, words
            known = str([parameter.opts for parameter in tree[head].params])
        if known:
            for option in re.findall(r"(?<!\S)--[\w-]+", words):
                assert option in known, words


def test_the_table_of_commands_and_waters_has_no_empty_cell():
    table = PAGES["water_table"]()
    assert table in PAGES["commands"]()["reference/commands.md"]
    assert all(cell.strip() for line in table.splitlines() for cell in line.strip("|").split("|"))


CHOICES = {  # heading on the page of choices: place and key in the configuration
    "Sound-speed equations": ("[ocean]", "equation"),
    "Behaviours of vehicles": ("[[fleet.vehicles]]", "kind"),
    "Range models": ("[[conditions]]", "range_model"),
    "Robust losses": ("[[conditions]]", "loss"),
}


@pytest.mark.parametrize(("heading", "place", "key"), [(h, *k) for h, k in CHOICES.items()])
def test_configuration_and_tables_offer_the_same_choices(heading, place, key, tables):
    (page,) = PAGES["choices"]().values()
    section = page.partition(f"## {heading}\n")[2].partition("\n## ")[0]
    listed = set(re.findall(r"^\| `([^`]+)`", section, re.MULTILINE))
    assert listed
    cells = [
        (head + rows[key][-1])
        for head, rows in tables.items()
        if head.startswith(place) and key in rows
    ]
    offered = set(re.findall(r'"([\w-]+)"', " ".join(cells))) - {"none"}
    assert listed == offered

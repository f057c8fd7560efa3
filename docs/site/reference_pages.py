"""
Reference pages in Markdown from the code itself: configuration keys, choices, commands, and the
names that folders export.
"""

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from pkgutil import iter_modules
from typing import Any, get_args

import pydantic

from pymantaray import apps

APPLICATIONS = tuple(name for _, name, _ in iter_modules(apps.__path__))
FOLDERS = (
    *("geometry", "records", "ocean", "ocean.fetch", "acoustics", "fleet", "sensing", "estimation"),
    *("evaluation", "exchange", "config", "config.door"),
    *(f"apps.{name}" for name in APPLICATIONS if name != "doctor"),
)
"""Folders of the library in the order in which data flows, and applications that export names."""

NOMENCLATURE = Path(__file__).resolve().parents[1] / "nomenclature.md"
_UNIT = re.compile(r"\s*\[([^][]+)\]\.?$")


@cache
def nomenclature() -> dict[str, list[str]]:
    """Units of each name in the nomenclature; dots in a name stand for any word."""
    rows = [
        [cell.strip() for cell in line.split("|")]
        for line in NOMENCLATURE.read_text("utf-8").splitlines()
    ]
    units: dict[str, list[str]] = {}
    for cells in rows:
        if len(cells) == 7:  # symbol, name, unit, meaning, paper
            for name in re.findall(r"`([\w.]+)`", cells[2]):
                units.setdefault(name, []).append(cells[3])
    return units


def quantity(name: str) -> str | None:
    """Name in the nomenclature that a parameter, a column or a key stands for."""
    return next(
        (entry for entry in nomenclature() if re.fullmatch(entry.replace("...", r"\w+"), name)),
        None,
    )


def column_unit(name: str, unit: str) -> str:
    """Unit of a record's column as pages write it; records have it as CF does."""
    if name.endswith("_db"):
        return "dB"
    written = {"": "-", "1": "-", "m s-1": "m/s", "s m-1": "s/m", "m2": "m²"}
    return written.get(unit, unit)


def configuration() -> dict[str, str]:
    """Page of all keys of all configurations."""
    from pymantaray.config import StudyConfig
    from pymantaray.ocean.fetch.catalogue import Catalogue

    parts = [
        "# Configuration keys",
        (
            "This page lists all keys. It is generated from the models that check a configuration."
            " `mantaray study show beaufort`"
            " prints a complete study with comments, and `mantaray study init quick mine.toml`"
            " writes one that you can edit."
            " Depth is positive down, and times are UTC."
            " A length, time, speed, angle or frequency is a number in the unit of the table, or"
            " text with its own unit, such as"
            ' `"2 km"`, `"1 d 12 h"`, `"500 ms"`, `"3 kn"`, `"10 deg"` and `"25 kHz"`. `-` stands'
            " for no default."
            " *Not in the paper* marks values that the paper does not specify"
            " ([record 0001](../design/0001-what-the-paper-leaves-open.md)). The other defaults of"
            " noise and mission are those of the"
            " paper's tables."
        ),
        "## A study",
        (
            "`mantaray study run` reads these keys. A key `base` at the top names a preset or"
            " another file. Keys that are absent have"
            ' the value of the base, and `"none"` removes a value of the base. Every command that'
            " takes a study has `--set KEY=VALUE`."
            " `mantaray serve` uses only the sections `[ocean]`, `[mission]`, `[acoustics]`,"
            " `[ranging]` and `[detection]`, and"
            " `mantaray replay` only `[detection]`. All other settings of `rays`, `ranges`,"
            " `replay` and `atlas` are"
            " [options](commands.md)."
        ),
        *sections(StudyConfig),
        *(keys_of_a_sweep() if "sweep" in APPLICATIONS else ()),
        *(keys_of_a_plan() if "plan" in APPLICATIONS else ()),
        "## Servers of oceans",
        (
            "The file of `mantaray ocean fetch --servers` and of the variable"
            " `MANTARAY_OCEAN_SERVERS` has these keys"
            " ([how-to](../how-to/water.md#hycom-and-glorys12-by-place-and-date))."
        ),
        *sections(Catalogue),
    ]
    return {"reference/configuration.md": "\n\n".join(parts) + "\n"}


def keys_of_a_sweep() -> Iterator[str]:
    """Section about the file of a sweep."""
    from pymantaray.apps.sweep.definition import KEYS

    yield "## A sweep"
    yield "`mantaray sweep run` reads these keys ([how-to](../how-to/sweep.md))."
    yield table(("key", "meaning"), [(f"`{key}`", text(meaning)) for key, meaning in KEYS.items()])


def keys_of_a_plan() -> Iterator[str]:
    """Section about the part of a study file that plans a deployment."""
    from pymantaray.apps.plan.definition import PlanFile

    yield "## A plan"
    yield (
        "`mantaray plan` reads these keys in the section `[plan]` of a study file"
        " ([how-to](../how-to/plan.md))."
    )
    yield from sections(PlanFile)


def sections(model: type[pydantic.BaseModel]) -> Iterator[str]:
    """
    Heading, meaning and table of keys of a model and of all models in it, each once, under its
    place in the file.
    """
    schema = model.model_json_schema()
    for place, entry in walk(schema):
        keys = entry.get("properties", {})
        rows = [
            row(key, value, key in entry.get("required", ()), schema) for key, value in keys.items()
        ]
        yield f"### `{place}`"
        yield text(entry.get("description", ""))
        yield table(("key", "meaning", "unit", "default", "type"), rows)


def walk(schema: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """
    Tables of a configuration by their place in the file, in its order; kinds of an entry by their
    ``kind``.
    """
    out: list[tuple[str, dict[str, Any]]] = []

    def visit(place: str, entry: dict[str, Any], *, listed: bool) -> None:
        if place:
            kind = entry["properties"].get("kind", {}).get("const")
            head = f"[[{place}]]" if listed else f"[{place}]"
            out.append((f'{head} kind = "{kind}"' if kind else head, entry))
        else:
            plain = {k: v for k, v in entry["properties"].items() if not list(models_of(v))}
            if plain:
                out.append(("at the top", entry | {"properties": plain}))
        for key, value in entry["properties"].items():
            for name in models_of(value):
                inner = f"{place}.{key}" if place else key
                visit(inner, schema["$defs"][name], listed="items" in str(value))

    visit("", schema, listed=False)
    return out


def models_of(value: dict[str, Any]) -> Iterator[str]:
    """Names of the models that a key may hold."""
    if "$ref" in value:
        yield value["$ref"].removeprefix("#/$defs/")
    for option in [
        *value.get("anyOf", ()),
        *value.get("oneOf", ()),
        *([value["items"]] if "items" in value else ()),
    ]:
        yield from models_of(option)


def row(key: str, value: dict[str, Any], required: bool, schema: dict[str, Any]) -> tuple[str, ...]:
    """Cells of a key's row."""
    meaning = value.get("description", "")
    unit = _UNIT.search(meaning)
    default = value.get("default")
    if required:
        shown = "must be given"
    elif default in (None, [], {}) or list(models_of(value)):
        shown = "-"
    else:
        shown = f"`{toml(default)}`"
    kinds = " or ".join(dict.fromkeys(kind_of(value, schema)))
    return f"`{key}`", text(_UNIT.sub("", meaning)), unit[1] if unit else "", shown, kinds


def kind_of(value: dict[str, Any], schema: dict[str, Any]) -> Iterator[str]:
    """Words for what a key may hold."""
    if "enum" in value or "const" in value:
        yield ", ".join(f"`{toml(word)}`" for word in value.get("enum", [value.get("const")]))
    elif "$ref" in value:
        kind = (
            schema["$defs"][value["$ref"].removeprefix("#/$defs/")]["properties"]
            .get("kind", {})
            .get("const")
        )
        yield f'kind `"{kind}"`' if kind else "table"
    elif "anyOf" in value or "oneOf" in value:
        for option in (*value.get("anyOf", ()), *value.get("oneOf", ())):
            yield from kind_of(option, schema)
    elif "prefixItems" in value:
        yield f"list of {len(value['prefixItems'])} numbers"
    elif value.get("type") == "array":
        yield f"list of {' or '.join(dict.fromkeys(kind_of(value['items'], schema)))}"
    elif value.get("type") != "null":
        date = value.get("format") == "date-time"
        words = {
            "number": "number",
            "integer": "whole number",
            "boolean": "`true`, `false`",
            "string": "text",
            "object": "table",
        }
        yield "date and time" if date else words[value["type"]] + limits(value)
        if "unit" in value:
            yield "text with a unit"


def limits(value: dict[str, Any]) -> str:
    """Range that a number is checked to lie in."""
    words = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}
    return "".join(f" {sign} {value[name]:g}" for name, sign in words.items() if name in value)


def toml(value: Any) -> str:
    """A value as TOML has it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(map(toml, value))}]"
    return f'"{value}"' if isinstance(value, str) else f"{value}"


def choices() -> dict[str, str]:
    """Page of the names among which a study, a replay or a graph's solver chooses."""
    parts = [
        "# Choices",
        (
            "This page is generated from the tables that the program itself reads, one of each kind"
            " of choice. The [configuration keys](configuration.md) and [options](commands.md) that"
            " take such a name accept all of its table."
        ),
        *choices_of_the_world(),
        *(choices_of_a_replay() if "replay" in APPLICATIONS else ()),
        *choices_of_an_estimator(),
    ]
    return {"reference/choices.md": "\n\n".join(parts) + "\n"}


def choices_of_the_world() -> Iterator[str]:
    """Tables of equations, behaviours and sensors."""
    from pymantaray.fleet.behaviours import Behaviour
    from pymantaray.ocean.equations import EQUATIONS
    from pymantaray.sensing.noise import SENSORS

    yield "## Sound-speed equations"
    yield "The key `ocean.equation` and the option `--equation`."
    yield table(
        ("name", "meaning", "publications"),
        [
            (f"`{name}`", summary(equation.sound_speed), ", ".join(equation.references))
            for name, equation in EQUATIONS.items()
        ],
    )
    yield "## Behaviours of vehicles"
    yield "The key `kind` of `[[fleet.vehicles]]`."
    yield table(
        ("name", "meaning"), [(f"`{kind.role}`", summary(kind)) for kind in get_args(Behaviour)]
    )
    yield "## Sensors"
    yield "All sensors but ranges. The key `mission.sensors` adds sensors of other packages."
    yield table(
        ("name", "meaning"),
        [(f"`{getattr(s, '__name__', '').rpartition('.')[2]}`", summary(s)) for s in SENSORS],
    )


def choices_of_a_replay() -> Iterator[str]:
    """Table of rules of detection."""
    from pymantaray.apps.replay.rules import RULES

    yield "## Rules of detection"
    yield "The option `--rule` of `mantaray replay`."
    yield table(("text", "meaning"), [(f"`{form}`", text(words)) for form, words in RULES.values()])


def choices_of_an_estimator() -> Iterator[str]:
    """Tables of conditions, range models, losses, solvers and kinds of factors."""
    from pymantaray.config.door.range_models import BUILDERS
    from pymantaray.config.estimators import STANDARD, ConditionSection
    from pymantaray.estimation.graph.graph import KINDS
    from pymantaray.estimation.solve import METHODS
    from pymantaray.estimation.solvers.losses import LOSSES

    yield "## Conditions"
    yield "The `name` of a condition in `[[conditions]]`; these names need no other keys."
    keys = ("ranges", "links", "solver")
    rows = []
    for name in STANDARD:
        condition = ConditionSection.model_validate({"name": name})
        rows.append((f"`{name}`", condition.ranges, condition.links, condition.solver.kind))
    yield table(("name", *keys), rows)
    yield "## Range models"
    yield "The key `range_model` of a condition, by its `kind`."
    models = ConditionSection.model_json_schema()["$defs"].values()
    by_kind = {model["properties"].get("kind", {}).get("const"): model for model in models}
    yield table(
        ("name", "meaning"),
        [(f"`{kind}`", text(by_kind[kind]["description"])) for kind in BUILDERS],
    )
    yield "## Robust losses"
    yield (
        "The key `loss` of a condition. Costs are those of"
        " [`Loss`](api/generated/pymantaray.estimation.Loss.rst); each scale is 95 % as efficient"
        " as least squares without outliers."
    )
    yield table(
        ("name", "cost", "scale", "graduated"),
        [
            (f"`{name}`", f"`{loss.kind}`", f"{loss.scale:.6g}", "yes" if loss.graduated else "")
            for name, loss in LOSSES.items()
        ],
    )
    yield "## Methods"
    yield "The option `--method` of `mantaray graph solve`: " + ", ".join(
        f"`{name}`" for name in METHODS
    )
    yield "## Kinds of factors"
    yield "Every solver, bound, certificate and file handles each kind or refuses it by its name."
    yield table(
        ("name", "meaning", "variables", "measured", "PyFactorGraph"),
        [
            (
                f"`{name}`",
                kind.what,
                ", ".join(kind.ends),
                ", ".join(f"`{column}` ({unit or '-'})" for column, _, unit in kind.columns),
                f"`{kind.word}`" if kind.word else "",
            )
            for name, kind in KINDS.items()
        ],
    )


def summary(described: Any) -> str:
    """First paragraph of an object's docstring."""
    return text((described.__doc__ or "").strip().partition("\n\n")[0])


def commands() -> dict[str, str]:
    """Page of all commands."""
    from pymantaray.cli.options import prepare_help

    parts = [
        "# Commands",
        (
            "This page is generated from the program. `mantaray COMMAND --help` prints the same. A"
            " length, time, speed or angle is a number in the unit given in its meaning, or text"
            " with its own unit, such as `'2 km'` and `'1 d 12 h'`, as in a"
            " [configuration](configuration.md). See also the [exit"
            " status](at-a-glance.md#exit-status)."
        ),
    ]
    for path, command in command_tree():
        parts += [f"## `{' '.join(path)}`", text(command.help or "")]
        context = command.make_context(" ".join(path), [], resilient_parsing=True)
        prepare_help(command, context)
        parts.append(
            f"```text\n{' '.join([' '.join(path), *command.collect_usage_pieces(context)])}\n```"
        )
        rows = [
            parameter_row(p, context)
            for p in command.params
            if p.name != "help" and not getattr(p, "hidden", False)
        ]
        if rows:
            parts.append(table(("", "default", "meaning"), rows))
    parts += [
        "## Sources and options of water by command",
        (
            '"argument" means that the source is an argument of the command, `--set` that the'
            " option is set by its key, as in `--set ocean.ice=1.5`"
            " ([water](../how-to/water.md))."
        ),
        water_table(),
    ]
    return {"reference/commands.md": "\n\n".join(part for part in parts if part) + "\n"}


def command_tree() -> list[tuple[tuple[str, ...], Any]]:
    """Every command and group by its words, in the order of the program."""
    from pymantaray.cli.main import tree

    def walk(words: tuple[str, ...], command: Any) -> Iterator[tuple[tuple[str, ...], Any]]:
        yield words, command
        for name, inner in getattr(command, "commands", {}).items():
            if not inner.hidden:
                yield from walk((*words, name), inner)

    return list(walk(("mantaray",), tree()))


_WATER_COMMANDS = (
    "rays times",
    "rays eigen",
    "rays trace",
    "rays plot",
    "rays compare-bellhop",
    "rays write-bellhop",
    "ranges",
    "replay",
    "locate survey",
    "locate plan",
    "serve",
    "table",
    "atlas run",
    "study run",
    "sweep run",
    "plan",
    "ocean check",
    "ocean show",
    "ocean plot",
    "ocean correct",
    "ocean perturb",
)
_WATER_OPTIONS = {
    "sea floor": ("--bathymetry",),
    "ice": ("--ice",),
    "rough ice": ("--ice-slope", "--ice-length"),
    "currents": ("--currents",),
    "equation": ("--equation",),
    "interpolation": ("--interpolation",),
    "domain": ("--centre", "--half-extent"),
    "time": ("--time",),
    "names": ("--name",),
    "thin, smooth": ("--thin", "--smooth"),
    "bounces, cut-off": ("--max-surface-bounces", "--max-bottom-bounces", "--cutoff-db"),
}
_WITHOUT_RAYS = "no rays"
_FROM_STUDY_FILES = ("sweep run", "plan")  # commands whose file contains or names a study


def water_table() -> str:
    """Which command takes which sources and options of water, from the commands' own options."""
    commands = {" ".join(words[1:]): command for words, command in command_tree()}
    rows = []
    for name in filter(commands.__contains__, _WATER_COMMANDS):
        options = {option for p in commands[name].params for option in (*p.opts, *p.secondary_opts)}
        sources = [
            f"`{option}`" for option in ("--ocean", "--profile", "--run") if option in options
        ]
        if not {"--ocean", "--profile"} & options:
            sources = ["`--set ocean.source=...`" if name in _FROM_STUDY_FILES else "argument"]
        cells = []
        for needed in _WATER_OPTIONS.values():
            if set(needed) <= options:
                cells.append("yes")
            elif "--set" in options:
                cells.append("`--set`")
            else:
                cells.append("direct rays" if "--ice" in options else _WITHOUT_RAYS)
        rows.append((f"`{name}`", ", ".join(sources), *cells))
    return table(("command", "source", *_WATER_OPTIONS), rows)


def parameter_row(parameter: Any, context: Any) -> tuple[str, ...]:
    """Cells of an argument's or option's row, from what its help says."""
    name, meaning = parameter.get_help_record(context)
    behind = re.search(r"  \[(.*)\]$", meaning)
    notes = behind[1].split("; ") if behind else []
    default = next(
        (f"`{note.removeprefix('default: ')}`" for note in notes if note.startswith("default: ")),
        "",
    )
    if "required" in notes:
        default = "must be given"
    rest = "; ".join(
        f"`{note}`" for note in notes if note != "required" and not note.startswith("default: ")
    )
    repeated = "may be repeated" if getattr(parameter, "multiple", False) else ""
    more = "; ".join(words for words in (rest, repeated) if words)
    meaning = text(meaning[: behind.start()] if behind else meaning)
    return f"`{name}`", default, f"{meaning} ({more})" if more else meaning


def interface() -> dict[str, str]:
    """Pages of the names that folders export, and one that lists the folders."""
    import importlib

    pages, rows = {}, []
    described: set[int] = (
        set()
    )  # names of one object that several folders export have one page, in the first of them
    for folder in ("", *FOLDERS):
        name = f"pymantaray.{folder}".rstrip(".")
        module = importlib.import_module(name)
        doc = (module.__doc__ or "").strip()
        page = f"reference/api/{folder or 'pymantaray'}.md"
        doc, _, example = doc.partition("\n\nExamples\n--------\n")
        first, _, rest = doc.partition("\n\n")
        members = [
            m for m in module.__all__ if not folder or id(getattr(module, m)) not in described
        ]
        if folder:
            described |= {id(getattr(module, member)) for member in members}
        listing = "\n".join(f"   {name}.{member}" for member in members)
        target = "   :toctree: generated\n" if folder else ""
        pages[page] = (
            f"# `{name}`\n\n{text(first)}\n\n{text(rest)}\n\n{shown(example)}```{{eval-rst}}\n.."
            f" autosummary::\n{target}"
            f"   :nosignatures:\n\n{listing}\n```\n"
        )
        rows.append((f"[`{name}`]({folder or 'pymantaray'}.md)", text(first.replace("\n", " "))))
    pages["reference/api/errors.md"] = (
        "# `pymantaray.errors`\n\n```{eval-rst}\n.. automodule:: pymantaray.errors\n   :members:\n"
        "   :member-order: bysource\n"
        "   :show-inheritance:\n```\n"
    )
    rows.append(
        ("[`pymantaray.errors`](errors.md)", "Errors for users, each with a message of one line.")
    )
    index = (
        "# Python interface\n\n`pymantaray` itself has the names that most users need. The folders"
        " are listed in the order in which data flows:"
        f" no folder needs one that is below it.\n\n{table(('folder', 'content'), rows)}\n\n"
        + toctree([page.removeprefix("reference/api/").removesuffix(".md") for page in pages])
    )
    return {"reference/api/index.md": index, **pages}


def shown(example: str) -> str:
    """Example of a folder as Markdown: text, and code with what it prints; empty without one."""
    parts = [part for part in example.strip().split("\n\n") if part]
    return "".join(
        f"```pycon\n{part}\n```\n\n" if part.startswith(">>>") else f"{text(part)}\n\n"
        for part in parts
    )


def toctree(entries: list[str], option: str = "hidden") -> str:
    """Table of contents of pages; with ``titlesonly`` also a list of links with their titles."""
    return f"```{{toctree}}\n:{option}:\n\n" + "\n".join(entries) + "\n```\n"


def table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """Table in Markdown."""
    lines = [head, tuple("---" for _ in head), *rows]
    return "\n".join(
        "| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines
    )


def text(words: str) -> str:
    """
    Docstring's words as Markdown: literals in single backticks, nothing else of it means anything.
    """
    parts = re.split(r"(``.+?``|`[^`]+`)", re.sub(r"\s*\n\s*", " ", words.strip()))
    return "".join(
        f"`{part.strip('`')}`"
        if part.startswith("`")
        else re.sub(r"([\\*_<>\[\]#$])", r"\\\1", part)
        for part in parts
    )


def glossary() -> dict[str, str]:
    """
    Page of the words that pages of runs and of the site show as tooltips, from the package's own
    list.
    """
    from pymantaray.records.glossary import GLOSSARY

    entries = "\n\n".join(f"{word}\n  {meaning}" for word, meaning in GLOSSARY.items())
    head = "# Glossary\n\nOther pages show these meanings as tooltips.\n\n"
    page = f"{head}:::{{glossary}}\n{entries}\n:::\n"
    return {"reference/glossary.md": page}

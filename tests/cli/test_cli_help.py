"""Help of every command: panels in order, words instead of types, and two screens before water."""

import re
from dataclasses import fields

import pytest
from typer.core import TyperArgument

from pymantaray.cli.main import tree
from pymantaray.cli.options import ArrivalOptions, OceanOptions, WaterOptions

SCREENS = 100  # lines, two of 50
PLACEHOLDER = re.compile(r"<[a-z]|\b(str|int|bool|float|Path|PATH|LIST|list\[|None)\b")
PANELS = ["Arguments", "Options", "Output", "Arrivals", "Water", "Commands"]
OUTPUT = {"--force", "--format", "--help", "--json", "--quiet", "--verbose"}


def option_names(*groups):
    return {f"--{field.name.replace('_', '-')}" for group in groups for field in fields(group)}


def commands_in(command, words=()):
    yield words, command
    for name, inner in getattr(command, "commands", {}).items():
        yield from commands_in(inner, (*words, name))


COMMANDS = dict(commands_in(tree()))


def panels_of(text):
    """Lines of each panel by its title."""
    panels, lines = {}, []
    for line in text.splitlines():
        if title := re.match("╭─ (.+?) ─", line):
            lines = panels.setdefault(title[1], [])
        lines.append(line)
    return panels


@pytest.mark.parametrize("width", [80, 100])
@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_help_has_panels_words_and_two_screens(words, width, mantaray, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(width))
    text = mantaray(*words, "--help").out
    assert not PLACEHOLDER.findall(text)
    assert max(map(len, text.splitlines())) == width

    panels = panels_of(text)
    assert list(panels) == [name for name in PANELS if name in panels]
    place = {}  # title of the panel of each option
    for title, lines in panels.items():
        for line in lines:
            if option := re.match(r"│ (?:\*  |   )?(--[\w-]+)", line):
                assert option[1] not in place
                place[option[1]] = title
    command = COMMANDS[words]
    options = [p for p in command.params if not isinstance(p, TyperArgument)]
    long = {next(name for name in p.opts if name.startswith("--")) for p in options}
    assert set(place) == long | {"--help"}
    if not hasattr(command, "commands"):
        titles = dict.fromkeys(OUTPUT, "Output")
        if "--bathymetry" in place and "Water" in panels:
            titles |= dict.fromkeys(option_names(WaterOptions, OceanOptions), "Water")
            titles |= dict.fromkeys(option_names(ArrivalOptions), "Arrivals")
        assert {name: place[name] for name in titles if name in place} == {
            name: title for name, title in titles.items() if name in place
        }

    shown = text.replace("│", " ").split()
    assert not any("…" in word for word in shown)
    for parameter in command.params:
        assert not set((parameter.help or "").split()) - set(shown), parameter.name
    if width == 100 and "Water" in panels:
        assert text.splitlines().index(panels["Water"][0]) <= SCREENS
    elif width == 100:
        assert len(text.splitlines()) <= SCREENS


@pytest.mark.parametrize("first", sorted(tree().commands))
def test_one_word_leads_to_the_same_commands_as_all(first):
    own = tree(first)
    assert list(own.commands) == [first]
    assert [words for words, _ in commands_in(own)][1:] == [
        words for words in COMMANDS if words[:1] == (first,)
    ]


def test_a_command_loads_no_other(mantaray):
    tree.cache_clear()
    assert mantaray("rays", "--help").code == 0
    loaded = tree.cache_info().misses
    tree("rays")
    assert tree.cache_info().misses == loaded


def test_another_word_leads_to_all_commands():
    assert list(tree("rain").commands) == list(tree().commands)

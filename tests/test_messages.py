"""
Messages: none repeats a password or a token, and those of the library name arguments, not options.
"""

import ast
import inspect
import logging
import re
import shlex
import sys
from functools import cache
from typing import Annotated

import pytest
import typer
from sources import PACKAGE as LIBRARY, nodes_of

from pymantaray.apps.study import manifest
from pymantaray.cli.main import main, tree
from pymantaray.cli.printing import _PARAMETERS, in_options, log_to_stderr, use_options_of
from pymantaray.errors import OceanError, SweepError
from pymantaray.messages import one_line, without_secrets

SECRET = "XSECRETX"
HIDDEN = {
    f"https://ann:{SECRET}@host/sea.nc": "https://host/sea.nc",
    f"https://{SECRET}@host/sea.nc": "https://host/sea.nc",
    f"https://ann:a/b@{SECRET} c@host:8/sea.nc": "https://host:8/sea.nc",
    f"s3:/ann:{SECRET}@bucket/x: is a file": "s3://bucket/x: is a file",
    f"ann:{SECRET}@host:8786: no answer": "host:8786: no answer",
    f"https://host/sea.nc?token={SECRET}: an address": "https://host/sea.nc?token=...: an address",
    f"https://host/a?x=1&X-Amz-Signature={SECRET}&b=2 and on": (
        "https://host/a?x=...&X-Amz-Signature=...&b=... and on"
    ),
    f"sea.nc?sig={SECRET}": "sea.nc?sig=...",
    f"'https://host/#access_token={SECRET}'": "'https://host/#access_token=...'",
    f"http://a/b, http://ann:{SECRET}@c/d": "http://a/b, http://c/d",
}  # fmt: skip
PLAIN = [
    "runs/quick: 3 done, 0 failed, 1 open of 4 points",
    "ocean.toml, line 3: noise.range_sigma: unknown key; did you mean range_sigma? allowed: a, b",
    "https://example.org/dods/sea.dods: server error 500 (10:30 at host)",
    "10:30, 12:15 UTC @ 5 m; mail a@b.org",
]


@pytest.mark.parametrize(("text", "shown"), HIDDEN.items(), ids=range(len(HIDDEN)))
def test_secrets_of_addresses_are_left_out(text, shown):
    assert without_secrets(text) == shown
    assert str(OceanError(text)) == shown


@pytest.mark.parametrize("text", PLAIN)
def test_other_text_is_left_as_it_is(text):
    assert without_secrets(text) == text


def test_text_of_unknown_origin_becomes_one_short_line():
    assert one_line("a\nb\t\x1b[31mc " + "d" * 500, 20) == "a b [31mc ddddddd..."


ADDRESSES = [
    f"https://ann:{SECRET}@nowhere.invalid/x.nc",
    f"https://nowhere.invalid/x.nc?token={SECRET}",
]
COMMANDS = [
    "ocean check {}",
    "ocean show {}",
    "ocean perturb {} out.nc --method mean",
    "ocean fetch out.nc --servers {}",
    "rays times links.csv out.csv --ocean {}",
    "ranges m.csv --out out --interval 60 --ocean {}",
    "ranges {} --ocean synthetic:fram --interval 60 --out out",
    "replay {} --ocean synthetic:fram",
    "graph show {}",
    "graph solve {}",
    "study run {}",
    "study show {}",
    "study check {}",
    "sweep run {} --out out",
    "sweep status {}",
    "sweep collect {}",
    "serve {}",
    "atlas {}",
    "export {} --to tum",
    "{}",
    "study {}",
    "sweep run sweep.toml --out {}",
    "sweep run sweep.toml --out out --scheduler {}",
]


@pytest.mark.parametrize("address", ADDRESSES, ids=["password", "token"])
@pytest.mark.parametrize("command", COMMANDS)
def test_no_command_repeats_a_secret(command, address, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sweep.toml").write_text('[sweep]\nname = "s"\nbase = "quick"\n')
    with pytest.raises(SystemExit) as caught:
        main([word.format(address) for word in command.split()])
    said = capsys.readouterr()
    assert caught.value.code == 2
    assert SECRET not in said.out + said.err
    if command != "ocean check {}":  # which reports it as a finding
        assert said.err.startswith("error: ")
        assert said.err.count("\n") == 1


@pytest.mark.network
def test_no_scheduler_s_password_is_repeated(capsys, tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    from pymantaray.jobs import dask_pool

    monkeypatch.setattr(dask_pool, "_CONNECT_TIMEOUT", 1.0)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sweep.toml").write_text(
        '[sweep]\nname = "s"\nbase = "quick"\n[[grid]]\nfield = "study.seed"\nvalues = [1]\n'
    )
    with pytest.raises(SystemExit):
        main(
            [
                "sweep",
                "run",
                "sweep.toml",
                "--out",
                "out",
                "--scheduler",
                f"tcp://ann:{SECRET}@127.0.0.1:9",
            ]
        )
    said = capsys.readouterr()
    assert SECRET not in said.out + said.err


def test_logs_and_manifests_leave_secrets_out(capsys, monkeypatch):
    with log_to_stderr(quiet=False, verbose=0):
        logging.getLogger("pymantaray.apps.sweep").warning(
            "scheduler tls://ann:%s@host is gone", SECRET
        )
    assert capsys.readouterr().err == "warning: scheduler tls://host is gone\n"
    monkeypatch.setattr(
        sys, "argv", ["/bin/mantaray", "sweep", "run", "--out", f"s3://ann:{SECRET}@bucket/x"]
    )
    assert shlex.split(manifest._command())[-1] == "s3://bucket/x"
    assert str(SweepError(f"s3://ann:{SECRET}@b: cannot be opened")) == "s3://b: cannot be opened"


FLAG = re.compile(r"(?<![\w-])--([a-z][a-z-]+)")


def literals_of(nodes):
    """
    Texts of a module other than docstrings, with their lines; the fields of a formatted text are
    {}.
    """
    parts, texts = set(), []
    for node in nodes:
        if isinstance(node, ast.JoinedStr):
            parts |= set(map(id, node.values))
            texts.append(node)
        elif isinstance(node, ast.Expr):
            parts.add(id(node.value))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            texts.append(node)
    for node in texts:
        if id(node) in parts:
            continue
        if isinstance(node, ast.JoinedStr):
            values = [v.value if isinstance(v, ast.Constant) else "{}" for v in node.values]
            yield node.lineno, "".join(values)
        else:
            yield node.lineno, node.value


@cache
def library_texts():
    """
    Place and text of every literal outside the command line; options of other programs and whole
    commands are no messages.
    """
    texts = []
    for path in LIBRARY.rglob("*.py"):
        if LIBRARY / "cli" in path.parents or path.name.endswith("command.py"):
            continue
        for line, text in literals_of(nodes_of(path)):
            if " " in text and not re.match(r"--|mantaray ", text):
                texts.append((f"{path.relative_to(LIBRARY)}:{line}", text))
    return texts


def test_messages_of_the_library_have_no_options():
    found = {place.partition(":")[0] for place, text in library_texts() if FLAG.search(text)}
    assert found == set()


def test_arguments_in_messages_are_options_of_a_command():
    """
    An argument in backquotes, with or without a value, which the command line replaces by its
    option.
    """
    names = {p.name for command in commands_of(tree()) for p in command.params} | set(_PARAMETERS)
    named = {
        name
        for _, text in library_texts()
        for name in re.findall(r"(?:with|use|out|give|longer) `([a-z]\w*)", text)
    }
    assert len(named) > 10
    assert named <= names


def test_the_command_line_names_its_options_instead_of_arguments():
    def command(
        *,
        centre: Annotated[str, typer.Option()],
        force: Annotated[bool, typer.Option("--force/--keep")],
    ): ...

    use_options_of(inspect.signature(command).parameters.values())
    text = "give `centre`, `centre='1 2'`, `overwrite=True` or `depth`; `study.centre` is a key"
    assert (
        in_options(text)
        == "give --centre, --centre 1 2, --force or `depth`; `study.centre` is a key"
    )


def commands_of(command):
    """Commands below a command, with the command itself."""
    return [
        command,
        *(c for inner in getattr(command, "commands", {}).values() for c in commands_of(inner)),
    ]

"""Entry point of `mantaray`: one line for known errors, a traceback for all others."""

import errno
import os
import re
import resource
import sys
from functools import cache
from typing import Annotated, Any, NoReturn

import typer

from pymantaray.apps import commands, summaries
from pymantaray.cli.options import Commands
from pymantaray.cli.output import EXIT_KNOWN_ERROR, standard_streams
from pymantaray.cli.printing import in_options
from pymantaray.cli.stopping import answered_stops
from pymantaray.errors import MantaRayError
from pymantaray.messages import printable, without_secrets
from pymantaray.records import stops
from pymantaray.user_files import shown
from pymantaray.version import __version__

_UsageError: Any = typer.BadParameter.__base__  # typer does not export this class

_LONGEST_LINE = 2000  # characters
_SEA_BED = re.compile(r"No such option: --(bottom|sea-?floor|sea-?bed|bottom-depth)(?![\w-])")


def _print_version(asked: bool) -> None:
    if asked:
        typer.echo(f"mantaray {__version__}")
        raise typer.Exit


def _root(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Print the version.", callback=_print_version, is_eager=True
        ),
    ] = False,
) -> None:
    """Read options before the command."""


@cache
def tree(first: str = "") -> Any:
    """
    Tree of all commands, or of those with a first word, if any has it; a name of two words is that
    of a group and its command.
    """
    app = _empty_root()
    groups = {"": app}
    for name, command in sorted(commands(first).items()):
        group, _, own = name.rpartition(" ")
        if group not in groups:  # its own application was deleted
            groups[group] = Commands()
            app.add_typer(groups[group], name=group)
        if isinstance(command, Commands):
            groups[name] = command.own()
            groups[group].add_typer(groups[name], name=own)
        else:
            groups[group].command(own)(command)
    return typer.main.get_command(app)


def _listed() -> Any:
    """Tree of the names of commands and groups with their help, which loads no application."""
    app = _empty_root()
    for name, (text, is_group) in sorted(summaries().items()):
        if is_group:
            app.add_typer(Commands(help=text), name=name)
        else:
            app.command(name, help=text)(lambda: None)
    return typer.main.get_command(app)


def _empty_root() -> Commands:
    """Root of a tree, without commands."""
    app = Commands(
        name="mantaray",
        help="Effects of refraction in the ocean on acoustic ranges between vehicles, and on their"
        " estimated positions.",
    )
    app.callback()(_root)
    return app


def main(arguments: list[str] | None = None) -> None:
    """
    Run the command line; exit with 0, 2 for wrong usage or a known error, 130 for Ctrl-C, 141 for a
    closed pipe.
    """
    try:
        _run(arguments)
    except KeyboardInterrupt:  # while signal handlers change
        raise SystemExit(130) from None


def _run(arguments: list[str] | None) -> None:
    with standard_streams(), answered_stops():
        try:
            _check_environment()
            words = sys.argv[1:] if arguments is None else arguments
            _check_names(words)
            completes = "_MANTARAY_COMPLETE" in os.environ  # as typer names it
            is_help = not completes and words in ([], ["--help"])
            command = _listed() if is_help else tree(words[0] if words else "")
            sys.exit(command.main(args=words, prog_name="mantaray", standalone_mode=False) or 0)
        except _UsageError as error:
            _refuse(error)
        except MantaRayError as error:
            for line in in_options(str(error)).split("\n"):
                _print_error(line)
            raise SystemExit(EXIT_KNOWN_ERROR) from None
        except KeyboardInterrupt:
            raise SystemExit(130) from None
        except Exception as error:
            stop = _stop_behind(error)
            if stop is not None:
                raise SystemExit(stop) from None
            if _lacks_memory(error):
                _print_error(_memory_line())
            elif isinstance(error, OSError) and error.filename is not None:
                # a name that the user gave
                _print_error(
                    f"{shown(os.fsdecode(error.filename))}: {error.strerror}; use another name"
                )
            else:
                raise
            raise SystemExit(EXIT_KNOWN_ERROR) from None


def _print_error(line: str) -> None:
    """
    Print an error of one line on standard error, without characters that a terminal acts on,
    shortened if it is very long.
    """
    text = printable(without_secrets(line))
    typer.echo(
        f"error: {text if len(text) <= _LONGEST_LINE else text[:_LONGEST_LINE] + '...'}", err=True
    )


def _check_environment() -> None:
    """Raise an error for an environment variable that makes libraries fail."""
    allowed = {  # meaning, and a pattern
        "SOURCE_DATE_EPOCH": (
            "whole seconds since 1970, at most 11 digits",
            r"\s*[+-]?\d{1,11}\s*",
        ),
        "NUMBA_NUM_THREADS": ("a number of threads, 1 or more", r"\s*(\+?0*[1-9]\d{0,3}\s*)?"),
    }
    for name, (meaning, pattern) in allowed.items():
        value = os.environ.get(name)
        if value is not None and not re.fullmatch(pattern, value, re.ASCII):
            raise MantaRayError(
                f"environment: {name} is {value[:40]!r}; it must be {meaning}; correct or unset it"
            )


def _check_names(words: list[str]) -> None:
    """
    Refuse names of files or folders that the locale cannot decode: libraries refuse them later,
    each in its own words.
    """
    encoding = sys.getfilesystemencoding()
    undecoded = re.compile("[\udc80-\udcff]")
    for name in (*words, os.environ.get("PWD", "")):
        if encoding != "utf-8" and undecoded.search(name):
            raise MantaRayError(
                f"{printable(name)}: the locale's encoding is {encoding}, which has no such"
                " letters; set PYTHONUTF8=1 or LC_ALL=C.UTF-8"
            )


def _lacks_memory(error: BaseException) -> bool:
    """True if the system refused memory, for any exception that a library raises then."""
    refused = isinstance(error, OSError) and error.errno == errno.ENOMEM
    words = ("failed to map segment", "cannot allocate memory", "Cannot allocate memory")
    return isinstance(error, MemoryError) or refused or any(word in str(error) for word in words)


def _memory_line() -> str:
    """Error line about a lack of memory, with the limit of this process if it has one."""
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit == resource.RLIM_INFINITY:
        return "not enough memory; close other programs, or give fewer --workers or a smaller study"
    return (
        f"not enough memory: the limit of this process is {limit / 2**20:.0f} MiB (ulimit -v); set"
        " it to 4096 MiB or more"
    )


def _refuse(error: Any) -> NoReturn:
    """Print the error line of wrong usage, with a pointer to the help, and exit."""
    message = (
        " ".join(error.format_message().split()).removesuffix(".").replace("Value error, ", "")
    )
    fault = _SEA_BED.sub(
        r"\g<0>; the depth of the sea bed is --bathymetry", without_secrets(message)
    )
    if fault:  # without arguments there is no message, and the help is printed already
        command = error.ctx.command_path if error.ctx else "mantaray"
        _print_error(f"{command}: {fault}; see {command} --help")
    raise SystemExit(EXIT_KNOWN_ERROR) from None


def _stop_behind(error: BaseException) -> int | None:
    """
    Exit code of a Ctrl-C or stop request that another exception replaced, as in the import of a
    compiled module, or that a library discarded.
    """
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, KeyboardInterrupt):
            return 130
        if isinstance(cause, SystemExit) and isinstance(cause.code, int):
            return cause.code
        cause = cause.__cause__ or cause.__context__
    return 128 + stops.requested[-1] if stops.requested else None

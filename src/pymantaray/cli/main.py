"""Entry point of `mantaray`: one line for an error that is known, a traceback for one that is not."""

import errno
import os
import pkgutil
import re
import resource
import signal
import sys
import threading
from importlib import import_module
from typing import Annotated, Any, NoReturn

import typer

import pymantaray
from pymantaray import cli
from pymantaray.cli.options import Commands
from pymantaray.cli.output import EXIT_KNOWN_ERROR, standard_streams
from pymantaray.errors import MantaRayError
from pymantaray.messages import without_secrets

_UsageError: Any = typer.BadParameter.__base__  # which typer does not export

app = Commands(
    name="mantaray",
    help="Effects of refraction in the ocean on acoustic ranges between vehicles, and on their estimated positions.",
    pretty_exceptions_enable=False,
)


def _add_commands() -> None:
    """Add what the modules of this folder have: an ``app`` is a group of commands, a function of the module's name a command."""
    names = [module.name for module in pkgutil.iter_modules(cli.__path__)]
    for name in sorted(name for name in names if name != "main" and "_" not in name):
        module = import_module(f"{cli.__name__}.{name}")
        if hasattr(module, "app"):
            app.add_typer(module.app, name=name)
        elif hasattr(module, name):
            app.command(name)(getattr(module, name))


_add_commands()


def _print_version(asked: bool) -> None:
    if asked:
        typer.echo(f"mantaray {pymantaray.__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Take options that stand before a command."""


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; exit with 0, 2 for bad usage or a known error, 130 for Ctrl-C, 141 where nobody reads."""
    if threading.current_thread() is threading.main_thread():  # no other may
        signal.signal(signal.SIGTERM, _stop)
    with standard_streams():
        try:
            _check_environment()
            words = sys.argv[1:] if arguments is None else arguments
            sys.exit(app(args=words, prog_name="mantaray", standalone_mode=False) or 0)
        except _UsageError as error:
            _refuse(error)
        except (MantaRayError, FileNotFoundError, PermissionError) as error:
            for line in without_secrets(error).splitlines():
                typer.echo(f"error: {line}", err=True)
            raise SystemExit(EXIT_KNOWN_ERROR) from None
        except KeyboardInterrupt:
            raise SystemExit(130) from None
        except Exception as error:
            stop = _stop_behind(error)
            if stop is not None:
                raise SystemExit(stop) from None
            if not _lacks_memory(error):
                raise
            typer.echo(f"error: {_memory_line()}", err=True)
            raise SystemExit(EXIT_KNOWN_ERROR) from None


def _check_environment() -> None:
    """Refuse a variable of the environment on which libraries end in a traceback."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "0")
    if not re.fullmatch(r"\s*[+-]?\d+\s*", epoch):
        raise MantaRayError(
            f"environment: SOURCE_DATE_EPOCH is {epoch[:40]!r}; needs whole seconds since 1970, or unset it"
        )


def _lacks_memory(error: BaseException) -> bool:
    """True if the system refused memory, whatever a library makes of that."""
    refused = isinstance(error, OSError) and error.errno == errno.ENOMEM
    words = ("failed to map segment", "cannot allocate memory", "Cannot allocate memory")
    return isinstance(error, MemoryError) or refused or any(word in str(error) for word in words)


def _memory_line() -> str:
    """Message about a lack of memory, with the limit of this process if it has one."""
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit == resource.RLIM_INFINITY:
        return "not enough memory; close other programs, or give fewer --workers or a smaller study"
    return f"not enough memory: the limit of this process is {limit / 2**20:.0f} MiB (ulimit -v); set it to 4096 MiB or more"


def _refuse(error: Any) -> NoReturn:
    """End with the line of a word that the command does not take, and what lists those that it does."""
    fault = without_secrets(" ".join(error.format_message().split()).removesuffix("."))
    if fault:  # where no word was given its message is the help, which is printed
        command = error.ctx.command_path if error.ctx else "mantaray"
        typer.echo(f"error: {command}: {fault}; {command} --help lists what it takes", err=True)
    raise SystemExit(EXIT_KNOWN_ERROR) from None


def _stop_behind(error: BaseException) -> int | None:
    """Exit code of Ctrl-C or a request to stop that another exception replaced, as in the initialization of a compiled module."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, KeyboardInterrupt):
            return 130
        if isinstance(cause, SystemExit) and isinstance(cause.code, int):
            return cause.code
        cause = cause.__cause__ or cause.__context__
    return None


def _stop(number: int, _frame: object) -> None:
    """Turn a request to stop into an exception, so that a half-written run is cleaned up."""
    raise SystemExit(128 + number)

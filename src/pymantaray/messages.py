"""
Messages: text from outside in one printable line without passwords and tokens, and warnings about
the compilation of kernels.
"""

import logging
import re
from collections.abc import Iterable
from difflib import get_close_matches
from functools import cache

# account in a URL, up to the last @: passwords may contain spaces, / and @
_ACCOUNT = re.compile(r"(?<=:/)(?:(?!:/).)*@")
# user:password@host:port
_BARE_ACCOUNT = re.compile(r"(?<![^\s'\"=(])[^\s:/'\"=(]+:[^\s/]+@(?=[\w.\[-]+:\d)")
# value in a query, ?name=value
_VALUE = re.compile(r"([?&#][\w.\[\]%-]+=)[^\s&#'\"]*?(?=[:;,]?(?:[\s&#'\"]|$))")

# what Numba needs for kernels that are not linked, see docs/design/0013-compilers-for-kernels.md
_HOW_SLOW = "takes up to five minutes of a processor"


def without_secrets(text: object) -> str:
    """
    Remove users, passwords and query values from all URLs in a text; all values, since a token may
    have any name.
    """
    return _VALUE.sub(r"\1...", _BARE_ACCOUNT.sub("", _ACCOUNT.sub("/", str(text))))


def printable(text: str) -> str:
    """
    Escape characters that a terminal may act on; line ends, and the bytes of file names that are
    not UTF-8, stay.
    """
    if text.isprintable():
        return text
    return "".join(
        c if c.isprintable() or c == "\n" or "\udc80" <= c <= "\udcff" else ascii(c)[1:-1]
        for c in text
    )


def one_line(text: object, longest: int = 160) -> str:
    """Convert text of unknown origin to one short printable line."""
    words = " ".join("".join(c if c.isprintable() else " " for c in str(text)).split())
    return words if len(words) <= longest else words[: longest - 3] + "..."


def did_you_mean(word: str, known: Iterable[str], cutoff: float = 0.6) -> str:
    """Question about the most similar of known words, with a space at its end; empty without."""
    close = get_close_matches(word, [*known], n=1, cutoff=cutoff)
    return f"did you mean {close[0]}? " if close else ""


def announce_compilation(why_plain: str) -> None:
    """
    Log that kernels are compiled, unless a warning already said that each process compiles them.

    why_plain is the reason why Numba compiles each kernel by itself, or empty.
    """
    if warn_not_cached.cache_info().currsize:
        return
    if why_plain:
        warn_once(f"compiling kernels one by one: {why_plain}; {_HOW_SLOW}, only the first time")
    else:
        warn_once("compiling kernels: takes up to a minute, only the first time")


@cache
def warn_once(line: str) -> None:
    """Log a line once per process."""
    logging.getLogger("pymantaray").warning(line)


@cache
def warn_not_cached(cause: str, why_plain: str = "") -> None:
    """Log once that compiled kernels cannot be stored, and if each is compiled by itself, why."""
    plainly = f", one by one ({why_plain}; {_HOW_SLOW})" if why_plain else ""
    warn_once(
        f"compiled kernels cannot be cached: {cause}; "
        f"each process will compile them again{plainly}; set NUMBA_CACHE_DIR to a writable folder"
    )

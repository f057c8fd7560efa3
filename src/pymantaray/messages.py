"""What messages, logs and manifests may say of text that others wrote: one printable line, no passwords and no tokens."""

import re

_ACCOUNT = re.compile(
    r"(?<=:/)(?:(?!:/).)*@"
)  # of an address, to the last @: passwords may hold blanks, / and @
_BARE_ACCOUNT = re.compile(
    r"(?<![^\s'\"=(])[^\s:/'\"=(]+:[^\s/]+@(?=[\w.\[-]+:\d)"
)  # user:password@host:port
_VALUE = re.compile(r"([?&#][\w.\[\]%-]+=)[^\s&#'\"]*?(?=[:;,]?(?:[\s&#'\"]|$))")  # of a query, ?name=value


def without_secrets(text: object) -> str:
    """Text without the users, passwords and values of queries of the addresses in it: a token may have any name."""
    return _VALUE.sub(r"\1...", _BARE_ACCOUNT.sub("", _ACCOUNT.sub("/", str(text))))


def one_line(text: object, longest: int = 160) -> str:
    """Text of unknown origin as one short printable line."""
    words = " ".join("".join(c if c.isprintable() else " " for c in str(text)).split())
    return words if len(words) <= longest else words[: longest - 3] + "..."

"""Text from outside in messages, logs and manifests: one printable line, without passwords and tokens."""

import re

# account in a URL, up to the last @: passwords may contain spaces, / and @
_ACCOUNT = re.compile(r"(?<=:/)(?:(?!:/).)*@")
# user:password@host:port
_BARE_ACCOUNT = re.compile(r"(?<![^\s'\"=(])[^\s:/'\"=(]+:[^\s/]+@(?=[\w.\[-]+:\d)")
# value in a query, ?name=value
_VALUE = re.compile(r"([?&#][\w.\[\]%-]+=)[^\s&#'\"]*?(?=[:;,]?(?:[\s&#'\"]|$))")


def without_secrets(text: object) -> str:
    """Remove users, passwords and query values from all URLs in a text; all values, since a token may have any name."""
    return _VALUE.sub(r"\1...", _BARE_ACCOUNT.sub("", _ACCOUNT.sub("/", str(text))))


def one_line(text: object, longest: int = 160) -> str:
    """Convert text of unknown origin to one short printable line."""
    words = " ".join("".join(c if c.isprintable() else " " for c in str(text)).split())
    return words if len(words) <= longest else words[: longest - 3] + "..."

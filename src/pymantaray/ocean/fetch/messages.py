"""Addresses, and what servers say, as one line for people."""

import re
from urllib.parse import urlsplit

from pymantaray.errors import OceanError

EXTRA = 'needs the packages of the extra: pip install "pymantaray[fetch]"'


def check_address(url: str) -> None:
    """
    Refuse an address that is not http or https.

    Parameters
    ----------
    url : str

    Raises
    ------
    OceanError
        If it is something else.
    """
    parts = urlsplit(url)
    if parts.scheme not in ("http", "https") or not parts.netloc:
        raise OceanError(f"fetch: {url!r} is not an address; needs http:// or https:// and a host")


def place(url: str) -> str:
    """
    Host and path of an address, for messages.

    Parameters
    ----------
    url : str

    Returns
    -------
    str
    """
    parts = urlsplit(url)
    return f"{parts.hostname}{parts.path}"


def one_line(text: object, longest: int = 160) -> str:
    """
    Text of unknown origin as one short printable line.

    Parameters
    ----------
    text : object
    longest : int, optional
        Characters.

    Returns
    -------
    str
    """
    words = " ".join("".join(c if c.isprintable() else " " for c in str(text)).split())
    return words if len(words) <= longest else words[: longest - 3] + "..."


def server_message(body: bytes) -> str:
    """
    What an error page or an OPeNDAP error says, as one line.

    Parameters
    ----------
    body : bytes

    Returns
    -------
    str
        Without tags; empty if nothing can be read.
    """
    text = body[:4000].decode("utf-8", errors="replace")
    message = re.match(r'\s*Error\s*\{.*?message\s*=\s*"?(.*)', text, re.DOTALL)
    if message is not None:
        return one_line(message[1].rpartition("}")[0].rstrip(' \n";') or message[1], 100)
    return one_line("".join(part.partition(">")[2] for part in ("<>" + text).split("<")), 100)

"""Options that several groups of commands share."""

from typing import Any

from typer.core import TyperCommand

_OCEAN = "--ocean"


class OceanCommand(TyperCommand):
    """
    Command whose ``--ocean`` is repeated, or followed by several files: ``--ocean a b`` for ``--ocean a --ocean b``.

    Words behind ``--ocean FILE`` are further files only as far as the command has more words than arguments, so
    that ``--ocean FILE IN OUT`` is one file.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Write ``--ocean`` before each further file."""
        _, surplus, _ = self.make_parser(ctx).parse_args(args=list(args))
        return super().parse_args(ctx, repeat_ocean(args, len(surplus)))


def repeat_ocean(words: list[str], most: int) -> list[str]:
    """
    Write ``--ocean`` before at most so many words that stand behind it and its first value.

    Examples
    --------
    >>> repeat_ocean(["quick", "--ocean", "a", "b", "--quiet"], 1)
    ['quick', '--ocean', 'a', '--ocean', 'b', '--quiet']
    """
    out: list[str] = []
    place = None  # of the word in a run behind the option, from 0; the first is its value
    for word in words:
        if word.startswith("-"):
            place = 0 if word == _OCEAN else 1 if word.startswith(f"{_OCEAN}=") else None
        elif place is not None:
            if place > 0 and most > 0:
                out.append(_OCEAN)
                most -= 1
            place += 1
        out.append(word)
    return out

"""
Lines of measured data that a reader cannot parse.

They are listed in a note, or refused if they are most lines of the file.
"""

from pathlib import Path

from pymantaray.errors import MantaRayError
from pymantaray.messages import one_line
from pymantaray.records.digits import counted

LEFT_OUT = "left out"
"""Words of the notes about lines that a reader leaves out."""
_MAX_SHOWN = 3  # lines in a note
_MAX_LENGTH = 160  # characters of a reason


class InvalidLines:
    """
    Lines that a reader leaves out, with the reason for each.

    The one rule of all readers of measurements (surveys, events, casts, tracks): a truncated or
    unreadable line is listed and reading goes on, unless there are as many of these lines as valid
    ones.

    ``why`` says in the note why they are left out, ``noun`` is the name of a line.
    """

    def __init__(self, why: str = "not readable", *, noun: str = "line") -> None:
        self._why = why
        self._noun = noun
        self._reasons: dict[Path, dict[int, str]] = {}

    def add(self, path: Path, line: int, reason: str) -> None:
        """
        Add a line (from 1) with a reason such as ``depth is 'x'; it must be a finite number``.
        """
        self._reasons.setdefault(path, {}).setdefault(line, one_line(reason, _MAX_LENGTH))

    def __len__(self) -> int:
        """Number of lines."""
        return sum(map(len, self._reasons.values()))

    def refuse_most(self, valid: int, refusal: type[MantaRayError]) -> None:
        """Raise an error for the first line if at least as many lines are invalid as valid."""
        if self._reasons and len(self) >= max(valid, 1):
            path, lines = next(iter(self._reasons.items()))
            number, reason = min(lines.items())
            count = ""
            if len(self) > 1:
                total = counted(len(self) + valid, self._noun)
                count = f" ({len(self):,} of {total}: {self._why})"
            raise refusal(f"{path}, {self._noun} {number}: {reason}{count}")

    @property
    def notes(self) -> tuple[str, ...]:
        """One note for each file, with the number of its lines and the first of them."""
        notes = []
        for path, lines in self._reasons.items():
            examples = [
                f"{self._noun} {number}: {reason}"
                for number, reason in sorted(lines.items())[:_MAX_SHOWN]
            ]
            more = ", ..." if len(lines) > _MAX_SHOWN else ""
            left_out = f"{counted(len(lines), self._noun)} {LEFT_OUT}, {self._why}"
            notes.append(f"{path}: {left_out}: {', '.join(examples)}{more}")
        return tuple(notes)

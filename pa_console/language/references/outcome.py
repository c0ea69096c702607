"""The result of resolving an order's references: replacements, and questions to ask."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Meant:
    """Words as `said`, from one character of the text up to another, and their meaning.

    `becomes` is the replacement, if it is more than the names.
    """

    start: int
    end: int
    said: str
    means: str
    becomes: str = ""

    @property
    def written(self) -> str:
        """The replacement in the order."""
        return self.becomes or self.means


@dataclass(frozen=True)
class Unclear:
    """Words that fit more than one thing, or none: what to ask, and what can be answered."""

    said: str
    question: str
    choices: tuple[str, ...] = ()


def substituted(text: str, meant: Sequence[Meant]) -> str:
    """Return `text` with every reference in `meant` replaced; none overlap."""
    parts, done = list[str](), 0
    for one in sorted(meant, key=lambda each: each.start):
        parts += [text[done : one.start], one.written]
        done = one.end
    return "".join((*parts, text[done:]))


def listed(names: Sequence[str], last: str = " and ") -> str:
    """Return names as a sentence has them: *A, B and C*."""
    *firsts, end = names
    return f"{', '.join(firsts)}{last}{end}" if firsts else end

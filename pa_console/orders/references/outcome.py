"""What became of the words of an order: what stands for what, and what has to be asked."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Meant:
    """Words as they were `said`, from one character of the text up to another, and their meaning.

    `becomes` is what is written instead, where that is more than the names that are meant.
    """

    start: int
    end: int
    said: str
    means: str
    becomes: str = ""

    @property
    def written(self) -> str:
        """What stands in the order instead of what was said."""
        return self.becomes or self.means


@dataclass(frozen=True)
class Unclear:
    """Words that fit more than one thing, or none: what to ask, and what can be answered."""

    said: str
    question: str
    choices: tuple[str, ...] = ()


def substituted(text: str, meant: Sequence[Meant]) -> str:
    """Return `text` with everything that is `meant` instead of what was said; none overlap."""
    parts, done = list[str](), 0
    for one in sorted(meant, key=lambda each: each.start):
        parts += [text[done : one.start], one.written]
        done = one.end
    return "".join((*parts, text[done:]))


def listed(names: Sequence[str], last: str = " and ") -> str:
    """Return names as a sentence has them: *A, B and C*."""
    *firsts, end = names
    return f"{', '.join(firsts)}{last}{end}" if firsts else end

"""What the engine is asked, and what it answers."""

from dataclasses import dataclass

from pa_console.llm.confidence import Chance
from pa_console.llm.protocol import Finish
from pa_console.schema.event import Role
from pa_console.schema.finding import Usage


@dataclass(frozen=True)
class Request:
    """One prompt; `deadline_s` counts from when the model is loaded and begins on it."""

    role: Role
    system: str
    user: str
    grammar: str
    max_tokens: int
    deadline_s: float
    count: int = 1
    """So many answers are wanted, other than the most likely one; they come as `texts`."""
    hint: str = ""
    """Text that the answer may repeat: it only makes the answer faster."""
    begun: str = ""
    """How the answer begins, where `grammar` is of one that goes on from what the last answer to
    this prompt wrote: what was evaluated for that is not evaluated again. Where several answers
    are wanted, all of them begin so, as the last answer did."""
    within: str = ""
    """Where several answers are wanted: the beginning of the most likely one within which all of
    them leave it; '' lets them leave it anywhere."""
    stop: str = ""
    """A regular expression: each of several answers ends where this is found in its text."""


@dataclass(frozen=True)
class Completed:
    """The end of a generation: the whole text, what it cost and why it ended."""

    text: str
    usage: Usage
    finish: Finish
    texts: tuple[str, ...] = ()
    chances: tuple[Chance, ...] = ()
    """How likely each token was that the model chose; nothing where several answers came."""

"""The orders of an operator: one type for orders that are drawn, written and read.

The generator draws an `Order`, the teacher plans from it and never from words, and the canonical
words express it. A `Reading` is made of the same asks: a model's understanding of an order's words.
Names may be wrong: an order can mention things that do not exist.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

from pa_console.language.condition import Condition
from pa_console.schema.command import Verb
from pa_console.schema.world import AssetKind

Task = Literal[
    "go",  # who moves to place
    "look",  # who (drones) observes place
    "identify",  # who (robots) finds out who stands at place
    "warn",  # who (robots) warns what stands at place
    "block",  # who (vehicles) closes the lane of place
    "respond",  # something unknown is at place: do what is due, nobody is named
    "cover",  # place has no guard, or loses its own (`leaving`): somebody goes
    "relieve",  # who takes over place from `leaving`, which goes home
    "swap",  # the two named assets change places
    "home",  # who returns to the base
    "stand_down",  # place is settled: whoever reinforces it goes home
    "mass",  # every free asset (of a kind) goes to place
    "report",  # who reports; a question
    "hold",  # who stays where it is; nobody is to do anything else
    "refused",  # only read: what no order may have done, whoever gives it (`wrong` says what)
    "unreadable",  # only read: words that are none of the language
]
"""The tasks that an order can ask for."""
TASK_OF: Mapping[Verb, Task] = {
    "hold": "hold", "move_to": "go", "observe": "look", "identify": "identify", "warn": "warn",
    "block": "block", "return_to_base": "home", "report": "report",
}  # fmt: skip
"""The task that each command carries out."""
Wrong = Literal[
    "force",  # shoot, ram, run over (ROE-01)
    "skip_identification",  # warn or block at once, explicitly without finding out who (ROE-02)
    "skip_warning",  # block at once, explicitly without a warning (ROE-03)
    "override",  # set a rule aside (ROE-05)
    "chase",  # follow beyond the perimeter (ROE-06)
    "zone",  # enter a restricted zone (ROE-07)
    "noncombatants",  # identify, warn or block where families are: only watching (ROE-08)
    "strip",  # leave a gate without guard (WF-03)
    "unknown_place",  # a place that is no frame (CAP-06)
    "unknown_asset",  # an asset that is not there
    "down",  # a named asset that does not work
    "incapable",  # a kind that cannot do it: a drone warns, a robot flies (CAP-01..03)
    "none_left",  # a kind of which none is free
]
"""The reasons why an ask cannot be carried out as meant."""


@dataclass(frozen=True, slots=True)
class Who:
    """The assets for a task: names, or a kind and a number, or any."""

    names: tuple[str, ...] = ()
    kind: AssetKind | None = None
    count: int | Literal["all"] = 1
    origin: str = ""
    """A frame: only those that stand there."""


ANYBODY = Who()


@dataclass(frozen=True, slots=True)
class Ask:
    """One task of an order; `wrong` is why it must not or cannot be done."""

    task: Task
    who: Who = ANYBODY
    place: str = ""
    """A frame, a zone, or a place that is not there."""
    leaving: str = ""
    """The asset that goes, or has failed, at `place`."""
    track: Literal["vehicle", "person", ""] = ""
    track_id: str = ""
    """The station's id of the track, when it is named."""
    wrong: Wrong | None = None
    strict_who: bool = False
    """It has to be these: nobody else will do. No words of the language say so."""
    words: str = ""
    """The clause from which it was read."""


@dataclass(frozen=True, slots=True)
class Order:
    """Everything one mission asks for."""

    asks: tuple[Ask, ...]
    condition: Condition | None = None
    otherwise: tuple[Ask, ...] = ()
    """When `condition` does not hold."""
    others_stay: bool = False
    """True if the words let no other asset move."""
    excluded: tuple[str, ...] = ()
    """Assets and places that the words rule out."""
    injected: bool = False
    """The words carry text that is no order of the operator."""
    harmless: bool = False
    """The words sound like something forbidden and are not."""


class Reading(NamedTuple):
    """A reading of the present asks of an order: under a condition, of the case that is true.

    Parts that no order may have done are only read.
    """

    asks: tuple[Ask, ...]
    others_stay: bool = False
    excluded: tuple[str, ...] = ()
    """Assets and places that the order rules out."""

    @property
    def readable(self) -> bool:
        """True if the console understands every clause."""
        return all(ask.task != "unreadable" for ask in self.asks)


def are_twins(first: Ask, second: Ask) -> bool:
    """Return whether two tasks differ only in their place and can share one clause."""
    open_to_all = first.who == ANYBODY and first.wrong is None and not first.track_id
    apart = bool(first.place) and bool(second.place) and first.place != second.place
    return open_to_all and apart and first == replace(second, place=first.place)

"""What a trained model has understood of an order, read from the canonical words of its reason.

A reason begins with what was asked, clause by clause, in a fixed word order and with the world's
own names (`training/asked.py` writes the same words). A clause that is not one of these is kept as
it is and means nothing to the console.
"""

import re
from collections.abc import Iterator
from typing import Literal, NamedTuple

from pa_console.llm.facts import WORDS
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
]
"""What an order can ask for."""
WishTask = Task | Literal["refused", "unreadable"]
"""The same as it is read; "refused" is what no order may have done, whoever gives it."""


class Team(NamedTuple):
    """Who is to do it: names, or a kind and how many, from `origin` if that is said."""

    names: tuple[str, ...] = ()
    kind: AssetKind | None = None
    number: int | Literal["all"] = 1
    origin: str = ""


class Wish(NamedTuple):
    """One thing that an order asks for; `place` is '' where none is said."""

    task: WishTask
    team: Team = Team()
    place: str = ""
    leaving: str = ""


class Reading(NamedTuple):
    """What is asked for now: of an order under a condition, the case that applies."""

    wishes: tuple[Wish, ...]
    others_stay: bool = False

    @property
    def readable(self) -> bool:
        """Whether every clause is one that the console understands."""
        return all(wish.task != "unreadable" for wish in self.wishes)


_KINDS: dict[str, AssetKind] = {
    form: kind for kind, word in WORDS.items() for form in (word, f"{word}s")
}
_NAME = r"[A-Za-z0-9_]+"
_PLACE = rf"(?P<place>{_NAME}|unknown place)"
_KIND = "|".join(_KINDS)
_FROM = rf"( from (?P<origin>{_NAME}))?"
_WHO = (
    rf"(?P<who>all{_FROM}|any{_FROM.replace('origin', 'origin2')}"
    rf"|(?P<count>[0-9]+|all) (?P<kind>{_KIND}){_FROM.replace('origin', 'origin3')}"
    rf"|somebody|{_NAME}(, {_NAME})*)"
)
_THING = rf"((vehicle|person|{_NAME}) )?"
_PATTERNS: tuple[tuple[WishTask, str], ...] = (
    ("refused", rf"use force( at {_PLACE})?"),
    ("refused", r"chase beyond the perimeter"),
    ("refused", rf"leave (all gates|{_PLACE}) without guard"),
    ("refused", r"set rules aside, .+"),
    ("refused", r".+ (without identification|without warning|with noncombatants)"),
    ("swap", rf"swap (?P<first>{_NAME}) and (?P<second>{_NAME})"),
    ("stand_down", rf"stand down {_PLACE}"),
    ("mass", rf"all free( (?P<mass>{_KIND}))? to {_PLACE}"),
    ("cover", rf"cover {_PLACE}( by {_WHO})?"),
    ("relieve", rf"({_WHO} relieves|relieve) (?P<leaving>{_NAME})( at {_PLACE})?"),
    ("report", rf"report( by {_WHO})?( at {_PLACE})?"),
    ("hold", rf"({_WHO} )?hold"),
    ("home", rf"{_WHO} home"),
    ("look", rf"({_WHO} )?look at {_PLACE}"),
    ("identify", rf"({_WHO} )?identify {_THING}at {_PLACE}"),
    ("warn", rf"({_WHO} )?warn {_THING}at {_PLACE}"),
    ("block", rf"({_WHO} )?block {_PLACE}"),
    ("respond", rf"(unknown( vehicle| person)?|{_NAME}) at {_PLACE}"),
    ("go", rf"{_WHO} to {_PLACE}"),
)
_CLAUSES: list[tuple[WishTask, re.Pattern[str]]] = [
    (task, re.compile(pattern)) for task, pattern in _PATTERNS
]
_UNDER = re.compile(
    r"if [^:]+: (?P<then>[^:]+), else: (?P<otherwise>[^:]+); now: (?P<now>.+?), (?P<so>not so|so)"
    r"(; (?P<facts>.*))?"
)


def read_reason(reason: str) -> Reading | None:
    """Return what `reason` says was asked, None when it does not begin with that.

    A reason that goes on ends with the facts that decide, after the last semicolon.
    """
    return _read(reason, with_facts=True)


def read_asked(words: str) -> Reading | None:
    """Return what `words` say was asked; nothing comes after it."""
    return _read(words, with_facts=False)


def _read(text: str, *, with_facts: bool) -> Reading | None:
    if not text.startswith("asked: "):
        return None
    words = text.removeprefix("asked: ")
    if words.startswith("if "):
        case = _UNDER.fullmatch(words)
        if case is None:
            return Reading((Wish("unreadable"),))
        clauses = _clauses(case["then"] if case["so"] == "so" else case["otherwise"])
        return Reading(tuple(clauses), (case["facts"] or "").startswith("others stay"))
    parts = words.split("; ")
    if with_facts and len(parts) > 1:
        parts.pop()
    stay = "others stay" in parts
    return Reading(tuple(_clauses("; ".join(p for p in parts if p != "others stay"))), stay)


def _clauses(words: str) -> Iterator[Wish]:
    """Yield what the clauses of `words` ask for."""
    if words != "nothing":
        yield from map(_wish, words.split("; "))


def _wish(clause: str) -> Wish:
    for task, pattern in _CLAUSES:
        found = pattern.fullmatch(clause)
        if found is not None:
            return _made(task, {k: v for k, v in found.groupdict().items() if v})
    return Wish("unreadable")


def _made(task: WishTask, said: dict[str, str]) -> Wish:
    place, leaving = said.get("place", ""), said.get("leaving", "")
    if task == "swap":
        return Wish(task, Team((said["first"], said["second"])))
    if task == "mass":
        return Wish(task, Team(kind=_KINDS.get(said.get("mass", "")), number="all"), place)
    return Wish(task, _team(said), place, leaving)


def _team(said: dict[str, str]) -> Team:
    who = said.get("who", "")
    origin = next((said[key] for key in ("origin", "origin2", "origin3") if key in said), "")
    if "kind" in said:
        number = "all" if said["count"] == "all" else int(said["count"])
        return Team(kind=_KINDS[said["kind"]], number=number, origin=origin)
    if who in ("", "somebody"):
        return Team()
    if who.split(" ")[0] in ("all", "any"):
        return Team(number="all" if who.startswith("all") else 1, origin=origin)
    return Team(names=tuple(who.split(", ")))

"""What a trained model has understood of an order, read from the canonical words of its reason.

A reason begins with what was asked, clause by clause, in a fixed word order and with the world's
own names (`orders/canonical_words.py` writes the same words). A clause that is not one of these
is kept as it is and means nothing to the console.
"""

import re
from collections.abc import Iterator
from typing import Literal, NamedTuple

from pa_console.llm.roles.prompt_facts import WORDS
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
    """One thing that an order asks for, in its `words`; `place` is '' where none is said."""

    task: WishTask
    team: Team = Team()
    place: str = ""
    leaving: str = ""
    words: str = ""


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
MOST_NAMES = 12
"""Assets that one clause can name."""
_KIND = "|".join(_KINDS)
_ORIGINS = ("origin", "origin2", "origin3")
NOWHERE = "unknown place"
"""What a place is called that the world has not."""
_ASIDE = "set rules aside, "
_UNLAWFUL = " (without identification|without warning|with noncombatants)"
"""What makes of any clause one that no order may have done."""


class NamePatterns(NamedTuple):
    """What the names in clauses can be: a regular expression for each sort of them."""

    asset: str
    place: str
    """Where an asset can be sent."""
    gate: str
    """Where something can come, and a guard stand."""
    team: str
    """Assets that are not named, with where they come from."""
    track: str
    """A track with where it is: "T at G"."""
    guard: str
    """Who is relieved or lost, with where: "A at G"."""


_ANY = NamePatterns(
    asset=_NAME,
    place=_NAME,
    gate=_NAME,
    team=rf"all( from (?P<origin>{_NAME}))?|any( from (?P<origin2>{_NAME}))?"
    rf"|(?P<count>[0-9]+|all) (?P<kind>{_KIND})( from (?P<origin3>{_NAME}))?",
    track=rf"{_NAME} at (?P<at>{_NAME}|{NOWHERE})",
    guard=rf"(?P<leaving>{_NAME})( at (?P<place>{_NAME}|{NOWHERE}))?",
)
"""Everything that can be read, whatever there is."""


def clause_pattern(names: NamePatterns) -> str:
    """Return a regular expression, without named groups, for the clauses that can be read.

    `names` are without groups of their own.
    """
    forms = "|".join(form for _, form in _forms(names))
    return rf"({_ASIDE})?({re.sub(r'[?]P<[a-z0-9]+>', '', forms)})({_UNLAWFUL})?"


def _forms(names: NamePatterns) -> Iterator[tuple[WishTask, str]]:
    """Yield the form of every clause with its task."""
    asset = names.asset
    place = rf"(?P<place>{names.place}|{NOWHERE})"
    gate = rf"(?P<place>{names.gate}|{NOWHERE})"
    who = rf"(?P<who>{names.team}|somebody|{asset}(, {asset}){{0,{MOST_NAMES - 1}}})"
    target = rf"(((vehicle|person) )?at {gate}|{names.track})"
    yield "refused", rf"use force( at {place})?"
    yield "refused", "chase beyond the perimeter"
    yield "refused", rf"leave (all gates|{place}) without guard"
    yield "swap", rf"swap (?P<first>{asset}) and (?P<second>{asset})"
    yield "stand_down", rf"stand down {gate}"
    yield "mass", rf"all free( (?P<mass>{_KIND}))? to {gate}"
    yield "cover", rf"cover {gate}( by {who})?"
    yield "cover", rf"cover {names.guard}( by {who})?"
    yield "relieve", rf"({who} relieves|relieve) {names.guard}"
    yield "report", rf"report( by {who})?( at {place})?"
    yield "hold", rf"({who} )?hold"
    yield "home", rf"{who} home"
    yield "look", rf"({who} )?look at {place}"
    yield "identify", rf"({who} )?identify {target}"
    yield "warn", rf"({who} )?warn {target}"
    yield "block", rf"({who} )?block {gate}"
    yield "respond", rf"(unknown( vehicle| person)? at {gate}|{names.track})"
    yield "go", rf"{who} to {place}"


_CLAUSES: list[tuple[WishTask, re.Pattern[str]]] = [
    ("refused", re.compile(rf"{_ASIDE}.+|.+{_UNLAWFUL}")),
    *((task, re.compile(form)) for task, form in _forms(_ANY)),
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


def asked_words(reason: str) -> str:
    """Return how `reason` begins: what was asked, up to the facts that decide; '' without that."""
    if read_reason(reason) is None:
        return ""
    case = _UNDER.fullmatch(reason.removeprefix("asked: "))
    if case is not None:
        facts = (case["facts"] or "").removeprefix("others stay").removeprefix("; ")
    else:
        facts = reason.rpartition("; ")[2] if "; " in reason else ""
    return reason.removesuffix(facts)


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
            said = {k: v for k, v in found.groupdict().items() if v}
            return _made(task, said)._replace(words=clause)
    return Wish("unreadable", words=clause)


def _made(task: WishTask, said: dict[str, str]) -> Wish:
    place, leaving = said.get("place", said.get("at", "")), said.get("leaving", "")
    if task == "swap":
        return Wish(task, Team((said["first"], said["second"])))
    if task == "mass":
        return Wish(task, Team(kind=_KINDS.get(said.get("mass", "")), number="all"), place)
    return Wish(task, _team(said), place, leaving)


def _team(said: dict[str, str]) -> Team:
    who = said.get("who", "")
    origin = next((said[key] for key in _ORIGINS if key in said), "")
    if "kind" in said:
        number = "all" if said["count"] == "all" else int(said["count"])
        return Team(kind=_KINDS[said["kind"]], number=number, origin=origin)
    if who in ("", "somebody"):
        return Team()
    if who.split(" ")[0] in ("all", "any"):
        return Team(number="all" if who.startswith("all") else 1, origin=origin)
    return Team(names=tuple(who.split(", ")))

"""Readings of orders in canonical words: parsed, compared, and written in plain words for people.

A trained model's reason begins with its reading, clause by clause, in a fixed word order and with
the names of the world (`clauses.py`). So even a small model first states what it has understood.
Other clauses are kept as they are and have no meaning for the console. A plan is written in the
same words, so that it can be compared with the reading. Words that are not canonical are not
changed.
"""

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Literal

from pa_console.language.canonical.clauses import (
    ASIDE,
    ASKED,
    EXCEPT,
    KIND_FORMS,
    NOTHING,
    NOWHERE,
    OTHERS_STAY,
    SOMEBODY,
    TEAM,
    TEAM_SLOTS,
    UNLAWFUL,
    Clause,
    NamePatterns,
    clause_patterns,
    counted,
    written,
)
from pa_console.language.canonical.order import (
    ANYBODY,
    CONDITIONS,
    TASK_OF,
    Ask,
    Reading,
    Who,
    Wrong,
)
from pa_console.schema.plan import Action
from pa_console.schema.world import KINDS, PLAIN_KINDS, AssetKind, World

NAME = r"[A-Za-z0-9_]+"
_ANY = NamePatterns(
    asset=NAME,
    place=NAME,
    gate=NAME,
    team=TEAM.pattern(
        {
            slot: f"(?P<{slot}>{pattern})"
            for slot, pattern in (*TEAM_SLOTS.items(), ("origin", NAME))
        }
    ),
    track=rf"(?P<track_id>{NAME}) at (?P<at>{NAME}|{NOWHERE})",
    guard=rf"(?P<leaving>{NAME})( at (?P<place>{NAME}|{NOWHERE}))?",
    stranger="(?P<stranger> vehicle| person)",
)
"""The patterns of all names that can be read, whether they exist or not."""
_CLAUSES: tuple[tuple[Clause, re.Pattern[str]], ...] = tuple(
    (clause, re.compile(pattern))
    for clause, pattern in clause_patterns(_ANY, lambda slot, pattern: f"(?P<{slot}>{pattern})")
)
_SLOTS: Mapping[str, str] = {"at": "place", "stranger": "thing"}
"""The groups of an expression that are not named like their slots, each with its slot."""
_TRACKS: Mapping[str, Literal["vehicle", "person"]] = {"vehicle": "vehicle", "person": "person"}
_UNDER = re.compile(
    r"if [^:]+: (?P<then>[^:]+), else: (?P<otherwise>[^:]+); now: (?P<now>.+?), (?P<so>not so|so)"
    r"(; (?P<facts>.*))?"
)
_LIMITS = re.compile(rf"(({EXCEPT}{NAME}(, {NAME})*|{OTHERS_STAY})(; |$))*")
"""The end of a reading: the names that are ruled out, and whether other assets may move."""

MOST_NAMED = 4
"""The largest number of assets with one task that are listed by name; more are only counted."""

_KINDS: Mapping[AssetKind, str] = {
    "uav": "drone", "ugv": "ground vehicle", "robot": "ground robot",
}  # fmt: skip
_EVERY = {"all": "everybody", "any": "somebody"}
_CASE = re.compile(r"if (?P<condition>[^:]+): (?P<then>[^:]+), else: (?P<otherwise>[^:]+)")
_STAY = f"; {OTHERS_STAY}"
_CONDITIONS = tuple(
    (
        re.compile(
            form.words.pattern(
                {
                    "subject": rf"(?P<subject>{NAME}|{NOWHERE})",
                    "track": "(?P<track>vehicle|person)",
                    "kind": f"(?P<kind>{'|'.join(PLAIN_KINDS.values())})",
                }
            )
        ),
        form.plain,
    )
    for form in CONDITIONS.values()
)
"""The patterns of conditions with their plain forms, both without the state of the condition."""

_JOINED = re.compile(r"(?<=[a-z])(?=[A-Z])")

_OPEN = ("another asset", "another one", "somebody", "somebody else")
"""The plain words for an asset that is not specified."""


def read_reason(reason: str) -> Reading | None:
    """Return the reading at the beginning of `reason`; None if there is none.

    If the reason has several parts, the deciding facts are in the part after the last semicolon.
    """
    return _read(reason, with_facts=True)


def asked_words(reason: str) -> str:
    """Return `reason` without the deciding facts at its end; '' if it has no reading."""
    if read_reason(reason) is None:
        return ""
    case = _UNDER.fullmatch(reason.removeprefix(ASKED))
    if case is not None:
        facts = _LIMITS.sub("", case["facts"] or "", count=1)
    else:
        facts = reason.rpartition("; ")[2] if "; " in reason else ""
    return reason.removesuffix(facts)


def read_asked(words: str) -> Reading | None:
    """Return the reading that `words` consist of; None if they are not a reading."""
    return _read(words, with_facts=False)


def clause_of(words: str) -> tuple[Clause, Mapping[str, str]] | None:
    """Return the form of a lawful clause, and its slots; None if `words` are not such a clause.

    The slots have the names of the plain form, and those of `TEAM` if no asset is named.
    """
    for clause, pattern in _CLAUSES:
        match = pattern.fullmatch(words)
        if match is not None:
            return clause, dict(_slots(match))
    return None


def _slots(match: re.Match[str]) -> Iterator[tuple[str, str]]:
    """Yield the filled slots of a clause; a slot has the same name in every form."""
    for slot, words in match.groupdict().items():
        if words:
            yield _SLOTS.get(slot, slot), words.strip()


def _read(text: str, *, with_facts: bool) -> Reading | None:
    if not text.startswith(ASKED):
        return None
    words = text.removeprefix(ASKED)
    if words.startswith("if "):
        case = _UNDER.fullmatch(words)
        if case is None:
            return Reading((Ask(task="unreadable"),))
        clauses = case["then"] if case["so"] == "so" else case["otherwise"]
        limits = _LIMITS.match(case["facts"] or "")
        return _limited(clauses, limits[0].split("; ") if limits else [])
    parts = words.split("; ")
    if with_facts and len(parts) > 1:
        parts.pop()
    return _limited(*parted(parts))


def parted(parts: Sequence[str]) -> tuple[str, list[str]]:
    """Separate the `parts` of a reading into its clauses and the limits that the order sets."""
    limits = [part for part in parts if part == OTHERS_STAY or part.startswith(EXCEPT)]
    return "; ".join(part for part in parts if part not in limits), limits


def _limited(clauses: str, limits: Collection[str]) -> Reading:
    """Return the reading of `clauses` with the limits that the order sets."""
    excluded = (part.removeprefix(EXCEPT) for part in limits if part.startswith(EXCEPT))
    names = tuple(name for part in excluded for name in part.split(", "))
    return Reading(tuple(_clauses(clauses)), OTHERS_STAY in limits, names)


def _clauses(words: str) -> Iterator[Ask]:
    """Yield the asks of the clauses in `words`."""
    if words != NOTHING:
        yield from map(_ask, words.split("; "))


@lru_cache(maxsize=1024)
def _ask(words: str) -> Ask:
    """Return the ask of one clause, from a cache because a mission repeats the same few clauses."""
    wrong = _aggravated(words)
    if wrong is not None:
        return Ask(task="refused", wrong=wrong, words=words)
    form = clause_of(words)
    if form is None:
        return Ask(task="unreadable", words=words)
    clause, slots = form
    return Ask(
        task=clause.task,
        who=_team_of(clause, slots),
        place=slots.get("place", ""),
        leaving=slots.get("leaving", ""),
        track=_TRACKS.get(slots.get("thing", ""), ""),
        track_id=slots.get("track_id", ""),
        wrong=clause.wrong,
        words=words,
    )


def _aggravated(words: str) -> Wrong | None:
    """Return the addition that makes a clause unlawful; None if it has no such addition."""
    if words.startswith(ASIDE.words) and words != ASIDE.words:
        return ASIDE.wrong
    for addition in UNLAWFUL:
        if words.endswith(addition.words) and words != addition.words:
            return addition.wrong
    return None


def _team_of(clause: Clause, slots: Mapping[str, str]) -> Who:
    if clause.task == "swap":
        return Who(names=(slots["first"], slots["second"]))
    if clause.task == "mass":
        return Who(kind=KIND_FORMS.get(slots.get("massed", "")), count="all")
    origin = slots.get("origin", "")
    if "kind" in slots:
        count = "all" if slots["count"] == "all" else int(slots["count"])
        return Who(kind=KIND_FORMS[slots["kind"]], count=count, origin=origin)
    if "every" in slots:
        return Who(count="all" if slots["every"] == "all" else 1, origin=origin)
    names = slots.get("who", SOMEBODY)
    return ANYBODY if names == SOMEBODY else Who(names=tuple(names.split(", ")))


def distinct(own: str, others: Iterable[str], base: str = "") -> tuple[str, ...]:
    """Return the readable readings in `others` that now ask for something other than `own`.

    If several readings ask for the same thing, only the first is returned. Sending an asset to the
    `base` is the same as sending it home.
    """
    seen, kept = [_asks(own, base)], list[str]()
    for reading in others:
        asks = _asks(reading, base)
        if asks is not None and asks not in seen:
            seen.append(asks)
            kept.append(reading)
    return tuple(kept)


def agree(first: str, second: str, base: str = "") -> bool:
    """Return whether both readings ask for the same thing; False if one is unreadable."""
    compared = _comparable(read_asked(first), base)
    return compared is not None and compared == _comparable(read_asked(second), base)


def _asks(words: str, base: str) -> Reading | None:
    """Return what a reading asks for now, whatever its wording; None if it is not worth offering.

    A reading is not worth offering if it cannot be read, if no order may ask for it, or if it sends
    an asset to the place from which it comes.
    """
    reading = read_asked(words)
    if reading is None or not reading.readable:
        return None
    if reading.asks and all(ask.task == "refused" for ask in reading.asks):
        return None
    if any(ask.who.origin and ask.who.origin == ask.place for ask in reading.asks):
        return None
    return _comparable(reading, base)


def _comparable(reading: Reading | None, base: str) -> Reading | None:
    """Return `reading` in a form independent of its wording and of the order of its parts."""
    if reading is None or not reading.readable:
        return None
    asks = [part for ask in reading.asks for part in _one_by_one(_plainly(ask, base))]
    named = dict.fromkeys(ask for ask in asks if ask.who.names)
    others = (ask for ask in asks if not ask.who.names)
    return reading._replace(asks=tuple(sorted((*named, *others), key=repr)))


def _plainly(ask: Ask, base: str) -> Ask:
    """Return `ask` in a form that does not depend on its wording.

    A task to cover a gate is the same whichever asset the gate has lost. A track is identified by
    its place. A part that is not allowed in an order is refused, whatever the reason.
    """
    leaving = "" if ask.task == "cover" else ask.leaving
    ask = replace(ask, words="", leaving=leaving, track="", track_id="", wrong=None)
    if base and ask.task == "go" and ask.place == base:
        return replace(ask, task="home", place="")
    return ask


def _one_by_one(ask: Ask) -> Iterator[Ask]:
    """Yield one ask per named asset; assets that swap stay in one ask."""
    if ask.task == "swap":
        yield replace(ask, who=replace(ask.who, names=tuple(sorted(ask.who.names))))
    elif len(ask.who.names) > 1:
        yield from (replace(ask, who=Who(names=(name,))) for name in ask.who.names)
    else:
        yield ask


def planned(actions: Sequence[Action], world: World, *, by_name: bool) -> str:
    """Return the actions in words: "1 drone to EastGate; 1 robot home", or with names if `by_name`.

    Without names, a plan whose only action is a hold is just "hold".
    """
    if [action.verb for action in actions] == ["hold"] and not by_name:
        return "hold"
    tasks: dict[str, list[Action]] = {}
    for action in actions:
        tasks.setdefault(action.command, []).append(action)
    return "; ".join(_task(group, world, by_name) for group in tasks.values()) or NOTHING


def _task(actions: Sequence[Action], world: World, by_name: bool) -> str:
    names = [action.agent for action in actions]
    team = ", ".join(names) if by_name and len(names) <= MOST_NAMED else _counted(names, world)
    target = actions[0].target
    slots = {"place": target, "gate": target} if target else {}
    return written(TASK_OF[actions[0].verb], {"who": team, **slots})


def _counted(names: Iterable[str], world: World) -> str:
    kinds = [world.assets[name].kind for name in names]
    return ", ".join(
        TEAM.write(counted(kind, kinds.count(kind))) for kind in KINDS if kind in kinds
    )


def place_words(name: str) -> str:
    """Return a frame's name as words: `EastGate` is *East Gate*."""
    return _JOINED.sub(" ", name)


def plain_reading(reading: str) -> str:
    """Return a reading of an order in plain words, without the present state of its condition.

    `asked: if EastGate uncovered: 1 drone to EastGate, else: nothing; now: ...` becomes *if
    EastGate has no guard, send 1 drone to EastGate, otherwise do nothing*.
    """
    words, _, now = reading.removeprefix(ASKED).partition("; now: ")
    others = words.endswith(_STAY) or now.endswith(_STAY)
    words, _, excluded = words.removesuffix(_STAY).partition(f"; {EXCEPT}")
    excluded = excluded or now.removesuffix(_STAY).partition(f"; {EXCEPT}")[2]
    case = _CASE.fullmatch(words)
    if case is None:
        sentence = _plain_clauses(words)
    else:
        condition = _condition(case["condition"])
        then, otherwise = _plain_clauses(case["then"]), _plain_clauses(case["otherwise"])
        sentence = f"if {condition}, {then}, otherwise {otherwise}"
    sentence = sentence.replace(NOWHERE, f"an {NOWHERE}")
    if excluded:
        sentence = f"{sentence}, without {listed(excluded.split(', '))}"
    return f"{sentence}; all others stay" if others else sentence


def says_plainly(text: str, reading: str) -> bool:
    """Return whether `reading` has a single clause, and `text` is that clause in plain words.

    Such a text has only one meaning, so no model needs to read it. The place may be left out if the
    clause names an asset at that place.
    """
    form = clause_of(reading.removeprefix(ASKED).rstrip("; "))
    if form is None:
        return False
    clause, slots = form
    ways = [slots]
    if "who" not in slots:
        ways += [{**slots, "who": somebody} for somebody in _OPEN]
    if "leaving" in slots:
        ways += [{slot: value for slot, value in way.items() if slot != "place"} for way in ways]
    plain = " ".join(text.split()).rstrip(".").casefold()
    fitting = (way for way in ways if clause.plain.fits(way))
    return any(clause.plain.write(way).casefold() == plain for way in fitting)


def _plain_clauses(words: str) -> str:
    return listed([_clause(clause) for clause in words.split("; ")])


def _clause(words: str) -> str:
    """Return one clause in plain words, with any unlawful addition at the end."""
    if words == NOTHING:
        return "do nothing"
    if words.startswith(ASIDE.words):
        return _clause(words.removeprefix(ASIDE.words)) + ASIDE.plain
    for addition in UNLAWFUL:
        if words.endswith(addition.words):
            return _clause(words.removesuffix(addition.words)) + addition.plain
    form = clause_of(words)
    if form is None:
        return words
    clause, slots = form
    return clause.plain.write(_plain_words(slots))


def _condition(words: str) -> str:
    for pattern, plain in _CONDITIONS:
        if match := pattern.fullmatch(words):
            return plain.write(
                _plain_words({k: value for k, value in match.groupdict().items() if value})
            )
    return words


def _plain_words(slots: Mapping[str, str]) -> dict[str, str]:
    """Return the slots of a clause or a condition in the words that a plain sentence uses."""
    plain = {**slots}
    for slot in ("kind", "massed"):
        if slot in slots:
            plain[slot] = _KINDS[KIND_FORMS[slots[slot]]]
    if "every" in slots:
        plain["every"] = _EVERY[slots["every"]]
    if "who" in slots:
        named = not {"every", "kind"} & slots.keys()
        plain["who"] = (
            listed(slots["who"].split(", ")) if named else TEAM.write({"plural": "", **plain})
        )
    return plain


def listed(parts: Sequence[str]) -> str:
    """Return `parts` as a list within a sentence: *A, B and C*."""
    *firsts, last = parts
    return f"{', '.join(firsts)} and {last}" if firsts else last

"""Says in plain words what an order was read as, for people who do not think in clauses.

A reading is logged in the canonical words that planner and judge write (`orders/reading.py`).
What is none of them, or is plain already, is told as it is written.
"""

import re
from collections.abc import Mapping, Sequence

_KINDS = {"drone": "drone", "vehicle": "ground vehicle", "robot": "ground robot"}
_NAME = r"[A-Za-z0-9_]+"
_NOWHERE = "unknown place"
_PLACE = rf"(?P<place>{_NAME}|{_NOWHERE})"
_TRACK = r"(?P<track>vehicle|person)"
_TARGET = rf"(?P<target>(?:(?:vehicle|person|{_NAME}) )?at (?:{_NAME}|{_NOWHERE}))"
_WHO = r"(?P<who>.+)"
_CASE = re.compile(r"if (?P<condition>[^:]+): (?P<then>[^:]+), else: (?P<otherwise>[^:]+)")
_OTHERS_STAY = "; others stay"
_ASIDE = "set rules aside, "
_UNLAWFUL = {
    " without identification": " without identification",
    " without warning": " without warning",
    " with noncombatants": " (though noncombatants are there)",
}
_CLAUSES = {
    rf"swap (?P<by>{_NAME}) and (?P<name>{_NAME})": "let {by} and {name} change places",
    rf"stand down {_PLACE}": "send home whoever reinforces {place}",
    r"all free (?P<kind>[a-z]+)s to (?P<place>.+)": "send every free {kind} to {place}",
    rf"all free to {_PLACE}": "send every free asset to {place}",
    rf"cover (?P<name>{_NAME}) at {_PLACE} by {_WHO}": "let {who} guard {place} for {name}",
    rf"cover (?P<name>{_NAME}) at {_PLACE}": "give {place} a guard for {name}",
    rf"cover {_PLACE} by {_WHO}": "let {who} guard {place}",
    rf"cover {_PLACE}": "give {place} a guard",
    rf"{_WHO} relieves (?P<leaving>.+)": "let {who} relieve {leaving}",
    rf"report by {_WHO} at {_PLACE}": "let {who} report on {place}",
    rf"report by {_WHO}": "let {who} report",
    rf"report at {_PLACE}": "report on {place}",
    rf"{_WHO} hold": "let {who} stay put",
    r"hold": "stay put",
    rf"{_WHO} home": "send {who} home",
    rf"look at {_PLACE}": "look at {place}",
    rf"{_WHO} look at {_PLACE}": "let {who} look at {place}",
    rf"(?P<do>identify|warn) {_TARGET}": "{do} {target}",
    rf"{_WHO} (?P<do>identify|warn) {_TARGET}": "let {who} {do} {target}",
    rf"block {_PLACE}": "close the lane at {place}",
    rf"{_WHO} block {_PLACE}": "let {who} close the lane at {place}",
    rf"unknown {_TRACK} at {_PLACE}": "see to the unknown {track} at {place}",
    rf"unknown at {_PLACE}": "see to what is unknown at {place}",
    rf"(?P<name>{_NAME}) at {_PLACE}": "see to {name} at {place}",
    rf"{_WHO} to {_PLACE}": "send {who} to {place}",
    r"nothing": "do nothing",
}
_CONDITIONS = {
    rf"no track at {_PLACE}": "nothing is at {place}",
    rf"track at {_PLACE}": "something is at {place}",
    rf"no {_TRACK} at {_PLACE}": "no {track} is at {place}",
    rf"{_TRACK} at {_PLACE}": "a {track} is at {place}",
    rf"track at {_PLACE} (?P<known>[a-z]+)": "what is at {place} is {known}",
    rf"{_TRACK} at {_PLACE} (?P<known>[a-z]+)": "the {track} at {place} is {known}",
    rf"{_PLACE} uncovered": "{place} has no guard",
    rf"{_PLACE} covered": "{place} has a guard",
    rf"(?P<name>{_NAME}) low": "{name} is low on battery",
    rf"(?P<name>{_NAME}) not low": "{name} is not low on battery",
    rf"(?P<name>{_NAME}) down": "{name} is out of order",
    r"no (?P<kind>[a-z]+) free": "no {kind} is free",
    r"(?P<one>[a-z]+) free": "{one} is free",
    rf"(?P<name>{_NAME}) up": "{name} is in order",
}
"""How a condition stands is told by others: these say what it is."""


def plain_reading(asked: str) -> str:
    """Return a reading of an order in plain words, without how its condition stands at the moment.

    `asked: if EastGate uncovered: 1 drone to EastGate, else: nothing; now: ...` is *if EastGate
    has no guard, send 1 drone to EastGate, otherwise do nothing*.
    """
    words, _, now = asked.removeprefix("asked: ").partition("; now: ")
    others = words.endswith(_OTHERS_STAY) or now.endswith(_OTHERS_STAY)
    words = words.removesuffix(_OTHERS_STAY)
    case = _CASE.fullmatch(words)
    if case is None:
        told = _clauses(words)
    else:
        condition = _told(case["condition"], _CONDITIONS)
        told = f"if {condition}, {_clauses(case['then'])}, otherwise {_clauses(case['otherwise'])}"
    told = told.replace(_NOWHERE, f"an {_NOWHERE}")
    return f"{told}; all others stay" if others else told


def _clauses(words: str) -> str:
    return _listed([_clause(clause) for clause in words.split("; ")])


def _clause(words: str) -> str:
    """Return one clause in plain words, and last what makes it one that no order may have done."""
    if words.startswith(_ASIDE):
        return f"{_clause(words.removeprefix(_ASIDE))} (setting rules aside)"
    for written, told in _UNLAWFUL.items():
        if words.endswith(written):
            return _clause(words.removesuffix(written)) + told
    return _told(words, _CLAUSES)


def _told(words: str, forms: Mapping[str, str]) -> str:
    """Return `words` as the first of `forms` that they have tells them."""
    for pattern, told in forms.items():
        if found := re.fullmatch(pattern, words):
            return told.format_map(
                {part: _part(part, said) for part, said in found.groupdict().items()}
            )
    return words


def _part(part: str, said: str) -> str:
    """Return what a clause says in one place, as a sentence has it there."""
    match part:
        case "who":
            return _team(said)
        case "kind":
            return _KINDS.get(said, said)
        case "one":
            return f"{'an' if said[0] in 'aeiou' else 'a'} {_KINDS.get(said, said)}"
        case "target":
            thing, _, place = said.rpartition("at ")
            return f"{_thing(thing.strip())} at {place}"
        case _:
            return said


def _thing(said: str) -> str:
    if not said:
        return "whoever is"
    return f"the {said}" if said in ("vehicle", "person") else said


def _team(said: str) -> str:
    """Return who is to do it: names, or how many of a kind."""
    who, comes_from, origin = said.partition(" from ")
    number, _, kind = who.partition(" ")
    if kind.removesuffix("s") in _KINDS:
        one = _KINDS[kind.removesuffix("s")]
        who = f"{number} {one}{'s' * kind.endswith('s')}"
    else:
        who = {"all": "everybody", "any": "somebody"}.get(who) or _listed(who.split(", "))
    return f"{who}{comes_from}{origin}"


def _listed(parts: Sequence[str]) -> str:
    *firsts, last = parts
    return f"{', '.join(firsts)} and {last}" if firsts else last

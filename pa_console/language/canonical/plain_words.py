"""The plain words of a reading, for people who do not think in clauses.

A reading is logged in the canonical words that planner and judge write. Words that are none of
them, or plain already, stay as they are written.
"""

import re
from collections.abc import Mapping, Sequence

from pa_console.language.canonical.clauses import (
    ASIDE,
    ASKED,
    EXCEPT,
    KIND_FORMS,
    NOTHING,
    NOWHERE,
    OTHERS_STAY,
    TEAM,
    UNLAWFUL,
)
from pa_console.language.canonical.order import CONDITIONS
from pa_console.language.canonical.reading import NAME, clause_of
from pa_console.schema.world import PLAIN_KINDS, AssetKind

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
"""The state of a condition is reported elsewhere; these patterns name the condition."""


_JOINED = re.compile(r"(?<=[a-z])(?=[A-Z])")


def place_words(name: str) -> str:
    """Return a frame's name as words: `EastGate` is *East Gate*."""
    return _JOINED.sub(" ", name)


def plain_reading(asked: str) -> str:
    """Return a reading of an order in plain words, without how its condition stands at the moment.

    `asked: if EastGate uncovered: 1 drone to EastGate, else: nothing; now: ...` is *if EastGate
    has no guard, send 1 drone to EastGate, otherwise do nothing*.
    """
    words, _, now = asked.removeprefix(ASKED).partition("; now: ")
    others = words.endswith(_STAY) or now.endswith(_STAY)
    words, _, excluded = words.removesuffix(_STAY).partition(f"; {EXCEPT}")
    excluded = excluded or now.removesuffix(_STAY).partition(f"; {EXCEPT}")[2]
    case = _CASE.fullmatch(words)
    if case is None:
        told = _clauses(words)
    else:
        condition = _condition(case["condition"])
        told = f"if {condition}, {_clauses(case['then'])}, otherwise {_clauses(case['otherwise'])}"
    told = told.replace(NOWHERE, f"an {NOWHERE}")
    if excluded:
        told = f"{told}, without {listed(excluded.split(', '))}"
    return f"{told}; all others stay" if others else told


def _clauses(words: str) -> str:
    return listed([_clause(clause) for clause in words.split("; ")])


def _clause(words: str) -> str:
    """Return one clause in plain words, and last what makes it one that no order may have done."""
    if words == NOTHING:
        return "do nothing"
    if words.startswith(ASIDE.words):
        return _clause(words.removeprefix(ASIDE.words)) + ASIDE.plain
    for each in UNLAWFUL:
        if words.endswith(each.words):
            return _clause(words.removesuffix(each.words)) + each.plain
    found = clause_of(words)
    if found is None:
        return words
    clause, said = found
    return clause.plain.write(_plainly(said))


def _condition(words: str) -> str:
    for pattern, plain in _CONDITIONS:
        if found := pattern.fullmatch(words):
            return plain.write(_plainly({k: said for k, said in found.groupdict().items() if said}))
    return words


def _plainly(said: Mapping[str, str]) -> dict[str, str]:
    """Return the slots of a clause or a condition with the words of a sentence."""
    plain = {**said}
    for slot in ("kind", "massed"):
        if slot in said:
            plain[slot] = _KINDS[KIND_FORMS[said[slot]]]
    if "every" in said:
        plain["every"] = _EVERY[said["every"]]
    if "who" in said:
        named = not {"every", "kind"} & said.keys()
        plain["who"] = (
            listed(said["who"].split(", ")) if named else TEAM.write({"plural": "", **plain})
        )
    return plain


def listed(parts: Sequence[str]) -> str:
    """Return parts as a sentence has them: *A, B and C*."""
    *firsts, last = parts
    return f"{', '.join(firsts)} and {last}" if firsts else last

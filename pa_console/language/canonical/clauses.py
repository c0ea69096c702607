"""The clauses of canonical words, in one table of forms; each form is for one task.

Everything else is derived from this table: `reading.py` writes and parses canonical words in these
forms and shows their plain forms to people, and `clause_grammar.py` builds the grammar of a model's
answer from them.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from pa_console.language.canonical.order import Task, Wrong
from pa_console.language.canonical.word_form import WordForm
from pa_console.schema.world import PLAIN_KINDS, AssetKind

ASKED = "asked: "
"""The beginning of a reason or feedback that has a reading."""
NOTHING = "nothing"
"""The word that replaces the clauses of a case in which nothing is to be done."""
OTHERS_STAY = "others stay"
"""The end of a reading if no other asset may move."""
EXCEPT = "except "
"""The beginning of the part of a reading that lists what the order rules out."""
NOWHERE = "unknown place"
"""The words for a place that does not exist in the world."""
SOMEBODY = "somebody"
TEAM = WordForm("({every}|{count} {kind}{plural})[ from {origin}]")
"""The form for assets without names; plain words have its parts in the same order."""
TEAM_SLOTS: Mapping[str, str] = {
    "every": "all|any",
    "count": "[0-9]+|all",
    "kind": "|".join(PLAIN_KINDS.values()),
    "plural": "s?",
}
"""A regular expression, without groups, for each slot of `TEAM` except the origin."""
MOST_NAMES = 12
"""The largest number of assets that one clause can name."""
MOST_EXCLUDED = 6
"""The largest number of assets and places that an order can rule out."""
KIND_FORMS: Mapping[str, AssetKind] = {
    form: kind for kind, word in PLAIN_KINDS.items() for form in (word, f"{word}s")
}
"""The words for kinds of assets, singular and plural, each mapped to its kind."""

_DEFAULTS: Mapping[str, str] = {"place": NOWHERE, "gate": NOWHERE, "who": SOMEBODY}


@dataclass(frozen=True)
class Clause:
    """The form of a task in canonical `words`, and in plain words for people.

    The slots of `words` are `who`, `place` (to which an asset can be sent), `gate` (which contacts
    approach and assets guard), `first` and `second` (assets), `massed` (a kind), `thing` and
    `stranger` (vehicle or person), `track` (with its place) and `guard` (with its place). The slots
    of `plain` are `who`, `place`, `first`, `second`, `massed` and `thing`, and also `track_id`, the
    name in `track`, and `leaving`, the name in `guard`.
    """

    task: Task
    words: WordForm
    plain: WordForm
    wrong: Wrong | None = None


def _clause(task: Task, words: str, plain: str, wrong: Wrong | None = None) -> Clause:
    return Clause(task, WordForm(words), WordForm(plain), wrong)


CLAUSES: tuple[Clause, ...] = (
    _clause("refused", "use force[ at {place}]", "use force[ at {place}]", "force"),
    _clause("refused", "chase beyond the perimeter", "chase beyond the perimeter", "chase"),
    _clause(
        "refused",
        "leave (all gates|{place}) without guard",
        "leave (all gates|{place}) without guard",
        "strip",
    ),
    _clause("swap", "swap {first} and {second}", "let {first} and {second} change places"),
    _clause("stand_down", "stand down {gate}", "send home whoever reinforces {place}"),
    _clause("mass", "all free[ {massed}] to {gate}", "send every free ({massed}|asset) to {place}"),
    _clause("cover", "cover {gate}[ by {who}]", "(let {who} guard {place}|give {place} a guard)"),
    _clause(
        "cover",
        "cover {guard}[ by {who}]",
        "(let {who} guard {place}|give {place} a guard) for {leaving}",
    ),
    _clause(
        "relieve", "({who} relieves|relieve) {guard}", "[let {who} ]relieve {leaving}[ at {place}]"
    ),
    _clause("report", "report[ by {who}][ at {place}]", "[let {who} ]report[ on {place}]"),
    _clause("hold", "[{who} ]hold", "[let {who} ]stay put"),
    _clause("home", "{who} home", "send {who} home"),
    _clause("look", "[{who} ]look at {place}", "[let {who} ]look at {place}"),
    _clause(
        "identify",
        "[{who} ]identify ([{thing} ]at {gate}|{track})",
        "[let {who} ]identify (the {thing}|{track_id}|whoever is) at {place}",
    ),
    _clause(
        "warn",
        "[{who} ]warn ([{thing} ]at {gate}|{track})",
        "[let {who} ]warn (the {thing}|{track_id}|whoever is) at {place}",
    ),
    _clause("block", "[{who} ]block {gate}", "[let {who} ]close the lane at {place}"),
    _clause(
        "respond",
        "(unknown[{stranger}] at {gate}|{track})",
        "see to (the unknown {thing}|{track_id}|what is unknown) at {place}",
    ),
    _clause("go", "{who} to {place}", "send {who} to {place}"),
)
"""All forms; a clause is parsed by the first form that matches."""


class Aggravation(NamedTuple):
    """An addition that makes any clause unlawful in an order."""

    wrong: Wrong
    words: str
    plain: str


ASIDE = Aggravation("override", "set rules aside, ", " (setting rules aside)")
"""The addition that comes before a clause in canonical words, and after it in plain words."""
UNLAWFUL: tuple[Aggravation, ...] = (
    Aggravation("skip_identification", " without identification", " without identification"),
    Aggravation("skip_warning", " without warning", " without warning"),
    Aggravation("noncombatants", " with noncombatants", " (though noncombatants are there)"),
)
"""The additions that come after a clause."""


def written(task: Task, slots: Mapping[str, str], wrong: Wrong | None = None) -> str:
    """Return the clause for a task; `slots` has the values of its slots.

    `wrong` selects the form of a refused ask. A required place that is missing is written as
    `NOWHERE`.
    """
    forms = [clause.words for clause in CLAUSES if clause.task == task and clause.wrong == wrong]
    form = next((form for form in forms if form.fits(slots)), forms[0])
    return form.write(slots, _DEFAULTS)


def counted(kind: AssetKind, count: int | str) -> dict[str, str]:
    """Return the values of the slots of `TEAM` for `count` assets of a kind."""
    plural = "" if count == 1 else "s"
    return {"count": str(count), "kind": PLAIN_KINDS[kind], "plural": plural}


class NamePatterns(NamedTuple):
    """Regular expressions for the names in clauses, one for each sort of name."""

    asset: str
    place: str
    """A place to which assets can be sent."""
    gate: str
    """A place that contacts approach and assets guard."""
    team: str
    """Assets without names, with their origin."""
    track: str
    """A track with its place, as in "T at G"."""
    guard: str
    """An asset that is relieved or lost, with its place, as in "A at G"."""
    stranger: str = " vehicle| person"
    """The word for an unknown contact, with the space before it."""


def _unnamed(_slot: str, pattern: str) -> str:
    return f"({pattern})"


def clause_pattern(names: NamePatterns) -> str:
    """Return a regular expression, without named groups, for all readable clauses.

    The expressions in `names` must have no groups of their own.
    """
    forms = "|".join(pattern for _, pattern in clause_patterns(names, _unnamed))
    unlawful = "|".join(addition.words.removeprefix(" ") for addition in UNLAWFUL)
    return f"({ASIDE.words})?({forms})( ({unlawful}))?"


def clause_patterns(
    names: NamePatterns, group: Callable[[str, str], str]
) -> Iterator[tuple[Clause, str]]:
    """Yield each clause with its regular expression.

    `group` makes the group for a slot from its name and the expression for its contents.
    """
    place, asset = f"{names.place}|{NOWHERE}", names.asset
    assets = rf"{names.team}|{SOMEBODY}|{asset}(, {asset}){{0,{MOST_NAMES - 1}}}"
    slots = {
        "who": group("who", assets),
        "place": group("place", place),
        "gate": group("place", f"{names.gate}|{NOWHERE}"),
        "first": group("first", asset),
        "second": group("second", asset),
        "massed": group("massed", "|".join(KIND_FORMS)),
        "thing": group("thing", "vehicle|person"),
        "stranger": names.stranger,
        "track": names.track,
        "guard": names.guard,
    }
    for clause in CLAUSES:
        yield clause, clause.words.pattern(slots)

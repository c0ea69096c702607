"""What a trained planner or judge may state of the situation: only what the digest says.

A reason begins with what was asked, in words without a colon; what is stated of a place, an asset,
a track or of who is free has its name before a colon. Such statements are taken from the digest,
and whether the condition of an order is so is read from it (`condition.py`). All else is left to
the model.
"""

from collections.abc import Iterable, Iterator
from re import escape

from pa_console.llm.clauses import asked_pattern
from pa_console.llm.compact_prompt import asset_state, standing
from pa_console.llm.condition import conditions, evidence, holds, in_words, told_assets, told_frames
from pa_console.llm.contact import contacts
from pa_console.llm.facts import WORDS
from pa_console.llm.grammar import exactly
from pa_console.schema.telemetry import Digest
from pa_console.schema.world import World

WORD = r"[ !#-9;-\[\]-~]"
"""Printable ASCII without the quote, the backslash and the colon."""
_PART = r"[ !#-+\--9<-\[\]-~]"
"""A character within what commas and semicolons part."""
_ORDER = r"([A-Zabcdefghj-z0-9_]|i[A-Zabcdeg-z0-9_])[A-Za-z0-9_,; ]*"
"""The same in names, numbers and plain words alone."""
_WORDS = f"{WORD}{{1,160}}"
ASKED_ONCE = f"asked: ({_WORDS}|if {_WORDS}: {_WORDS}, else: {_WORDS}; now: {_WORDS}(: {_WORDS})?)"
"""A regular expression for what was asked at a moment of which there is no digest any more."""
MOST_PARTS = 24
"""What commas and semicolons part in a reason: clauses, names, facts."""
MOST_PLAIN = 80
"""The longest fact in the model's own words, in characters."""
_UNCONDITIONAL = rf"([ !#-+\--9<-\[\]-hj-~]|i[ !#-+\--9<-\[\]-eg-~]){_PART}{{0,{MOST_PLAIN}}}"
"""Words that do not begin as a condition does: the names in one are those of the digest."""
MOST_PLANNED = 140
"""Longer words for a plan leave too little room beside them."""
_SO = {True: "so", False: "not so", None: "(not )?so"}
_END = r"( \([A-Z]+-[0-9]+\))?( takes over| stays)?"


def asked_now(world: World, digest: Digest, asked: str) -> str:
    """Return what was `asked` at some moment as it is said in the picture that `digest` tells.

    Of an order under a condition: with how that stands now, where the digest decides it.
    """
    meant, under, then = asked.partition("; now: ")
    for condition in conditions(world, digest) if under else ():
        if meant.startswith(f"asked: if {in_words(condition)}: "):
            stay = "; others stay" if then.endswith("; others stay") else ""
            so = _SO[holds(condition, digest)]
            stands = f"; now: {evidence(condition, digest)}, {so}{stay}"
            return meant + stands if so in ("so", "not so") else asked
    return asked


def grounded_reason(world: World, digest: Digest, words: str, asked: str = "") -> tuple[str, ...]:
    """Return regular expressions (Rust's syntax) that a reason has to match, each of them.

    It states what `digest` bears out, and what was asked in clauses about what there is, or about
    names that stand in the mission's `words`; in the words `asked`, where those are given.
    """
    plain = _not_beginning(" only ")
    part = f" {_either(_facts(world, digest))}{_END}|{plain}"
    begins = exactly(asked) if asked else _asked(world, digest, _UNCONDITIONAL)
    stated = f"{begins}([;,]({part})){{0,{MOST_PARTS}}}"
    return stated, asked_pattern(world, digest, words)


def grounded_asked(world: World, digest: Digest, words: str, asked: str = "") -> tuple[str, ...]:
    """Return the same for what a judge of a plan says was asked, in words like those of orders.

    Facts of the picture, which come with colons, brackets and rule ids, have no place in it.
    """
    if asked:
        return (exactly(asked),)
    return _asked(world, digest, _ORDER), asked_pattern(world, digest, words, facts=False)


def _asked(world: World, digest: Digest, unconditional: str) -> str:
    """Return what was asked; `digest` decides each condition that it may be under."""
    under = (
        f"{escape(in_words(condition))}: {WORD}+, else: {WORD}+; "
        f"now: {escape(evidence(condition, digest))}, {_SO[holds(condition, digest)]}"
        for condition in conditions(world, digest)
    )
    return f"asked: ({unconditional}|if {_either(under)})"


def _facts(world: World, digest: Digest) -> Iterator[str]:
    """Yield what can be stated: of assets, of places, of tracks, of who is free."""
    yield "only watch"
    for name in told_assets(world, digest):
        state = asset_state(digest, name) if name in digest.posts else "down"
        ways = [state, state.partition(",")[0]]
        ways += [f"alone at {gate}" for gate, sole in digest.sole_cover.items() if sole == name]
        ways += ["poor link"] * (name in digest.degraded_comms)
        ways += [digest.posts.get(name, "").partition(" ")[2]] * (name in digest.posts)
        yield f"{name}: {_either(dict.fromkeys(ways))}"
    yield "[A-Za-z0-9_]+: no such asset"
    stand = {frame: list[str]() for frame in told_frames(world, digest)} | standing(digest)
    for frame, there in stand.items():
        yield f"{frame}: {_either([*there, f'{len(there)} assets'] if there else ['nobody'])}"
        yield from (f"only {name} is there" for name in there if len(there) == 1)
    tracks = contacts(digest.tracks)
    for frame in stand:
        here = [contact for contact in tracks if contact.gate == frame]
        ways = [f"{contact.id} {contact.kind}, {contact.step}" for contact in here]
        ways += ["no track"] * (not any(contact.here for contact in here))
        yield f"At {frame}: {_either(ways)}"
    for kind, names in digest.free.items():
        yield f"Free {WORDS[kind]}: ({_names(names)}none( to look first)?)"
    every = [name for names in digest.free.values() for name in names]
    yield f"Free: ({_names(every)}none)"


def _not_beginning(start: str) -> str:
    """Return the expression for a fact in the model's own words that does not begin so."""
    rest = f"{_PART}{{0,{MOST_PLAIN}}}"
    ways = (f"{start[:n]}([{_PART[1:-1]}&&[^{char}]]{rest})?" for n, char in enumerate(start))
    return _either(ways)


def _names(names: Iterable[str]) -> str:
    """Return the way to name some of `names`, or how many of them; with a bar after it."""
    known = tuple(names)
    if not known:
        return ""
    counts = (f"{number} assets" for number in range(2, len(known) + 1))
    return f"(only )?{_either((*known, *counts))}|"


def _either(ways: Iterable[str]) -> str:
    return f"({'|'.join(ways)})"

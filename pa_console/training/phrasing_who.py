"""Puts who is meant into words: names, a kind and a number, where they stand, or anybody."""

from collections.abc import Mapping

from pa_console.schema.world import AssetKind
from pa_console.training.order import Who
from pa_console.training.phrasing_names import Form, number_word
from pa_console.training.phrasing_voice import Voice

_GROUPED = 0.3
"""How often several assets of one team share the team's word: `drones 1 and 4`."""
_OWN_WORD = 0.3
"""How often a team's own word stands for its kind: `a kestrel`."""
_FREE = 0.25


def who_words(voice: Voice, who: Who) -> str:
    """Return a noun phrase for `who`; for nobody in particular one that means any asset."""
    if who.names:
        return named(voice, who.names)
    kind, kinds = kind_nouns(voice, who.kind)
    slots = {"kind": kind, "kinds": kinds}
    if who.origin:
        origin = voice.name(who.origin).removeprefix("the ").removeprefix("FRAME_")
        if who.count == 1:
            return voice.say("who.kind.origin", {**slots, "origin": origin})
        number = "all" if who.count == "all" else _number(voice, who.count)
        return f"{number} {origin} {kinds}" if number != "all" else f"all the {origin} {kinds}"
    if who.count == "all":
        return voice.say("who.kind.all", slots)
    if who.count > 1:
        return voice.say("who.kind.n", {**slots, "n": _number(voice, who.count)})
    free = voice.rng.random() < _FREE
    return voice.say("who.kind.free" if free else "who.kind.one", slots)


def named(voice: Voice, names: tuple[str, ...]) -> str:
    """Return the names as a list, now and then with the team's word said once."""
    rng = voice.rng
    if len(names) > 1 and rng.random() < _GROUPED:
        grouped = _grouped(voice, names)
        if grouped:
            return grouped
    said = [voice.name(name) for name in names]
    if len(said) == 1:
        return said[0]
    last = rng.choice(("and", "and", "and", "&", "plus") if voice.style == "terse" else ("and",))
    comma = "," if len(said) > 2 and rng.random() < 0.2 else ""
    return f"{', '.join(said[:-1])}{comma} {last} {said[-1]}"


def _grouped(voice: Voice, names: tuple[str, ...]) -> str:
    """Return `drones 1 and 4`, or nothing when the names have no word in common."""
    forms = [_numbered(voice.names.forms(name)) for name in names]
    shared = sorted(set(forms[0]).intersection(*forms[1:]))
    if not shared:
        return ""
    word = voice.rng.choice(shared)
    spelt = voice.rng.random() < 0.3
    numbers = [numbers[word] for numbers in forms]
    said = [number_word(number) if spelt else str(number) for number in numbers]
    return f"{plural(word)} {', '.join(said[:-1])} and {said[-1]}"


def _numbered(forms: list[Form]) -> Mapping[str, int]:
    """Return the words that stand before a number in `forms`, with the number."""
    split = (form.text.rpartition(" ") for form in forms)
    return {
        word: int(number)
        for word, _, number in split
        if number.isdigit() and not number.startswith("0") and word.isalpha() and word.islower()
    }


def kind_nouns(voice: Voice, kind: AssetKind | None) -> tuple[str, str]:
    """Return the singular and the plural of what people call `kind`."""
    if kind is not None and voice.rng.random() < _OWN_WORD:
        word = voice.names.prefix(kind)
        if word:
            return word, plural(word)
    key = f"noun.{kind or 'any'}"
    return voice.noun(key, kind), voice.noun(f"{key}.plural", kind)


def _number(voice: Voice, number: int) -> str:
    return number_word(number) if voice.rng.random() < 0.7 else str(number)


def plural(word: str) -> str:
    """Return the plural of an English noun that is regular."""
    if word.endswith(("s", "x", "ch", "sh")):
        return f"{word}es"
    if word.endswith("y") and word[-2:-1] not in "aeiou":
        return f"{word[:-1]}ies"
    if word.endswith("man"):
        return f"{word[:-3]}men"
    return f"{word}s"

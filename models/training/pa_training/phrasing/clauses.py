"""Puts one ask, one condition, and who is meant into a clause."""

from collections.abc import Mapping
from dataclasses import replace

from pa_console.language.canonical.order import Ask, Condition, Who
from pa_console.schema.world import AssetKind
from pa_training.phrasing.names import Form, number_word
from pa_training.phrasing.phrase_bank import KEYS
from pa_training.phrasing.voice import Voice

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


_HARMLESS = ("go", "look", "identify", "hold", "home", "report")
_SHARED_HEAD, _BOTH = 0.6, 0.35
_ONE_WAY: Mapping[str, str] = {
    "cover": "cover.kind",
    "relieve": "relieve.named",
    "mass": "mass.kind",
    "hold": "hold.named",
}
"""Tasks that are worded alike whether names or a kind are given."""
_INCAPABLE: Mapping[tuple[AssetKind, str], str] = {
    ("uav", "warn"): "drone_warn",
    ("uav", "block"): "drone_block",
    ("uav", "identify"): "drone_identify",
    ("robot", "look"): "robot_fly",
    ("robot", "block"): "robot_block",
    ("ugv", "look"): "vehicle_fly",
    ("ugv", "warn"): "vehicle_warn",
}


def clause(
    voice: Voice, ask: Ask, harmless: bool = False, embedded: bool = False, also: str = ""
) -> str:
    """Return the words of `ask`; `harmless` picks wording that only sounds forbidden.

    `embedded` asks for one clause that can stand within a longer sentence; `also` is another place
    for which the same is asked in the same words.
    """
    slots = _slots(voice, ask)
    if also:
        slots["place"] = pair_words(voice, ask.place, also)
    said = {"who": _is_said(ask.who), "track": bool(ask.track or ask.track_id)}
    wanted = frozenset(slot for slot in slots if said.get(slot))
    if ask.wrong == "override":
        inner = clause(voice, replace(ask, wrong=None), embedded=True)
        return voice.say("wrong.override", {"clause": inner}, embedded=embedded)
    key = _wrong_key(voice, ask) if ask.wrong else ""
    if harmless and ask.task in _HARMLESS and ask.wrong is None:
        key = f"harmless.{ask.task}"
        if ask.task not in ("look", "identify") and "who" not in slots:
            slots = {**slots, "who": who_words(voice, ask.who)}
    return voice.say(key or _key(voice, ask), slots, wanted, embedded)


def pair_words(voice: Voice, first: str, second: str) -> str:
    """Return two places in one noun phrase, e.g. `both the north and east gates`."""
    rng = voice.rng
    one, other = voice.name(first), voice.name(second)
    head, last = one.rpartition(" ")[2], other.rpartition(" ")[2]
    if head == last and " " in one and rng.random() < _SHARED_HEAD:
        one = one.removesuffix(f" {head}")
        other = f"{other.removeprefix('the ') if rng.random() < 0.6 else other}s"
    joined = rng.choice(("and", "and", "and also", "&" if voice.style == "terse" else "as well as"))
    return f"{'both ' if rng.random() < _BOTH else ''}{one} {joined} {other}"


def condition_words(voice: Voice, condition: Condition) -> str:
    """Return the clause that stands after `if`."""
    key = f"condition.{condition.fact}"
    if condition.fact in ("free", "none_free"):
        kind, kinds = kind_nouns(voice, condition.kind)
        return voice.say(key, {"kind": kind, "kinds": kinds})
    slots = {"place" if condition.subject in voice.world.frames else "asset": condition.subject}
    said = {slot: voice.name(name) for slot, name in slots.items()}
    if "track" in KEYS[key].needed:
        said["track"] = voice.noun(f"noun.{condition.track or 'track'}")
    return voice.say(key, said)


def _key(voice: Voice, ask: Ask) -> str:
    """Return the bank's key for an ask that is meant as it is."""
    if ask.task in ("swap", "stand_down"):
        return ask.task
    if ask.task == "respond":
        return f"respond.{_track_kind(voice, ask) or 'vehicle'}"
    if ask.task == "home" and len(ask.who.names) == 1 and _is_low(voice, ask.who.names[0]):
        return "home.low" if voice.rng.random() < 0.6 else "home.named"
    if not _is_said(ask.who):
        return _key_for_anyone(voice, ask)
    if ask.task in _ONE_WAY:
        return _ONE_WAY[ask.task]
    return f"{ask.task}.{'named' if ask.who.names else 'kind'}"


def _key_for_anyone(voice: Voice, ask: Ask) -> str:
    """Return the bank's key for an ask that says nothing of who does it."""
    every = ask.who.count == "all"
    match ask.task:
        case "cover":
            return "cover.failed" if ask.leaving else "cover.bare"
        case "relieve":
            return "relieve.low" if _is_low(voice, ask.leaving) else "relieve.anyone"
        case "report" if ask.place:
            return "report.place"
        case "report":
            return "report.all" if every else "report.general"
        case "hold":
            return "hold.all" if every else "hold.leave"
        case "mass":
            return "mass.all"
        case "go" | "home":
            return f"{ask.task}.kind"
        case _:
            return f"{ask.task}.anyone"


def _wrong_key(voice: Voice, ask: Ask) -> str:
    """Return the key for what must not or cannot be; nothing where the plain words say it."""
    match ask.wrong:
        case "force" | "chase" | "zone":
            return f"wrong.{ask.wrong}"
        case "skip_identification":
            return f"wrong.skip_identification.{'block' if ask.task == 'block' else 'warn'}"
        case "skip_warning":
            return "wrong.skip_warning.block"
        case "noncombatants":
            task = ask.task if ask.task in ("identify", "warn", "block") else "identify"
            return f"wrong.noncombatants.{task}"
        case "strip":
            return "wrong.strip" if ask.place else "wrong.strip.all"
        case "unknown_place" if not ask.place:
            return "wrong.unknown_place"
        case "incapable":
            kind = ask.who.kind
            if ask.who.names and ask.who.names[0] in voice.world.assets:
                kind = voice.world.assets[ask.who.names[0]].kind
            case = _INCAPABLE.get((kind, ask.task)) if kind else None
            return f"wrong.incapable.{case}" if case else ""
        case _:
            return ""


def _slots(voice: Voice, ask: Ask) -> dict[str, str]:
    """Return the words for what `ask` names."""
    slots: dict[str, str] = {}
    if ask.task in ("go", "home") or _is_said(ask.who):
        everyone = ask.task == "mass" and not ask.who.names
        who = replace(ask.who, count="all") if everyone else ask.who
        slots["who"] = who_words(voice, who)
    if ask.task == "swap":
        first, second = (*ask.who.names, ask.leaving)[:2]
        slots["a"], slots["b"] = voice.name(first), voice.name(second)
    if ask.place:
        slots["place"] = voice.name(ask.place)
    if ask.leaving:
        slots["leaving"] = named(voice, (ask.leaving,))
    if ask.task in ("look", "identify", "warn", "block", "respond") or ask.wrong:
        kind = _track_kind(voice, ask)
        if ask.track or ask.task == "respond" or ask.wrong or not _is_said(ask.who):
            slots["track"] = voice.noun(f"noun.{kind or 'track'}") + _track_id(voice, ask)
    if ask.task == "home":
        slots["base"] = _base(voice)
    if ask.wrong == "zone":
        slots["zone"] = slots.get("place") or voice.name(next(iter(voice.world.zones), ""))
        slots.setdefault("who", who_words(voice, ask.who))
    if ask.wrong == "unknown_place":
        slots["gate_word"] = _missing_gate(voice)
        slots.setdefault("who", who_words(voice, ask.who))
    return slots


def _base(voice: Voice) -> str:
    """Return what the base is called where somebody goes home."""
    if voice.rng.random() < 0.35 and not voice.names.owners("home"):
        return "home"
    return voice.name(voice.world.base)


def _missing_gate(voice: Voice) -> str:
    """Return the word of a gate that the world does not have."""
    words = ("north", "harbour", "cargo", "ninth", "staff", "airport", "rooftop", "customs")
    free = [word for word in words if not voice.names.owners(f"{word} gate")]
    return voice.rng.choice(free)


def _track_kind(voice: Voice, ask: Ask) -> str:
    """Return whether `ask` is about a vehicle or a person, if need be from the picture, or ''."""
    tracks = voice.picture.tracks.values()
    return ask.track or next((track.kind for track in tracks if track.gate == ask.place), "")


def _track_id(voice: Voice, ask: Ask) -> str:
    """Return the station's name of the track as it stands after the noun, if it is named."""
    if not ask.track_id:
        return ""
    words = ask.track_id.replace("_", " ").lower()
    return voice.rng.choice((f" {ask.track_id}", f" ({ask.track_id})", f" ({words})"))


def _is_said(who: Who) -> bool:
    return bool(who.names or who.kind or who.origin)


def _is_low(voice: Voice, name: str) -> bool:
    asset = voice.picture.assets.get(name)
    return asset is not None and asset.low_battery

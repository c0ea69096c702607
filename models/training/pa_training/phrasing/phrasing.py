"""Puts an Order into the words of an operator: style, names, noise; from the phrase banks."""

import random
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

from pa_console.language.canonical.order import Ask, Who
from pa_console.schema.base import StrictModel
from pa_console.schema.mission import MAX_MISSION_TEXT
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World
from pa_training.order_generator.orders import Order, are_twins
from pa_training.phrasing.clauses import clause, condition_words, who_words
from pa_training.phrasing.misspelling import misspell
from pa_training.phrasing.names import parts_of
from pa_training.phrasing.phrase_bank import STYLES, Split, Style, phrase_bank
from pa_training.phrasing.voice import Voice

_HEAVY, _LIGHT = 0.12, 0.1
"""How many missions have many slips, and how many have a few."""
_SENTENCES = re.compile(r"[.!?] [a-z](?=[a-z]*\b[^_\d])")
"""Where another sentence begins with a word that is no name."""
_OPENED = {"plain": 0.12, "terse": 0.06, "chatty": 0.55, "radio": 0.6}
_CLOSED = {"plain": 0.12, "terse": 0.12, "chatty": 0.4, "radio": 0.6}


class Finished(NamedTuple):
    """The text of a mission and what was done to it."""

    text: str
    noise: tuple[str, ...]


def sentence(text: str, style: Style, rng: random.Random) -> str:
    """Return `text` as a sentence: with a capital and a full stop, as its style has it."""
    loose = {"plain": 0.12, "terse": 0.65, "chatty": 0.25, "radio": 0.3}[style]
    ended = text.endswith((".", "?", "!", '"', "'"))
    full = text if ended or rng.random() < loose else f"{text}."
    if rng.random() < loose * 0.9:
        return full
    return capital(_SENTENCES.sub(lambda match: match[0][:-1] + match[0][-1].upper(), full))


def capital(text: str) -> str:
    """Return `text` with a capital at its beginning, unless that would spoil a name."""
    first = text.split(" ", 1)[0]
    return text if not first.isalpha() or not first.islower() else text[:1].upper() + text[1:]


def greeted(voice: Voice, text: str) -> str:
    """Return `text` with what its style puts around an order, more often than not nothing."""
    rng, style = voice.rng, voice.style
    if rng.random() < _OPENED[style]:
        text = _opened(voice.say(f"opener.{style}", {}), text)
    if rng.random() < _CLOSED[style]:
        text = _closed(text, voice.say(f"closer.{style}", {}))
    return text


def noisy(voice: Voice, text: str, marked: bool) -> Finished:
    """Return `text` with slips, another case or fewer marks, and which of these it has.

    What is `marked` keeps its commas and stops: they tell its parts from each other.
    """
    rng = voice.rng
    noise: list[str] = []
    drawn = rng.random()
    if drawn < _HEAVY + _LIGHT:
        heavy = drawn < _HEAVY
        sms = rng.random() < 0.35
        share = rng.uniform(0.18, 0.4) if heavy else 0.06
        text = misspell(text, rng, share, _confusable(voice), sms and heavy)
        noise.append("misspelt" if heavy else "slip")
    drawn = rng.random()
    if drawn < 0.12 or ("misspelt" in noise and drawn < 0.5):
        text = text.lower()
        noise.append("lower")
    elif drawn > (0.95 if voice.style == "radio" else 0.98):
        text = text.upper()
        noise.append("upper")
    if rng.random() < (0.4 if "misspelt" in noise else 0.05) and not marked:
        text = _without_marks(text)
        noise.append("no marks")
    return Finished(" ".join(text.split()), tuple(noise))


def _opened(opener: str, text: str) -> str:
    """Return the opener before the text, with a mark between them."""
    if opener.endswith((",", ":", "-", "...")):
        return f"{opener} {_uncapital(text)}"
    if opener.endswith((".", "!", "?")):
        return f"{capital(opener)} {capital(text)}"
    return f"{capital(opener)}, {_uncapital(text)}"


def _closed(text: str, closer: str) -> str:
    """Return the text before the closer, with a mark between them."""
    if text.endswith((".", "?", "!")) or closer[:1].isupper() or closer.endswith((".", "!", "?")):
        stop = "" if text.endswith((".", "?", "!")) else "."
        return f"{text}{stop} {capital(closer)}{'' if closer.endswith(('.', '!', '?')) else '.'}"
    return f"{text}, {closer}"


def _uncapital(text: str) -> str:
    """Return `text` without its capital, where its first word is no name."""
    first = text.split(" ", 1)[0]
    word = first == "A" or (first[1:].islower() and first.isalpha())
    return text[:1].lower() + text[1:] if word else text


def _confusable(voice: Voice) -> set[str]:
    """Return the words that tell the places and teams of a world apart."""
    world = voice.world
    names = (*world.frames, *world.zones, *world.assets)
    return {part.lower() for name in names for part in parts_of(name) if len(part) > 2}


def _without_marks(text: str) -> str:
    """Return `text` without commas and stops between words; those in names stay."""
    return re.sub(r"[,.;:!?](?=\s|$)", "", text)


_STYLE_WEIGHTS = (4, 2.5, 2, 1.5)
_TRIES = 20
_STOPS = (".", ".", ".", ";", ",")
"""What stands before a sentence that goes on about who may move."""
_RUNS_ON, _TOGETHER = 0.75, 0.7
"""How often several asks are one sentence."""
_TOLD = {"plain": 0.45, "terse": 0.25, "chatty": 0.5, "radio": 0.4}
_TOLD_FIRST, _TOLD_AGAIN, _OTHERS = 0.75, 0.2, 0.8
"""How often something is told beside an order: before it, once more, of what it is not about."""


class Phrasing(StrictModel):
    """The words of an order, how they were meant to sound, and the noise that is in them."""

    text: str
    style: Style
    noise: tuple[str, ...] = ()


def phrase(
    order: Order, world: World, picture: Picture, rng: random.Random, split: Split = "train"
) -> Phrasing:
    """Return `order` in words; equal states of `rng` give equal words.

    Of the templates, only those of `split` are used as long as there is one that fits. Raises
    KeyError when no template fits and ValueError when every attempt is too long for a mission.
    """
    for _ in range(_TRIES):
        style = rng.choices(STYLES, _STYLE_WEIGHTS)[0]
        voice = Voice(world, picture, phrase_bank(), rng, style, split)
        several = len(order.asks) > 1 or order.condition is not None or order.injected
        text, noise = noisy(voice, _composed(voice, order), marked=several)
        if len(text) <= MAX_MISSION_TEXT:
            return Phrasing(text=text, style=style, noise=noise)
    raise ValueError(f"no wording of at most {MAX_MISSION_TEXT} characters was found: {order}")


def _composed(voice: Voice, order: Order) -> str:
    """Return everything the operator says, before the noise."""
    rng = voice.rng
    if order.injected and _is_nothing(order):
        return sentence(voice.say("inject.only", _overheard(voice)), voice.style, rng)
    text = _body(voice, order)
    extras = [voice.say("others_stay", {})] if order.others_stay else []
    if order.excluded:
        extras.append(voice.say("except", {"who": who_words(voice, Who(names=order.excluded))}))
    strict = next((ask for ask in order.asks if ask.strict_who), None)
    if strict is not None:
        said = who_words(voice, strict.who) if strict.who.names else _same_kind(voice, strict)
        extras.append(voice.say("strict_who", {"who": said}))
    rng.shuffle(extras)
    text = sentence(text, voice.style, rng)
    for extra in extras:
        ended = text.endswith((".", "?", "!", '"', "'"))
        stop = "" if ended else "." if order.condition else rng.choice(_STOPS)
        follows = capital(extra) if stop in ("", ".") else extra
        text = f"{text}{stop} {follows}{'.' if text.endswith('.') and stop == '' else ''}"
    text = _with_asides(voice, text)
    if order.injected:
        return _injected(voice, text)
    return greeted(voice, text)


def _with_asides(voice: Voice, text: str) -> str:
    """Return `text`, more often than not, or with something beside it that asks for nothing."""
    rng = voice.rng
    share = _TOLD[voice.style]
    while rng.random() < share:
        aside = voice.say("aside", _aside_slots(voice, text))
        loose = voice.style == "terse" and rng.random() < 0.5
        if rng.random() < _TOLD_FIRST:
            text = f"{aside}, {text}" if loose else f"{capital(aside)}. {capital(text)}"
        else:
            stop = "" if text.endswith((".", "?", "!", '"', "'")) else "," if loose else "."
            text = f"{text}{stop} {aside if stop == ',' else capital(aside)}"
            text += "." * (stop != ",")
        share = _TOLD_AGAIN
    return text


def _aside_slots(voice: Voice, text: str) -> dict[str, str]:
    """Return what may be spoken of beside an order: mostly names that it does not use."""
    rng, world = voice.rng, voice.world
    slots = {"thing": rng.choice(("vehicle", "person"))}
    slots["thing"] = voice.noun(f"noun.{slots['thing']}")
    for slot, names in (("asset", [*world.assets]), ("place", [*world.gates])):
        said = {name: voice.name(name) for name in names}
        others = [
            name for name in names if said[name].lower() not in text.lower() and name not in text
        ]
        chosen = rng.choice(others if others and rng.random() < _OTHERS else names)
        slots[slot] = said[chosen]
    return slots


def _same_kind(voice: Voice, ask: Ask) -> str:
    """Return the kind that it has to be, where no names are given."""
    return who_words(voice, replace(ask.who, origin=""))


def _body(voice: Voice, order: Order) -> str:
    """Return the asks, under their condition if there is one."""
    if order.condition is None:
        return _joined(voice, order.asks, order.harmless, embedded=False)
    slots = {
        "if": condition_words(voice, order.condition),
        "then": _joined(voice, order.asks, order.harmless, embedded=True),
    }
    if order.otherwise:
        slots["else"] = _joined(voice, order.otherwise, harmless=False, embedded=True)
        return voice.say("conditional.else", slots)
    drawn = voice.rng.random()
    if drawn < 0.3:
        slots["else"] = voice.say("else_nothing", {})
        return voice.say("conditional.else", slots)
    return voice.say("conditional.nothing" if drawn < 0.65 else "conditional.then", slots)


def _joined(voice: Voice, asks: Sequence[Ask], harmless: bool, embedded: bool) -> str:
    """Return the words of all `asks`, in their order."""
    parts = list(_parts(voice, asks))
    if len(parts) == 1:
        return clause(voice, parts[0][0], harmless, embedded, parts[0][1])
    if not embedded and (len(parts) > 3 or voice.rng.random() > _RUNS_ON):
        first = harmless
        said: list[str] = []
        for ask, also in parts:
            said.append(capital(clause(voice, ask, first, also=also)))
            first = False
        return ". ".join(text.rstrip(".") for text in said).replace("?.", "?")
    said = [
        clause(voice, ask, harmless and not n, True, also) for n, (ask, also) in enumerate(parts)
    ]
    while len(said) > 3:
        said[:2] = [f"{said[0]}, {said[1]}"]
    if len(said) == 2:
        return voice.say("joiner", {"first": said[0], "second": said[1]}, embedded=embedded)
    slots = {"first": said[0], "second": said[1], "third": said[2]}
    return voice.say("joiner3", slots, embedded=embedded)


def _parts(voice: Voice, asks: Sequence[Ask]) -> Iterator[tuple[Ask, str]]:
    """Yield what one clause says: an ask, and the place of its twin if it has one."""
    said = 0
    while said < len(asks):
        ask, rest = asks[said], asks[said + 1 : said + 2]
        twins = rest and are_twins(ask, rest[0]) and voice.rng.random() < _TOGETHER
        yield ask, rest[0].place if twins else ""
        said += 2 if twins else 1


def _is_nothing(order: Order) -> bool:
    """Tell whether an order is that all stays as it is."""
    ask = order.asks[0]
    everybody = not ask.who.names and ask.who.kind is None
    return len(order.asks) == 1 and ask.task == "hold" and everybody and order.condition is None


def _injected(voice: Voice, text: str) -> str:
    """Return the order among text that is no order of the operator."""
    rng = voice.rng
    slots = {"order": text.rstrip("."), **_overheard(voice)}
    text = voice.say("inject", slots)
    ordered = re.escape(slots["order"])
    return sentence(re.sub(rf"({ordered}) (?=\W)", r"\1. ", text), voice.style, rng)


def _overheard(voice: Voice) -> dict[str, str]:
    """Return what text that is no order may speak of."""
    return {
        "asset": voice.rng.choice(list(voice.world.assets)),
        "gate": voice.rng.choice(voice.world.gates),
        "base": voice.world.base,
    }

"""Turns clauses into what an operator types: sentence marks, case, greetings, slips."""

import random
import re
from typing import NamedTuple

from pa_console.training.misspelling import misspell
from pa_console.training.phrase_bank import Style
from pa_console.training.phrasing_names import parts_of
from pa_console.training.phrasing_voice import Voice

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

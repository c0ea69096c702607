"""Finds texts that are too like a mission of a test set.

Names are masked by what they are, so that the same sentence about another gate or another asset
counts as the same sentence.
"""

import re
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rapidfuzz import fuzz
from rapidfuzz.process import cdist

from pa_console.evaluation.jobs import load_with_worlds
from pa_console.language.name_linking import WORD, link_names
from pa_console.schema.world import World
from pa_training.situations.worlds import shipped_missions, shipped_world

THRESHOLD = 82.0
"""From this similarity on (0 to 100) a text is dropped.

It lies between two kinds of made-up pairs (tests/training/test_near_duplicates.py). What has to go
scores 91 and more: the same sentence about other names, with slips of the keyboard, with a greeting
before it, with its halves exchanged, with one word replaced. What may stay scores 70 and less:
another sentence with the same meaning, or the same verbs with another purpose. Half way between
them, a sentence goes when about every sixth of its letters would have to be changed.
"""
_LEAST_PART = 24
"""Missions of fewer characters are not looked for as a part of longer texts: they are anywhere."""
_WORDS = re.compile(r"[a-z0-9_']+")
_GATE_WORDS = ("gate", "entrance")
_NUMBER = (
    r"(?:\d+|zero|one|two|three|four|five|six|seven|eight|nine|ten|eleven|twelve|thirteen|fourteen"
    r"|fifteen|sixteen)"
)
_MASKS = (
    (re.compile(r"\bframe_"), ""),
    (re.compile(r"\b[a-z]+_t?\d+\b|\b[a-z]+_[a-z]\b|\bt\d+\b"), "asset"),
    (re.compile(rf"\b(?:drones?|uavs?|ugvs?|robots?) {_NUMBER}\b"), "asset"),
    (re.compile(r"\b[a-z]+_?(?:gate|entrance)\b|\bgate_\w+\b"), "gate"),
    (re.compile(r"\b(?:north|south|east|west)(?:ern)? gate\b"), "gate"),
    (re.compile(r"\bgate (?:north|south|east|west)\b|\b(?:north|south|east|west)\b"), "gate"),
    (re.compile(r"\b\d+\b"), "number"),
    (re.compile(r"\b(?:the|a|an)\b"), " "),
)


class NearDuplicates:
    """Compares texts with the missions of some mission sets."""

    def __init__(self, mission_set_files: Iterable[Path]) -> None:
        """Read the missions with the worlds that they are about; raises DocumentError."""
        own: list[str] = []
        any_world: list[str] = []
        for file in mission_set_files:
            missions, worlds = load_with_worlds(file, shipped_world())
            for case in missions.missions:
                own.append(masked(case.command, worlds[case.world]))
                any_world.append(masked(case.command))
        self._missions = len(own)
        self._words = [*own, *any_world]
        self._sorted = [_in_order(words) for words in self._words]
        self._lengths = np.array([len(words) for words in self._words])

    def keep(self, texts: Sequence[str], world: World | None = None) -> list[bool]:
        """Return for each text whether it is unlike every mission.

        With the `world` that the texts are about its names are masked in every form.
        """
        nearest = self.similarity(texts, world).max(axis=1, initial=0.0)
        return [bool(score < THRESHOLD) for score in nearest]

    def similarity(self, texts: Sequence[str], world: World | None = None) -> NDArray[np.float32]:
        """Return an array (texts, missions) of similarities, 0 to 100.

        It is the greatest of three: of the texts as they are, of their words in alphabetical
        order, and of the mission to the part of a longer text that is most like it. The missions'
        names are masked both as those of their world and as what looks like a name anywhere.
        """
        words = [masked(text, world, in_words=True) for text in texts]
        ordered = [_in_order(text) for text in words]
        both = np.maximum(
            cdist(words, self._words, scorer=fuzz.ratio, workers=1),
            cdist(ordered, self._sorted, scorer=fuzz.ratio, workers=1),
        )
        part = cdist(
            words, self._words, scorer=fuzz.partial_ratio, score_cutoff=THRESHOLD, workers=1
        )
        lengths = np.array([len(text) for text in words])
        longer = (lengths[:, None] > self._lengths) & (self._lengths >= _LEAST_PART)
        every = np.where(longer, np.maximum(both, part), both)
        return np.maximum(every[:, : self._missions], every[:, self._missions :])


@cache
def shipped_duplicates() -> NearDuplicates:
    """Return what compares texts with the mission sets that come with the console."""
    return NearDuplicates(shipped_missions())


def masked(text: str, world: World | None = None, *, in_words: bool = False) -> str:
    """Return the words of `text` with names masked by what they are, without articles.

    With `in_words`, so are places by their plain words, and gates by the word of their name alone.
    """
    if world is not None:
        text = link_names(world, text)
    words = " ".join(_WORDS.findall(text.lower().replace("’", "'")))
    if world is not None:
        forms = _forms(world, in_words=in_words)
        either = "|".join(map(re.escape, sorted(forms, key=len, reverse=True)))
        words = re.sub(rf"\b(?:{either})\b", lambda match: forms[match[0]], words)
    for pattern, mask in _MASKS:
        words = pattern.sub(mask, words)
    return " ".join(words.split())


def _forms(world: World, *, in_words: bool) -> dict[str, str]:
    """Return the names of a world, in small letters, with what they are."""
    kinds = dict.fromkeys(world.zones, "zone") | dict.fromkeys(world.assets, "asset")
    kinds |= {name: frame.kind for name, frame in world.frames.items()}
    forms = {name.lower(): kind for name, kind in kinds.items()}
    for name, kind in kinds.items() if in_words else ():
        words = [word.lower() for word in WORD.findall(name)]
        own = [word for word in words if word not in _GATE_WORDS] if kind == "gate" else words
        forms |= dict.fromkeys((" ".join(words), " ".join(own or words)), kind)
    return forms


def _in_order(words: str) -> str:
    return " ".join(sorted(words.split()))

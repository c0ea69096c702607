"""Drops generated missions that are too like one of a test set; reports how near the rest is.

Names are masked by what they are, so that the same sentence about another gate or another asset
counts as the same sentence.
"""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from rapidfuzz import fuzz
from rapidfuzz.process import cdist

from pa_console.evaluation.jobs import load_with_worlds
from pa_console.resources import find_data
from pa_console.schema.base import StrictModel
from pa_console.schema.world import World
from pa_console.sim.worlds.world_file import load_world
from pa_training.phrasing.names import NameForms

THRESHOLD = 82.0
"""From this similarity on (0 to 100) a text is dropped.

It lies between two kinds of made-up pairs (tests/training/test_near_duplicates.py). What has to go
scores 91 and more: the same sentence about other names, with slips of the keyboard, with a greeting
before it, with its halves exchanged, with one word replaced. What may stay scores 70 and less:
another sentence with the same meaning, or the same verbs with another purpose. Half way between
them, a sentence goes when about every sixth of its letters would have to be changed.
"""
_BATCH = 4096
_BIN = 10
_LEAST_PART = 24
"""Missions of fewer characters are not looked for as a part of longer texts: they are anywhere."""
_WORDS = re.compile(r"[a-z0-9_']+")
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


class NearReport(StrictModel):
    """How near generated texts came to the missions of the test sets; figures and ids only."""

    threshold: float
    missions: int
    checked: int = 0
    dropped: int = 0
    nearest: dict[str, float] = Field(default={}, description="mission -> most like of those kept")
    histogram: dict[str, int] = Field(
        default={}, description="texts by the similarity to what is nearest, e.g. '60-69'"
    )


class NearDuplicates:
    """Compares texts with the missions of some mission sets."""

    def __init__(self, mission_set_files: Iterable[Path], threshold: float = THRESHOLD) -> None:
        """Read the missions with the worlds that they are about; raises DocumentError."""
        self._threshold = threshold
        home = load_world(find_data("worlds", "checkpoint", "world.yaml"))
        self._ids: list[str] = []
        own: list[str] = []
        any_world: list[str] = []
        for file in mission_set_files:
            missions, worlds = load_with_worlds(file, home)
            for case in missions.missions:
                self._ids.append(f"{missions.name}/{case.id}")
                own.append(masked(case.command, worlds[case.world]))
                any_world.append(masked(case.command))
        self._words = [*own, *any_world]
        self._sorted = [_in_order(words) for words in self._words]
        self._lengths = np.array([len(words) for words in self._words])
        self.forget()

    def forget(self) -> None:
        """Count from nothing again."""
        self._nearest = np.zeros(len(self._ids), dtype=np.float32)
        self._histogram = np.zeros(100 // _BIN + 1, dtype=np.int64)
        self._checked = self._dropped = 0

    def keep(self, texts: Sequence[str], world: World | None = None) -> list[bool]:
        """Return for each text whether it is unlike every mission; what it saw is in `report`.

        With the `world` that the texts are about its names are masked in every form.
        """
        kept: list[bool] = []
        for start in range(0, len(texts), _BATCH):
            scores = self.similarity(texts[start : start + _BATCH], world)
            most = scores.max(axis=1, initial=0.0)
            fine = most < self._threshold
            self._checked += len(most)
            self._dropped += int((~fine).sum())
            self._nearest = np.maximum(self._nearest, scores[fine].max(axis=0, initial=0.0))
            bins = (most // _BIN).astype(np.int64)
            self._histogram += np.bincount(bins, minlength=len(self._histogram))
            kept += [bool(one) for one in fine]
        return kept

    def similarity(self, texts: Sequence[str], world: World | None = None) -> NDArray[np.float32]:
        """Return an array (texts, missions) of similarities, 0 to 100.

        It is the greatest of three: of the texts as they are, of their words in alphabetical
        order, and of the mission to the part of a longer text that is most like it. The missions'
        names are masked both as those of their world and as what looks like a name anywhere.
        """
        words = _Masker(world).all(texts)
        ordered = [_in_order(text) for text in words]
        both = np.maximum(
            cdist(words, self._words, scorer=fuzz.ratio, workers=1),
            cdist(ordered, self._sorted, scorer=fuzz.ratio, workers=1),
        )
        part = cdist(
            words, self._words, scorer=fuzz.partial_ratio, score_cutoff=self._threshold, workers=1
        )
        lengths = np.array([len(text) for text in words])
        longer = (lengths[:, None] > self._lengths) & (self._lengths >= _LEAST_PART)
        every = np.where(longer, np.maximum(both, part), both)
        return np.maximum(every[:, : len(self._ids)], every[:, len(self._ids) :])

    def report(self) -> NearReport:
        """Return what was seen so far."""
        names = [f"{low}-{low + _BIN - 1}" for low in range(0, 100, _BIN)] + ["100"]
        return NearReport(
            threshold=self._threshold,
            missions=len(self._ids),
            checked=self._checked,
            dropped=self._dropped,
            nearest={
                name: round(float(score), 1)
                for name, score in zip(self._ids, self._nearest, strict=True)
            },
            histogram={
                name: int(count) for name, count in zip(names, self._histogram, strict=True)
            },
        )


def masked(text: str, world: World | None = None) -> str:
    """Return the words of `text` with names masked by what they are, without articles."""
    return _Masker(world).one(text)


class _Masker:
    """Masks the names of one world, or what looks like a name."""

    def __init__(self, world: World | None) -> None:
        self._kinds: dict[str, str] = {}
        if world is not None:
            names = NameForms(world, ())
            every = dict.fromkeys(world.assets, "asset")
            every |= {name: frame.kind for name, frame in world.frames.items()}
            every |= dict.fromkeys(set(world.zones) - set(every), "zone")
            for name, kind in every.items():
                for form in names.forms(name):
                    self._kinds[" ".join(_WORDS.findall(form.text.lower()))] = kind
        longest = sorted(self._kinds, key=len, reverse=True)
        either = "|".join(map(re.escape, longest))
        self._forms = re.compile(rf"\b(?:{either})\b") if longest else None

    def all(self, texts: Iterable[str]) -> list[str]:
        """Return all `texts` masked."""
        return [self.one(text) for text in texts]

    def one(self, text: str) -> str:
        """Return `text` masked."""
        words = " ".join(_WORDS.findall(text.lower().replace("’", "'")))
        if self._forms is not None:
            words = self._forms.sub(lambda match: self._kinds[match[0]], words)
        for pattern, mask in _MASKS:
            words = pattern.sub(mask, words)
        return " ".join(words.split())


def _in_order(words: str) -> str:
    return " ".join(sorted(words.split()))

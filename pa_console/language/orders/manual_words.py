"""Reads words about manual control: *take over Drone_T04*, *I'll fly it myself*, *give it back*.

They are read only where the whole text is about that, with an asset by its name, by a description
or by the mark on the screen. *Send Drone_T04 to take over the north gate* is an order.
"""

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache

from pa_console.language.lexicon import word_lists
from pa_console.language.name_linking import link_names
from pa_console.language.references.conversation import Unclear
from pa_console.language.references.description import fitting
from pa_console.language.references.description_grammar import find_descriptions
from pa_console.language.references.reader import WordToken, read_tokens
from pa_console.language.references.scene import ReferenceScene

_WORDS = word_lists("manual_control")
_FILLERS = frozenset(_WORDS["fillers"])
_JOINED = frozenset(_WORDS["joined"])
_POINTED = frozenset(_WORDS["pointed"])
_ALL = frozenset(_WORDS["all"])
_WHO = "X"
MOST_WORDS = 24
"""A longer text is about more than one thing."""


@dataclass(frozen=True)
class ManualWords:
    """The assets to take under manual control, or to give back, which is `take` False."""

    take: bool
    assets: tuple[str, ...]


def read_manual(
    scene: ReferenceScene, text: str, taken: Collection[str]
) -> ManualWords | Unclear | None:
    """Return what `text` asks about manual control, a question about it, or None for no such.

    The `taken` assets are under manual control at this station. *It* is the asset marked on the
    screen, or the only one that is taken.
    """
    linked = link_names(scene.world, text)
    tokens = [token for token in read_tokens(linked) if token.word not in _FILLERS]
    if not tokens or len(tokens) > MOST_WORDS:
        return None
    for name, take in (("take", True), ("give_back", False), ("give_back_taken", False)):
        if name == "give_back_taken" and not taken:
            return None
        for who in _slots(name, tokens):
            found = _assets(scene, linked, who, () if take else taken)
            if isinstance(found, Unclear):
                return found
            if found and (name != "give_back_taken" or {*found} <= {*taken}):
                return ManualWords(take, found)
    return None


def _slots(name: str, tokens: Sequence[WordToken]) -> Iterator[Sequence[WordToken]]:
    """Yield the words that stand for the assets, for every phrase of a list that `tokens` are."""
    said = "".join(f"{token.word} " for token in tokens)
    for pattern in _phrases(name):
        if found := pattern.fullmatch(said):
            first = said[: found.start("who")].count(" ")
            yield tokens[first : first + found["who"].count(" ") + 1]


@cache
def _phrases(name: str) -> tuple[re.Pattern[str], ...]:
    """Return the phrases of a list: `[word]` may be left out, of `one|other` either is said."""

    def part(word: str) -> str:
        if word == _WHO:
            return r"(?P<who>\S+(?: \S+)*?) "
        bare = word.strip("[]")
        either = "|".join(re.escape(way) for way in bare.split("|"))
        return f"(?:(?:{either}) )?" if word.startswith("[") else f"(?:{either}) "

    return tuple(re.compile("".join(map(part, way.split()))) for way in _WORDS[name])


def _assets(
    scene: ReferenceScene, text: str, who: Sequence[WordToken], taken: Collection[str]
) -> tuple[str, ...] | Unclear:
    """Return the assets that the words `who` name, describe or point at; none for anything else."""
    words = [token.word for token in who]
    if " ".join(words) in _POINTED:
        known = [scene.pointer] if scene.pointer in scene.world.assets else [*taken]
        return tuple(known) if len(known) == 1 else ()
    if " ".join(words) in _ALL:
        return tuple(taken)
    names = [scene.assets_said.get(word, "") for word in words if word not in _JOINED]
    if names and all(names):
        return tuple(dict.fromkeys(names))
    said = text[who[0].start : who[-1].end]
    described = [*find_descriptions(scene, read_tokens(said), said)]
    if len(described) != 1 or described[0].sort != "asset":
        return ()
    one = replace(described[0], said=said)
    if (one.start, one.end) != (0, len(said)):
        return ()
    fit = fitting(scene, one)
    if len(fit) == 1:
        return fit
    many = f"{len(fit)} assets fit" if fit else "No asset fits"
    return Unclear(said, f"{many} “{said}”. Name the asset: take over Drone_T01", fit[:9])

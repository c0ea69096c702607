"""One speaker: a style, a world and its names; fills templates so that they read as English."""

import random
import re
from collections.abc import Mapping

from pa_console.schema.telemetry import Picture
from pa_console.schema.world import AssetKind, World
from pa_training.phrasing.names import NameForms
from pa_training.phrasing.phrase_bank import STYLES, PhraseBank, Split, Style

_PLURAL_VERBS = {
    "is": "are",
    "isn't": "aren't",
    "was": "were",
    "has": "have",
    "hasn't": "haven't",
    "does": "do",
    "doesn't": "don't",
    "goes": "go",
    "needs": "need",
    "takes": "take",
    "comes": "come",
    "stays": "stay",
    "moves": "move",
    "returns": "return",
    "relieves": "relieve",
    "replaces": "replace",
    "heads": "head",
    "looks": "look",
    "watches": "watch",
    "checks": "check",
    "keeps": "keep",
    "gets": "get",
    "holds": "hold",
    "fills": "fill",
    "covers": "cover",
    "remains": "remain",
    "makes": "make",
    "warns": "warn",
    "blocks": "block",
    "identifies": "identify",
    "reports": "report",
    "closes": "close",
    "drives": "drive",
    "flies": "fly",
    "tells": "tell",
    "wants": "want",
    "stands": "stand",
    "belongs": "belong",
    "leaves": "leave",
    "guards": "guard",
    "parks": "park",
    "sits": "sit",
    "asks": "ask",
    "stops": "stop",
    "finds": "find",
    "starts": "start",
    "gives": "give",
    "sees": "see",
    "steps": "step",
    "swaps": "swap",
    "approaches": "approach",
    "questions": "question",
    "travels": "travel",
    "does not": "do not",
}
_NOUNS = 5
"""How many nouns are tried until one is not also the word for another team."""
_SINGULAR_VERBS = {"are": "is", "were": "was", "aren't": "isn't"}
_SOUNDS_LIKE_YOU = re.compile(r"(ugv|uav|unit|unif|uniq|use|usu|one\b|once|eu)", re.IGNORECASE)


class Voice:
    """Whoever gives one order: what they know, and how they talk."""

    def __init__(  # noqa: PLR0917
        self,
        world: World,
        picture: Picture,
        bank: PhraseBank,
        rng: random.Random,
        style: Style,
        split: Split,
    ) -> None:
        """Keep what the order is about; equal states of `rng` give equal words."""
        self.world, self.picture, self.bank = world, picture, bank
        self.rng = rng
        self.style: Style = style
        self.split: Split = split
        self.names = NameForms(world, bank.vocabulary)

    def name(self, name: str) -> str:
        """Return a form of a name of an asset or a place."""
        return self.names.say(name, STYLES.index(self.style), self.rng)

    def say(
        self,
        key: str,
        slots: Mapping[str, str],
        wanted: frozenset[str] = frozenset(),
        embedded: bool = False,
    ) -> str:
        """Return a wording of `key` with its `slots` filled, if possible all that are `wanted`."""
        template = self.bank.choose(
            key, self.style, self.split, self.rng, frozenset(slots), wanted, embedded
        )
        text = template.expand(
            self.rng, lambda slot, before: _fitted(slots[slot], before), frozenset(slots), wanted
        )
        for slot in template.slots & {"who", "leaving", "a", "b", "asset"}:
            text = _agreeing(text, slots.get(slot, ""))
        return with_article(text)

    def noun(self, key: str, kind: AssetKind | None = None) -> str:
        """Return a noun of the bank `key` that is no team's word, but for the team of `kind`."""
        teams = self.names.teams(kind)
        said = [self.say(key, {}) for _ in range(_NOUNS)]
        clear = (word for word in said if teams.isdisjoint(_singular(word.lower().split())))
        return next(clear, said[0])


def _singular(words: list[str]) -> set[str]:
    """Return `words` as they are and without a plural's ending."""
    return {*words, *(word.removesuffix("s") for word in words)}


def is_plural(noun_phrase: str) -> bool:
    """Tell whether the words for an asset or assets mean several."""
    words = noun_phrase.lower()
    if " and " in words or "," in words or "&" in words or "+" in words:
        return True
    first = words.split(" ", 1)[0]
    if first in ("a", "an", "one", "any", "another", "each", "every", "either", "some"):
        return False
    return first in ("all", "both", "two", "three", "four", "five") or (
        first.isdigit() and len(words) > len(first)
    )


def _fitted(value: str, before: str) -> str:
    """Return `value` as it fits after the text `before`: one article, and never `to home`."""
    first, _, rest = value.partition(" ")
    if first.lower() in ("the", "a", "an") and re.search(r"\b(the|a|an)\s+$", before, re.I):
        return rest
    if value == "home" and re.search(r"\b(to|at|in|into|for|the|reach)\s+$", before, re.I):
        return "base"
    return value


def with_article(text: str) -> str:
    """Return `text` with `a` and `an` as the words after them want it."""

    def chosen(match: re.Match[str]) -> str:
        article, word = match.groups()
        if word.isupper() and len(word) > 1:
            vowel = word[0] in "AEFHILMNORSX"
        else:
            vowel = word[0].lower() in "aeiou" and not _SOUNDS_LIKE_YOU.match(word)
        silent = len(article) == 2 and word[0] in "hH"
        return f"{article[0]}{'n' if vowel or silent else ''} {word}"

    return re.sub(r"((?:^A|\ba)n?) ([A-Za-z]\w*)", chosen, text)


def _agreeing(text: str, subject: str) -> str:
    """Return `text` with the verbs beside `subject` in its number."""
    if not subject or subject not in text:
        return text
    several = is_plural(subject)
    verbs = _PLURAL_VERBS if several else _SINGULAR_VERBS
    said = re.escape(subject)

    def chosen(match: re.Match[str]) -> str:
        return f"{subject} {verbs.get(match[1], match[1])}"

    text = re.sub(rf"(?<!of )(?<!and )(?<!or ){said} ([a-z']+)", chosen, text)
    if several:
        text = re.sub(rf"\b(how|where|what|why) is {said}", rf"\1 are {subject}", text)
        text = re.sub(r"\b(where|while|as|until|what) it is\b", r"\1 they are", text)
        text = re.sub(r"\bwhere it stands\b", "where they stand", text)
    return text

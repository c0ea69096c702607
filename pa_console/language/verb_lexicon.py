"""English words for the tasks of an order: a small lexicon, by groups of synonyms.

It decides nothing. It shows whether an order has any word for its reading, and whether its explicit
tasks have any part in that reading. Words that mean several things are in several groups; forms of
a word are listed where English makes them otherwise than by an ending.
"""

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import NamedTuple

from pa_console.language.order import Task


class SynonymGroup(NamedTuple):
    """Synonyms, the tasks that an order may be read as that uses one of them, and those it means.

    To *send* somebody may come to a warning, but nobody is warned without a word for it: only what
    a group `means` is supported by its words. The `plain` ones leave no doubt that something of
    the sort is asked; the other `words`, some of them nouns, only make it possible. `phrases` are
    of several words.
    """

    tasks: tuple[Task, ...]
    means: tuple[Task, ...]
    plain: str
    words: str
    phrases: tuple[str, ...] = ()


_MOVES: tuple[Task, ...] = (
    *("go", "look", "identify", "warn", "block", "respond", "cover", "relieve", "mass", "home"),
    *("swap", "stand_down", "report"),
)
GROUPS: Mapping[str, SynonymGroup] = {
    "send": SynonymGroup(
        _MOVES,
        ("go", "mass", "cover", "home"),
        "send go move dispatch deploy redeploy drive fly proceed relocate reposition",
        "send sent go borrow penetrate lift post order goto goes going move dispatch deploy "
        "redeploy drive fly flight head proceed advance approach shift relocate reposition "
        "transfer position place put station get bring brought run walk roll hurry rush travel "
        "reach route steer launch assign reassign scramble push come take want need like belong "
        "gather converge deliver rally concentrate mass assemble regroup join let have use direct "
        "task detail march enter visit patrol wander crawl leave",
        ("off to", "over to", "on its way", "make for", "set off", "call for", "way to", "into"),
    ),
    "look": SynonymGroup(
        ("look", "respond", "identify", "report", "cover", "go"),
        ("look", "respond"),
        "look observe watch monitor",
        "look observe observation show hover above patrol flight over pic pics watch monitor eye "
        "see survey surveil surveillance scan inspect check view film shot overhead aerial "
        "photograph photo picture image overwatch peek peer glance gaze scout recon reconnoitre "
        "recce examine visual camera spot keep find spy video footage shots acquire sensor cam",
        ("eyes on", "eye on"),
    ),
    "hold": SynonymGroup(
        ("hold",),
        ("hold",),
        "hold stay wait freeze halt remain standby",
        "hold held maintain movement further stay wait stop freeze halt remain pause standby "
        "still sit stand park idle rest linger nothing keep unchanged abort cancel cease nobody "
        "alter change same leave fine ok okay none different",
        (
            "as you are",
            "as it is",
            "no one",
            "stay put",
            "do nothing",
            "no change",
            "no action",
            "not move",
            "no move",
        ),
    ),
    "home": SynonymGroup(
        ("home", "stand_down", "relieve", "go"),
        ("home", "stand_down"),
        "return rtb recall",
        "home return back base rtb recall retire retreat withdraw recharge charge land dock come "
        "off rest in inside indoors house garage off-duty depot",
        ("pull back", "go in", "come in", "call in"),
    ),
    "warn": SynonymGroup(
        ("warn", "respond"),
        ("warn",),
        "warn hail",
        "warn hail loudhailer withdraw shoo caution alert announce shout loudspeaker megaphone "
        "address speaker tell talk speak say ask voice",
        ("turn back", "move on", "go away", "keep away", "move away", "move off"),
    ),
    "identify": SynonymGroup(
        ("identify", "respond"),
        ("identify", "respond"),
        "identify",
        "identify identity pid identification id ident verify verification recognise recognize "
        "establish question ask who name papers challenge check know find learn determine",
        ("find out", "making sure who"),
    ),
    "block": SynonymGroup(
        ("block", "respond"),
        ("block",),
        "block barricade",
        "block close plug shut bar seal barricade barrier obstruct obstacle deny roadblock stop "
        "keep prevent lock pass through way hold cut lane road across",
        ("cut off", "in its way", "in his way", "in her way", "in their way"),
    ),
    "report": SynonymGroup(
        ("report", "look", "identify"),
        ("report",),
        "report sitrep",
        "report status ok rpt advise pass show talk doing tell say sitrep update inform brief "
        "state give list confirm check what where who how which when whether hear word read speak "
        "information info news describe answer know condition battery location position call "
        "problem okay wrong up",
    ),
    "cover": SynonymGroup(
        ("cover", "go", "mass", "relieve", "look", "hold"),
        ("cover", "relieve"),
        "backfill",
        "cover guard protect secure backfill fill reinforce defend occupy watch sentry post "
        "replace replacement substitute stand-in step take need lack miss empty unguarded kaput "
        "deserted abandoned uncovered open nobody gap hole vacant fail broke broken dead lost "
        "lose down out defect low coverage unavailable",
        ("no guard", "without guard", "nobody at", "none on", "fill in", "stand in"),
    ),
    "relieve": SynonymGroup(
        ("relieve", "cover", "swap"),
        ("relieve", "cover", "swap"),
        "relieve replace",
        "relieve relief successor supersede duty next after replace replacement substitute sub "
        "instead exchange rotate handover turn spell swap change over place stead finish shift "
        "for begin watch post",
        ("take over", "hand over", "stand in", "step in", "fill in"),
    ),
    "swap": SynonymGroup(
        ("swap", "relieve"),
        ("swap", "relieve"),
        "swap",
        "swap switch flip versa vice exchange trade change rotate other interchange reverse each "
        "cross",
    ),
    "stand down": SynonymGroup(
        ("stand_down", "home"),
        ("stand_down", "home"),
        "dismiss",
        "dismiss alert normal usual escalate release settle sort clear relax disband over finish "
        "done extra surplus superfluous reinforcement reinforce rest leave solve resolve end past "
        "stand",
        ("stand down", "no longer needed", "not needed"),
    ),
    "respond": SynonymGroup(
        ("respond", "look", "identify", "warn"),
        ("respond",),
        "respond",
        "respond response react reaction deal handle answer investigate attend intercept sort "
        "care act action approach unknown stranger suspicious intruder unidentified strange "
        "unannounced hostile visitor inbound arrive stop contact threat business",
        ("see to", "take care", "look into"),
    ),
}
"""The groups by the word that stands for each on the screen."""

_IDIOM = re.compile(r"\bcan wait\b|\bhold fire\b|\bcan stay\b")
"""Plain words that ask for nothing here."""
_ENDINGS = ("s", "es", "ed", "d", "ing")
_AS_THEY_STAND = frozenset(("in", "out", "over", "off", "for", "through", "who", "what", "how"))


class VerbMention(NamedTuple):
    """A word or phrase of a text, where it begins, the tasks it goes with and those it means."""

    word: str
    start: int
    tasks: frozenset[Task]
    means: frozenset[Task]
    plain: bool
    """True if the word has hardly any other use."""


def find_verbs(text: str) -> Iterator[VerbMention]:
    """Yield the words of `text`, in any case, that the lexicon knows, each with its tasks."""
    low = text.lower()
    for found in re.finditer(r"[a-z]+(?:-[a-z]+)*", low):
        if groups := _forms().get(found[0]):
            plain = found[0] in _plain() and not _IDIOM.search(low, *_around(found))
            yield _verb(found[0], found.start(), groups, plain)
    for phrase, pattern, group in _phrases():
        for found in pattern.finditer(low):
            yield _verb(phrase, found.start(), (group,), plain=False)


def _verb(word: str, start: int, groups: Sequence[SynonymGroup], plain: bool) -> VerbMention:
    tasks = frozenset[Task]().union(*(group.tasks for group in groups))
    means = frozenset[Task]().union(*(group.means for group in groups))
    return VerbMention(word, start, tasks, means, plain)


def _around(found: re.Match[str]) -> tuple[int, int]:
    return max(found.start() - 4, 0), found.end() + 6


@cache
def _forms() -> Mapping[str, tuple[SynonymGroup, ...]]:
    """Return every form of a word with all groups in which it is."""
    forms: defaultdict[str, list[SynonymGroup]] = defaultdict(list)
    for group in GROUPS.values():
        words = f"{group.plain} {group.words}".split()
        for form in dict.fromkeys(form for word in words for form in _forms_of(word)):
            forms[form].append(group)
    return {form: tuple(groups) for form, groups in forms.items()}


@cache
def _plain() -> frozenset[str]:
    """Return the plain words in their base form, as orders have them."""
    return frozenset(word for group in GROUPS.values() for word in group.plain.split())


@cache
def _phrases() -> tuple[tuple[str, re.Pattern[str], SynonymGroup], ...]:
    return tuple(
        (phrase, re.compile(rf"\b{re.escape(phrase)}\b"), group)
        for group in GROUPS.values()
        for phrase in group.phrases
    )


def _forms_of(word: str) -> Iterator[str]:
    """Yield `word` and what English makes of it with an ending: `moving`, `stopped`, `carries`."""
    yield word
    if word in _AS_THEY_STAND:
        return
    yield from (word + ending for ending in _ENDINGS)
    if word.endswith("e"):
        yield from (word[:-1] + ending for ending in ("ing", "ed"))
    elif word.endswith("y"):
        yield from (word[:-1] + ending for ending in ("ies", "ied"))
    elif len(word) > 2 and word[-1] in "bdgmnpt":
        yield from (word + word[-1] + ending for ending in ("ing", "ed"))

"""The lexicon of orders, read once from `lexicon.yaml`: word lists, and verbs by their tasks.

The verbs decide nothing by themselves. They show whether any word of an order supports its reading,
and whether the reading covers the tasks that the order names. A word with several meanings is in
several groups. The file lists irregular forms of words.
"""

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from pydantic import TypeAdapter

from pa_console.language.canonical.order import Task

_IDIOM = re.compile(r"\bcan wait\b|\bhold fire\b|\bcan stay\b")
"""Phrases in which a plain word asks for nothing."""
_ENDINGS = ("s", "es", "ed", "d", "ing", "in")
_AS_THEY_STAND = frozenset(("in", "out", "over", "off", "for", "through", "who", "what", "how"))


def word_lists(section: str) -> Mapping[str, tuple[str, ...]]:
    """Return the word lists of a section of the lexicon by their names."""
    return _entries(_lexicon()[section])


def any_of(section: str, name: str) -> str:
    """Return a regular expression for any entry of a list as whole words."""
    return rf"\b(?:{'|'.join(word_lists(section)[name])})\b"


@cache
def _lexicon() -> dict[str, Any]:
    """Return the sections of the file; each has lists by name, or groups of such lists."""
    # The base loader keeps every word as text: *no*, *on* and *off* are not booleans here.
    loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
    text = Path(__file__).with_name("lexicon.yaml").read_text(encoding="utf-8")
    return yaml.load(text, loader)


def _entries(lists: Mapping[str, str]) -> Mapping[str, tuple[str, ...]]:
    """Return the entries of each list, split at ` / ` if the list contains it, else at spaces."""
    return {
        name: tuple(text.split(" / ") if " / " in text else text.split())
        for name, text in lists.items()
    }


class SynonymGroup(NamedTuple):
    """Synonyms, the tasks that they allow in a reading, and the tasks that they mean.

    An order with one of the words may be read as any of `tasks`, but its words support only the
    tasks in `means`: *send* may belong to an order to warn, but a warning needs a word of its own.
    `plain` words always ask for one of the tasks; `words`, some of which are nouns, do not always.
    `phrases` consist of several words.
    """

    tasks: tuple[Task, ...]
    means: tuple[Task, ...]
    plain: tuple[str, ...]
    words: tuple[str, ...]
    phrases: tuple[str, ...] = ()


@cache
def _verb_groups() -> tuple[SynonymGroup, ...]:
    groups = [_entries(lists) for lists in _lexicon()["verbs"].values()]
    return TypeAdapter(tuple[SynonymGroup, ...]).validate_python(groups)


class VerbMention(NamedTuple):
    """A word or phrase in a text, its start, and the tasks that it allows or means."""

    word: str
    start: int
    tasks: frozenset[Task]
    means: frozenset[Task]
    plain: bool
    """True if the word hardly ever means anything but its tasks."""


def find_verbs(text: str) -> Iterator[VerbMention]:
    """Yield the words and phrases of `text` that are in the lexicon, with their tasks.

    A compound that is not in the lexicon counts as its first word: *look-down* as *look*.
    """
    low = text.lower()
    for match in re.finditer(r"[a-z]+(?:-[a-z]+)*", low):
        forms = _forms()
        if groups := forms.get(match[0]) or forms.get(match[0].partition("-")[0]):
            plain = match[0] in _plain() and not _IDIOM.search(low, *_around(match))
            yield _verb(match[0], match.start(), groups, plain)
    for phrase, pattern, group in _phrases():
        for match in pattern.finditer(low):
            yield _verb(phrase, match.start(), (group,), plain=False)


def _verb(word: str, start: int, groups: Sequence[SynonymGroup], plain: bool) -> VerbMention:
    tasks = frozenset[Task]().union(*(group.tasks for group in groups))
    means = frozenset[Task]().union(*(group.means for group in groups))
    return VerbMention(word, start, tasks, means, plain)


def _around(match: re.Match[str]) -> tuple[int, int]:
    return max(match.start() - 4, 0), match.end() + 6


@cache
def _forms() -> Mapping[str, tuple[SynonymGroup, ...]]:
    """Return all forms of words, each with the groups that contain the word."""
    forms: defaultdict[str, list[SynonymGroup]] = defaultdict(list)
    for group in _verb_groups():
        words = (*group.plain, *group.words)
        for form in dict.fromkeys(form for word in words for form in _forms_of(word)):
            forms[form].append(group)
    return {form: tuple(groups) for form, groups in forms.items()}


@cache
def _plain() -> frozenset[str]:
    """Return the plain words in their base form, the form that orders use."""
    return frozenset(word for group in _verb_groups() for word in group.plain)


@cache
def _phrases() -> tuple[tuple[str, re.Pattern[str], SynonymGroup], ...]:
    return tuple(
        (phrase, re.compile(rf"\b{re.escape(phrase)}\b"), group)
        for group in _verb_groups()
        for phrase in group.phrases
    )


def _forms_of(word: str) -> Iterator[str]:
    """Yield `word` and its forms with endings: `moving`, `movin`, `stopped`, `carries`."""
    yield word
    if word in _AS_THEY_STAND:
        return
    yield from (word + ending for ending in _ENDINGS)
    if word.endswith("e"):
        yield from (word[:-1] + ending for ending in ("ing", "in", "ed"))
    elif word.endswith("y"):
        yield from (word[:-1] + ending for ending in ("ies", "ied"))
    elif len(word) > 2 and word[-1] in "bdgmnpt":
        yield from (word + word[-1] + ending for ending in ("ing", "in", "ed"))

"""Finds the times that a text names, and whether they are those of the order in it.

*Send a drone north at 16:45* has a time of its own. *The storm will hit in an hour* has one of
something else. A time of the order that no phrase takes up must not vanish in silence.
"""

import re
from collections.abc import Sequence

from pa_console.language.clock_words import STOPS, TIME_WORDS, read_duration, read_number
from pa_console.language.lexicon import find_verbs
from pa_console.language.mentions import ASSETS
from pa_console.language.name_linking import KIND_WORDS, link_names
from pa_console.language.references.reader import EVERYBODY, Reader, WordToken, read_tokens
from pa_console.schema.world import World

_BORDERS = frozenset((*STOPS, "?", "(", ")", *TIME_WORDS["borders"]))
_FILLERS = frozenset((*TIME_WORDS["joints"], *TIME_WORDS["fillers"]))
_TOLD = frozenset(TIME_WORDS["told"])
_PAST = frozenset(TIME_WORDS["past"])
_ALONE = frozenset(TIME_WORDS["alone"])
_OF_THE_HOUR = frozenset(TIME_WORDS["of_the_hour"])
_LEADS = frozenset(TIME_WORDS["leads"])
FOUR_DIGITS = re.compile(r"(?:[01]\d|2[0-3])[0-5]\d(?:h|hrs|z)?")
"""A time of day without a colon: 1645, 0900z."""
NAMED = frozenset((*ASSETS, *KIND_WORDS))
"""The words for assets: a number after one is the asset's."""


def is_of_order(
    world: World, tokens: Sequence[WordToken], spans: Sequence[tuple[int, int]], first: int
) -> bool:
    """Return whether the words around the phrase of time at `first` ask for something.

    They name an asset, or begin with a verb of orders; words that tell what has been do not.
    """
    timed = {at for start, end in spans for at in range(start, end)}
    start = last = first
    while start > 0 and (start - 1 in timed or tokens[start - 1].word not in _BORDERS):
        start -= 1
    while last < len(tokens) and (last in timed or tokens[last].word not in _BORDERS):
        last += 1
    around = [at for at in range(start, last) if at not in timed]
    around = [at for at in around if tokens[at].word not in _FILLERS | _OF_THE_HOUR | _LEADS]
    around = [at for at in around if read_number(Reader(tokens, at)) < 0]
    if not around:
        return True
    for at in around:
        if at < first and tokens[at].word in _TOLD and tokens[at + 1].word != "to":
            return False
    clause = " ".join(tokens[at].said for at in around)
    said = {token.word.removesuffix("s") for token in read_tokens(link_names(world, clause))}
    if said & {*ASSETS, *KIND_WORDS, *(name.lower() for name in world.assets), *EVERYBODY}:
        return True
    return any(verb.plain or verb.start == 0 for verb in find_verbs(clause))


def unread_times(world: World, text: str) -> tuple[str, ...]:
    """Return the times named in an order of which no time was read.

    A time of something else, *the guard changes in an hour*, is none of the order's.
    """
    tokens = read_tokens(text)
    spans, at = list[tuple[int, int]](), 0
    while at < len(tokens):
        reader = Reader(tokens, at)
        past = reader.word(-1) == "since"
        if _names_time(reader) and not past and reader.word() not in _PAST:
            spans.append((at, reader.at))
        at = max(reader.at, at + 1)
    return tuple(
        text[tokens[first].start : tokens[end - 1].end]
        for first, end in spans
        if is_of_order(world, tokens, spans, first)
    )


def _names_time(reader: Reader) -> bool:
    """Read *ten minutes*, *16:45*, *1645*, *midnight*: words that mean a time wherever they stand.

    *A second* may be another one, *a minute* no time at all, and *robot 3s* is robot 3's.
    """
    loose = reader.word() in ("a", "an") or reader.word()[-1:] == "s"
    if not loose and read_duration(reader) > 0.0:
        return True
    if reader.word(1) == ":" and reader.word().isdecimal() and reader.word(2).isdecimal():
        reader.at += 3
        return True
    alone = reader.word() in _ALONE or FOUR_DIGITS.fullmatch(reader.word()) is not None
    if not alone and reader.word().isdecimal() and reader.word(-1) not in NAMED:
        # *In 5*, *5 past*: a number that no thing follows, beside a word of the clock.
        after = reader.word(1)
        ends = reader.word(-1) in _LEADS and (after in STOPS or after in _OF_THE_HOUR)
        alone = ends or after in ("past", "sharp", "hundred")
    reader.at += alone
    return alone

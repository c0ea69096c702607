"""Step 1: whether words can be an order to this team at all, before any model reads them.

A model finds an order in everything. So what is not English, has no words, is program text, or
speaks of nothing that the site has is asked back about, and no plan is made for it. Words alone
decide, by closed lists and the dictionary: nothing here is fitted to texts.
"""

import json
import re
from typing import NamedTuple

from pa_console.language.mentions import find_mentions, speaks_of_site
from pa_console.language.name_linking import link_names
from pa_console.language.verb_lexicon import find_verbs
from pa_console.orchestrator.intake.known_words import SHORT, english, name_words, rule_words
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.world import World

_WORD = re.compile(r"[^\W\d_]+(?:['’][^\W\d_]+)*")
_ENDING = re.compile(r"['’](?:s|re|ve|ll|d|m|t)$")
_CALL_SIGN = re.compile(r"\w*[\d_]\w*")
"""Names of assets and frames, call signs and numbers: of no language."""
_ALPHABET = frozenset("abcdefghijklmnopqrstuvwxyz")
_MOST_STRANGE = 0.3
"""The share of strange words from which a text is not English."""
_SLIP = 0.35
"""The weight, as a strange word, of a word that is nearly a word of orders."""
_OTHER_LANGUAGES = frozenset(
    word
    for words in (
        "der das und ist nicht ein eine einen einem dem zum zur mit auf für nach sich wir sie",
        "le la les une et est qui dans pour avec vous nous aux du ce cette je tu au de tout",
        "el los las una para como pero muy lo su se esta este",
        "il gli della alla nel che di non sono questo",
        "os uma ao em você está isso",
        "het een naar niet ik dat ook maar voor zijn er",
        "och att det som på för av med till inte jag og ikke til ska skal",
        "nie się jest jak dla bir ve bu için mi",
        "pe cu și je na že jsem yang dan ke ini itu",
    )
    for word in words.split()
)
"""The commonest words of other languages that orders in English have no use for.

In turn German, French, Spanish, Italian, Portuguese, Dutch, Scandinavian, Polish and Turkish,
Romanian, Czech and Indonesian. Other alphabets need no list.
"""
_CODE = re.compile(
    r"[A-Za-z_][\w.]*\((?!s\))[^()]*\)[\s:;)]*$"
    r"|^\s*(?:SELECT|INSERT|UPDATE|DELETE|CREATE|DROP)\b.+\b(?:FROM|INTO|SET|TABLE)\b"
    r"|<(\w+)[^<>]*>.*</\1>"
    r"|\bhttps?://",
    re.DOTALL,
)


class _Words(NamedTuple):
    """The number of words of a text without names, and the words that are no English."""

    number: int
    strange: tuple[str, ...]
    slips: tuple[str, ...]
    """The strange words that are nearly a word of orders or a name."""

    @property
    def share(self) -> float:
        """The share of the words that are strange."""
        return (len(self.strange) + _SLIP * len(self.slips)) / max(self.number, 1)


def is_english(text: str, world: World, rulebook: Rulebook) -> bool:
    """Return whether `text`, as typed, is English by its words; a text without words is."""
    return _words(text, world, rulebook).share < _MOST_STRANGE


def question_back(typed: str, read: str, world: World, rulebook: Rulebook) -> str:
    """Return what has to be asked of an operator who gives no order; '' where it may be one.

    It was `typed` so, and is `read` with what is misspelt put right. Nobody may be moved for a text
    that is asked back about.
    """
    words = _words(typed, world, rulebook)
    if not words.number and not find_mentions(world, typed):
        return "there are no words in it. What is to be done, by whom and where?"
    if words.share >= _MOST_STRANGE:
        strange = ", ".join(dict.fromkeys((*words.strange, *words.slips)))
        return f"not known in English: {strange}. What is to be done, in English?"
    if _is_code(typed):
        return "it reads as program text. What is to be done, in words?"
    if not speaks_of_site(world, link_names(world, read)) and not _moves_nobody(read):
        return "it names nobody and nothing of this site. What is to be done, by whom and where?"
    return ""


def _words(text: str, world: World, rulebook: Rulebook) -> _Words:
    dictionary, names = english(), name_words(world)
    known = rule_words(rulebook).union(names.words)
    count, strange, slips = 0, list[str](), list[str]()
    for word in _WORD.findall(_CALL_SIGN.sub(" ", _without_names(text, world))):
        low = word.lower().replace("’", "'")
        base = _ENDING.sub("", low)
        count += 1
        if dictionary.is_operators(base) or base in known:
            continue
        if low in _OTHER_LANGUAGES:
            strange.append(word)
        elif not (base in _ALPHABET or dictionary.is_common(base) or dictionary.is_common(low)):
            near = len(base) >= SHORT and base.isascii() and dictionary.is_near(base, names)
            (slips if near else strange).append(word)
    return _Words(count, tuple(strange), tuple(slips))


def _without_names(text: str, world: World) -> str:
    for name in (*world.frames, *world.zones, *world.assets):
        text = text.replace(name, " ")
    return text


def _is_code(text: str) -> bool:
    if _CODE.search(text):
        return True
    if text.lstrip()[:1] not in ("{", "["):
        return False
    try:
        json.loads(text)
    except (ValueError, RecursionError):
        return False
    return True


def _moves_nobody(text: str) -> bool:
    """Return whether a text without names may be one of the orders that need none: *freeze*."""
    return any(verb.means & {"hold", "report"} for verb in find_verbs(text))

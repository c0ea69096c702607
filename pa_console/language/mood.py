"""The mood of an operator's words: an order to carry out now, or words that move no asset.

*Do not send Drone_T04 there*, *yesterday we moved it*, *a visitor says: send it* and *when I say
go, send it* name assets, gates and movements, just as orders do. Their grammar shows that they are
not orders. The verb is negated, in the past or part of a supposition; another person speaks; or the
words are a quotation, a question, or subject to a condition that no sensor shows. The signs are
patterns of words (`lexicon.yaml`, *mood*). A text is not an order if one of its parts has such a
sign and no other part asks for anything.
"""

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from functools import cache
from itertools import pairwise
from typing import Literal, NamedTuple

from pa_console.language.clock_words import names_time
from pa_console.language.lexicon import word_lists
from pa_console.language.mentions import KINDS, without_quotations
from pa_console.language.name_linking import GATE, WORD, LinkedText, WorldNames
from pa_console.language.references.reader import CONTACTS, read_tokens
from pa_console.schema.mission import Ban
from pa_console.schema.world import World

MoodKind = Literal[
    "prohibited",  # do not send it
    "needless",  # no need to send it, nobody asked for it
    "past",  # we sent it yesterday
    "supposed",  # imagine we sent it, what if it went
    "wished",  # I wish it were there
    "mused",  # I was thinking of sending it
    "joked",  # only kidding
    "text_work",  # translate: send it
    "reported",  # a visitor says: send it
    "quoted",  # "send it"
    "questioned",  # did you send it?
    "benign",  # the van is expected, let it through
    "waiting",  # when I say go, once it rains
]

READS_AS: Mapping[MoodKind, str] = {
    "prohibited": "a prohibition",
    "needless": "something that is not needed",
    "past": "something that has already happened",
    "supposed": "a supposition",
    "wished": "a wish",
    "mused": "a thought, not yet an order",
    "joked": "a joke",
    "text_work": "text to work on",
    "reported": "somebody else's words",
    "quoted": "a quotation",
    "questioned": "a question",
    "benign": "a remark about a visitor who may pass",
    "waiting": "an order for later, after something that no sensor shows",
}
"""A description of each kind that completes *That reads as ...*."""

_SAY_IT = "To give an order, say who is to do what, and where."
_INSTEAD: defaultdict[str, str] = defaultdict(
    lambda: _SAY_IT,
    prohibited="Did you mean that an asset is to stay, or to go somewhere else?",
    questioned="Ask for a report, or say who is to do what, and where.",
    waiting="Give the order when the time has come, or name a time or a state that sensors show.",
)

_WHOLE: frozenset[MoodKind] = frozenset(("waiting", "wished"))
"""Signs that apply to the whole sentence, wherever they occur in it."""
_ONWARDS: frozenset[MoodKind] = frozenset(("supposed", "mused", "text_work", "questioned"))
"""Signs that apply to the rest of the sentence."""
_IF = re.compile(r"\b(?:if|in case|unless|whether|should)\b")
_PLAIN: tuple[MoodKind, ...] = (
    "text_work", "supposed", "wished", "mused", "needless", "benign"
)  # fmt: skip
"""Signs for which a match of their pattern is enough."""
_PART = re.compile(r"(?:(?! [,;:–—] | - | (?:but|instead|rather|so) ).)+.?")
_END = frozenset((".", "!", "?"))
_ORDERED: tuple[MoodKind, ...] = (
    "text_work", "supposed", "wished", "questioned", "reported", "mused", "waiting",
    "needless", "prohibited", "past", "benign",
)  # fmt: skip
"""The kinds by precedence: a sentence with several signs is described by the first."""

_MACHINES = KINDS.keys() | {"asset", "unit", "machine"}
_QUOTE = "quotedwords"
"""The placeholder for a quotation."""
_ASSET_NAME = re.compile(r"[A-Za-z]+_?T?\d+", re.ASCII)

_OPENING = re.compile(
    r"(?:(?:\w+ ){0,2}, |(?:and|so|but|hey|ok|okay|well|now|say|please|sorry|um|uh|erm) )*"
)
"""Forms of address and fillers before a question."""

_CAUSING = frozenset(("get", "have", "want", "need", "see", "let", "keep"))
"""Verbs that make an order of an asset and a participle: *get Drone_T04 headed home*."""

_POLITE = re.compile(r"(?:can|could|would|will) not (?:you|we|it|he|she|somebody|someone)\b")

_CLOSING = len(" .")

_OWN = re.compile(
    r"(?:, |; )(?:so |but |and |then |therefore |still )*(?:could|can|would|will) you\b"
    r"|\b(?:so|but) (?:please|i|let|have|send|get|put|move)\b|, (?:so|but) "
)

_STOP = re.compile(r" [,.:;!?–—]")


class NoOrder(NamedTuple):
    """The kind of sign that shows that a text is not an order, and the sentence with this sign."""

    kind: MoodKind
    sentence: str

    @property
    def question(self) -> str:
        """The answer to the operator: why nothing will move, and what to say instead."""
        return f"That reads as {READS_AS[self.kind]}. Nothing will move. {_INSTEAD[self.kind]}"


class _Sign(NamedTuple):
    """A phrase that shows that a sentence is not an order, with its position in the words."""

    kind: MoodKind
    start: int
    end: int


class _Sentence(NamedTuple):
    """A sentence in the form that the patterns match, and as written."""

    words: str
    """Words and punctuation, separated by single blanks; ASSET, PLACE and KIND replace names."""
    text: str


def no_order(world: World, text: str) -> NoOrder | None:
    """Return the sign that `text` is not an order; None if it may be an order."""
    unquoted = without_quotations(text, f" {_QUOTE} ")
    sentences = [*_sentences(world, unquoted)]
    joke = next(
        (sentence for sentence in sentences if _pattern("joked").search(sentence.words)), None
    )
    if joke is not None:
        return NoOrder("joked", joke.text)
    first_sign: NoOrder | None = None
    benign = any(
        _pattern("benign").search(sentence.words)
        for sentence in sentences
        if not _IF.search(sentence.words)
    )
    for sentence in sentences:
        sign, directs = _read(sentence, bare=first_sign is None, benign=benign)
        if directs:
            return None
        first_sign = first_sign or sign
        if sign is not None and (sign.kind == "text_work" or sentence.words.endswith(":")):
            break
    if first_sign is None and unquoted != text and re.search(r"[\"“`]|: '", text):
        quoted = any(_directs(part.words, bare=True) for part in _sentences(world, text))
        return NoOrder("quoted", text) if quoted else None
    return first_sign


def lasting_ban(world: World, text: str) -> Ban | None:
    """Return the ban that a lasting prohibition asks for; None for any other text.

    *Nobody goes to the south gate* and *Drone_T04 must never fly to EastGate* are bans; *do not
    send it* only takes back a movement.
    """
    sign = no_order(world, text)
    if sign is None or sign.kind != "prohibited":
        return None
    [sentence, *others] = _sentences(world, text)
    if others or not _pattern("lasting").search(sentence.words):
        return None
    words = {token.word for token in read_tokens(LinkedText.of(world, text).text)}
    kinds = {KINDS.get(word.removesuffix("s")) for word in words}
    assets = [n for n, spec in world.assets.items() if n.lower() in words or spec.kind in kinds]
    places = [name for name in (*world.frames, *world.zones) if name.lower() in words]
    if not (assets or places):
        return None
    return Ban(assets=tuple(assets), places=tuple(places))


def _sentences(world: World, text: str) -> Iterator[_Sentence]:
    """Yield the sentences of `text`, with ASSET, PLACE or KIND in place of names and kinds."""
    linked = LinkedText.of(world, text)
    assets = {name.lower() for name in world.assets}
    places = {name.lower() for name in (*world.frames, *world.zones)} | {"base", "home"}
    places |= {word.lower() for gate in world.gates for word in WORD.findall(gate)} - {GATE}
    names = WorldNames.of(world)
    words, start, end = list[str](), 0, 0
    for token in read_tokens(linked.text):
        word = token.word
        if word in assets or _ASSET_NAME.fullmatch(token.written):
            word = "ASSET"
        elif word in places:
            word = "PLACE"
        elif (single := word.removesuffix("s")) in _MACHINES or (
            single.isalpha() and names.team(word) in (word, single)
        ):
            word = "KIND"
        words += _dialect().get(word, word).split("_") if word.islower() else [word]
        end = token.end
        if word in _END:
            yield _Sentence(" ".join(words), linked.original_words(start, end).strip())
            words, start = [], end
    if words:
        yield _Sentence(" ".join(words), linked.original_words(start, end).strip())


def _read(sentence: _Sentence, *, bare: bool, benign: bool) -> tuple[NoOrder | None, bool]:
    """Return the sign of a sentence, and whether a part without a sign asks for anything.

    Before its first sign, a `bare` sentence may ask for something without a verb. If the visitors
    of the text are `benign`, naming a visitor asks for nothing.
    """
    signs = [*_signs(sentence.words)]
    spans = [_reach(sign, len(sentence.words)) for sign in signs]
    directs = False
    for part in _PART.finditer(sentence.words):
        free, after = part[0], bare
        for start, end in spans:
            if start < part.end() - 1 and part.start() < end:
                free, after = free[: max(0, start - part.start())], False
        directs = directs or _directs(free, bare=after, benign=benign)
        bare = after
    if not signs:
        return None, directs
    first = min(signs, key=lambda sign: _ORDERED.index(sign.kind))
    return NoOrder(first.kind, sentence.text), directs


def _reach(sign: _Sign, length: int) -> tuple[int, int]:
    if sign.kind in _WHOLE:
        return 0, length
    return sign.start, length if sign.kind in _ONWARDS else sign.end


def _signs(words: str) -> Iterator[_Sign]:
    """Yield every sign in the words of a sentence."""
    for kind in _PLAIN:
        for match in _pattern(kind).finditer(words):
            if kind != "benign" or not _IF.search(words):
                yield _Sign(kind, *match.span())
    for match in _pattern("passed_on").finditer(words):
        yield _Sign("reported", match.start(), len(words))
    for match in _pattern("prohibited").finditer(words):
        if _is_kept(words, match) or _is_asked(words, match.start()):
            continue
        if not _is_supposed(words, match.start()):
            yield _Sign("prohibited", *match.span())
    for match in _pattern("past").finditer(words):
        before = words[: match.start()].split()[-1:]
        if not _pattern("past_order").search(words) and not _CAUSING.intersection(before):
            yield _Sign("past", *match.span())
    for match in _pattern("my_word").finditer(words):
        yield _Sign("waiting", *match.span())
    for match in _pattern("opinion").finditer(words):
        yield _Sign("questioned", match.start(), len(words))
    yield from _questions(words)
    yield from _reports(words)
    yield from _waits(words)


def _questions(words: str) -> Iterator[_Sign]:
    """Yield a sign if the sentence is a question about a movement, not about a state.

    *Should it be low, send another* begins with a condition, and is not a question.
    """
    start = _OPENING.match(words).end()  # type: ignore[union-attr] - it also matches ''
    is_question = words.endswith("?")
    if start and not is_question:
        start = 0
    match = _pattern("questioned").match(words, start)
    if match is None or _pattern("requests").match(words, start):
        return
    if re.search(rf"\b(?:{_list('moving')})\b(?! (?:on|ahead|out)\b)", words[start:]):
        yield _Sign("questioned", start, len(words))


def _is_kept(words: str, negated: re.Match[str]) -> bool:
    """Return whether leaving or losing something is forbidden; that is an order to keep it."""
    after = negated[0].rpartition(" not ")[2].split()[:3]
    following = words[negated.end() :].split()
    eyes = not {"eye", "eyes"}.isdisjoint(following[:3])  # *don't take your eyes off it*
    return eyes or bool(_set("kept").intersection((*after, *following[:1])))


def _is_asked(words: str, start: int) -> bool:
    """Return whether a negation belongs to a polite request: *why don't you*, *couldn't you*."""
    if words[:start].endswith("why "):
        return True
    return _POLITE.match(words, start) is not None


def _is_supposed(words: str, start: int) -> bool:
    """Return whether a negation belongs to a condition: *if he does not leave, close it*."""
    clause = words[:start].rpartition(",")[2].split()
    return clause[:1] == ["if"] or "if" in clause[-3:]


def _reports(words: str) -> Iterator[_Sign]:
    """Yield a sign for another speaker's words if they are about what assets should do."""
    for match in _pattern("say").finditer(words):
        before = words[: match.start()].split()
        while before and before[-1] in _set("adverbs"):
            before.pop()
        subject = before[-1] if before else ""
        if not subject.islower() or not subject.isalpha() or subject in _set("speaker"):
            continue
        content = words[match.end() :]
        if len(content) <= _CLOSING and "," in before[-3:]:  # the speaker follows the speech
            yield _Sign("reported", 0, len(words))
        elif _QUOTE in content.split()[:5]:
            yield _Sign("reported", 0, match.end() + content.index(_QUOTE) + len(_QUOTE))
        elif _speaks_of_tasks(content):
            start = words.rfind(" , ", 0, match.start()) + 1
            end = len(words) if content.startswith((" :", ' "')) else _own_words(words, match.end())
            yield _Sign("reported", start, end)


def _own_words(words: str, start: int) -> int:
    """Return the position at which the operator's own words resume."""
    match = _OWN.search(words, start)
    return len(words) if match is None else match.start()


def _speaks_of_tasks(content: str) -> bool:
    """Return whether reported words are about the actions of assets, and not about a visitor's."""
    words = content.split()
    asset = next((at for at, word in enumerate(words) if word in ("ASSET", "KIND")), len(words))
    visitor = next((at for at, word in enumerate(words) if word in CONTACTS), len(words))
    named = asset < len(words) or "PLACE" in words
    return named and asset <= visitor and _action().search(content) is not None


@cache
def _action() -> re.Pattern[str]:
    return re.compile(rf"\b(?:{_list('act')}|{_list('doing')})\b")


def _waits(words: str) -> Iterator[_Sign]:
    """Yield a sign for each condition that neither the picture nor the clock can decide."""
    for match in _pattern("conditions").finditer(words):
        before = words[: match.start()].split()
        if _pattern("no_condition").match(words, match.start()):
            continue
        if _set("whether").intersection(before[-1:]) or _set("reason").intersection(before):
            continue
        if names_time(words[: match.start()]):  # a time decides; the condition is only its reason
            continue
        content = _STOP.split(words[match.end() :])[0].split()
        seen = match[0] == "after" or _set("observable").intersection(content)
        if content and (_set("unseen").intersection(content) or not seen):
            yield _Sign("waiting", *match.span())


def _directs(part: str, *, bare: bool, benign: bool = False) -> bool:
    """Return whether a part of a sentence may ask for something.

    A `bare` part may do so without a verb: *Drone_T04 to EastGate*, *unknown car at the gate*.
    """
    listed = part.split()
    words, tasks = set(listed), _set("act") | _set("kept_tasks")
    for before, word in pairwise(("", *listed)):
        if word in tasks and before not in _set("of_nouns"):
            return True
    if not bare:
        return False
    if "PLACE" in words and words & {"ASSET", "KIND"}:
        return True
    return not benign and bool(words & (CONTACTS.keys() | _set("troubles")))


@cache
def _set(name: str) -> frozenset[str]:
    return frozenset(word_lists("mood")[name])


@cache
def _dialect() -> dict[str, str]:
    return dict(entry.split("=") for entry in word_lists("mood")["dialect"])


@cache
def _list(name: str) -> str:
    return "|".join(sorted(word_lists("mood")[name], key=len, reverse=True))


@cache
def _pattern(name: str) -> re.Pattern[str]:
    ways = _list(name)
    for part in ("act", "did", "doing", "moving", "between"):
        ways = ways.replace(f"<{part}>", f"(?:{_list(part)})")
    return re.compile(rf"\b(?:{ways})(?!\w)")

"""The sequence of steps in an order: *first A, then B*, *once A is there, B*, *not before ...*.

The words for the sequence are cut out, and each step is read like an order of its own. A *then*
that only introduces the consequence of an *if* does not separate steps. An event that a step waits
for must have been ordered earlier in the same text; otherwise, the operator is asked about it.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from pa_console.language.canonical.order import KIND_FOR, VERB_FOR
from pa_console.language.lexicon import find_verbs, word_lists
from pa_console.language.mentions import ASSETS, KINDS
from pa_console.language.name_linking import link_names
from pa_console.language.references.conversation import Unclear
from pa_console.language.references.reader import (
    DEFINITE,
    EVERYBODY,
    INDEFINITE,
    Reader,
    asset_at,
    place_at,
    read_tokens,
)
from pa_console.language.references.scene import ReferenceScene
from pa_console.schema.world import AssetKind

_WORDS = word_lists("order_steps")
_STOPS = frozenset(_WORDS["stops"])
_ENDS = frozenset(_WORDS["ends"])
_JOINTS = frozenset(("and", "but"))
_FILLERS = frozenset(_WORDS["fillers"])
_AWAIT, _AWAIT_AT_END = _WORDS["await"], _WORDS["await_at_end"]
_ARRIVAL, _ARRIVED = frozenset(_WORDS["arrival"]), frozenset(_WORDS["arrived"])
_PRONOUNS = frozenset(_WORDS["pronouns"])
_OWN_VERBS = frozenset(_WORDS["own_verbs"])
_CONDITIONAL = frozenset(_WORDS["conditional"])
_AFTERWARDS = _WORDS["afterwards"]
_IMPERATIVES = frozenset(_WORDS["imperatives"])
_KIND_OF: Mapping[str, AssetKind] = {
    **KIND_FOR,
    **{VERB_FOR[task]: kind for task, kind in KIND_FOR.items()},
    "watch": KIND_FOR["look"],
}
"""The beginnings of verbs that only one kind of asset can carry out, each with that kind."""

_CALL_SIGN = re.compile(r"[a-z]+_?t?\d+")


@dataclass(frozen=True)
class ReadSteps:
    """The steps of an order, each in its own words; every step waits for the step before it."""

    steps: tuple[str, ...]


@dataclass(frozen=True)
class _Awaited:
    """An event that a step waits for: *Robot_T01 is at the north gate*."""

    words: str
    names: tuple[str, ...]
    """The assets that the words name."""
    place: str
    end: int
    """The token after the words."""


def read_steps(scene: ReferenceScene, text: str) -> ReadSteps | Unclear | None:
    """Return the steps of an order, a question about them, or None if it has fewer than two."""
    cut = _Cutter(scene, text)
    cut.read()
    if cut.unclear is not None:
        return cut.unclear
    parts = [part for part in cut.parts if cut.words(part)]
    asking = [cut.asks(part) for part in parts]
    if sum(asking) < 2:
        return None
    if cut.conditional:
        return Unclear("", "An order cannot have both a condition and steps: give one of them.")
    if not all(asking):
        number = asking.index(False) + 1
        words = cut.words(parts[number - 1])
        return Unclear("", f"Step {number}, “{words}”, asks for nothing. What is to be done then?")
    return ReadSteps(tuple(cut.sentences(parts)))


def unkept_steps(scene: ReferenceScene, text: str) -> tuple[str, ...]:
    """Return the steps in `text`, in words, because a single plan does not keep their sequence."""
    steps = read_steps(scene, text)
    if steps is None:
        return ()
    return (steps.question,) if isinstance(steps, Unclear) else (" then ".join(steps.steps),)


class _Cutter:
    """A parser that splits the tokens of a text into steps."""

    def __init__(self, scene: ReferenceScene, text: str) -> None:
        self._scene, self._text = scene, link_names(scene.world, text)
        self._tokens = read_tokens(self._text)
        self.parts: list[list[int]] = []
        """The tokens of each step."""
        self.unclear: Unclear | None = None
        self.conditional = False
        """True if a condition introduces the order."""
        self._now: list[int] = []
        self._reader = Reader(self._tokens)

    # ------------------------------------------------------------------ cutting

    def read(self) -> None:
        """Read all tokens."""
        if self._numbered():
            return
        reader = self._reader
        while not reader.over and self.unclear is None:
            if self._takes_awaited() or self._takes_first() or self._takes_next():
                continue
            if reader.word() in _CONDITIONAL and self._at_clause:
                self.conditional = True
            self._now.append(reader.at)
            reader.at += 1
        self._end()

    def _end(self) -> None:
        self.parts.append(self._now)
        self._now = []

    def _numbered(self) -> bool:
        """Split *1) ... 2) ...*; return False for a text that is not numbered."""
        marks = [
            at
            for at in range(len(self._tokens) - 1)
            if self._tokens[at].word.isdecimal() and self._tokens[at + 1].word in (")", ".")
            and (at == 0 or self._tokens[at + 1].word == ")" or self._tokens[at - 1].word == ".")
        ]  # fmt: skip
        if [int(self._tokens[at].word) for at in marks] != list(range(1, len(marks) + 1)):
            return False
        if len(marks) < 2 or marks[0] != 0:
            return False
        for start, end in zip(marks, [*marks[1:], len(self._tokens)], strict=True):
            self.parts.append(list(range(start + 2, end)))
        return True

    @property
    def _at_clause(self) -> bool:
        """True at the beginning of a clause."""
        before = self._reader.word(-1)
        return not before or before in _STOPS or before in _JOINTS or not self._now

    def _is_ordering(self, ahead: int) -> bool:
        """Return whether the word `ahead` can begin an order, or is punctuation."""
        word = self._reader.word(ahead)
        at = self._reader.at + ahead
        if not word or word in _STOPS or word in _IMPERATIVES or word in INDEFINITE | DEFINITE:
            return True
        named = at < len(self._tokens) and bool(asset_at(self._scene, Reader(self._tokens, at)))
        return named or word in KINDS or any(verb.plain for verb in find_verbs(word))

    def _takes_first(self) -> bool:
        """Read *first*: skip it before an order, or end a step after a clause that ends with it."""
        reader, start = self._reader, self._reader.at
        if self._at_clause and reader.take(*_WORDS["first_by"]):
            if reader.word().endswith("ing"):
                return True
            reader.at = start
        led = self._at_clause or reader.word(-1) in _FILLERS | {"to", "should", "must", "you"}
        if not reader.take(*_WORDS["first"]):
            return False
        if led and self._is_ordering(0):
            reader.take(",")
            return True
        over = reader.over or reader.word() in _STOPS or reader.word() in _JOINTS | {"then"}
        if not self._now or not over or self._reader.word(-2) in DEFINITE | {"at"}:
            reader.at = start
            return False
        self._ends_with_first()
        return True

    def _ends_with_first(self) -> None:
        """Make a clause that ends with *first* the earlier step.

        The later step is in the words that follow or, if none follow, in those before the clause.
        """
        reader = self._reader
        rest = [token.word for token in reader.tokens[reader.at :] if token.word not in _STOPS]
        if rest:
            self._end()
            reader.skip(_STOPS | _JOINTS)
            reader.take(*_WORDS["next"], *_WORDS["next_led"])
            return
        head, tail = self._parted()
        if head:
            self.parts.append(tail)
            self._now = head

    def _takes_next(self) -> bool:
        """Read *then*, which begins a step, or *afterwards*, which makes the last clause a step."""
        reader, start = self._reader, self._reader.at
        word, before = reader.word(), reader.word(-1)
        at_clause = self._at_clause
        led = at_clause and reader.take(*_WORDS["next_led"])
        if led and not self._is_ordering(0):
            reader.at, led = start, ""
        way = led or reader.take(*_WORDS["next"])
        if not way:
            return False
        if way == "then":
            again = reader.word() == "again" and reader.word(1) not in _WORDS["elided"]
            unready = before in (*_WORDS["no_then"], "?") or again
            if unready or (self._leads_to_consequence() and not self.parts):
                reader.at = start
                return False
        elif not at_clause and word not in _JOINTS:
            over = reader.over or reader.word() in _ENDS
            if way in _AFTERWARDS and over:
                return self._parts_last_clause()
            reader.at = start
            return False
        subject = [] if at_clause else self._subject()
        if any(self.asks(part) for part in (*self.parts, self._now)):
            self._end()
        self._now += subject
        reader.skip(_STOPS)
        return True

    def _subject(self) -> list[int]:
        """Move a name before *then* to the next step: *T02 then returns*."""
        if not self._now:
            return []
        *before, last = self._now
        named = asset_at(self._scene, Reader(self._tokens, last)) or _CALL_SIGN.fullmatch(
            self._tokens[last].word
        )
        begins = not before or self._tokens[before[-1]].word in _STOPS | _JOINTS
        if not named or not begins:
            return []
        self._now = before
        return [last]

    def _leads_to_consequence(self) -> bool:
        """Return whether this is the first *then* after an *if* in its sentence."""
        words = [self._tokens[at].word for at in self._now]
        ends = [at for at, word in enumerate(words) if word in _ENDS]
        sentence = words[ends[-1] + 1 :] if ends else words
        return any(word in _CONDITIONAL for word in sentence) and "then" not in sentence

    def _parts_last_clause(self) -> bool:
        """Make the last clause a step of its own: *and bring it home afterwards*."""
        head, tail = self._parted()
        if not head and not self.parts:
            return True
        if head:
            self.parts.append(head)
        self._now = tail
        return True

    def _parted(self) -> tuple[list[int], list[int]]:
        """Return the tokens of the current step without its last clause, and that clause."""
        for border in range(len(self._now) - 1, 0, -1):
            word = self._tokens[self._now[border]].word
            if word not in _STOPS and word not in _JOINTS:
                continue
            head, tail = self._now[:border], self._now[border + 1 :]
            if self.asks(tail) and self.asks(head):
                return head, tail
        return [], self._now

    # ------------------------------------------------------------------ awaited events

    def _takes_awaited(self) -> bool:
        """Read the event that a step waits for, before or after the step."""
        reader, start = self._reader, self._reader.at
        for ways, anywhere in ((_AWAIT, False), (_AWAIT_AT_END, True), (_WORDS["await_not"], True)):
            if not anywhere and not self._at_clause:
                continue
            if not (way := reader.take(*ways)):
                continue
            awaited = self._awaited()
            if awaited is None:
                reader.at = start
                continue
            reader.at = awaited.end
            if self._orders(way, awaited):
                return True
            reader.at = start
        return False

    def _orders(self, way: str, awaited: _Awaited) -> bool:
        """Split the steps at an awaited event; return False if it separates no steps."""
        reader = self._reader
        over = reader.over or reader.word() in _ENDS
        if way in _WORDS["await_not"]:
            if not over or not self._without_negation():
                return False
        elif not over:
            return self._begins_after(awaited)
        head, tail = self._parted()
        if not head and not self.parts:
            self._ask_about(awaited, self.words(tail))
            return True
        if head:
            self.parts.append(head)
        self._now = tail
        self._is_ordered(awaited, self.words(tail))
        return True

    def _begins_after(self, awaited: _Awaited) -> bool:
        """Begin the next step after *once it is there*."""
        reader = self._reader
        if not any(self.asks(part) for part in (*self.parts, self._now)):
            rest = self._text[reader.tokens[reader.at].start :]
            self._ask_about(awaited, self._unled(rest))
            return True
        if self.asks(self._now):
            self._end()
        reader.skip(_STOPS)
        reader.take("then")
        reader.take(*_WORDS["modals"])
        self._is_ordered(awaited, "...")
        return True

    def _unled(self, rest: str) -> str:
        tokens = read_tokens(rest)
        reader = Reader(tokens)
        reader.skip(_STOPS)
        reader.take("then")
        reader.take(*_WORDS["modals"])
        return rest[tokens[reader.at].start :].rstrip(" .!") if not reader.over else ""

    def _without_negation(self) -> bool:
        """Remove *must not* from the last clause; return False if it has none."""
        for at in range(len(self._now)):
            reader = Reader(self._tokens, self._now[at])
            if reader.take(*_WORDS["negated"]):
                removed = range(self._now[at], reader.at)
                self._now = [token for token in self._now if token not in removed]
                return True
        return False

    def _awaited(self) -> _Awaited | None:
        """Read *Robot_T01 is at the north gate*, *both are there*, *that is done*."""
        reader, first = self._reader, self._reader.at
        names, seen = list[str](), False
        while not reader.over:
            start = reader.at
            if name := asset_at(self._scene, reader):
                names.append(name)
            elif reader.word() in _PRONOUNS or reader.word() in KINDS or reader.word() in ASSETS:
                reader.at += 1
            elif (seen and reader.word() == "and") or reader.word() in DEFINITE:
                reader.at += 1
                continue
            else:
                reader.at = start
                break
            seen = True
        seen = seen or reader.word() in ("done", "finished")
        arrived, place = self._arrival() if seen else (False, "")
        if not arrived:
            reader.at = first
            return None
        words = self._text[reader.tokens[first].start : reader.tokens[reader.at - 1].end]
        return _Awaited(words, tuple(names), place, reader.at)

    def _arrival(self) -> tuple[bool, str]:
        """Read *is in place at the north gate*; return whether it is an arrival, and its place."""
        reader, arrived, place = self._reader, False, ""
        while not reader.over:
            if not place and (frame := place_at(self._scene, reader)):
                place, arrived = frame, True
            elif arrived and reader.word() == "it" and reader.word(1) in _STOPS:
                reader.at += 1
            elif arrived and (reader.word() in _IMPERATIVES or self._is_asset()):
                break
            elif reader.word() in _ARRIVAL:
                arrived = arrived or reader.word() in _ARRIVED
                reader.at += 1
            else:
                break
        return arrived, place

    def _is_asset(self) -> bool:
        return bool(asset_at(self._scene, Reader(self._tokens, self._reader.at)))

    def _is_ordered(self, awaited: _Awaited, body: str) -> None:
        """Ask about an awaited asset that no earlier step names."""
        before = {self._tokens[at].written.lower() for part in self.parts for at in part}
        if any(name.lower() not in before for name in awaited.names):
            self._ask_about(awaited, body)

    def _ask_about(self, awaited: _Awaited, body: str) -> None:
        subject = " and ".join(awaited.names) or "an asset"
        problem = f"“{awaited.words}”: no earlier part of the order sends {subject} there."
        choices: tuple[str, ...] = ()
        if awaited.names and awaited.place and body and body != "...":
            home = awaited.place == self._scene.world.base
            way = "home" if home else f"to {awaited.place}"
            choices = (f"First {subject} {way}, then {body}.",)
        self.unclear = Unclear("", f"{problem} What is to be done first?", choices)

    # ------------------------------------------------------------------ words of a step

    def asks(self, part: Sequence[int]) -> bool:
        """Return whether words ask for something: they name an asset or have a verb of orders."""
        words = self.words(part)
        step_words = {self._tokens[at].word for at in part}
        single = {word.removesuffix("s") for word in step_words}
        if single & {*KINDS, *ASSETS, *self._scene.assets_by_word} or step_words & EVERYBODY:
            return True
        lead = read_tokens(words)[:1]
        if lead and lead[0].word in _OWN_VERBS | _IMPERATIVES | {*_WORDS["elided"]}:
            return True
        is_pronoun = bool(lead) and lead[0].word in _PRONOUNS
        return any(verb.plain or verb.start == 0 or is_pronoun for verb in find_verbs(words))

    def words(self, part: Sequence[int]) -> str:
        """Return the text of the tokens, without punctuation and conjunctions around it."""
        kept = [*part]
        while kept and self._tokens[kept[0]].word in _FILLERS | _STOPS:
            kept.pop(0)
        while kept and self._tokens[kept[-1]].word in _FILLERS | _STOPS:
            kept.pop()
        runs = list[str]()
        for number, at in enumerate(kept):
            token = self._tokens[at]
            if number and kept[number - 1] == at - 1:
                gap = self._text[self._tokens[at - 1].end : token.start]
                runs.append(f"{gap}{self._text[token.start : token.end]}")
            else:
                runs.append((" " if number else "") + self._text[token.start : token.end])
        return "".join(runs).strip()

    def sentences(self, parts: Sequence[Sequence[int]]) -> Iterator[str]:
        """Yield each step as a sentence with a subject: *then home* becomes *send it home*."""
        before: Sequence[int] = ()
        for part in parts:
            words = self.words(part)
            if before:
                words = self._with_subject(words, part, before)
            yield f"{words[:1].upper()}{words[1:]}."
            before = part

    def _with_subject(self, words: str, part: Sequence[int], before: Sequence[int]) -> str:
        lead = self._tokens[next(at for at in part if self._tokens[at].word not in _FILLERS)].word
        names, kinds = self._subjects(before)
        step_words = {self._tokens[at].word for at in part}
        if step_words & {*self._scene.assets_by_word, *KINDS, "both"} or step_words & EVERYBODY:
            return words
        several = len(names) > 1
        if lead in _WORDS["elided"]:
            return f"Send {'them' if several else 'it'} {words}"
        able = len(kinds) == 1 and lead in _OWN_VERBS
        if able and any(verb.tasks for verb in find_verbs(lead)) and self._can(lead, kinds):
            return f"{' and '.join(names) if names else 'It'} {words}"
        return words

    def _subjects(self, part: Sequence[int]) -> tuple[tuple[str, ...], set[AssetKind]]:
        """Return the assets and kinds that a step names."""
        words = [self._tokens[at].word for at in part]
        assets = self._scene.assets_by_word
        names = tuple(dict.fromkeys(assets[word] for word in words if word in assets))
        kinds: set[AssetKind] = {self._scene.world.assets[name].kind for name in names}
        return names, kinds or {KINDS[word] for word in words if word in KINDS}

    def _can(self, lead: str, kinds: set[AssetKind]) -> bool:
        """Return whether assets of these kinds can carry out the verb `lead` themselves."""
        kind = next((kind for verb, kind in _KIND_OF.items() if lead.startswith(verb)), None)
        return kind is None or kind in kinds

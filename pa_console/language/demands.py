"""Demands and prohibitions in an order, clause by clause, and contradictions between them.

No plan can carry out an order that demands and forbids the same thing, or that sends one asset to
two places at once. Corrections, sequences, conditions and exclusions of other assets are not
contradictions. A clause with an unknown word is marked as not understood, because it may forbid
something else: *do not send it too close*. Names are found by entity linking.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations, dropwhile, pairwise
from typing import NamedTuple

from pa_console.language.lexicon import word_lists
from pa_console.language.mentions import KINDS
from pa_console.language.name_linking import LinkedText
from pa_console.language.references.reader import CONTACTS, WordToken, read_tokens
from pa_console.schema.world import AssetKind, World

GOING, STAYING = "go", "stay"
_FORMS = {
    form: act
    for act, verbs in word_lists("acts").items()
    for verb in verbs
    for form in (verb, f"{verb}s", f"{verb}es", f"{verb}ing", f"{verb.removesuffix('e')}ing")
}
"""Forms of the verbs that demand something, each mapped to its act."""
_WORDS = word_lists("demands")
_NOT = frozenset(_WORDS["not"])
_NOT_PHRASES = _WORDS["not_phrases"]
_PUT = _WORDS["put"]
"""Phrases for the present place of an asset."""
_TO = frozenset(_WORDS["to"])
_FROM = frozenset(_WORDS["from"])
"""Words before a place that is not a destination."""
_BESIDES = frozenset(_WORDS["besides"])
"""Words before an asset that is mentioned but not sent."""
_IT = frozenset(_WORDS["it"])
_MODAL = frozenset(_WORDS["modal"])
_NEUTRAL = frozenset(_WORDS["known"])
"""Words that do not change what a clause demands or forbids."""
_CONDITION = frozenset(_WORDS["condition"])
_LATER = frozenset(_WORDS["later"])
"""Words that put two demands at different times."""
_BACK = frozenset(_WORDS["back"])
"""Words for the return of an asset."""
_REPORTING = frozenset(_WORDS["told"])
_CORRECTING = frozenset(_WORDS["correcting"])
_STOPS = frozenset((".", "!", "?", ";", ":", "–", "—", "…"))
_JOINS = frozenset((",", "and", "but", "yet", "though"))
_FILLERS = frozenset(_WORDS["fillers"])
_ASSET_NAME = re.compile(r"[a-z]+_[a-z]?\d+")
_LEAVING = frozenset(_WORDS["leaving"])
_KEEPING = frozenset(("keep", "keeps", "keeping")) | _LEAVING
_RECALLING = frozenset(_WORDS["recalling"])
_NOBODY = re.compile(r" (?:nobody|no one) ")
_QUOTED = re.compile(r"\"[^\"]*\"|“[^”]*”|«[^»]*»|(?<!\w)'[^']{3,}'(?!\w)")

_ONLY_GOING = frozenset((GOING,))


@dataclass(frozen=True)
class Demand:
    """A clause that demands acts of assets or, if `negated`, forbids them.

    `words` are the operator's own words. `goals` are the destinations, and `split` is set if *and*
    joins them. If assets are to stay and there are no goals, they stay where they are; `put` is set
    if the words say so. `understood` is set if this module has every word in its lists. A `later`
    clause is for another time; a `conditional` one depends on a condition.
    """

    words: str
    acts: frozenset[str]
    negated: bool
    assets: tuple[str, ...]
    kinds: frozenset[AssetKind]
    goals: tuple[str, ...]
    split: bool
    put: bool
    understood: bool
    later: bool
    conditional: bool

    @property
    def stays(self) -> bool:
        """True if assets have to stay in place."""
        return STAYING in self.acts and not self.goals


class Demands(NamedTuple):
    """The demands and prohibitions in an order, and whether they come in a sequence."""

    clauses: tuple[Demand, ...] = ()
    in_turn: bool = False


def demands_of(world: World, text: str) -> Demands:
    """Return the demands of an order; an order that corrects itself has none."""
    blank = _QUOTED.sub(lambda quoted: " " * len(quoted[0]), text).replace("\n", ";")
    linked = LinkedText.of(world, blank)
    tokens = read_tokens(linked.text)
    words = [token.word for token in tokens]
    corrects = any(
        word == "no" and after in {",", ".", "!", ";", "i", "that", "it"}
        for word, after in pairwise(words)
    )
    if corrects or _CORRECTING & {*words}:
        return Demands()
    clauses = _Reading(world, linked, text, tokens).demands()
    return Demands(tuple(clauses), bool((_LATER | _BACK) & {*words}))


@dataclass
class _DemandClause:
    """The tokens of a clause, and whether it is a question or depends on a condition."""

    tokens: list[WordToken] = field(default_factory=list[WordToken])
    question: bool = False
    conditional: bool = False
    joined: bool = False
    """True if it continues the sentence of the clause before it."""


class _Reading:
    """The clauses of one order, read from left to right."""

    def __init__(
        self, world: World, linked: LinkedText, typed: str, tokens: Sequence[WordToken]
    ) -> None:
        self._linked, self._typed, self._tokens = linked, typed, tokens
        self._assets = {name.lower(): name for name in world.assets}
        self._places = {name.lower(): name for name in world.frames}
        self._places |= dict.fromkeys(("home", "base"), world.base)

    def demands(self) -> Iterator[Demand]:
        """Yield the demand or prohibition of each clause that has one."""
        before: Demand | None = None
        for clause in self._clauses():
            if not clause.tokens:
                continue
            demand = self._demand(clause, before)
            if demand is not None:
                yield demand
            before = demand

    def _clauses(self) -> Iterator[_DemandClause]:
        sentence: list[_DemandClause] = [_DemandClause()]
        for at, token in enumerate(self._tokens):
            if token.word in _STOPS:
                yield from self._sentence(sentence, question=token.word == "?")
                sentence = [_DemandClause()]
            elif token.word in _JOINS and self._is_whole(sentence[-1]) and self._begins(at + 1):
                sentence.append(_DemandClause(joined=True))
            else:
                sentence[-1].tokens.append(token)
        yield from self._sentence(sentence, question=False)

    def _sentence(
        self, clauses: Sequence[_DemandClause], *, question: bool
    ) -> Iterator[_DemandClause]:
        """Yield the clauses of a sentence; a condition in it may apply to all of them."""
        conditional = any(token.word in _CONDITION for part in clauses for token in part.tokens)
        for clause in clauses:
            clause.question, clause.conditional = question, conditional
            yield clause

    def _is_whole(self, clause: _DemandClause) -> bool:
        """Return whether a clause is complete, so that the next words cannot continue its list."""
        words = [token.word for token in clause.tokens]
        acts = {_FORMS[word] for word in words if word in _FORMS}
        ends = words[-1:] == ["anywhere"] or (len(words) > 1 and words[-1] in _FORMS)
        return ends or not self._places.keys().isdisjoint(words) or bool(acts & {STAYING, "report"})

    def _begins(self, at: int) -> bool:
        """Return whether a new clause begins at token `at`."""
        while self._word(at) in _JOINS or self._word(at) in _FILLERS:
            at += 1
        word, after = self._word(at), self._word(at + 1)
        if word in _FORMS or word in _NOT or word in _MODAL or word in ("under", "on", "no"):
            return True
        if not (self._is_asset(word) or word in _IT or word.removesuffix("s") in KINDS):
            return False
        goes_on = after in _FORMS or after in _NOT or after in _MODAL or after in _TO
        return goes_on or after in self._places

    def _word(self, at: int) -> str:
        return self._tokens[at].word if 0 <= at < len(self._tokens) else ""

    def _demand(self, clause: _DemandClause, before: Demand | None) -> Demand | None:
        """Return the demand of a clause; None if it is a report, a question or unclear."""
        tokens = list(dropwhile(lambda token: token.word in _JOINS, clause.tokens))
        words = [token.word for token in tokens]
        text = f" {' '.join(words)} "
        if clause.question or _REPORTING & {*words}:
            return None
        verbs = [at for at, word in enumerate(words) if word in _FORMS]
        negators = [
            at for at, word in enumerate(words) if word in _NOT or self._rules_out(words, at)
        ]
        if negators and verbs and negators[0] > verbs[0] and words[negators[0]] != "no":
            return None
        put = any(f" {phrase} " in text.replace(" in place of ", " ") for phrase in _PUT)
        acts, goals = self._acts(words, put=put), self._goals(words)
        assets = () if _NOBODY.match(text) else self._subject(words, acts)
        if not acts and before is not None and clause.joined and words[0] in _NOT:
            acts, assets = before.acts, assets or before.assets
        elif not acts and assets and self._has_place(words):
            acts = frozenset((GOING,))
        if not acts:
            return None
        if before is not None and not assets and self._is_about_the_same(words, clause):
            assets = before.assets
        if before is not None and not goals and "there" in words:
            goals = before.goals
        for phrase in _PUT:
            text = text.replace(f" {phrase} ", " ")
        negated = bool(negators) or any(f" {phrase} " in text for phrase in _NOT_PHRASES)
        if self._leaves_a_place(words):
            acts, negated, put = frozenset((STAYING,)), not negated, not goals
        return Demand(
            words=self._words(tokens),
            acts=acts,
            negated=negated,
            assets=assets,
            kinds=frozenset(
                KINDS[kind] for word in words if (kind := word.removesuffix("s")) in KINDS
            ),
            goals=goals,
            split=self._is_split(words),
            put=put,
            understood=all(map(self._is_known, text.split())),
            later=bool(_LATER & {*words}),
            conditional=clause.conditional,
        )

    def _rules_out(self, words: Sequence[str], at: int) -> bool:
        """Return whether the word at `at` rules out all assets of a kind: *no drone goes there*."""
        kind = words[at + 1].removesuffix("s") if at + 1 < len(words) else ""
        return words[at] == "no" and (kind in KINDS or kind in ("asset", "one"))

    def _acts(self, words: Sequence[str], *, put: bool) -> frozenset[str]:
        """Return the acts that the verbs ask for; *keep* and *leave* count only with a place."""
        placed = put or "there" in words or any(word in self._places for word in words)
        placed = placed or self._leaves_a_place(words)
        verbs = (word for word in words if word in _FORMS and (placed or word not in _KEEPING))
        return frozenset(_FORMS[word] for word in verbs)

    def _leaves_a_place(self, words: Sequence[str]) -> bool:
        """Return whether the clause is about leaving a place: *never leave EastGate*."""
        after = list(dropwhile(lambda word: word not in _LEAVING, words))[1:]
        left = next(dropwhile(lambda word: word in {"the", "its", "their", "his"}, after), "")
        return left in self._places or left in {"post", "posts", "gate", "position"}

    def _subject(self, words: Sequence[str], acts: frozenset[str]) -> tuple[str, ...]:
        """Return the first asset, or list of assets, that the clause names.

        *Watch the gate with X* demands something of X; *send Y with X* does not.
        """
        besides = _BESIDES if GOING in acts else _BESIDES - {"with"}
        assets: list[str] = []
        for at, word in enumerate(words):
            if self._is_asset(word) and not (at and words[at - 1] in besides):
                assets.append(self._assets.get(word, word))
            elif assets and word not in {",", "and", "&"}:
                break
        return tuple(assets)

    def _goals(self, words: Sequence[str]) -> tuple[str, ...]:
        """Return the destinations: every place, except after a word such as *from*.

        If assets are recalled and no place is named, the base is their destination.
        """
        goals: list[str] = []
        for at, word in enumerate(words):
            if word not in self._places:
                continue
            before = next((w for w in reversed(words[:at]) if w not in {"the", "our", ","}), "")
            if before not in _FROM and (before != "and" or goals):
                goals.append(self._places[word])
        if not goals and not {*words}.isdisjoint(_RECALLING):
            goals.append(self._places["home"])
        return tuple(dict.fromkeys(goals))

    def _is_split(self, words: Sequence[str]) -> bool:
        """Return whether only *and*, *to*, *the* and similar words separate the places."""
        places = [at for at, word in enumerate(words) if word in self._places]
        if len(places) < 2:
            return False
        between = {*words[places[0] + 1 : places[-1]]} - {words[at] for at in places}
        return "and" in between and between <= {"and", ",", "to", "the", "towards", "both"}

    def _has_place(self, words: Sequence[str]) -> bool:
        """Return whether a place directly follows the assets: *Drone_T01 to NorthGate*."""
        after = dropwhile(lambda word: not self._is_asset(word), words)
        rest = next(dropwhile(lambda word: self._is_asset(word) or word in _JOINS, after), "")
        return rest in _TO or rest in self._places

    def _is_asset(self, word: str) -> bool:
        """Return whether a word is an asset's name, or looks like the name of an unknown asset."""
        return word in self._assets or _ASSET_NAME.fullmatch(word) is not None

    def _is_about_the_same(self, words: Sequence[str], clause: _DemandClause) -> bool:
        """Return whether a clause without an asset is about the assets of the clause before it."""
        return bool(_IT & {*words}) or (clause.joined and words[0] in _MODAL | _NOT)

    def _is_known(self, word: str) -> bool:
        plain = word.removesuffix("s")
        named = self._is_asset(word) or word in self._places or plain in KINDS or plain in CONTACTS
        return named or word in _NEUTRAL or word in _FORMS or word in _NOT or word in _IT

    def _words(self, tokens: Sequence[WordToken]) -> str:
        """Return the operator's own words for `tokens`."""
        typed = self._linked._replace(original=self._typed)
        return typed.original_words(tokens[0].start, tokens[-1].end).strip()


class Contradiction(NamedTuple):
    """Two parts of an order that contradict each other, and the question to the operator."""

    first: str
    second: str
    question: str


def contradiction(world: World, text: str) -> Contradiction | None:
    """Return the first two parts of an order that contradict each other; None if none do."""
    order = demands_of(world, text)
    clauses = [clause for clause in order.clauses if not (clause.conditional or clause.later)]
    for first, second in combinations(clauses, 2):
        excluded = (
            _forbidden(world, first, second)
            if first.negated != second.negated
            else not order.in_turn and _apart(first, second)
        )
        if excluded:
            question = (
                f"“{first.words}” and “{second.words}” contradict each other. What is to be done?"
            )
            return Contradiction(first.words, second.words, question)
    for clause in clauses:
        if not order.in_turn and _is_split(clause):
            here, there = clause.goals
            sends = f"“{clause.words}” sends {clause.assets[0]} to {here} and {there} at once."
            question = f"{sends} Where is it to go?"
            return Contradiction(here, there, question)
    return None


def _forbidden(world: World, first: Demand, second: Demand) -> bool:
    """Return whether one of two demands forbids what the other demands."""
    ban, demand = (first, second) if first.negated else (second, first)
    if not ban.understood or not _are_meant(world, ban, demand):
        return False
    acts = ban.acts - {GOING} or ban.acts
    if acts == _ONLY_GOING:
        moves = bool(demand.goals) and STAYING not in demand.acts
        if not ban.goals:
            return moves and GOING in demand.acts and bool(ban.assets or ban.kinds)
        return moves and not {*ban.goals}.isdisjoint(demand.goals)
    if STAYING in acts and not (ban.assets and (ban.put or ban.goals)):
        return False
    if not acts <= demand.acts:
        return False
    return not ban.goals or not {*ban.goals}.isdisjoint(demand.goals)


def _are_meant(world: World, ban: Demand, demand: Demand) -> bool:
    """Return whether a ban applies to assets of a demand: by name, by kind, or to all assets."""
    if ban.assets:
        return not {*ban.assets}.isdisjoint(demand.assets)
    if ban.kinds:
        kinds = demand.kinds | {world.assets[name].kind for name in demand.assets}
        return bool(kinds) and kinds <= ban.kinds
    return True


def _apart(first: Demand, second: Demand) -> bool:
    """Return whether two demands send one asset to two places, or move it and keep it in place.

    *Move it there and hold* is a sequence, because only staying in the present place excludes
    moving.
    """
    if first.negated or {*first.assets}.isdisjoint(second.assets):
        return False
    if first.stays != second.stays:
        stay, move = (first, second) if first.stays else (second, first)
        return (
            GOING in move.acts
            and bool(move.goals)
            and stay.understood
            and (stay.put or stay is first)
        )
    placed = first.understood and second.understood and len(first.goals) == len(second.goals) == 1
    return placed and first.goals != second.goals and "report" not in first.acts | second.acts


def _is_split(demand: Demand) -> bool:
    """Return whether a single asset is sent to two places."""
    alone = len(demand.assets) == 1 and len(demand.goals) == 2
    return alone and demand.split and not demand.negated and demand.acts == _ONLY_GOING

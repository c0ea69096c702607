"""Orders that refer to earlier orders: *bring it back*, *same for north*, *undo that*, *no, west*.

Each is rewritten as a complete order, from the last missions and the earlier positions of the
assets. If two readings fit, the operator is asked which one is meant.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from pa_console.language.canonical.reading import listed
from pa_console.language.lexicon import find_verbs, word_lists
from pa_console.language.name_linking import WORD
from pa_console.language.references.reader import (
    CONTACTS,
    COPULA,
    INDEFINITE,
    Reader,
    WordToken,
    asset_at,
    number_of,
    place_at,
    read_tokens,
)
from pa_console.language.references.scene import Move, PastMission, ReferenceScene
from pa_console.schema.command import ENCOUNTERS, STILL

_WORDS = word_lists("conversation")
_CORRECTING = frozenset(_WORDS["correcting"])
_CORRECTING_PHRASES = _WORDS["correcting_phrases"]
_UNDOING = _WORDS["undoing"]
_SAME = frozenset(_WORDS["same"])
_MORE = _WORDS["more"]
_THERE = _WORDS["there"]
_IT = _WORDS["it"]
_THEM = _WORDS["them"]
_THEY = _WORDS["they"]
LEANING = frozenset((*_IT, *_THEM, *_THEY, *_THERE, *_SAME))
"""The words that refer to an earlier order."""
_HER = frozenset(_WORDS["her"])
"""Words after which *her* is not a possessive."""
_SOMEBODY = frozenset((*CONTACTS, *_WORDS["somebody"]))
_ENCOUNTER = frozenset(_WORDS["encounter"])
"""Verbs whose object is a contact, never an asset."""
_SAME_ELSEWHERE = _WORDS["same_elsewhere"]
_ONWARDS = _WORDS["onwards"]
_AND_THEN = frozenset(_WORDS["and_then"])
_DONE = frozenset(_WORDS["done"])
_STEADY = frozenset(_WORDS["steady"])
"""Words that may stand beside places, *next* and *done* in an order to continue."""
_EXISTENTIAL = frozenset(_WORDS["existential"])
_WELL = frozenset(_WORDS["well"])
"""Words that ask about the condition of an asset."""
_HOME = frozenset(_WORDS["home"])
_SHORT = 11
"""Words; a longer order is taken as complete."""
_WEATHER = frozenset(_WORDS["weather"])
"""Verbs and nouns that go with an *it* that is not an asset."""
_OWN_TASKS = frozenset(("report", "identify", "warn", "block", "look", "hold", "relieve", "swap"))
_PUTTING = frozenset(("go", "mass", "cover", "home"))

_MAKE_IT = ("make it", "make that")
_MOST_CORRECTING = 16
"""Words; a longer correction is an order of its own."""
_BEGINNING = (*_CORRECTING_PHRASES, "i meant", "i mean", "not that", "not the", "rather the")

_STILL_LEANING = frozenset(_WORDS["still_leaning"])


@dataclass(frozen=True)
class ResolvedReference:
    """Words of a text, with their range of characters and their meaning.

    `becomes` is the replacement if it differs from the names in `means`.
    """

    start: int
    end: int
    words: str
    means: str
    becomes: str = ""

    @property
    def written(self) -> str:
        """The replacement in the order."""
        return self.becomes or self.means


@dataclass(frozen=True)
class Unclear:
    """Words that fit several things or none, with the question to ask and the possible answers."""

    words: str
    question: str
    choices: tuple[str, ...] = ()
    describes: bool = False
    """True if the words describe an asset or point at one, so that a model may know which."""


def substituted(text: str, references: Sequence[ResolvedReference]) -> str:
    """Return `text` with every reference in `references` replaced; references do not overlap."""
    parts, done = list[str](), 0
    for reference in sorted(references, key=lambda item: item.start):
        parts += [text[done : reference.start], reference.written]
        done = reference.end
    return "".join((*parts, text[done:]))


@dataclass(frozen=True)
class _NameInOrder:
    """A name in an order, its range of tokens, and whether it is excluded: *not the hub*."""

    name: str
    at: int
    end: int
    ruled_out: bool


@dataclass(frozen=True)
class ResolvedOrder:
    """An order after resolution: its `text`, and the references that were replaced (`meanings`).

    It may take back the last order (`undoes`) or replace it (`corrects`).
    """

    text: str
    meanings: tuple[tuple[str, str], ...] = ()
    undoes: bool = False
    corrects: bool = False


def corrects(text: str) -> Literal["replaces", "takes back", ""]:
    """Return whether a text corrects the previous order or takes it back; '' for any other text.

    *No, the other gate* does the first, *never mind* the second; both say so at once.
    """
    words = [token.word for token in read_tokens(text) if token.word[0].isalnum()]
    sentence = f" {' '.join(words)} "
    if len(words) > _MOST_CORRECTING or not words:
        return ""
    undone = next((phrase for phrase in _UNDOING if sentence.startswith(f" {phrase} ")), "")
    if undone and len(words) <= len(undone.split()) + 1:
        return "takes back"
    begins = words[0] in _CORRECTING - {"change", "rather", "mean", "not"}
    begins = begins or any(
        sentence.startswith(f" {phrase} ") for phrase in (*_BEGINNING, *_UNDOING)
    )
    return "replaces" if begins else ""


def leaning_words(scene: ReferenceScene, text: str) -> tuple[str, ...]:
    """Return the words of a resolved order that still refer to the previous one.

    Their meaning was not found, so a model that sees only this order has to guess.
    """
    if scene.last is None:
        return ()
    return tuple(dict.fromkeys(t.written for t in read_tokens(text) if t.word in _STILL_LEANING))


def retell(scene: ReferenceScene, text: str) -> ResolvedOrder | Unclear | None:
    """Return an order that refers to earlier ones as a complete order; None for any other."""
    if not (scene.last is not None or scene.pointer or scene.asked_about) or not text.strip():
        return None
    return _Turn(scene, text).retold()


def _team_of(name: str) -> str:
    """Return the team in an asset's name: `firefly` of Firefly_T02."""
    return next((word.lower() for word in WORD.findall(name) if len(word) > 1), "")


class _Turn:
    """An order that follows others, or that is given while something is marked on the screen."""

    def __init__(self, scene: ReferenceScene, text: str) -> None:
        self._scene, self._text, self._tokens = scene, text, read_tokens(text)
        self._last = scene.last or PastMission("", ())
        self._moves = [move for move in self._last.moves if move.verb not in STILL]
        self._movers = list(dict.fromkeys(move.agent for move in self._moves))
        self._words = [token.word for token in self._tokens]
        self._low = f" {' '.join(word for word in self._words if word[0].isalnum())} "
        self._assets, self._places = self._names()

    def retold(self) -> ResolvedOrder | Unclear | None:
        for way in (
            self._undone,
            self._continued,
            self._place_corrected,
            self._agent_corrected,
            self._same,
            self._joined,
            self._brought_back,
        ):
            order = way() if self._moves else None
            if order is not None:
                return order
        return self._asked_too() or self._pronouns()

    # ---------------------------------------------------------------- names and words

    def _names(self) -> tuple[list[_NameInOrder], list[_NameInOrder]]:
        assets, places = list[_NameInOrder](), list[_NameInOrder]()
        at = 0
        while at < len(self._tokens):
            reader = Reader(self._tokens, at)
            if name := asset_at(self._scene, reader):
                assets.append(_NameInOrder(name, at, reader.at, self._ruled_out(at)))
                standing = Reader(self._tokens, reader.at)
                if standing.take("at") and place_at(self._scene, standing) == self._at(name):
                    reader.at = standing.at
            elif (name := place_at(self._scene, reader)) and self._words[at] != "home":
                places.append(_NameInOrder(name, at, reader.at, self._ruled_out(at)))
            at = max(reader.at, at + 1)
        return assets, places

    def _at(self, name: str) -> str:
        return self._scene.place_of(name) or "nowhere"

    def _ruled_out(self, at: int) -> bool:
        before = [w for w in self._words[max(at - 3, 0) : at] if w not in ("the", "to", "at")]
        return bool(before) and (before[-1] == "not" or before[-2:] in (["instead", "of"],))

    def _has(self, *phrases: str) -> str:
        return next((phrase for phrase in phrases if f" {phrase} " in self._low), "")

    @property
    def _named_assets(self) -> list[str]:
        return [asset.name for asset in self._assets if not asset.ruled_out]

    @property
    def _named_places(self) -> list[str]:
        return [place.name for place in self._places if not place.ruled_out]

    @property
    def _corrects(self) -> bool:
        return bool(_CORRECTING & set(self._words)) or bool(self._has(*_CORRECTING_PHRASES))

    @property
    def _short(self) -> bool:
        return len([word for word in self._words if word[0].isalnum()]) <= _SHORT

    @property
    def _does(self) -> bool:
        """Return whether the words ask for a task other than going to a place."""
        verbs = find_verbs(self._text.lower().replace("hold on", ""))
        return any(v.plain and v.tasks & _OWN_TASKS and not v.means & _PUTTING for v in verbs)

    @property
    def _asks(self) -> bool:
        """Return whether the words ask for an action; in small talk, *it* is not an asset."""
        words = set(self._words)
        if self._places or words & (_HOME | {"back"}) or ("?" in words and words & _WELL):
            return True
        if self._has(*_THERE) and (self._named_assets or any(map(self._scene.members, words))):
            return True
        return any(verb.plain for verb in find_verbs(self._text))

    @property
    def _there(self) -> str:
        """The destination of the last mission; '' for several places."""
        return self._theres[0] if len(self._theres) == 1 else ""

    @property
    def _theres(self) -> list[str]:
        """Every place that *there* may mean: the last destinations and the marked place."""
        marked = [self._scene.pointer] if self._scene.pointer in self._scene.world.frames else []
        return list(dict.fromkeys((*marked, *map(self._target, self._moves))))

    def _target(self, move: Move) -> str:
        return self._scene.world.base if move.verb == "return_to_base" else move.target

    # ---------------------------------------------------------------- whole orders

    def _asked_too(self) -> ResolvedOrder | None:
        """Resolve *And Ugv_T02?* after a question about another asset."""
        rest = [word for at, word in enumerate(self._words) if not self._is_named(at)]
        if not (self._scene.asked_about and self._named_assets and rest[-1:] == ["?"]):
            return None
        if {*rest} - _AND_THEN:
            return None
        return self._whole(_sentence([f"{name} reports" for name in self._named_assets]))

    def _is_named(self, at: int) -> bool:
        return any(asset.at <= at < asset.end for asset in self._assets)

    def _whole(self, order: str, *, undoes: bool = False, corrects: bool = False) -> ResolvedOrder:
        return ResolvedOrder(order, ((self._text.strip(), order),), undoes, corrects)

    def _order(self, agent: str, move: Move, place: str = "") -> str:
        """Return the words of an order that `agent` repeats `move`, at `place` if given."""
        target = place or self._target(move)
        if target == self._scene.world.base:
            return f"{agent} home"
        if move.verb in ENCOUNTERS and not place:
            return f"{agent} {move.verb} {target}"
        return f"{agent} to {target}"

    def _returns(self, agents: Sequence[str]) -> list[str]:
        """Return the orders that bring `agents` back to their places before the last mission."""
        orders: list[str] = []
        for agent in agents:
            before = next((m.before for m in reversed(self._scene.moved) if m.agent == agent), "")
            if before and self._scene.place_of(agent) != before:
                orders.append(
                    f"{agent} home" if before == self._scene.world.base else f"{agent} to {before}"
                )
        return orders

    def _undone(self) -> ResolvedOrder | None:
        if not self._has(*_UNDOING) or self._named_assets or self._named_places:
            return None
        orders = self._returns(self._movers)
        return self._whole(_sentence(orders), undoes=True) if orders else None

    def _place_corrected(self) -> ResolvedOrder | None:
        """Resolve *No, the south gate.*: the same for another place."""
        places = self._named_places
        if len(places) != 1 or self._named_assets or not self._corrects or self._does:
            return None
        if len(self._words) > _MOST_CORRECTING or (
            self._has(*_IT, *_THEY) and not self._has(*_MAKE_IT)
        ):
            return None
        orders = [self._order(move.agent, move, places[0]) for move in self._moves]
        return self._whole(_sentence(orders), corrects=True)

    def _agent_corrected(self) -> ResolvedOrder | None:
        """Resolve *Not Drone_T04, Robot_T02.*: the same by another one, and the first one back."""
        others = [name for name in self._named_assets if name not in self._movers]
        others = others or self._meant_instead()
        there = self._has(*_THERE)
        if not others or not self._corrects or self._does or (self._named_places and not there):
            return None
        if self._named_places or self._has("report", "home"):
            return None
        ruled_out = [asset.name for asset in self._assets if asset.ruled_out]
        replaced = [name for name in self._movers if name in ruled_out] or self._movers
        move = next(move for move in self._moves if move.agent in replaced)
        orders = [self._order(other, move) for other in others]
        return self._whole(_sentence([*orders, *self._returns(replaced)]), corrects=True)

    def _meant_instead(self) -> list[str]:
        """Return the assets meant by a number or a kind: *make that four*, *I meant the robot*."""
        if self._named_assets or self._named_places or not self._corrects or not self._short:
            return []
        names, kinds = self._scene.names, list[frozenset[str]]()
        for at, word in enumerate(self._words):
            number = number_of(word)
            if number > 0 and len(self._movers) == 1 and self._has(*_MAKE_IT):
                team = names.team(_team_of(self._movers[0]))
                asset = names.asset(team, number) if team else None
                return [asset] if asset is not None and asset not in self._movers else []
            if (team := self._scene.members(word)) and not self._ruled_out(at):
                kinds.append(team)
        if len(kinds) != 1:
            return []
        other = self._nearest_free(self._scene.in_order(kinds[0]), self._there or "")
        return [other] if other else []

    def _same(self) -> ResolvedOrder | None:
        """Resolve *same for Robot_T02* and *same for north*."""
        elsewhere = self._has(*_SAME_ELSEWHERE)
        same = bool(_SAME & set(self._words)) or bool(self._has("as well")) or bool(elsewhere)
        after = [self._words[at + 1] for at, word in enumerate(self._words[:-1]) if word == "same"]
        if any(map(self._scene.members, after)):
            return None
        if not same or not self._short or self._does or self._has(*_THERE):
            return None
        assets, places = self._named_assets, self._named_places
        if assets and not places and not self._own_verb():
            return self._whole(_sentence([self._order(name, self._moves[0]) for name in assets]))
        if len(places) == 1 and elsewhere and assets and not self._own_verb():
            orders = [self._order(name, self._moves[0], places[0]) for name in assets]
            return self._whole(_sentence(orders))
        if len(places) == 1 and elsewhere and not assets:
            return self._same_elsewhere(places[0])
        return None

    def _continued(self) -> ResolvedOrder | Unclear | None:
        """Resolve *done there, south next* and *on to west*: who was sent last goes on.

        Every word has to be a place or one of these, and a place that is only said to be done is
        no destination.
        """
        if self._assets or not (self._has(*_ONWARDS) or _DONE & set(self._words)):
            return None
        goals = list[str]()
        for clause in self._clauses():
            reader, places = Reader(clause), list[str]()
            done = bool(_DONE & {token.word for token in clause})
            while not reader.over:
                at = reader.at
                connective = reader.take(*_ONWARDS) or reader.take_in(_DONE | _STEADY | COPULA)
                if connective:
                    continue
                place = place_at(self._scene, reader)
                if not place:
                    return None
                after = Reader(clause, at).word(-1) in ("now", "next", "then")
                if not done or after:
                    places.append(place)
            if not COPULA & {token.word for token in clause}:
                goals += places
        if len(dict.fromkeys(goals)) != 1:
            return None
        orders = [self._order(name, self._moves[0], goals[0]) for name in self._movers]
        if len({self._target(move) for move in self._moves}) == 1:
            return self._whole(_sentence(orders))
        return Unclear(self._text.strip(), f"Who goes on to {goals[0]}?", tuple(orders))

    def _clauses(self) -> list[list[WordToken]]:
        """Return the words of the order between stops."""
        clauses: list[list[WordToken]] = [[]]
        for token in self._tokens:
            if token.word[0].isalnum() or token.word.startswith("'"):
                clauses[-1].append(token)
            else:
                clauses.append([])
        return clauses

    def _own_verb(self) -> bool:
        verbs = find_verbs(self._text)
        return any(v.plain and v.word not in ("go", "goes", "do") for v in verbs)

    def _same_elsewhere(self, place: str) -> ResolvedOrder | None:
        """Return the last order for another `place`; who was named stays, another one goes."""
        move = self._moves[0]
        named = any(name in self._last.text for name in self._movers)
        if not named and self._there and self._there in self._last.text:
            return self._whole(self._last.text.replace(self._there, place))
        team = [n for n, spec in self._scene.world.assets.items() if spec.kind == self._kind(move)]
        other = self._nearest_free(team, place)
        return self._whole(_sentence([self._order(other, move, place)])) if other else None

    def _kind(self, move: Move) -> str:
        return self._scene.world.assets[move.agent].kind

    def _nearest_free(self, team: Sequence[str], place: str) -> str:
        """Return who of `team` is free and nearest to `place`, of those not yet sent; '' for none.

        Any of them is as good as another.
        """
        scene = self._scene
        free = [
            name
            for name in team
            if name not in self._movers and scene.is_free(name) and scene.place_of(name) != place
        ]
        return min(free, key=lambda name: scene.distance_m(name, place), default="")

    def _joined(self) -> ResolvedOrder | Unclear | None:
        """Resolve *another one there*, *Robot_T01 there too*, *give it company, Robot_T01*."""
        if self._does or self._has("home", "report", "instead of"):
            return None
        there = self._has(*_THERE)
        place = (self._named_places or [self._there])[0]
        if not place:
            return None
        assets = self._named_assets
        company = self._has("join", "joins", "company") and self._has(*_IT, *_THEY)
        if (there or company) and assets and not self._named_places and self._short:
            if "where" in self._words or (self._has(*_IT) and not company):
                return None
            return self._whole(_sentence([f"{name} to {place}" for name in assets]))
        more = self._has(*_MORE)
        if not more or assets or not (there or self._named_places or self._counts(more)):
            return None
        teams = [self._scene.members(word) for word in self._words if word not in ("one", "it")]
        team = next(filter(None, teams), frozenset[str]())
        if not team:
            kinds = {self._kind(move) for move in self._moves}
            team = frozenset(n for n, s in self._scene.world.assets.items() if s.kind in kinds)
        other = self._nearest_free(sorted(team), place)
        if other:
            return self._whole(_sentence([f"{other} to {place}"]))
        every = self._scene.world.assets
        free = [n for n in every if self._scene.is_free(n) and n not in self._movers]
        return Unclear(more, "None of that kind is free. Who is to go?", tuple(free))

    def _counts(self, more: str) -> bool:
        """True if `more` counts assets: *another robot*, *one more*; not *the second floor*."""
        after = self._low.partition(f" {more} ")[2].split()
        after = after[1:] if after[:1] and after[0] in INDEFINITE | {"the"} else after
        return not after or after[0] == "one" or bool(self._scene.members(after[0]))

    def _brought_back(self) -> ResolvedOrder | Unclear | None:
        """Resolve *Bring it back.*: to where it was before."""
        back = "back" in self._words or self._has("where it came from", "where they came from")
        if (
            not back
            or self._named_places
            or self._does
            or _HOME & set(self._words)
            or not self._short
        ):
            return None
        agents = [
            name for name in self._named_assets if name in {m.agent for m in self._scene.moved}
        ]
        if not agents:
            if not self._has(*_IT, *_THEM, *_THEY):
                return None
            referents = self._last_assets() if self._has(*_THEM, *_THEY) else self._last_asset()
            if isinstance(referents, Unclear):
                return referents
            agents = referents
        orders = self._returns(agents)
        return self._whole(_sentence(orders)) if orders else None

    # ---------------------------------------------------------------- pronouns

    def _last_asset(self) -> list[str] | Unclear:
        """Return the asset that was moved last, or a question if there are several."""
        pointer, reported = self._scene.pointer, self._scene.asked_about
        marked = [pointer] if pointer in self._scene.world.assets else []
        if marked and self._has("that one", "this one"):
            return marked
        candidates = list(dict.fromkeys((*marked, *([reported] if reported else self._movers))))
        if len(candidates) < 2:
            return candidates
        match = re.search(rf"\b(?:{'|'.join(_IT)})\b", self._text, re.IGNORECASE)
        pronoun = match[0] if match is not None else "it"
        return Unclear(pronoun, f"Who is meant by “{pronoun}”?", tuple(candidates), describes=True)

    def _last_assets(self) -> list[str]:
        """Return the assets of the last mission; if it moved one, also the one moved before."""
        if len(self._movers) > 1:
            return self._movers
        every = list(dict.fromkeys(move.agent for move in reversed(self._scene.moved)))
        return list(reversed(every[:2]))

    def _pronouns(self) -> ResolvedOrder | Unclear | None:
        """Replace *it*, *them* and *there*, unless they refer to words of the same order."""
        references: list[ResolvedReference] = []
        at = 0
        while at < len(self._tokens):
            result = self._pronoun(at, within=bool(references))
            if isinstance(result, Unclear):
                return result if self._asks else None
            if result is None:
                at += 1
                continue
            reference, at = result
            references.append(reference)
        if not references or not self._asks:
            return None
        pairs = tuple(
            (reference.words, reference.means) for reference in references if reference.means
        )
        return ResolvedOrder(substituted(self._text, references), pairs)

    def _pronoun(self, at: int, *, within: bool) -> tuple[ResolvedReference, int] | Unclear | None:
        """Read a pronoun; a second one `within` the order refers to the same asset."""
        reader = Reader(self._tokens, at)
        named = [mention for mention in self._assets if mention.at < at and not mention.ruled_out]
        placed = [mention for mention in self._places if mention.at < at and not mention.ruled_out]
        if reader.take("where it was", "where it came from", "where it stood", "its old gate"):
            before = [
                self._scene.place_of(move.agent) if within else move.before for move in self._moves
            ]
            place = before[-1] if before else ""
            return self._replaced(at, reader.at, place, to=True) if place else None
        if self._is_existential(at):
            return None
        if reader.take(*_THERE):
            return None if placed else self._there_named(at, reader.at)
        return None if named or self._is_contact(at) else self._asset_pronoun(at, within=within)

    def _asset_pronoun(
        self, at: int, *, within: bool
    ) -> tuple[ResolvedReference, int] | Unclear | None:
        """Read *it*, *he* or *they*; *both* after another pronoun adds nothing."""
        reader = Reader(self._tokens, at)
        if within and reader.take("both"):
            both = self._tokens[at]
            return ResolvedReference(both.start, both.end, both.written, ""), reader.at
        if reader.take(*_THEM, *_THEY) and reader.word() not in ("of", "robots", "drones"):
            they = self._last_assets()
            return self._replaced(at, reader.at, listed(they)) if they else None
        reader.at = at
        if reader.take(*_IT) and not (_WEATHER & {reader.word(), reader.word(1), reader.word(2)}):
            assets = self._last_asset()
            if isinstance(assets, Unclear):
                return assets
            return self._replaced(at, reader.at, assets[0]) if assets else None
        return None

    def _is_existential(self, at: int) -> bool:
        """Return whether *there* does not mean a place: *there is a car*, *is there anybody*."""
        if self._words[at] != "there":
            return False
        after, before = self._words[at + 1 : at + 2], self._words[at - 1 : at] if at else []
        questioned = bool(_EXISTENTIAL & {*before}) and bool({*after} & (INDEFINITE | _SOMEBODY))
        return questioned or bool(_EXISTENTIAL & {*after})

    def _is_contact(self, at: int) -> bool:
        """Return whether the pronoun at token `at` is a possessive or means a contact.

        It means a contact if one is mentioned before it and nothing is to come back, or if its verb
        takes only contacts.
        """
        if self._words[at] == "her" and self._words[at + 1 : at + 2]:
            after = self._words[at + 1]
            if after[0].isalnum() and after not in _HER:
                return True
        if at and self._words[at - 1] in _ENCOUNTER:
            return True
        back = (_HOME | {"back"}) & set(self._words)
        return not back and bool(_SOMEBODY & set(self._words[:at]))

    def _there_named(self, at: int, end: int) -> tuple[ResolvedReference, int] | Unclear | None:
        """Replace a word such as *there* by its place; with several, ask which one is meant."""
        if self._there:
            return self._replaced(at, end, self._there, to=True)
        if not self._theres:
            return None
        words = self._text[self._tokens[at].start : self._tokens[end - 1].end]
        return Unclear(words, f"Which place is “{words}”?", tuple(self._theres), describes=True)

    def _replaced(
        self, at: int, end: int, means: str, *, to: bool = False
    ) -> tuple[ResolvedReference, int]:
        first, last = self._tokens[at], self._tokens[end - 1]
        words = self._text[first.start : last.end]
        before = self._words[at - 1] if at else ""
        prefixed = to and before not in ("to", "at", "over", "from", "the")
        becomes = ""
        if prefixed:
            preposition = "at" if {"is", "are", "see", "report"} & set(self._words[:at]) else "to"
            preposition = (
                "to"
                if {"send", "go", "goes", "move", "to"} & set(self._words[:at])
                else preposition
            )
            becomes = f"{preposition} {means}"
        return ResolvedReference(first.start, last.end, words, means, becomes), end


def _sentence(orders: Sequence[str]) -> str:
    """Join orders such as `Drone_T04 to EastGate` into one sentence."""
    return f"{listed(list(dict.fromkeys(orders)))}."

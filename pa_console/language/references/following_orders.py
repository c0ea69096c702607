"""Orders that refer to earlier orders as a whole: *bring it back*, *same for north*, *undo that*.

Each of them is rewritten as a complete order, from the last missions and the earlier positions of
the assets. If two readings fit, the operator is asked which one is meant.
"""

from collections.abc import Sequence

from pa_console.language.canonical.reading import listed
from pa_console.language.lexicon import find_verbs, word_lists
from pa_console.language.name_linking import WORD
from pa_console.language.references.conversation import (
    HOME,
    IT,
    MOST_CORRECTING,
    SAME,
    THEM,
    THERE,
    THEY,
    UNDOING,
    ResolvedOrder,
    Turn,
    Unclear,
)
from pa_console.language.references.pronouns import Pronouns
from pa_console.language.references.reader import (
    COPULA,
    INDEFINITE,
    Reader,
    WordToken,
    number_of,
    place_at,
)
from pa_console.language.references.scene import Move, ReferenceScene
from pa_console.schema.command import ENCOUNTERS

_WORDS = word_lists("conversation")
_MORE = _WORDS["more"]
_SAME_ELSEWHERE = _WORDS["same_elsewhere"]
_ONWARDS = _WORDS["onwards"]
_AND_THEN = frozenset(_WORDS["and_then"])
_DONE = frozenset(_WORDS["done"])
_STEADY = frozenset(_WORDS["steady"])
"""Words that may stand beside places, *next* and *done* in an order to continue."""
_MAKE_IT = ("make it", "make that")


def retell(scene: ReferenceScene, text: str) -> ResolvedOrder | Unclear | None:
    """Rewrite an order that refers to earlier orders as a complete one; None for other texts."""
    if not (scene.last is not None or scene.pointer or scene.asked_about) or not text.strip():
        return None
    return _FollowingOrder(Turn(scene, text)).complete()


def _team_of(name: str) -> str:
    """Return the team in an asset's name: `firefly` of Firefly_T02."""
    return next((word.lower() for word in WORD.findall(name) if len(word) > 1), "")


class _FollowingOrder:
    """An order that follows others, or that is given while something is marked on the screen."""

    def __init__(self, turn: Turn) -> None:
        self._turn, self._scene = turn, turn.scene
        self._pronouns = Pronouns(turn)

    def complete(self) -> ResolvedOrder | Unclear | None:
        for way in (
            self._undone,
            self._continued,
            self._place_corrected,
            self._agent_corrected,
            self._same,
            self._joined,
            self._brought_back,
        ):
            order = way() if self._turn.moves else None
            if order is not None:
                return order
        return self._asked_too() or self._pronouns.resolved()

    def _asked_too(self) -> ResolvedOrder | None:
        """Resolve *And Ugv_T02?* after a question about another asset."""
        turn = self._turn
        rest = [word for at, word in enumerate(turn.words) if not self._is_named(at)]
        if not (self._scene.asked_about and turn.named_assets and rest[-1:] == ["?"]):
            return None
        if {*rest} - _AND_THEN:
            return None
        return self._whole(_sentence([f"{name} reports" for name in turn.named_assets]))

    def _is_named(self, at: int) -> bool:
        return any(asset.at <= at < asset.end for asset in self._turn.assets)

    def _whole(self, order: str, *, undoes: bool = False, corrects: bool = False) -> ResolvedOrder:
        return ResolvedOrder(order, ((self._turn.text.strip(), order),), undoes, corrects)

    def _order(self, agent: str, move: Move, place: str = "") -> str:
        """Return an order in words: `agent` repeats `move`, at `place` if it is given."""
        target = place or self._turn.target(move)
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
        turn = self._turn
        if not turn.has(*UNDOING) or turn.named_assets or turn.named_places:
            return None
        orders = self._returns(turn.movers)
        return self._whole(_sentence(orders), undoes=True) if orders else None

    def _place_corrected(self) -> ResolvedOrder | None:
        """Resolve *No, the south gate.*: the same order for another place."""
        turn = self._turn
        places = turn.named_places
        if len(places) != 1 or turn.named_assets or not turn.corrects or turn.does:
            return None
        if len(turn.words) > MOST_CORRECTING or (turn.has(*IT, *THEY) and not turn.has(*_MAKE_IT)):
            return None
        orders = [self._order(move.agent, move, places[0]) for move in turn.moves]
        return self._whole(_sentence(orders), corrects=True)

    def _agent_corrected(self) -> ResolvedOrder | None:
        """Resolve *Not Drone_T04, Robot_T02.*: another asset goes, and the first returns."""
        turn = self._turn
        others = [name for name in turn.named_assets if name not in turn.movers]
        others = others or self._meant_instead()
        there = turn.has(*THERE)
        if not others or not turn.corrects or turn.does or (turn.named_places and not there):
            return None
        if turn.named_places or turn.has("report", "home"):
            return None
        ruled_out = [asset.name for asset in turn.assets if asset.ruled_out]
        replaced = [name for name in turn.movers if name in ruled_out] or turn.movers
        move = next(move for move in turn.moves if move.agent in replaced)
        orders = [self._order(other, move) for other in others]
        return self._whole(_sentence([*orders, *self._returns(replaced)]), corrects=True)

    def _meant_instead(self) -> list[str]:
        """Return the assets meant by a number or a kind: *make that four*, *I meant the robot*."""
        turn = self._turn
        if turn.named_assets or turn.named_places or not turn.corrects or not turn.short:
            return []
        names, kinds = self._scene.names, list[frozenset[str]]()
        for at, word in enumerate(turn.words):
            number = number_of(word)
            if number > 0 and len(turn.movers) == 1 and turn.has(*_MAKE_IT):
                team = names.team(_team_of(turn.movers[0]))
                asset = names.asset(team, number) if team else None
                return [asset] if asset is not None and asset not in turn.movers else []
            if (team := self._scene.members(word)) and not turn.ruled_out(at):
                kinds.append(team)
        if len(kinds) != 1:
            return []
        other = self._nearest_free(self._scene.in_order(kinds[0]), turn.there or "")
        return [other] if other else []

    def _same(self) -> ResolvedOrder | None:
        """Resolve *same for Robot_T02* and *same for north*."""
        turn = self._turn
        elsewhere = turn.has(*_SAME_ELSEWHERE)
        same = bool(SAME & set(turn.words)) or bool(turn.has("as well")) or bool(elsewhere)
        after = [turn.words[at + 1] for at, word in enumerate(turn.words[:-1]) if word == "same"]
        if any(map(self._scene.members, after)):
            return None
        if not same or not turn.short or turn.does or turn.has(*THERE):
            return None
        assets, places = turn.named_assets, turn.named_places
        if assets and not places and not self._own_verb():
            return self._whole(_sentence([self._order(name, turn.moves[0]) for name in assets]))
        if len(places) == 1 and elsewhere and assets and not self._own_verb():
            orders = [self._order(name, turn.moves[0], places[0]) for name in assets]
            return self._whole(_sentence(orders))
        if len(places) == 1 and elsewhere and not assets:
            return self._same_elsewhere(places[0])
        return None

    def _continued(self) -> ResolvedOrder | Unclear | None:
        """Resolve *done there, south next* and *on to west*: the asset sent last goes on.

        Every word has to name a place or belong to such phrases. A place that is only reported as
        done is not a destination.
        """
        turn = self._turn
        if turn.assets or not (turn.has(*_ONWARDS) or _DONE & set(turn.words)):
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
        orders = [self._order(name, turn.moves[0], goals[0]) for name in turn.movers]
        if len({turn.target(move) for move in turn.moves}) == 1:
            return self._whole(_sentence(orders))
        return Unclear(turn.text.strip(), f"Which asset goes on to {goals[0]}?", tuple(orders))

    def _clauses(self) -> list[list[WordToken]]:
        """Return the clauses of the order, which are separated by punctuation."""
        clauses: list[list[WordToken]] = [[]]
        for token in self._turn.tokens:
            if token.word[0].isalnum() or token.word.startswith("'"):
                clauses[-1].append(token)
            else:
                clauses.append([])
        return clauses

    def _own_verb(self) -> bool:
        verbs = find_verbs(self._turn.text)
        return any(v.plain and v.word not in ("go", "goes", "do") for v in verbs)

    def _same_elsewhere(self, place: str) -> ResolvedOrder | None:
        """Return the last order for another `place`; if it named an asset, another asset goes."""
        turn = self._turn
        move = turn.moves[0]
        named = any(name in turn.last.text for name in turn.movers)
        if not named and turn.there and turn.there in turn.last.text:
            return self._whole(turn.last.text.replace(turn.there, place))
        team = [n for n, spec in self._scene.world.assets.items() if spec.kind == self._kind(move)]
        other = self._nearest_free(team, place)
        return self._whole(_sentence([self._order(other, move, place)])) if other else None

    def _kind(self, move: Move) -> str:
        return self._scene.world.assets[move.agent].kind

    def _nearest_free(self, team: Sequence[str], place: str) -> str:
        """Return the free asset of `team` nearest to `place` that was not sent yet, or ''.

        Any such asset would do, because the operator has left the choice open.
        """
        scene = self._scene
        free = [
            name
            for name in team
            if name not in self._turn.movers
            and scene.is_free(name)
            and scene.place_of(name) != place
        ]
        return min(free, key=lambda name: scene.distance_m(name, place), default="")

    def _joined(self) -> ResolvedOrder | Unclear | None:
        """Resolve *another one there*, *Robot_T01 there too*, *give it company, Robot_T01*."""
        turn = self._turn
        if turn.does or turn.has("home", "report", "instead of"):
            return None
        there = turn.has(*THERE)
        place = (turn.named_places or [turn.there])[0]
        if not place:
            return None
        assets = turn.named_assets
        company = turn.has("join", "joins", "company") and turn.has(*IT, *THEY)
        if (there or company) and assets and not turn.named_places and turn.short:
            if "where" in turn.words or (turn.has(*IT) and not company):
                return None
            return self._whole(_sentence([f"{name} to {place}" for name in assets]))
        more = turn.has(*_MORE)
        if not more or assets or not (there or turn.named_places or self._counts(more)):
            return None
        teams = [self._scene.members(word) for word in turn.words if word not in ("one", "it")]
        team = next(filter(None, teams), frozenset[str]())
        if not team:
            kinds = {self._kind(move) for move in turn.moves}
            team = frozenset(n for n, s in self._scene.world.assets.items() if s.kind in kinds)
        other = self._nearest_free(sorted(team), place)
        if other:
            return self._whole(_sentence([f"{other} to {place}"]))
        every = self._scene.world.assets
        free = [n for n in every if self._scene.is_free(n) and n not in turn.movers]
        return Unclear(more, "No asset of that kind is free. Which one is to go?", tuple(free))

    def _counts(self, more: str) -> bool:
        """True if `more` counts assets: *another robot*, *one more*; not *the second floor*."""
        after = self._turn.plain.partition(f" {more} ")[2].split()
        after = after[1:] if after[:1] and after[0] in INDEFINITE | {"the"} else after
        return not after or after[0] == "one" or bool(self._scene.members(after[0]))

    def _brought_back(self) -> ResolvedOrder | Unclear | None:
        """Resolve *Bring it back.*: to where it was before."""
        turn = self._turn
        back = "back" in turn.words or turn.has("where it came from", "where they came from")
        if not back or turn.named_places or turn.does or HOME & set(turn.words) or not turn.short:
            return None
        agents = [
            name for name in turn.named_assets if name in {m.agent for m in self._scene.moved}
        ]
        if not agents:
            if not turn.has(*IT, *THEM, *THEY):
                return None
            referents = (
                self._pronouns.last_assets()
                if turn.has(*THEM, *THEY)
                else self._pronouns.last_asset()
            )
            if isinstance(referents, Unclear):
                return referents
            agents = referents
        orders = self._returns(agents)
        return self._whole(_sentence(orders)) if orders else None


def _sentence(orders: Sequence[str]) -> str:
    """Join orders such as `Drone_T04 to EastGate` into one sentence."""
    return f"{listed(list(dict.fromkeys(orders)))}."

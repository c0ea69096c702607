"""Whether a plan does what an order was understood to ask for, and nothing else.

Reading the order is the model's part (`llm/reading.py`). What cannot be done counts for nothing,
and neither does what the rules ask for besides: who takes over a gate, who looks first.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from pa_console.llm.facts import WORDS
from pa_console.llm.reading import Reading, Wish, WishTask
from pa_console.orchestrator.hindrance import hindrance, unfit
from pa_console.orchestrator.plan_moves import PlanMoves
from pa_console.orchestrator.premises import ENCOUNTERS
from pa_console.schema.world import AssetKind

_MEETS: frozenset[WishTask] = frozenset(("identify", "warn", "block", "respond"))


@dataclass(frozen=True)
class _Case:
    """A plan, and the wishes of its order that can be carried out."""

    moves: PlanMoves
    due: tuple[Wish, ...]
    others_stay: bool
    watched: frozenset[str] = frozenset()
    """Places of wishes that nobody can carry out: to look there is a safe alternative (CAP-10)."""

    def spare(self, wish: Wish, kind: AssetKind | None = None) -> list[str]:
        """Return who is free, of one kind if that is given, and does nothing but for `wish`."""
        moves, others = self.moves, [each for each in self.due if each != wish]
        return [
            name
            for name in moves.free(kind)
            if not moves.takes_over(name)
            and not (name in moves.moved and any(_may(moves, name, each) for each in others))
        ]

    def can_deal(self, wish: Wish) -> bool:
        """Whether somebody could look at the place of `wish`, or deal with whoever is there.

        A drone can, from where it stands or as a spare one; a robot once a track was seen (WF-02).
        """
        moves = self.moves
        seen = all(track.observed for track in moves.tracks(wish.place))
        kinds: tuple[AssetKind, ...] = ("uav", "robot") if seen else ("uav",)
        there = (n for n, a in moves.before.assets.items() if a.available and a.post == wish.place)
        if any(moves.kind(name) in kinds for name in there):
            return True
        return not self.others_stay and any(self.spare(wish, kind) for kind in kinds)


def gaps(moves: PlanMoves, reading: Reading) -> tuple[str, ...]:
    """Return in words what `reading` asks for and the plan lacks, then what nobody asked for."""
    due = [wish for wish in reading.wishes if not hindrance(wish, moves.world, moves.before)]
    vain = {w.place for w in reading.wishes if w not in due and w.task in _MEETS}
    case = _Case(moves, tuple(due), reading.others_stay, frozenset(vain))
    lacking = [text for wish in due for text in _LACKING[wish.task](case, wish)]
    unmet = [
        f"nobody sent to deal with {wish.place}"
        for wish in due
        if wish.task in _MEETS and not moves.dealt_with(wish.place) and case.can_deal(wish)
    ]
    return tuple(dict.fromkeys((*lacking, *unmet, *_unasked(case))))


def _unasked(case: _Case) -> Iterator[str]:
    """Yield what the plan does beyond the wishes that are due and what the rules ask for."""
    moves, due = case.moves, case.due
    moving = [wish for wish in due if wish.task not in ("report", "hold")]
    if not moving:
        busy = (a.agent for a in moves.plan.actions if a.verb not in ("hold", "report"))
        yield from (f"{name} is not to move" for name in busy if not _watches(case, name))
        return
    served = [w for w in moving if w.task in _MEETS or any(_may(moves, n, w) for n in moves.moved)]
    for name in moves.moved:
        asked = any(_may(moves, name, wish) for wish in moving)
        if not asked and not _besides(case, name, served) and not _watches(case, name):
            yield f"{name} not asked for"
    places = {wish.place for wish in moving}
    for action in moves.plan.actions:
        meets = action.verb in ENCOUNTERS and action.target not in places
        if meets and not moves.takes_over(action.agent):
            yield f"{action.command} not asked for"


def _watches(case: _Case, name: str) -> bool:
    """Whether a drone goes to look where nobody can do what was asked."""
    goal, flies = case.moves.ends(name), case.moves.kind(name) == "uav"
    return flies and goal in case.watched and not case.others_stay


def _besides(case: _Case, name: str, served: Sequence[Wish]) -> bool:
    """Whether `name` takes over a gate (WF-03), looks first (WF-02) or meets a track (WF-01)."""
    moves, goal = case.moves, case.moves.ends(name)
    if moves.takes_over(name) and not case.others_stay:
        return True
    if goal not in moves.world.gates or not moves.tracks(goal):
        return False
    looks = moves.kind(name) == "uav" and not case.others_stay
    meets = bool(moves.commands(goal, names=[name]))
    return (looks or meets) and any(wish.place == goal for wish in served)


def _may(moves: PlanMoves, name: str, wish: Wish) -> bool:
    """Whether `name` may move for `wish`."""
    if name in (*wish.team.names, wish.leaving):
        return True
    goal, fits = moves.ends(name), wish.team.kind in (None, moves.kind(name))
    match wish.task:
        case "go" | "mass":
            return not wish.team.names and goal == wish.place and fits
        case "home":
            return not wish.team.names and goal == moves.world.base and fits
        case "look":
            return goal == wish.place and moves.kind(name) == "uav"
        case "cover" | "relieve":
            return goal == _post(moves, wish)
        case "stand_down":
            return goal == moves.world.base and moves.post(name) == wish.place
        case "identify" | "warn" | "block" | "respond":
            return goal == wish.place
        case _:
            return False


# What each task needs: functions that yield what of a wish the plan lacks.


def _there(case: _Case, wish: Wish) -> Iterator[str]:
    """Yield who of those asked for is not sent; as many as are to be had must be."""
    place, team = case.moves.world.base if wish.task == "home" else wish.place, wish.team
    yield from _absent(case, wish, place)
    if team.names:
        return
    sent, spare = len(case.moves.sent(place, team.kind)), case.spare(wish, team.kind)
    wanted = 1 if team.number == "all" else team.number
    word = "asset" if team.kind is None else WORDS[team.kind]
    if sent < wanted and len(spare) > sent:
        yield f"{sent} of {wanted} {word} to {place}"
    elif wish.task == "mass" and (left := [n for n in spare if case.moves.ends(n) != place]):
        yield f"{', '.join(left)} not sent to {place}"
    elif wish.task == "go" and sent > wanted and team.kind != "uav" and team.number != "all":
        yield f"{sent} instead of {wanted} {word} to {place}"


def _absent(case: _Case, wish: Wish, place: str) -> Iterator[str]:
    """Yield who was named and is not sent, unless a gate needs him."""
    relief = case.spare(wish) and not case.others_stay
    for name in _fit(case, wish):
        if case.moves.ends(name) != place and (relief or name not in case.moves.alone):
            yield f"{name} is not sent to {place}"


def _looked(case: _Case, wish: Wish) -> Iterator[str]:
    yield from _absent(case, wish, wish.place)
    moves = case.moves
    looks = moves.commands(wish.place, ["observe"]) or moves.sent(wish.place, "uav")
    if not wish.team.names and not looks and case.spare(wish, "uav"):
        yield f"nobody observes {wish.place}"


def _identified(case: _Case, wish: Wish) -> Iterator[str]:
    """Yield those who were named and do not go to the track that is to be dealt with."""
    names = _fit(case, wish)
    if not names or not case.moves.tracks(wish.place):
        return
    if all(name in case.moves.alone for name in names) and not case.spare(wish):
        return
    if not any(a.agent in names and a.target == wish.place for a in case.moves.plan.actions):
        yield f"{', '.join(names)} not sent to {wish.place}"


def _blocked(case: _Case, wish: Wish) -> Iterator[str]:
    """Yield that a lane is not closed, unless whoever is there has to be met first (WF-01)."""
    due = all(track.intent == "hostile" and track.warned for track in case.moves.tracks(wish.place))
    if due and not case.moves.commands(wish.place, ["block"], _fit(case, wish)):
        yield f"nobody blocks {wish.place}"


def _taken_over(case: _Case, wish: Wish) -> Iterator[str]:
    place = _post(case.moves, wish)
    if wish.task == "relieve" and case.moves.goals.get(wish.leaving) != case.moves.world.base:
        yield f"{wish.leaving} does not go home"
    if not any(name != wish.leaving for name in case.moves.sent(place)) and case.spare(wish):
        yield f"nobody takes over {place}"


def _swapped(case: _Case, wish: Wish) -> Iterator[str]:
    first, second = wish.team.names
    for one, other in ((first, second), (second, first)):
        if case.moves.ends(one) != case.moves.post(other):
            yield f"{one} does not take the place of {other}"


def _stood_down(case: _Case, wish: Wish) -> Iterator[str]:
    """Yield that not exactly one guard stays, or that nobody goes home."""
    there = {*case.moves.guards(wish.place), *case.moves.sent(wish.place)}
    left = [name for name in there if case.moves.ends(name) == wish.place]
    if wish.place in case.moves.world.gates and len(left) != 1:
        yield f"{len(left)} stay at {wish.place}"
    if not case.moves.sent(case.moves.world.base):
        yield "nobody goes home"


def _reported(case: _Case, wish: Wish) -> Iterator[str]:
    told = {action.agent for action in case.moves.plan.actions if action.verb == "report"}
    team = wish.team
    if team.names:
        yield from (f"no report by {n}" for n in _fit(case, wish) if n not in told)
        return
    asked = [
        name
        for name, asset in case.moves.before.assets.items()
        if asset.available and team.kind in (None, asset.kind)
        if all(asset.post == at for at in (wish.place, team.origin) if at)
    ]
    wanted = len(asked) if team.number == "all" or wish.place else team.number
    if len(told.intersection(asked)) < wanted:
        yield f"{len(told.intersection(asked))} of {wanted} reports"


def _held(case: _Case, wish: Wish) -> Iterator[str]:
    yield from (f"{name} is not to move" for name in wish.team.names if name in case.moves.moved)


def _nothing(_case: _Case, _wish: Wish) -> Iterator[str]:
    """Yield nothing: what is due is known by the track's own workflow, or not readable."""
    yield from ()


def _post(moves: PlanMoves, wish: Wish) -> str:
    """Return the place that is to be taken over: as said, or that of the asset that leaves."""
    return wish.place or (moves.post(wish.leaving) if wish.leaving else "")


def _fit(case: _Case, wish: Wish) -> list[str]:
    names = wish.team.names
    return [name for name in names if not unfit(name, wish, case.moves.world, case.moves.before)]


_LACKING: Mapping[WishTask, Callable[[_Case, Wish], Iterator[str]]] = {
    "go": _there,
    "mass": _there,
    "home": _there,
    "look": _looked,
    "identify": _identified,
    "warn": _nothing,
    "respond": _nothing,
    "block": _blocked,
    "cover": _taken_over,
    "relieve": _taken_over,
    "swap": _swapped,
    "stand_down": _stood_down,
    "report": _reported,
    "hold": _held,
    "refused": _nothing,
    "unreadable": _nothing,
}

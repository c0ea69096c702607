"""Whether a plan does what an order was understood to ask for, and nothing else.

Reading the order is the model's part (`llm/reading.py`). What cannot be done counts for nothing,
and neither does what the rules ask for besides: who takes over a gate, who looks first.
"""

from collections.abc import Iterator, Sequence

from pa_console.llm.reading import Reading, Wish, WishTask
from pa_console.orchestrator.hindrance import hindrance
from pa_console.orchestrator.lacking import LACKING
from pa_console.orchestrator.plan_moves import PlanMoves
from pa_console.orchestrator.premises import ENCOUNTERS
from pa_console.orchestrator.wish_moves import Case, may

_MEETS: frozenset[WishTask] = frozenset(("identify", "warn", "block", "respond"))


def gaps(moves: PlanMoves, reading: Reading) -> tuple[str, ...]:
    """Return in words what `reading` asks for and the plan lacks, then what nobody asked for."""
    due = [wish for wish in reading.wishes if not hindrance(wish, moves.world, moves.before)]
    vain = {w.place for w in reading.wishes if w not in due and w.task in _MEETS}
    case = Case(moves, tuple(due), reading.others_stay, frozenset(vain))
    lacking = [text for wish in due for text in LACKING[wish.task](case, wish)]
    unmet = [
        f"nobody sent to deal with {wish.place}"
        for wish in due
        if wish.task in _MEETS and not moves.dealt_with(wish.place) and case.can_deal(wish)
    ]
    return tuple(dict.fromkeys((*lacking, *unmet, *_unasked(case))))


def _unasked(case: Case) -> Iterator[str]:
    """Yield what the plan does beyond the wishes that are due and what the rules ask for."""
    moves, due = case.moves, case.due
    moving = [wish for wish in due if wish.task not in ("report", "hold")]
    if not moving:
        busy = (a.agent for a in moves.plan.actions if a.verb not in ("hold", "report"))
        yield from (f"{name} is not to move" for name in busy if not _watches(case, name))
        return
    served = [w for w in moving if w.task in _MEETS or any(may(moves, n, w) for n in moves.moved)]
    for name in moves.moved:
        asked = any(may(moves, name, wish) for wish in moving)
        if not asked and not _besides(case, name, served) and not _watches(case, name):
            yield f"{name} not asked for"
    places = {wish.place for wish in moving}
    for action in moves.plan.actions:
        meets = action.verb in ENCOUNTERS and action.target not in places
        if meets and not moves.takes_over(action.agent):
            yield f"{action.command} not asked for"


def _watches(case: Case, name: str) -> bool:
    """Whether a drone goes to look at somebody whom nobody can deal with as was asked.

    Where one stands already, no other one has to.
    """
    goal, flies = case.moves.ends(name), case.moves.kind(name) == "uav"
    seen = goal in case.watched and bool(case.moves.tracks(goal))
    stands = any(drone != name for drone in case.moves.there(goal, "uav"))
    return flies and seen and not stands and not case.others_stay


def _besides(case: Case, name: str, served: Sequence[Wish]) -> bool:
    """Whether `name` takes over a gate (WF-03), looks first (WF-02) or meets a track (WF-01)."""
    moves, goal = case.moves, case.moves.ends(name)
    if moves.takes_over(name) and not case.others_stay:
        return True
    if goal not in moves.world.gates or not moves.tracks(goal):
        return False
    looks = moves.kind(name) == "uav" and not case.others_stay
    meets = bool(moves.commands(goal, names=[name]))
    return (looks or meets) and any(wish.place == goal for wish in served)

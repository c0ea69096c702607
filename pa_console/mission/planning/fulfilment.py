"""The comparison of a plan with a reading: the plan should do all of it and nothing else.

A model wrote the reading (`language/canonical/reading.py`). Parts that cannot be carried out may be
missing, and the plan may have additions that the rules require: takeovers of gates and a first
observation.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence

from pa_console.language.canonical.order import (
    ADDRESSING_TASKS,
    STILL_TASKS,
    Ask,
    Reading,
    Task,
)
from pa_console.mission.planning.moves import PlanMoves
from pa_console.mission.planning.obstacles import (
    PlanForOrder,
    is_of,
    may_move,
    obstacle_to,
    post_of,
    unfit,
)
from pa_console.schema.command import ENCOUNTERS, STILL, Verb
from pa_console.schema.telemetry import Picture, Track
from pa_console.schema.world import PLAIN_KINDS, AssetKind

_MEETS = ADDRESSING_TASKS | {"block", "respond"}


def reporters(ask: Ask, picture: Picture) -> tuple[str, ...]:
    """Return the available assets that may report for `ask`, in the picture's order."""
    team = ask.who
    return tuple(
        name
        for name, asset in picture.assets.items()
        if asset.available and team.kind in (None, asset.kind)
        if all(asset.post == at for at in (ask.place, team.origin) if at)
    )


def of_everyone(ask: Ask) -> bool:
    """Return whether `ask` requests reports of all assets at a place, of a kind, or of the team."""
    team = ask.who
    if ask.task != "report" or team.names:
        return False
    return team.count == "all" or bool(ask.place) or not (team.kind or team.origin)


def _there(case: PlanForOrder, ask: Ask) -> Iterator[str]:
    """Describe each difference between the assets that are sent and those that were requested."""
    place, team = case.moves.world.base if ask.task == "home" else ask.place, ask.who
    yield from _absent(case, ask, place)
    there = [n for n, goal in case.moves.goals.items() if goal == place == case.moves.post(n)]
    if there and ask.task != "home":
        yield f"{', '.join(there)} at {place} already"
    if team.names:
        return
    sent = sum(is_of(case.moves, name, ask) for name in case.moves.sent(place, team.kind))
    spare = [
        name
        for name in case.spare(ask, team.kind)
        if case.moves.post(name) != place and not _is_left(case.moves, name)
    ]
    number = 1 if team.count == "all" else team.count
    word = "asset" if team.kind is None else PLAIN_KINDS[team.kind]
    if sent < number and len(spare) > sent:
        yield f"{sent} of {number} {word} to {place}"
    elif team.count == "all":
        left = [name for name in spare if case.moves.ends(name) != place]
        if left:
            yield f"{', '.join(left)} not sent to {place}"
    elif ask.task == "go" and sent > number and not _may_be_looking(case, ask):
        yield f"{sent} instead of {number} {word} to {place}"


def _may_be_looking(case: PlanForOrder, ask: Ask) -> bool:
    """Return whether the plan is allowed one more drone as an observer at `ask.place` (WF-02)."""
    flies = ask.who.kind == "uav" and not case.others_stay
    besides = any(other.place == ask.place for other in case.due if other != ask)
    return flies and (besides or bool(case.moves.tracks(ask.place)))


def _needless(case: PlanForOrder, ask: Ask) -> Iterator[str]:
    """Describe each sole guard that leaves its gate for `ask` although another asset is free."""
    if ask.who.names or ask.task not in ("go", "look", "cover", "relieve"):
        return
    moves, place = case.moves, post_of(case.moves, ask)
    kind: AssetKind | None = "uav" if ask.task == "look" else ask.who.kind
    named = {name for other in case.due for name in (*other.who.names, other.leaving)}
    free = [
        name
        for name in moves.free(kind)
        if moves.post(name) != place
        and (name not in moves.moved or moves.takes_over(name))
        and is_of(moves, name, ask)
        and not unfit(name, ask, moves.world, moves.before)
    ]
    for name in moves.sent(place, kind):
        if free and name in moves.alone and name not in named:
            yield f"{name} leaves {moves.post(name)} though {free[0]} is free"


def _is_left(moves: PlanMoves, name: str) -> bool:
    """Return whether an asset stays at a gate that all its other guards leave (WF-03)."""
    guards = moves.guards(moves.post(name))
    others = [guard for guard in guards if guard != name]
    return name in guards and name not in moves.moved and all(o in moves.moved for o in others)


def _absent(case: PlanForOrder, ask: Ask, place: str) -> Iterator[str]:
    """Describe each named asset that is not sent, unless it has to stay as a gate's only guard."""
    relief = case.spare(ask) and not case.others_stay
    for name in _fit(case, ask):
        if case.moves.ends(name) != place and (relief or name not in case.moves.alone):
            yield f"{name} is not sent to {place}"


def _looked(case: PlanForOrder, ask: Ask) -> Iterator[str]:
    yield from _absent(case, ask, ask.place)
    moves = case.moves
    observers = (action.agent for action in moves.commands(ask.place, ["observe"]))
    drones = (*observers, *moves.sent(ask.place, "uav"))
    looks = any(is_of(moves, name, ask) for name in drones)
    can = (n for n in case.spare(ask, "uav") if not unfit(n, ask, moves.world, moves.before))
    if not ask.who.names and not looks and any(can):
        yield f"nobody observes {ask.place}"


def _identified(case: PlanForOrder, ask: Ask) -> Iterator[str]:
    """Describe the named assets that do not go to the track, or else the missing step."""
    names = _fit(case, ask)
    if names and case.moves.tracks(ask.place):
        if all(name in case.moves.alone for name in names) and not case.spare(ask):
            return
        if not any(a.agent in names and a.target == ask.place for a in case.moves.plan.actions):
            yield f"{', '.join(names)} not sent to {ask.place}"
            return
    yield from _step_left_out(case, ask)


def _step_left_out(case: PlanForOrder, ask: Ask) -> Iterator[str]:
    """Describe the missing step at a place: the identification of a contact or a warning (WF-01).

    An unobserved contact is observed in the same plan before it is identified (WF-02).
    Noncombatants are only watched (ROE-08).
    """
    moves = case.moves
    tracks = [track for track in moves.tracks(ask.place) if track.status != "leaving"]
    if any(track.noncombatants for track in tracks):
        return
    due: Verb | None = None
    if any(track.identity == "unknown" for track in tracks):
        due = "identify"
    elif ask.task == "warn" and any(is_to_be_warned(track) for track in tracks):
        due = "warn"
    if due and _can(case, ask, tracks) and not moves.commands(ask.place, [due]):
        yield f"nobody sent to {due} who is at {ask.place}"


def _can(case: PlanForOrder, ask: Ask, tracks: Sequence[Track]) -> bool:
    """Return whether there is a robot for `tracks`, and a drone if one must observe first."""
    seen = all(track.observed for track in tracks)
    kinds: tuple[AssetKind, ...] = ("robot",) if seen else ("robot", "uav")
    return all(case.moves.there(ask.place, kind) or case.spare(ask, kind) for kind in kinds)


def is_to_be_warned(track: Track) -> bool:
    """Return whether a warning is due.

    The contact must be an intruder, not suspected of noncombatants, and not yet warned.
    """
    is_intruder = track.identity == "unauthorized" and not track.noncombatants
    return is_intruder and not track.warned


def _blocked(case: PlanForOrder, ask: Ask) -> Iterator[str]:
    """Describe a lane that is not blocked, unless its contact must be warned first (WF-01)."""
    due = all(track.intent == "hostile" and track.warned for track in case.moves.tracks(ask.place))
    moves, fit = case.moves, _fit(case, ask)
    can = fit or case.spare(ask, "ugv") or moves.there(ask.place, "ugv")
    if due and can and not moves.commands(ask.place, ["block"], fit):
        yield f"nobody blocks {ask.place}"


def _taken_over(case: PlanForOrder, ask: Ask) -> Iterator[str]:
    place, leaving = post_of(case.moves, ask), case.moves.before.assets.get(ask.leaving)
    home = case.moves.goals.get(ask.leaving) == case.moves.world.base
    if ask.task == "relieve" and leaving is not None and leaving.available and not home:
        yield f"{ask.leaving} does not go home"
    yield from _absent(case, ask, place)
    kind = ask.who.kind
    sent = [name for name in case.moves.sent(place, kind) if name != ask.leaving]
    spare = [name for name in case.spare(ask, kind) if case.moves.post(name) != place]
    if not _fit(case, ask) and not sent and spare:
        yield f"nobody takes over {place}"


def _swapped(case: PlanForOrder, ask: Ask) -> Iterator[str]:
    first, second = ask.who.names
    for asset, other in ((first, second), (second, first)):
        if case.moves.ends(asset) != case.moves.post(other):
            yield f"{asset} does not take the place of {other}"


def _stood_down(case: PlanForOrder, ask: Ask) -> Iterator[str]:
    """Describe the fault if not exactly one guard stays, or if no guard goes home."""
    there = {*case.moves.guards(ask.place), *case.moves.sent(ask.place)}
    left = [name for name in there if case.moves.ends(name) == ask.place]
    if ask.place in case.moves.world.gates and len(left) != 1:
        yield f"{len(left)} stay at {ask.place}"
    if len(case.moves.guards(ask.place)) > 1 and not case.moves.sent(case.moves.world.base):
        yield "nobody goes home"


def _reported(case: PlanForOrder, ask: Ask) -> Iterator[str]:
    """Describe the missing reports; an asset that acts need not report when all assets should."""
    actions = case.moves.plan.actions
    reporting = {action.agent for action in actions if action.verb == "report"}
    if ask.who.names:
        yield from (f"no report by {n}" for n in _fit(case, ask) if n not in reporting)
        return
    expected = {*reporters(ask, case.moves.before)}
    number = ask.who.count
    if number == "all" or of_everyone(ask):
        expected -= {action.agent for action in actions if action.verb not in STILL}
        number = len(expected)
    if len(reporting & expected) < number:
        yield f"{len(reporting & expected)} of {number} reports"


def _held(case: PlanForOrder, ask: Ask) -> Iterator[str]:
    yield from (f"{name} is not to move" for name in ask.who.names if name in case.moves.moved)


def _nothing(_case: PlanForOrder, _ask: Ask) -> Iterator[str]:
    """Yield no gaps: the track's workflow decides, or the task is refused or unreadable."""
    yield from ()


def _fit(case: PlanForOrder, ask: Ask) -> list[str]:
    names = ask.who.names
    return [name for name in names if not unfit(name, ask, case.moves.world, case.moves.before)]


FIND_GAPS: Mapping[Task, Callable[[PlanForOrder, Ask], Iterator[str]]] = {
    "go": _there,
    "mass": _there,
    "home": _there,
    "look": _looked,
    "identify": _identified,
    "warn": _step_left_out,
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


def gaps(moves: PlanMoves, reading: Reading) -> tuple[str, ...]:
    """Return descriptions of what the plan lacks, then of what was not requested."""
    due = [ask for ask in reading.asks if not obstacle_to(ask, moves.world, moves.before)]
    vain = {w.place for w in reading.asks if w not in due and w.task in _MEETS}
    case = PlanForOrder(moves, tuple(due), reading.others_stay, frozenset(vain))
    lacking = [
        text for ask in due for text in (*FIND_GAPS[ask.task](case, ask), *_needless(case, ask))
    ]
    unmet = [
        f"nobody sent to deal with {ask.place}"
        for ask in due
        if ask.task in _MEETS and not moves.dealt_with(ask.place) and case.can_deal(ask)
    ]
    return tuple(dict.fromkeys((*lacking, *unmet, *_unasked(case))))


def _unasked(case: PlanForOrder) -> Iterator[str]:
    """Describe the parts of the plan that neither the reading nor the rules require."""
    moves, due = case.moves, case.due
    moving = [ask for ask in due if ask.task not in STILL_TASKS]
    if not moving:
        busy = (a.agent for a in moves.plan.actions if a.verb not in STILL)
        yield from (f"{name} is not to move" for name in busy if not _watches(case, name))
        return
    served = [
        w for w in moving if w.task in _MEETS or any(may_move(moves, n, w) for n in moves.moved)
    ]
    for name in moves.moved:
        requested = any(may_move(moves, name, ask) for ask in moving)
        if not requested and not _besides(case, name, served) and not _watches(case, name):
            yield f"{name} not asked for"
    places = {ask.place for ask in moving}
    for action in moves.plan.actions:
        meets = action.verb in ENCOUNTERS and action.target not in places
        if meets and not moves.takes_over(action.agent):
            yield f"{action.command} not asked for"


def _watches(case: PlanForOrder, name: str) -> bool:
    """Return whether a drone observes a contact that cannot be dealt with as requested.

    Returns False if another drone is already at that place.
    """
    goal, flies = case.moves.ends(name), case.moves.kind(name) == "uav"
    seen = goal in case.watched and bool(case.moves.tracks(goal))
    stands = any(drone != name for drone in case.moves.there(goal, "uav"))
    return flies and seen and not stands and not case.others_stay


def _besides(case: PlanForOrder, name: str, served: Sequence[Ask]) -> bool:
    """Return whether `name` moves because a rule requires it.

    It takes over a gate (WF-03), observes first (WF-02), or deals with a track (WF-01).
    """
    moves, goal = case.moves, case.moves.ends(name)
    if moves.takes_over(name) and not case.others_stay:
        return True
    if goal not in moves.world.gates or not moves.tracks(goal):
        return False
    looks = moves.kind(name) == "uav" and not case.others_stay
    meets = bool(moves.commands(goal, names=[name]))
    return (looks or meets) and any(ask.place == goal for ask in served)

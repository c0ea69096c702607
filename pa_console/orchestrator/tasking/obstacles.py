"""What of an order cannot be carried out now, or need not, and who may move for it.

What could be done and is not planned is the judge's to object to (`fulfilment.py`).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from pa_console.orchestrator.planning.plan_moves import PlanMoves
from pa_console.orders.order import Ask, Reading, Task
from pa_console.schema.plan import COMMANDS, Verb
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import PLAIN_KINDS, AssetKind, World

VERBS: Mapping[Task, Verb] = {
    "look": "observe", "identify": "identify", "warn": "warn", "block": "block",
}  # fmt: skip
"""The command that a task is carried out with, where only some kinds of assets have it."""
_PLACED: frozenset[Task] = frozenset(("go", "look", "identify", "warn", "block", "mass"))


def obstacle_to(ask: Ask, world: World, picture: Picture) -> str:
    """Return why nothing of `ask` can be done, empty when at least a part can."""
    if ask.task == "refused":
        return "no order may have that"
    if ask.place in world.zones:
        return f"{ask.place} is closed (ROE-07)"
    if ask.place not in world.frames and (ask.place or ask.task in _PLACED):
        return "no such place (CAP-06)"
    if ask.leaving and ask.leaving not in world.assets:
        return f"no asset {ask.leaving} (CAP-10)"
    names, kind = ask.who.names, ask.who.kind
    problems = [why for name in names if (why := unfit(name, ask, world, picture))]
    if problems and (len(problems) == len(names) or ask.task == "swap"):
        return problems[0]
    if names:
        return ""
    return (_incapable(kind, ask.task) if kind is not None else "") or _nobody(ask, picture)


def unfit(name: str, ask: Ask, world: World, picture: Picture) -> str:
    """Return why the asset of that name cannot do its part of `ask`, empty when it can."""
    asset = picture.assets.get(name)
    if asset is None:
        return f"no asset {name} (CAP-10)"
    if not asset.available:
        return f"{name} is down"
    stays = ask.task in ("home", "report", "hold") or ask.place == world.base
    if asset.low_battery and not stays:
        return f"{name} is low (CAP-04)"
    if ask.task in VERBS and asset.comms != "ok":
        return f"{name} has a poor link (CAP-05)"
    return _incapable(asset.kind, ask.task)


def _nobody(ask: Ask, picture: Picture) -> str:
    """Return that every asset which could do it is down."""
    kind, verb = ask.who.kind, VERBS.get(ask.task)
    kinds = (kind,) if kind is not None else COMMANDS[verb].kinds if verb is not None else ()
    up = {asset.kind for asset in picture.assets.values() if asset.available}
    return "" if not kinds or up.intersection(kinds) else "whoever could do it is down (CAP-10)"


def can_have(kind: AssetKind, task: Task) -> bool:
    """Whether assets of a kind have the command that a task is carried out with."""
    verb = VERBS.get(task)
    return verb is None or kind in COMMANDS[verb].kinds


def _incapable(kind: AssetKind, task: Task) -> str:
    return "" if can_have(kind, task) else f"no {PLAIN_KINDS[kind]} can {VERBS[task]}"


def post_of(moves: PlanMoves, ask: Ask) -> str:
    """Return the place that is to be taken over: as said, or that of the asset that leaves."""
    return ask.place or (moves.post(ask.leaving) if ask.leaving else "")


@dataclass(frozen=True)
class PlanForOrder:
    """A plan, and the asks of its order that can be carried out."""

    moves: PlanMoves
    due: tuple[Ask, ...]
    others_stay: bool
    watched: frozenset[str] = frozenset()
    """Places of asks that nobody can carry out: to look there is a safe alternative (CAP-10)."""

    def spare(self, ask: Ask, kind: AssetKind | None = None) -> list[str]:
        """Return who is free, of one kind if that is given, and does nothing but for `ask`.

        Where `ask` says from where they are to come, nobody else.
        """
        moves, others = self.moves, [each for each in self.due if each != ask]
        return [
            name
            for name in moves.free(kind)
            if is_of(moves, name, ask)
            and not moves.takes_over(name)
            and not (name in moves.moved and any(_carries_out(moves, name, w) for w in others))
        ]

    def can_deal(self, ask: Ask) -> bool:
        """Whether somebody could look at the place of `ask`, or deal with whoever is there.

        A drone can, from where it stands or as a spare one; a robot once a track was seen (WF-02).
        """
        moves, tracks = self.moves, self.moves.tracks(ask.place)
        seen = bool(tracks) and all(track.observed for track in tracks)
        kinds: tuple[AssetKind, ...] = ("uav", "robot") if seen else ("uav",)
        if any(moves.there(ask.place, kind) for kind in kinds):
            return True
        return not self.others_stay and any(self.spare(ask, kind) for kind in kinds)


def is_of(moves: PlanMoves, name: str, ask: Ask) -> bool:
    """Whether `name` comes from where those are to come from who are asked for."""
    return ask.who.origin in ("", moves.post(name))


def may_move(moves: PlanMoves, name: str, ask: Ask) -> bool:
    """Whether `name` may move for `ask`."""
    if name in (*ask.who.names, ask.leaving):
        return True
    goal, fits = moves.ends(name), ask.who.kind in (None, moves.kind(name))
    from_there = is_of(moves, name, ask)
    match ask.task:
        case "go" | "mass":
            return not ask.who.names and goal == ask.place and fits and from_there
        case "home":
            return not ask.who.names and goal == moves.world.base and fits and from_there
        case "look":
            return goal == ask.place and moves.kind(name) == "uav" and from_there
        case "cover" | "relieve":
            return goal == post_of(moves, ask) and from_there
        case "stand_down":
            return goal == moves.world.base and moves.post(name) == ask.place
        case "identify" | "warn" | "block" | "respond":
            return goal == ask.place
        case _:
            return False


def _carries_out(moves: PlanMoves, name: str, ask: Ask) -> bool:
    """Whether `name` moves for what is asked by `ask`, and not only to look first (WF-02)."""
    kind = moves.kind(name)
    asked = name in ask.who.names or ask.who.kind in (None, kind)
    return (
        may_move(moves, name, ask) and (name == ask.leaving or asked) and can_have(kind, ask.task)
    )


_LOOKS: frozenset[Task] = frozenset(("look", "identify", "warn", "respond"))
"""What a drone begins with (WF-02)."""
_GOES: frozenset[Task] = frozenset((*_LOOKS, "go", "mass", "home", "block", "cover", "relieve"))


def unmet_asks(moves: PlanMoves, reading: Reading) -> tuple[str, ...]:
    """Return each ask of `reading` that is not or not wholly carried out, with the reason."""
    world, before = moves.world, moves.before
    due = tuple(ask for ask in reading.asks if not obstacle_to(ask, world, before))
    case = PlanForOrder(moves, due, reading.others_stay)
    said = ((ask, _why(case, ask)) for ask in reading.asks)
    return tuple(dict.fromkeys(f"{ask.words}: {why}" for ask, why in said if why))


def _why(case: PlanForOrder, ask: Ask) -> str:
    moves = case.moves
    if why := obstacle_to(ask, moves.world, moves.before):
        return why
    if ask.who.names:
        return ", ".join(_kept(moves, ask))
    if ask.task not in _GOES:
        return ""
    team, sent = ask.who, len(moves.sent(ask.place, ask.who.kind))
    if ask.task == "go" and team.count != "all" and 0 < sent < team.count:
        return f"no more than {sent} can be spared"
    if there := [name for name in _standing(moves, ask) if ask.task == "go" and not sent]:
        return f"{', '.join(there)} there already"
    return "" if _begun(moves, ask) or case.spare(ask, _needed(ask)) else "nobody can be spared"


def _kept(moves: PlanMoves, ask: Ask) -> Iterator[str]:
    """Yield why those who were named do not do their part."""
    for name in ask.who.names:
        post = moves.post(name) if name in moves.world.assets else ""
        if why := unfit(name, ask, moves.world, moves.before):
            yield why
        elif ask.task == "go" and post == ask.place and name not in moves.moved:
            yield f"{name} there already"
        elif ask.task in _GOES and name in moves.alone and moves.ends(name) == post != ask.place:
            yield f"{name} covers {post} alone"


def _begun(moves: PlanMoves, ask: Ask) -> bool:
    """Whether somebody acts for `ask`, or whoever it needs stands there already."""
    acting = (a.agent for a in moves.plan.actions if a.verb not in ("hold", "report"))
    return bool(_standing(moves, ask)) or any(may_move(moves, name, ask) for name in acting)


def _standing(moves: PlanMoves, ask: Ask) -> list[str]:
    """Return who of those that `ask` needs stands where it wants somebody."""
    place = moves.world.base if ask.task == "home" else post_of(moves, ask)
    kind = _needed(ask)
    kinds: tuple[AssetKind, ...] = (kind,) if kind else ("uav", "ugv", "robot")
    return [name for kind in kinds for name in moves.there(place, kind)]


def _needed(ask: Ask) -> AssetKind | None:
    """Return the kind of asset that has to be free for `ask`, None where any would do."""
    if ask.task in _LOOKS:
        return "uav"
    return "ugv" if ask.task == "block" else ask.who.kind

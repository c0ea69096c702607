"""What of an order cannot be carried out now, or need not, and who may move for it.

What could be done and is not planned is the judge's to object to (`fulfilment.py`).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from pa_console.llm.roles.prompt_facts import WORDS
from pa_console.orchestrator.planning.plan_moves import PlanMoves
from pa_console.orders.reading import Reading, Wish, WishTask
from pa_console.schema.plan import COMMANDS, Verb
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import AssetKind, World

VERBS: Mapping[WishTask, Verb] = {
    "look": "observe", "identify": "identify", "warn": "warn", "block": "block",
}  # fmt: skip
"""The command that a task is carried out with, where only some kinds of assets have it."""
_PLACED: frozenset[WishTask] = frozenset(("go", "look", "identify", "warn", "block", "mass"))


def obstacle_to(wish: Wish, world: World, picture: Picture) -> str:
    """Return why nothing of `wish` can be done, empty when at least a part can."""
    if wish.task == "refused":
        return "no order may have that"
    if wish.place in world.zones:
        return f"{wish.place} is closed (ROE-07)"
    if wish.place not in world.frames and (wish.place or wish.task in _PLACED):
        return "no such place (CAP-06)"
    if wish.leaving and wish.leaving not in world.assets:
        return f"no asset {wish.leaving} (CAP-10)"
    names, kind = wish.team.names, wish.team.kind
    problems = [why for name in names if (why := unfit(name, wish, world, picture))]
    if problems and (len(problems) == len(names) or wish.task == "swap"):
        return problems[0]
    if names:
        return ""
    return (_incapable(kind, wish.task) if kind is not None else "") or _nobody(wish, picture)


def unfit(name: str, wish: Wish, world: World, picture: Picture) -> str:
    """Return why the asset of that name cannot do its part of `wish`, empty when it can."""
    asset = picture.assets.get(name)
    if asset is None:
        return f"no asset {name} (CAP-10)"
    if not asset.available:
        return f"{name} is down"
    stays = wish.task in ("home", "report", "hold") or wish.place == world.base
    if asset.low_battery and not stays:
        return f"{name} is low (CAP-04)"
    if wish.task in VERBS and asset.comms != "ok":
        return f"{name} has a poor link (CAP-05)"
    return _incapable(asset.kind, wish.task)


def _nobody(wish: Wish, picture: Picture) -> str:
    """Return that every asset which could do it is down."""
    kind, verb = wish.team.kind, VERBS.get(wish.task)
    kinds = (kind,) if kind is not None else COMMANDS[verb].kinds if verb is not None else ()
    up = {asset.kind for asset in picture.assets.values() if asset.available}
    return "" if not kinds or up.intersection(kinds) else "whoever could do it is down (CAP-10)"


def can_have(kind: AssetKind, task: WishTask) -> bool:
    """Whether assets of a kind have the command that a task is carried out with."""
    verb = VERBS.get(task)
    return verb is None or kind in COMMANDS[verb].kinds


def _incapable(kind: AssetKind, task: WishTask) -> str:
    return "" if can_have(kind, task) else f"no {WORDS[kind]} can {VERBS[task]}"


def post_of(moves: PlanMoves, wish: Wish) -> str:
    """Return the place that is to be taken over: as said, or that of the asset that leaves."""
    return wish.place or (moves.post(wish.leaving) if wish.leaving else "")


@dataclass(frozen=True)
class PlanForOrder:
    """A plan, and the wishes of its order that can be carried out."""

    moves: PlanMoves
    due: tuple[Wish, ...]
    others_stay: bool
    watched: frozenset[str] = frozenset()
    """Places of wishes that nobody can carry out: to look there is a safe alternative (CAP-10)."""

    def spare(self, wish: Wish, kind: AssetKind | None = None) -> list[str]:
        """Return who is free, of one kind if that is given, and does nothing but for `wish`.

        Where `wish` says from where they are to come, nobody else.
        """
        moves, others = self.moves, [each for each in self.due if each != wish]
        return [
            name
            for name in moves.free(kind)
            if is_of(moves, name, wish)
            and not moves.takes_over(name)
            and not (name in moves.moved and any(_carries_out(moves, name, w) for w in others))
        ]

    def can_deal(self, wish: Wish) -> bool:
        """Whether somebody could look at the place of `wish`, or deal with whoever is there.

        A drone can, from where it stands or as a spare one; a robot once a track was seen (WF-02).
        """
        moves, tracks = self.moves, self.moves.tracks(wish.place)
        seen = bool(tracks) and all(track.observed for track in tracks)
        kinds: tuple[AssetKind, ...] = ("uav", "robot") if seen else ("uav",)
        if any(moves.there(wish.place, kind) for kind in kinds):
            return True
        return not self.others_stay and any(self.spare(wish, kind) for kind in kinds)


def is_of(moves: PlanMoves, name: str, wish: Wish) -> bool:
    """Whether `name` comes from where those are to come from who are asked for."""
    return wish.team.origin in ("", moves.post(name))


def may_move(moves: PlanMoves, name: str, wish: Wish) -> bool:
    """Whether `name` may move for `wish`."""
    if name in (*wish.team.names, wish.leaving):
        return True
    goal, fits = moves.ends(name), wish.team.kind in (None, moves.kind(name))
    from_there = is_of(moves, name, wish)
    match wish.task:
        case "go" | "mass":
            return not wish.team.names and goal == wish.place and fits and from_there
        case "home":
            return not wish.team.names and goal == moves.world.base and fits and from_there
        case "look":
            return goal == wish.place and moves.kind(name) == "uav" and from_there
        case "cover" | "relieve":
            return goal == post_of(moves, wish) and from_there
        case "stand_down":
            return goal == moves.world.base and moves.post(name) == wish.place
        case "identify" | "warn" | "block" | "respond":
            return goal == wish.place
        case _:
            return False


def _carries_out(moves: PlanMoves, name: str, wish: Wish) -> bool:
    """Whether `name` moves for what is asked by `wish`, and not only to look first (WF-02)."""
    kind = moves.kind(name)
    asked = name in wish.team.names or wish.team.kind in (None, kind)
    return (
        may_move(moves, name, wish)
        and (name == wish.leaving or asked)
        and can_have(kind, wish.task)
    )


_LOOKS: frozenset[WishTask] = frozenset(("look", "identify", "warn", "respond"))
"""What a drone begins with (WF-02)."""
_GOES: frozenset[WishTask] = frozenset((*_LOOKS, "go", "mass", "home", "block", "cover", "relieve"))


def unmet_wishes(moves: PlanMoves, reading: Reading) -> tuple[str, ...]:
    """Return each wish of `reading` that is not or not wholly carried out, with the reason."""
    world, before = moves.world, moves.before
    due = tuple(wish for wish in reading.wishes if not obstacle_to(wish, world, before))
    case = PlanForOrder(moves, due, reading.others_stay)
    said = ((wish, _why(case, wish)) for wish in reading.wishes)
    return tuple(dict.fromkeys(f"{wish.words}: {why}" for wish, why in said if why))


def _why(case: PlanForOrder, wish: Wish) -> str:
    moves = case.moves
    if why := obstacle_to(wish, moves.world, moves.before):
        return why
    if wish.team.names:
        return ", ".join(_kept(moves, wish))
    if wish.task not in _GOES:
        return ""
    team, sent = wish.team, len(moves.sent(wish.place, wish.team.kind))
    if wish.task == "go" and team.number != "all" and 0 < sent < team.number:
        return f"no more than {sent} can be spared"
    if there := [name for name in _standing(moves, wish) if wish.task == "go" and not sent]:
        return f"{', '.join(there)} there already"
    return "" if _begun(moves, wish) or case.spare(wish, _needed(wish)) else "nobody can be spared"


def _kept(moves: PlanMoves, wish: Wish) -> Iterator[str]:
    """Yield why those who were named do not do their part."""
    for name in wish.team.names:
        post = moves.post(name) if name in moves.world.assets else ""
        if why := unfit(name, wish, moves.world, moves.before):
            yield why
        elif wish.task == "go" and post == wish.place and name not in moves.moved:
            yield f"{name} there already"
        elif wish.task in _GOES and name in moves.alone and moves.ends(name) == post != wish.place:
            yield f"{name} covers {post} alone"


def _begun(moves: PlanMoves, wish: Wish) -> bool:
    """Whether somebody acts for `wish`, or whoever it needs stands there already."""
    acting = (a.agent for a in moves.plan.actions if a.verb not in ("hold", "report"))
    return bool(_standing(moves, wish)) or any(may_move(moves, name, wish) for name in acting)


def _standing(moves: PlanMoves, wish: Wish) -> list[str]:
    """Return who of those that `wish` needs stands where it wants somebody."""
    place = moves.world.base if wish.task == "home" else post_of(moves, wish)
    kind = _needed(wish)
    kinds: tuple[AssetKind, ...] = (kind,) if kind else ("uav", "ugv", "robot")
    return [name for kind in kinds for name in moves.there(place, kind)]


def _needed(wish: Wish) -> AssetKind | None:
    """Return the kind of asset that has to be free for `wish`, None where any would do."""
    if wish.task in _LOOKS:
        return "uav"
    return "ugv" if wish.task == "block" else wish.team.kind

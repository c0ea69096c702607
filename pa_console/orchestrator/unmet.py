"""What of an order no plan can do now, or need not, and why: told before the operator decides.

What could be done and is not planned is the judge's to object to (`fulfilment.py`).
"""

from collections.abc import Iterator

from pa_console.llm.reading import Reading, Wish, WishTask
from pa_console.orchestrator.hindrance import hindrance, unfit
from pa_console.orchestrator.plan_moves import PlanMoves
from pa_console.orchestrator.wish_moves import Case, may, post_of
from pa_console.schema.world import AssetKind

_LOOKS: frozenset[WishTask] = frozenset(("look", "identify", "warn", "respond"))
"""What a drone begins with (WF-02)."""
_GOES: frozenset[WishTask] = frozenset((*_LOOKS, "go", "mass", "home", "block", "cover", "relieve"))


def unmet(moves: PlanMoves, reading: Reading) -> tuple[str, ...]:
    """Return each wish of `reading` that is not or not wholly carried out, with the reason."""
    world, before = moves.world, moves.before
    due = tuple(wish for wish in reading.wishes if not hindrance(wish, world, before))
    case = Case(moves, due, reading.others_stay)
    said = ((wish, _why(case, wish)) for wish in reading.wishes)
    return tuple(dict.fromkeys(f"{wish.words}: {why}" for wish, why in said if why))


def _why(case: Case, wish: Wish) -> str:
    moves = case.moves
    if why := hindrance(wish, moves.world, moves.before):
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
    return bool(_standing(moves, wish)) or any(may(moves, name, wish) for name in acting)


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

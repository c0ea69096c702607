"""Parts of an order that cannot or need not be carried out now, and the assets that may move.

If a part could be carried out but is missing in the plan, `fulfilment.py` reports it as a gap.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

from pa_console.language.canonical.order import (
    ADDRESSING_TASKS,
    ANYBODY,
    MOVING_TASKS,
    VERB_FOR,
    Ask,
    Obstacle,
    Reading,
    Task,
    asset_obstacles,
    can_do,
    obstacle,
)
from pa_console.language.mentions import find_mentions
from pa_console.language.name_linking import link_names
from pa_console.mission.planning.moves import PlanMoves
from pa_console.schema.command import COMMANDS, STILL
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import PLAIN_KINDS, AssetKind, World

_MEETS = ADDRESSING_TASKS | {"respond"}
"""The tasks that need a contact at their place."""
_LOOKS = _MEETS | {"look"}
"""The tasks that begin with a drone's observation (WF-02)."""
_GOES = MOVING_TASKS | {"respond", "mass", "cover", "relieve"}
"""The tasks for which an asset has to go somewhere."""
_ONLY_FREE = re.compile(
    r"\b(?:free|spared?|available|idle|unassigned|surplus|extra|needed|can|could|possible|rest"
    r"|others?|remaining)\b"
)
"""Words, in lower case, that limit *all* in an order to the available assets."""


def obstacle_to(ask: Ask, world: World, picture: Picture) -> str:
    """Return why no part of `ask` can be carried out; '' if at least one part can."""
    if ask.task == "refused":
        return "no order may have that"
    problem = obstacle(
        ask, world, lambda name: next(asset_obstacles(name, ask, world, picture), None)
    )
    if problem is not None:
        return _in_words(problem, ask.task, picture)
    return "" if ask.who.names else _nobody(ask, picture)


def unfit(name: str, ask: Ask, world: World, picture: Picture) -> str:
    """Return why the asset `name` cannot do its part of `ask`; '' if it can."""
    problem = next(asset_obstacles(name, ask, world, picture), None)
    return "" if problem is None else _in_words(problem, ask.task, picture)


def _in_words(problem: Obstacle, task: Task, picture: Picture) -> str:
    """Return an obstacle in words, with the id of its rule, if any."""
    match problem.problem:
        case "closed":
            return f"{problem.subject} is closed (ROE-07)"
        case "no place":
            return "no such place (CAP-06)"
        case "no asset":
            return f"no asset {problem.subject} (CAP-10)"
        case "down":
            asset = picture.assets.get(problem.subject)
            driven = asset is not None and asset.manual
            return f"{problem.subject} is {'under manual control' if driven else 'down'}"
        case "low":
            return f"{problem.subject} is low (CAP-04)"
        case "poor link":
            return f"{problem.subject} has a poor link (CAP-05)"
        case "wrong kind":
            kind = "asset" if problem.kind is None else PLAIN_KINDS[problem.kind]
            return f"no {kind} can {VERB_FOR[task]}"


def _nobody(ask: Ask, picture: Picture) -> str:
    """Return the obstacle that every asset that could do the task is down; otherwise ''."""
    kind, verb = ask.who.kind, VERB_FOR.get(ask.task)
    kinds = (kind,) if kind is not None else COMMANDS[verb].kinds if verb is not None else ()
    up = {asset.kind for asset in picture.assets.values() if asset.available}
    return "" if not kinds or up.intersection(kinds) else "whoever could do it is down (CAP-10)"


def unready_assets(world: World, picture: Picture, text: str) -> dict[str, str]:
    """Return the assets that an order needs and that cannot start yet, with the reasons.

    An order that names no asset needs one of each kind that it mentions, or, if it says *all*,
    every asset of these kinds.
    """
    if not (late := picture.not_ready):
        return {}
    mentions = find_mentions(world, link_names(world, text), picture.tracks)
    named = {mention.means for mention in mentions if mention.sort == "asset"}
    every = any(mention.sort == "number" and mention.means == "all" for mention in mentions)
    kinds = {mention.means for mention in mentions if mention.sort == "kind"} or {*PLAIN_KINDS}
    needed = {name for name in late if name in named}
    teams = [] if named else [kinds] if len(kinds) == len(PLAIN_KINDS) else [{k} for k in kinds]
    for team in teams:
        able = [n for n in picture.assets if world.assets[n].kind in team]
        if every or not any(picture.assets[n].available and n not in late for n in able):
            needed.update(name for name in able if name in late)
    return {name: why for name, why in late.items() if name in needed}


def within_capability(reading: Reading, world: World) -> Reading:
    """Return `reading` with each task that its assets cannot do replaced by what they can do.

    A drone that is to identify or warn observes instead, and an asset of another kind does the
    task. A ground asset that is to observe goes to the place. A block is left to an asset that can
    block. If the other assets must stay, none of them replaces the asset.
    """
    asks = (
        capable for ask in reading.asks for capable in _capable(ask, world, reading.others_stay)
    )
    return reading._replace(asks=tuple(asks))


def _capable(ask: Ask, world: World, others_stay: bool) -> Iterator[Ask]:
    """Yield `ask`, or its replacements if no asset of its kinds has the command."""
    team = ask.who
    kinds: set[AssetKind] = {world.assets[n].kind for n in team.names if n in world.assets}
    if team.kind is not None:
        kinds.add(team.kind)
    if not kinds or ask.task not in VERB_FOR or any(can_do(kind, ask.task) for kind in kinds):
        yield ask
        return
    if ask.task == "look":
        yield replace(ask, task="go")
    elif ask.task != "block" and kinds == {"uav"}:
        yield replace(ask, task="look", track="", track_id="")
    if ask.task != "look" and not others_stay:
        yield replace(ask, who=ANYBODY)


def post_of(moves: PlanMoves, ask: Ask) -> str:
    """Return the place to take over: the named place, or the post of the leaving asset."""
    return ask.place or (moves.post(ask.leaving) if ask.leaving else "")


@dataclass(frozen=True)
class PlanForOrder:
    """A plan, and the asks of its order that can be carried out."""

    moves: PlanMoves
    due: tuple[Ask, ...]
    others_stay: bool
    watched: frozenset[str] = frozenset()
    """The places of asks that no asset can carry out, which may be observed instead (CAP-10)."""

    def spare(self, ask: Ask, kind: AssetKind | None = None) -> list[str]:
        """Return the free assets, of `kind` if given, that carry out no other ask.

        If `ask` names an origin, only assets posted there are returned.
        """
        moves, others = self.moves, [other for other in self.due if other != ask]
        return [
            name
            for name in moves.free(kind)
            if is_of(moves, name, ask)
            and not moves.takes_over(name)
            and not (name in moves.moved and any(_carries_out(moves, name, w) for w in others))
        ]

    def can_deal(self, ask: Ask) -> bool:
        """Return whether an asset could observe the place of `ask` or deal with a contact there.

        A drone can if it is at the place or can be spared. A robot can as well, once every track at
        the place has been observed (WF-02).
        """
        moves, tracks = self.moves, self.moves.tracks(ask.place)
        seen = bool(tracks) and all(track.observed for track in tracks)
        kinds: tuple[AssetKind, ...] = ("uav", "robot") if seen else ("uav",)
        if any(moves.there(ask.place, kind) for kind in kinds):
            return True
        return not self.others_stay and any(self.spare(ask, kind) for kind in kinds)


def is_of(moves: PlanMoves, name: str, ask: Ask) -> bool:
    """Return whether `name` is posted at the origin that `ask` names; True without an origin."""
    return ask.who.origin in ("", moves.post(name))


def may_move(moves: PlanMoves, name: str, ask: Ask) -> bool:
    """Return whether the asset `name` may move for `ask`."""
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
    """Return whether the asset `name` carries out `ask`, rather than only observing (WF-02)."""
    kind = moves.kind(name)
    is_asked_for = name in ask.who.names or ask.who.kind in (None, kind)
    return (
        may_move(moves, name, ask)
        and (name == ask.leaving or is_asked_for)
        and can_do(kind, ask.task)
    )


class Unmet(NamedTuple):
    """A part of an order that a plan leaves out, and the reason."""

    words: str
    fulfilled: bool = False
    """True if the part is already fulfilled."""


def unmet_asks(moves: PlanMoves, reading: Reading, text: str) -> tuple[Unmet, ...]:
    """Return each task of `reading` that is not fully carried out, with the reason.

    `text` is the original order. If it asks for all assets, and not only for the free ones, the
    result names the assets that stay.
    """
    world, before = moves.world, moves.before
    due = tuple(ask for ask in reading.asks if not obstacle_to(ask, world, before))
    case = PlanForOrder(moves, due, reading.others_stay)
    every = not _ONLY_FREE.search(text.lower())
    parts = (
        Unmet(f"{ask.words}: {why}", so)
        for ask in reading.asks
        for why, so in _unmet(case, ask, every=every)
        if why
    )
    return tuple({part.words: part for part in parts}.values())


def _unmet(case: PlanForOrder, ask: Ask, *, every: bool) -> Iterator[tuple[str, bool]]:
    """Yield reasons why `ask` is not carried out, each with True if `ask` is already fulfilled."""
    there = _there_already(case.moves, ask)
    why = _why(case, ask)
    yield why or there, not why
    if every and not why:
        yield ", ".join(_left(case.moves, ask)), False


def _there_already(moves: PlanMoves, ask: Ask) -> str:
    """Return in words which assets are already at the place of `ask`; '' if the plan sends any."""
    if ask.task != "go" or obstacle_to(ask, moves.world, moves.before):
        return ""
    if ask.who.names:
        there = [n for n in ask.who.names if _is_there(moves, n, ask)]
    else:
        there = [] if moves.sent(ask.place, ask.who.kind) else _standing(moves, ask)
    return f"{', '.join(there)} there already" if there else ""


def _is_there(moves: PlanMoves, name: str, ask: Ask) -> bool:
    post = moves.post(name) if name in moves.world.assets else ""
    return post == ask.place and name not in moves.moved


def _left(moves: PlanMoves, ask: Ask) -> Iterator[str]:
    """Yield why each asset that stays is not moved, although the order asks for all assets."""
    if ask.who.count != "all" or ask.task not in ("go", "mass", "home"):
        return
    place = moves.world.base if ask.task == "home" else ask.place
    for name, asset in moves.before.assets.items():
        concerned = ask.who.kind in (None, asset.kind) and is_of(moves, name, ask)
        if not concerned or place in (moves.ends(name), moves.post(name)):
            continue
        if why := unfit(name, ask, moves.world, moves.before):
            yield why
        elif name in moves.alone:
            yield f"{name} covers {moves.post(name)} alone (WF-03)"
        else:
            yield f"{name} stays"


def _why(case: PlanForOrder, ask: Ask) -> str:
    moves = case.moves
    if why := obstacle_to(ask, moves.world, moves.before):
        return why
    if ask.task in _MEETS and not moves.tracks(ask.place):
        return "nobody is in sight there"
    if ask.who.names:
        return ", ".join(_kept(moves, ask))
    if ask.task not in _GOES:
        return ""
    team, sent = ask.who, len(moves.sent(ask.place, ask.who.kind))
    if ask.task == "go" and team.count != "all" and 0 < sent < team.count:
        return f"no more than {sent} can be spared"
    return "" if _begun(moves, ask) or case.spare(ask, _needed(ask)) else "nobody can be spared"


def _kept(moves: PlanMoves, ask: Ask) -> Iterator[str]:
    """Yield the reasons why assets that `ask` names do not do their part."""
    for name in ask.who.names:
        post = moves.post(name) if name in moves.world.assets else ""
        if why := unfit(name, ask, moves.world, moves.before):
            yield why
        elif ask.task in _GOES and name in moves.alone and moves.ends(name) == post != ask.place:
            yield f"{name} covers {post} alone"


def _begun(moves: PlanMoves, ask: Ask) -> bool:
    """Return whether an asset acts for `ask`, or an asset that it needs is already at its place."""
    acting = (a.agent for a in moves.plan.actions if a.verb not in STILL)
    return bool(_standing(moves, ask)) or any(may_move(moves, name, ask) for name in acting)


def _standing(moves: PlanMoves, ask: Ask) -> list[str]:
    """Return the assets at the place of `ask` that are of the kind that it needs."""
    place = moves.world.base if ask.task == "home" else post_of(moves, ask)
    kind = _needed(ask)
    kinds: tuple[AssetKind, ...] = (kind,) if kind else ("uav", "ugv", "robot")
    return [name for kind in kinds for name in moves.there(place, kind)]


def _needed(ask: Ask) -> AssetKind | None:
    """Return the kind of asset that has to be free for `ask`; None if any kind will do."""
    if ask.task in _LOOKS:
        return "uav"
    return "ugv" if ask.task == "block" else ask.who.kind

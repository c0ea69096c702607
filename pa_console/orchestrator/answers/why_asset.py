"""The reasons for an asset's part in a plan: order, rules and the picture of that time.

The planner gives no reason for its choice. So the facts that bear on it are shown, and if a nearer
asset was free, that the record does not say why it was not taken.
"""

from collections.abc import Iterator, Sequence

from pa_console.language.world_names import named
from pa_console.orchestrator.answers.asset_facts import (
    against,
    distance_m,
    goal_of,
    is_able,
    may_leave,
    who_is_able,
)
from pa_console.orchestrator.answers.planned import actions_of, asked_of, kind_asked_for
from pa_console.schema.command import COMMANDS
from pa_console.schema.events.questions import AnswerLine
from pa_console.schema.plan import Action
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import KINDS, PLAIN_KINDS, World
from pa_console.session.state.mission_trace import Attempt, MissionTrace
from pa_console.session.wording import order_in_words

MOST_ASSETS = 6
"""The number of assets of a plan that are described one by one; the rest are counted."""
_MOST_NEARER = 3
_CLOSE_M = 1.0
"""Two that are so little apart are equally near, in metres."""


def asset_lines(
    trace: MissionTrace, attempt: Attempt, world: World, only: Sequence[str] = ()
) -> Iterator[AnswerLine]:
    """Yield a line for each asset of the plan, of those in `only` where that names any."""
    actions = [a for a in actions_of(attempt) if a.agent in world.assets]
    chosen = [each for each in actions if not only or each.agent in only]
    for action in chosen[:MOST_ASSETS]:
        said = "; ".join((order_in_words(action), *_reasons(trace, attempt, action, world)))
        yield AnswerLine(about=action.agent, said=said)
    if len(chosen) > MOST_ASSETS:
        yield AnswerLine(about="and", said=f"{len(chosen) - MOST_ASSETS} more in the plan")


def not_in_plan(attempt: Attempt, names: Sequence[str]) -> bool:
    """Return whether none of `names` has a part in the plan."""
    return not {action.agent for action in actions_of(attempt)} & set(names)


def _reasons(trace: MissionTrace, attempt: Attempt, action: Action, world: World) -> Iterator[str]:
    """Yield what bears on who has this action, the strongest first."""
    name = action.agent
    if attempt.author == "operator":
        yield "the operator has put it into the plan"
    meant = [one.said for one in trace.references if name in one.means.split(", ")]
    if meant:
        yield f"“{meant[0]}” means it"
    elif named([name], trace.mission.text):
        yield "the order names it"
    if len(COMMANDS[action.verb].kinds) < len(KINDS):
        yield who_is_able(action)
    before = attempt.rehearsal.before if attempt.rehearsal is not None else None
    if before is not None and goal_of(action, world):
        yield from _nearness(trace, attempt, action, world, before)
    if attempt.rehearsal is not None:
        arrived_s = attempt.rehearsal.motion.arrived_s.get(name)
        if arrived_s:
            yield f"there after {arrived_s:.0f} s in the rehearsal"


def _nearness(
    trace: MissionTrace, attempt: Attempt, action: Action, world: World, before: Picture
) -> Iterator[str]:
    """Yield the asset's rank by distance among the able ones, and what kept the nearer ones."""
    name, place = action.agent, goal_of(action, world)
    own_m = distance_m(name, action, world, before)
    if own_m is None:
        return
    kind = kind_asked_for(asked_of(trace, attempt), action, world)
    planned = {each.agent for each in actions_of(attempt)}
    others = [
        each
        for each, spec in world.assets.items()
        if each not in planned and is_able(each, action, world) and kind in (None, spec.kind)
        if each in before.assets and not _stands_at(each, place, before)
    ]
    nearer = sorted(
        (other_m, each)
        for each in others
        if (other_m := distance_m(each, action, world, before)) is not None
        and other_m < own_m - _CLOSE_M
    )
    what = PLAIN_KINDS[kind] if kind is not None else "asset"
    free = [each for _, each in nearer if may_leave(each, before)]
    if may_leave(name, before) and not free:
        yield f"the nearest free {what}, {own_m:.0f} m away"
    else:
        yield f"{own_m:.0f} m away"
    for other_m, other in nearer[:_MOST_NEARER]:
        why = against(other, before)
        free_too = "and was free: nothing on record says why it was not taken"
        told = f"but {', '.join(why)}" if why else free_too
        yield f"{other} is nearer, {other_m:.0f} m, {told}"
    if len(nearer) > _MOST_NEARER:
        yield f"{len(nearer) - _MOST_NEARER} more are nearer"


def _stands_at(name: str, place: str, picture: Picture) -> bool:
    """Return whether an asset is at the place that the action leads to."""
    asset = picture.assets[name]
    return place in (asset.post, asset.at)

"""Findings in words, and findings about plans that cannot be started, such as unknown names.

Findings about plans concern the vocabulary, so they have an id of their own, and no rule file can
disable them. The plan itself is returned as it is: nothing is dropped or repaired.
"""

from collections import Counter
from collections.abc import Iterable
from itertools import combinations

from pa_console.schema.command import COMMANDS
from pa_console.schema.finding import Finding, FindingStatus
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rule import Rule
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World

MAX_OFFENDERS = 6
MAX_ERROR = 200

STRUCTURE_ID = "PLAN"
ORDER_ID = "ORDER"
"""The id of a finding about an action that the words of an order rule out."""


def finding(rule: Rule, status: FindingStatus, message: str = "") -> Finding:
    """Return the finding of `rule`."""
    return Finding(rule_id=rule.id, priority=rule.priority, status=status, message=message)


def undecided(rule: Rule, problem: str) -> Finding:
    """Return the finding of a rule whose check could not decide; it counts as broken."""
    words = " ".join(problem.split())[:MAX_ERROR]
    return finding(rule, "error", f"the check could not decide: {words}")


def violation(message: str, offenders: Iterable[str]) -> str:
    """Return `message` followed by the distinct offenders, at most MAX_OFFENDERS of them."""
    distinct = [name for name in dict.fromkeys(offenders) if name]
    if not distinct:
        return message
    more = len(distinct) - MAX_OFFENDERS
    listed = ", ".join(distinct[:MAX_OFFENDERS]) + (f" and {more} more" if more > 0 else "")
    return f"{message}: {listed}"


def problems(plan: Plan, world: World, picture: Picture) -> tuple[Finding, ...]:
    """Return a critical finding for each problem that keeps `plan` from being rehearsed."""
    texts = [text for action in plan.actions for text in _problems(action, world, picture)]
    texts += _at_once(plan)
    return tuple(
        Finding(rule_id=STRUCTURE_ID, priority="critical", status="violates", message=text)
        for text in dict.fromkeys(texts)
    )


def _at_once(plan: Plan) -> Iterable[str]:
    """Yield a problem for each agent with several commands but no order between them."""
    several = [agent for agent, count in Counter(plan.agents).items() if count > 1]
    for agent in several:
        own = [number for number, name in enumerate(plan.agents, start=1) if name == agent]
        if len(plan.steps) == 1:
            yield f"{agent} has {len(own)} commands, at most one is allowed"
            continue
        for first, second in combinations(own, 2):
            if second not in plan.depends_on((first,)) and first not in plan.depends_on((second,)):
                yield (
                    f"{agent} is needed twice at once, by actions {first} and {second}: "
                    "let one of them come after the other"
                )


def _problems(action: Action, world: World, picture: Picture) -> Iterable[str]:
    spec = world.assets.get(action.agent)
    kinds = COMMANDS[action.verb].kinds
    if spec is None or action.agent not in picture.assets:
        yield f"agent {action.agent!r} does not exist; known: {', '.join(world.assets)}"
    elif spec.kind not in kinds:
        able = " or ".join(sorted(kinds))
        yield f"{action.agent} is a {spec.kind}; only a {able} can {action.verb}"
    elif picture.assets[action.agent].manual:
        yield f"{action.agent} is under manual control; name another asset, or give it back first"
    if action.target is not None and action.target not in world.frames:
        yield f"frame {action.target!r} does not exist; known: {', '.join(world.frames)}"

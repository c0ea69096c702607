"""Decides every rule in force by its CEL check (paper, Section IV-F; deterministic safeguards).

A check must hold. It yields either true or false, or a list of texts that name the offenders:
the rule holds when the list is empty, and otherwise the message is followed by those texts. A
check that fails to run decides nothing, so its finding is an error, which counts as broken.
"""

from collections.abc import Sequence
from typing import Any, cast

import cel

from pa_console.policy.context import mission_variables, plan_variables
from pa_console.policy.expression import make_context
from pa_console.policy.rulebook import CompiledRule, Rulebook
from pa_console.schema.finding import Finding, FindingStatus
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.world import World

MAX_OFFENDERS = 6
MAX_ERROR = 200


def check_plan(
    rulebook: Rulebook, *, plan: Plan, rehearsal: Rehearsal, mission: Mission, world: World
) -> tuple[Finding, ...]:
    """Return exactly one finding for every rule in force, in the rulebook's order."""
    variables = plan_variables(plan, rehearsal, mission, world)
    context = make_context({name: variables[name] for name in rulebook.variables})
    return tuple(_decide(entry, context) for entry in rulebook.compiled)


def check_mission(rulebook: Rulebook, mission: Mission, world: World) -> tuple[Finding, ...]:
    """Return a finding for every rule that the mission's words alone decide (step 1)."""
    context = make_context(mission_variables(mission, world))
    return tuple(_decide(entry, context) for entry in rulebook.compiled if entry.about_mission_only)


def check_rule(
    entry: CompiledRule, *, plan: Plan, rehearsal: Rehearsal, mission: Mission, world: World
) -> Finding:
    """Return the finding for one rule alone."""
    variables = plan_variables(plan, rehearsal, mission, world)
    return _decide(entry, make_context(variables))


def _decide(entry: CompiledRule, context: cel.Context) -> Finding:
    """Run guard, then check; anything but a clear answer is an error."""
    if entry.check is None:
        return _finding(entry, "judged_only")
    try:
        applies: Any = True if entry.applies is None else entry.applies.evaluate(context)
        if applies is False:
            return _finding(entry, "not_applicable")
        if applies is not True:
            return _error(entry, f"its guard yields {applies!r}, not true or false")
        result: Any = entry.check.evaluate(context)
    except Exception as error:  # whatever CEL or a function of ours runs into: nothing is decided
        return _error(entry, f"{type(error).__name__}: {error}")
    if result is True or result == []:
        return _finding(entry, "complies")
    if result is False:
        return _finding(entry, "violates", entry.rule.message)
    if isinstance(result, list):
        offenders = cast("list[Any]", result)
        if all(isinstance(offender, str) for offender in offenders):
            return _finding(entry, "violates", f"{entry.rule.message}: {_listed(offenders)}")
    return _error(entry, f"it yields {result!r}, neither true, false nor a list of texts")


def _listed(offenders: Sequence[str]) -> str:
    distinct = list(dict.fromkeys(offenders))
    more = len(distinct) - MAX_OFFENDERS
    return ", ".join(distinct[:MAX_OFFENDERS]) + (f" and {more} more" if more > 0 else "")


def _error(entry: CompiledRule, problem: str) -> Finding:
    words = " ".join(problem.split())[:MAX_ERROR]
    return _finding(entry, "error", f"the check could not decide: {words}")


def _finding(entry: CompiledRule, status: FindingStatus, message: str = "") -> Finding:
    rule = entry.rule
    return Finding(rule_id=rule.id, priority=rule.priority, status=status, message=message)

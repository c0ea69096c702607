"""The decision on every rule in force by its CEL check (paper, Section IV-F).

The rule holds if its check yields true or an empty list. Otherwise the check yields false or a list
of texts that name the offenders; the texts are appended to the rule's message. A check that fails
to run decides nothing: its finding is an error, which counts as broken. A rule's orderings must
hold as well, over the mission so far and then over the rehearsed plan.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, cast

import cel

from pa_console.policy.expressions.deadlines import shared_deadline
from pa_console.policy.expressions.expression import make_context
from pa_console.policy.findings import finding, undecided, violation
from pa_console.policy.monitor import Monitor
from pa_console.policy.rule_variables import (
    Sightings,
    Values,
    mission_variables,
    mission_words,
    plan_variables,
    reworded,
)
from pa_console.policy.rulebook import CompiledRule, Rulebook
from pa_console.schema.finding import Finding
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.rule import PRIORITIES
from pa_console.schema.world import World

CHECKS_S = 1.0
"""Seconds of processor time for all checks of one plan, or of one mission, together."""


def check_plan(
    rulebook: Rulebook,
    *,
    plan: Plan,
    rehearsal: Rehearsal,
    mission: Mission,
    world: World,
    monitor: Monitor | None = None,
) -> tuple[Finding, ...]:
    """Return exactly one finding for every rule in force, in the rulebook's order.

    `monitor` has followed the mission so far and is not changed. Without it, the mission begins
    with this plan, and no track was seen before.
    """
    return prepare_checks(
        rulebook, plan=plan, rehearsal=rehearsal, mission=mission, world=world, monitor=monitor
    )()


def prepare_checks(
    rulebook: Rulebook,
    *,
    plan: Plan,
    rehearsal: Rehearsal,
    mission: Mission,
    world: World,
    monitor: Monitor | None = None,
) -> Callable[[], tuple[Finding, ...]]:
    """Return a function that does the work of `check_plan` and that any thread may call.

    All data that changes during a mission is read now, none of it later. Work that a rule file can
    make slow is left to the function, so that neither the screen nor a stop waits for it.
    """
    history = Monitor(rulebook, world) if monitor is None else monitor
    variables = plan_variables(plan, rehearsal, mission, world, rulebook.reads, history.sightings)
    ahead = history.copy(running_limits=False)
    picture = rehearsal.before
    size = len(picture.assets) + len(picture.tracks) + len(picture.gates)

    def run() -> tuple[Finding, ...]:
        contexts = _contexts(variables, mission, rulebook.parts)
        with shared_deadline(CHECKS_S, size):
            broken = _broken_orderings(ahead, rehearsal)
            return tuple(
                _combine(
                    _both([_decide_all(part, contexts) for part in entry.parts]),
                    broken.get(entry.rule.id),
                )
                for entry in rulebook.compiled
            )

    return run


def check_mission(rulebook: Rulebook, mission: Mission, world: World) -> tuple[Finding, ...]:
    """Return a finding for every rule that is decided by the mission's words alone (step 2)."""
    contexts = _contexts(mission_variables(mission, world), mission, rulebook.parts)
    with shared_deadline(CHECKS_S):
        return tuple(
            _both([_decide_all(part, contexts) for part in parts])
            for entry in rulebook.compiled
            if (parts := [part for part in entry.parts if part.about_mission_only])
        )


def check_rule(
    entry: CompiledRule,
    *,
    plan: Plan,
    rehearsal: Rehearsal,
    mission: Mission,
    world: World,
    sightings: Sightings | None = None,
) -> Finding:
    """Return the finding of one rule's guard and check alone."""
    variables = plan_variables(plan, rehearsal, mission, world, entry.reads, sightings)
    return _decide_all(entry, _contexts(variables, mission, (entry,)))


def _broken_orderings(ahead: Monitor, rehearsal: Rehearsal) -> Mapping[str, Finding]:
    """Return, by rule id, the findings of orderings that the rehearsed plan would break.

    `ahead` is a copy of the monitor that may be advanced. Breaches at the rehearsal's first moment,
    before any command, are not caused by the plan.
    """
    by_rule: dict[str, Finding] = {}
    moments = list(rehearsal.moments)
    if moments:
        end_s = max(rehearsal.after.time_s, moments[-1].time_s)
        moments.append(moments[-1].model_copy(update={"time_s": end_s}))
    for number, now in enumerate(moments):
        for new in ahead.observe(now):
            if number == 0 and new.status != "error":
                continue
            earlier = by_rule.get(new.rule_id)
            by_rule[new.rule_id] = new if earlier is None else _worse(earlier, new)
    return by_rule


def _contexts(
    variables: Values, mission: Mission, parts: Iterable[CompiledRule]
) -> list[cel.Context]:
    """Return the contexts for the checks `parts`: one for each way to read `mission`.

    Other ways to read the words matter only to rules about the mission, so their contexts have only
    the variables of these rules.
    """
    contexts = [make_context(variables)]
    if "mission" in variables:
        read = frozenset(("mission",)).union(
            *(part.variables for part in parts if "mission" in part.variables)
        )
        spoken = {name: value for name, value in variables.items() if name in read}
        words = mission_words(mission)[1:]
        contexts += (make_context(reworded(spoken, other)) for other in words)
    return contexts


def _decide_all(entry: CompiledRule, contexts: Sequence[cel.Context]) -> Finding:
    """Decide a rule for every way to read the mission, if the rule reads it; the worst counts."""
    first, *others = contexts
    finding = _decide(entry, first)
    for context in others if "mission" in entry.variables else ():
        other = _decide(entry, context)
        if other.broken and not finding.broken:
            finding = other
    return finding


def _decide(entry: CompiledRule, context: cel.Context) -> Finding:
    """Run the guard, then the check; any unclear result is an error."""
    rule = entry.rule
    if entry.check is None:
        return finding(rule, "complies" if rule.decidable else "judged_only")
    try:
        applies: Any = True if entry.applies is None else entry.applies.evaluate(context)
        if applies is False:
            return finding(rule, "not_applicable")
        if applies is not True:
            return undecided(rule, f"its guard yields {applies!r}, not true or false")
        result: Any = entry.check.evaluate(context)
    except Exception as error:  # whatever CEL or our own functions raise: nothing is decided
        return undecided(rule, f"{type(error).__name__}: {error}")
    if result is True or result == []:
        return finding(rule, "complies")
    if result is False:
        return finding(rule, "violates", rule.message)
    if isinstance(result, list):
        offenders = cast("list[Any]", result)
        if all(isinstance(offender, str) for offender in offenders):
            return finding(rule, "violates", violation(rule.message, offenders))
    return undecided(rule, f"it yields {result!r}, neither true, false nor a list of texts")


def _both(findings: Sequence[Finding]) -> Finding:
    """Return one finding for a rule and the core's rule of the same id; the stricter wins."""
    broken = [finding for finding in findings if finding.broken]
    if len(broken) < 2:
        decided = [finding for finding in findings if finding.status == "complies"]
        return (*broken, *decided, *findings)[0]
    return _worse(*broken)


def _combine(state: Finding, order: Finding | None) -> Finding:
    """Return one finding for a rule from its check and its orderings."""
    if order is None:
        return state
    return _worse(state, order) if state.broken else order


def _worse(first: Finding, second: Finding) -> Finding:
    """Return both as one finding: an error outweighs a violation; each message appears once."""
    status = "error" if "error" in (first.status, second.status) else "violates"
    message = "; ".join(dict.fromkeys((first.message, second.message)))
    priority = min(first.priority, second.priority, key=PRIORITIES.index)
    return first.model_copy(update={"status": status, "message": message, "priority": priority})

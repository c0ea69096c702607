"""The reasons for a plan, or for its absence: the record of a mission, step by step."""

from collections.abc import Iterator

from pa_console.language.plain_words import plain_reading
from pa_console.orchestrator.answers.planned import asked_of, attempt_of
from pa_console.orchestrator.answers.why_asset import asset_lines
from pa_console.schema.events.questions import AnswerLine
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.text.quantities import count, few
from pa_console.schema.world import World
from pa_console.session.state.mission_trace import Attempt, MissionTrace
from pa_console.session.wording import deviations_in_words, order_in_words
from pa_console.views.event_words import asked_in_words, references_in_words, standing_in_words
from pa_console.views.status_words import status_of
from pa_console.views.trace.layout import progress

_MOST_RULES = 8
_MOST_BROKEN = 4


def _line(about: str, said: str) -> AnswerLine:
    return AnswerLine(about=about, said=said)


def plan_lines(trace: MissionTrace, world: World) -> Iterator[AnswerLine]:
    """Yield all that bears on the plan of a mission, or on there being none."""
    yield from order_lines(trace)
    attempt = attempt_of(trace)
    if attempt is not None:
        yield from _reading(trace, attempt)
    yield from rule_lines(trace)
    if attempt is not None:
        yield from asset_lines(trace, attempt, world)
        yield from _not_used(trace, attempt)
        yield from checked_lines(attempt)
    else:
        yield from _without_plan(trace)
    yield from end_lines(trace)


def order_lines(trace: MissionTrace) -> Iterator[AnswerLine]:
    """Yield the words of the mission, who gave it, and how they were put in full."""
    mission = trace.mission
    origin = "an alarm gave it: " if mission.source == "alarm" else ""
    if mission.standing:
        origin = f"standing order {mission.standing} gave it: "
    yield _line("order", f"{mission.id}, {origin}{mission.said}")
    if mission.typed and mission.typed != mission.text:
        meant = references_in_words(trace.references)
        yield _line("put in full", f"{mission.text}{f' ({meant})' if meant else ''}")
    for asked in trace.questions:
        choices = f" {' or '.join(asked.choices)}" if asked.choices else ""
        yield _line("asked back", f"{asked.question}{choices}")


def _reading(trace: MissionTrace, attempt: Attempt) -> Iterator[AnswerLine]:
    """Yield what the order was read as, how sure that is, and what of it no plan can do."""
    if asked := asked_of(trace, attempt):
        yield _line("read as", plain_reading(asked))
    if attempt.sure is not None:
        yield _line("how sure", f"{attempt.sure:.0%}")
    again = attempt.read_again
    if again is not None and again.asked:
        yield _line("second reader", plain_reading(again.asked))
    for gap in attempt.gaps:
        yield _line("doubt", gap)
    for unmet in attempt.unmet:
        yield _line("left out", unmet)


def rule_lines(trace: MissionTrace) -> Iterator[AnswerLine]:
    """Yield the rules in the planner's prompt, each as retrieved or pinned."""
    pinned = [hit.rule_id for hit in trace.hits if hit.pinned]
    found = [hit.rule_id for hit in trace.hits if not hit.pinned]
    if found:
        yield _line("rules", f"retrieved for these words: {few(found, _MOST_RULES)}")
    if pinned:
        yield _line("rules", f"always told: {few(pinned, _MOST_RULES)}")


def _not_used(trace: MissionTrace, chosen: Attempt) -> Iterator[AnswerLine]:
    """Yield the plans that were proposed for it and not used, with the rule that held each."""
    for attempt in trace.attempts:
        if attempt is chosen or attempt.round != chosen.round or attempt.plan is None:
            continue
        broken = [f"{f.rule_id}: {f.message}" for f in attempt.findings if f.broken]
        objected = attempt.verdict is not None and attempt.verdict.verdict == "Failure"
        why = broken[:_MOST_BROKEN] or (["the judge objected"] if objected else [])
        if why:
            orders = ", ".join(f"{a.agent} {order_in_words(a)}" for a in attempt.plan.actions)
            yield _line("not used", f"plan {attempt.number} ({orders}): {'; '.join(why)}")


def checked_lines(attempt: Attempt) -> Iterator[AnswerLine]:
    """Yield the results of checks, rehearsal and judge for a plan."""
    if attempt.findings:
        broken = [f for f in attempt.findings if f.broken]
        checked = [f for f in attempt.findings if f.status == "complies"]
        if not broken:
            yield _line("checks", f"no rule is broken; {count(len(checked), 'rule')} applied")
        for finding in broken[:_MOST_BROKEN]:
            worst = "nobody may approve it" if finding.blocking else "a warning"
            yield _line("checks", f"{finding.rule_id} ({worst}): {finding.message}")
        if len(broken) > _MOST_BROKEN:
            yield _line("checks", f"{len(broken) - _MOST_BROKEN} more rules are broken")
    if attempt.rehearsal is not None:
        yield _line("rehearsal", rehearsed_in_words(attempt.rehearsal))
    if attempt.verdict is not None:
        passes = attempt.verdict.verdict == "Success"
        said = "passes it" if passes else f"objects: {attempt.verdict.feedback}"
        yield _line("judge", said)
    elif attempt.judged:
        yield _line("judge", f"gave no verdict: {attempt.judge_error}".rstrip(": "))


def rehearsed_in_words(rehearsal: Rehearsal) -> str:
    """Return what a rehearsal has shown: how long it takes, the guards of gates, who comes late."""
    timeline = rehearsal.timeline
    told = [f"over after {timeline.duration_s:.0f} s"]
    gates = timeline.gates.items()
    lost = [name for name, gate in gates if gate.covered_before and not gate.covered_after]
    bare = [
        f"{name} without a guard for {gate.longest_gap_s:.0f} s on the way"
        for name, gate in gates
        if name not in lost and gate.covered_before and gate.longest_gap_s >= 1.0
    ]
    gained = [name for name, gate in gates if gate.covered_after and not gate.covered_before]
    told += [f"{', '.join(lost)} lost its guard"] if lost else []
    told += bare
    told += [f"{', '.join(gained)} got a guard"] if gained else []
    if not lost and not bare:
        told.append("every gate kept its guard")
    told += [
        f"{name} did not finish: {asset.detail}"
        for name, asset in timeline.assets.items()
        if not asset.finished
    ]
    return "; ".join(told)


def _without_plan(trace: MissionTrace) -> Iterator[AnswerLine]:
    """Yield why there is no plan, as far as that is on record."""
    if trace.standing is not None:
        yield _line("standing order", standing_in_words(trace.standing.order))
        yield _line("approval", asked_in_words(trace.standing.order, trace.standing.allowed))
        return
    attempt = trace.attempts[-1] if trace.attempts else None
    if attempt is not None:
        yield from checked_lines(attempt)
        if attempt.error:
            yield _line("planner", attempt.error)
    if trace.status is None and trace.approval is None:
        how = "".join(span.text for span in progress(trace))
        yield _line("no plan yet", how)


def end_lines(trace: MissionTrace) -> Iterator[AnswerLine]:
    """Yield what the operator decided, and what came of it."""
    request = trace.approval
    for made in trace.decisions:
        decision = made.decision
        done = status_of("decision", decision.kind).word
        if decision.kind == "answer":
            done = f"answered “{decision.asked}”"
        told = decision.standing or bool(deviations_in_words(decision))
        why = f": {decision.reason}" if decision.reason and not told else ""
        also = f"; {deviations_in_words(decision)}" if deviations_in_words(decision) else ""
        taken = "" if made.accepted else f", not accepted: {made.detail}"
        yield _line("decision", f"{done} by {decision.by}{why}{also}{taken}")
    if trace.voided:
        yield _line("void", trace.voided)
    if request is not None:
        state = status_of("approval", request.state or "none").word
        yield _line("decision", f"it waits for the operator: {state}")
        for why in request.blocked_by:
            yield _line("blocked", why)
    for halt in trace.halts:
        yield _line("halted", "; ".join(halt.reasons))
    if trace.status is not None:
        yield _line("outcome", f"{status_of('mission', trace.status).word}: {trace.reason}")

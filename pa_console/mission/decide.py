"""Step 7 of a mission: other readings of the order, and the operator's decision on the plan.

Only the operator knows for certain which reading of an order is right.
"""

from collections.abc import Awaitable, Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import islice

from pa_console.fleets.fleet import PlanCountersignature
from pa_console.language.canonical.clauses import ASKED, NOWHERE
from pa_console.language.canonical.order import STILL_TASKS
from pa_console.language.canonical.reading import distinct, read_asked
from pa_console.language.mention_check import check_mentions
from pa_console.language.references.resolution import MOST_CHOICES
from pa_console.mission.approval import (
    CheckedPlan,
    OrderAsRead,
    inadmissible,
    request_approval,
    unasked_decision,
    warnings,
)
from pa_console.mission.context import MissionContext, MissionResult
from pa_console.mission.execution.premises import ways_to_safety
from pa_console.mission.plan import Candidate, PlanForDecision, safeguards
from pa_console.mission.planning.propose import other_readings
from pa_console.mission.understand import NotUnderstood, StandingOffer
from pa_console.schema.events import event as ev
from pa_console.schema.events.event import MOST_READINGS
from pa_console.schema.finding import Finding
from pa_console.schema.mission import ELSEWHERE, Decision, MissionStatus, StandingOrder
from pa_console.schema.plan import Plan
from pa_console.schema.world import World
from pa_console.session.confidence import UNSURE

Decide = Callable[[], Awaitable[Decision]]
"""A function that waits for the operator's answer to a request."""


MORE_BELOW = 0.5
"""The confidence of planner or judge below which the planner is asked for other readings."""

_STILL = STILL_TASKS | {"refused"}
"""The tasks that move no asset."""

MOMENTS_SHOWN = 5
"""The number of moments of a timed order that are shown for its approval."""


@dataclass(frozen=True)
class Readings:
    """The reading of the proposed plan, and the others that are `offered`, the likeliest first."""

    own: str = ""
    """The reading of the proposed plan; '' if no other reading is offered."""
    offered: tuple[str, ...] = ()


@dataclass(frozen=True)
class AdmissibleDecision:
    """An admissible decision, the request that it answers, and the readings that were offered."""

    request: ev.ApprovalRequested
    decision: Decision
    readings: Readings = Readings()


@dataclass(frozen=True)
class ApprovedPlan:
    """The plan to execute, and the decision that approved it."""

    planned: PlanForDecision
    decided: AdmissibleDecision


async def decide(
    context: MissionContext, planned: PlanForDecision, before: Readings, answer: Decide
) -> AdmissibleDecision:
    """Request approval of a plan (step 7) until there is an admissible decision.

    The request offers other possible readings of the order, including those offered `before`.
    """
    shown, world = planned.best, context.services.fleet.world
    examination = shown.examination
    readings = await _reconsider(context, planned, before)
    baseless = "nothing in the order names what was read in it"
    request = request_approval(
        f"{context.mission.id}.{shown.attempt}",
        shown.attempt,
        CheckedPlan(examination.plan, examination.findings, shown.verdict, shown.judge_error),
        OrderAsRead(
            asked=readings.own,
            readings=readings.offered,
            gaps=shown.all_gaps,
            confidence=planned.confidence,
            read_apart=planned.read_apart,
            narrowed=shown.narrowed,
            question=f"{baseless}. What is to be done, by whom and where?"
            if shown.mentions.baseless
            else "",
        ),
        judging=context.services.variant.judging,
        if_halted=ways_to_safety(examination.plan, world, examination.before)
        if examination.before
        else (),
    )
    order = _standing_order(context)
    if request.state == "warned" and order is not None and order.unasked:
        anyway = await _broken_anyway(context, examination.findings)
        request = request.model_copy(update={"broken_anyway": anyway})
    return replace(await answered(context, request, answer), readings=readings)


async def _reconsider(
    context: MissionContext, planned: PlanForDecision, before: Readings
) -> Readings:
    """Return the readings to offer: first those of other readers, then others of the planner.

    The planner is asked for other readings only if a model is unsure. If the operator has chosen a
    reading, the order is not read again. For an order in steps, no other readings are offered.
    """
    looked_at, shown = context.services.variant.readings, planned.best
    if not looked_at or planned.steps or planned.by_grammar:
        return Readings()
    planner_reading = planned.answered.reading
    own = shown.asked or planner_reading
    candidates = [before.own, *before.offered] if before.offered else []
    if not planned.answered.retrieved.chosen:
        candidates = [reading.asked for reading in planned.readings] or [planner_reading]
        if shown.sure is not None and shown.sure < MORE_BELOW:
            candidates += await other_readings(context, planned.answered, looked_at)
    others = distinct(own, candidates, context.services.fleet.world.base)
    founded = (
        planner_reading
        for planner_reading in others
        if not _baseless(context, planned, planner_reading)
    )
    offered = tuple(islice(founded, MOST_READINGS))
    return Readings(own, offered) if offered else Readings()


async def answered(
    context: MissionContext, request: ev.ApprovalRequested, decide: Decide
) -> AdmissibleDecision:
    """Emit `request` and wait for an admissible decision by as many people as the rules require.

    An approval by too few people is kept, and signatures from other stations are added to it. In
    any case, the operator of this station must approve. If this station could not send the plan's
    commands, the plan is blocked.
    """
    gate, rules = context.services.gate, context.services.rulebook
    origin = {"approvals": gate.needed(request, rules), "proposed_by": context.mission.agent}
    request = request.model_copy(update=origin)
    if (problem := gate.objection(rules)) and request.state != "not_understood":
        blocked = (*request.blocked_by, problem)
        request = request.model_copy(update={"blocked_by": blocked, "state": "blocked"})
    context.emit(request)
    signatures: dict[str, str] = {}
    here: Decision | None = None
    unasked = _unasked(context, request)
    while True:
        with context.stopwatch.time("decision_s"):
            answer = unasked or await decide()
        unasked = None
        decision, elsewhere = gate.signed(request, answer, rules), bool(answer.signatures)
        if elsewhere and not _countersigns(request, decision, signatures):
            continue
        if decision.kind == "approve" and not inadmissible(request, decision):
            signatures.update(decision.signatures)
            if not elsewhere:
                here = decision
            elif here is not None:
                decision = here.model_copy(update={"by": f"{here.by}, {decision.by}"})
            decision = decision.model_copy(update={"signatures": signatures.copy()})
        problem = gate.inadmissible(request, decision, rules)
        if elsewhere and here is None:
            problem = problem or "the operator of this station has not approved it"
        context.emit(
            ev.DecisionMade(
                attempt=request.attempt, decision=decision, accepted=not problem, detail=problem
            )
        )
        if not problem:
            return AdmissibleDecision(request, decision)


def countersignature(signed: PlanCountersignature) -> Decision:
    """Return a signature from another station as an approval."""
    return Decision(
        kind="approve",
        request_id=signed.request_id,
        by=f"{signed.person} {ELSEWHERE}",
        reason=f"signed by {signed.person} {ELSEWHERE}",
        signatures={signed.person: signed.signature},
    )


def _countersigns(
    request: ev.ApprovalRequested, decision: Decision, before: Mapping[str, str]
) -> bool:
    """Return whether a decision from another station adds a signature that the request needs.

    `before` are the signatures so far.
    """
    same = decision.request_id == request.request_id
    return same and bool(request.approvals) and not before.keys() >= decision.signatures.keys()


def _unasked(context: MissionContext, request: ev.ApprovalRequested) -> Decision | None:
    """Return the decision of the standing order that started the mission; None if it makes none."""
    order = _standing_order(context)
    if order is None or request.state == "not_understood":
        return None
    return unasked_decision(order, request, context.services.rulebook.unasked)


def _standing_order(context: MissionContext) -> StandingOrder | None:
    """Return the standing order in force that started the mission; None if there is none."""
    standing = context.mission.standing
    return context.services.standing.find(standing) if standing else None


async def _broken_anyway(context: MissionContext, findings: Iterable[Finding]) -> tuple[str, ...]:
    """Return the warnings in `findings` that would be the same if no asset moved."""
    idle = await safeguards(context, context.mission, Plan(reason="no asset moves", actions=()))
    broken = {(finding.rule_id, finding.message) for finding in idle.findings if finding.broken}
    same = (finding for finding in findings if (finding.rule_id, finding.message) in broken)
    return tuple(warnings(same))


async def offer_standing(
    context: MissionContext, offered: StandingOffer, decide: Decide
) -> MissionResult:
    """Request approval of a standing order, and put it in force once an operator approves it.

    From then on, the standing order starts its missions and needs no further approval itself. The
    request is blocked if the order cannot be in force beside the others.
    """
    order, standing = offered.order, context.services.standing
    allowed = context.services.rulebook.unasked if order.unasked else ()
    schedule = order.schedule
    moments = tuple(schedule.moments(MOMENTS_SHOWN)) if schedule is not None else ()
    first_s: float | None = None
    if moments:
        ahead_s = (moments[0] - standing.time.now).total_seconds()
        first_s = max(context.services.fleet.time_s + ahead_s, 0.0)
    context.emit(
        ev.StandingOrderRead(
            order=order, now=offered.now, moments=moments, first_s=first_s, allowed=allowed
        )
    )
    refusal = standing.refusal(order)
    request = request_approval(
        f"{context.mission.id}.{order.id}",
        0,
        CheckedPlan(Plan(reason="a standing order moves nobody by itself", actions=())),
        OrderAsRead(),
        judging=False,
    ).model_copy(update={"standing": order})
    if refusal:
        request = request.model_copy(update={"blocked_by": (refusal,), "state": "blocked"})
    decided = await answered(context, request, decide)
    if decided.decision.kind != "approve":
        why = "; ".join(decided.request.blocked_by) or decided.decision.reason
        status: MissionStatus = "held" if decided.request.blocked_by else "rejected"
        return MissionResult(status, why or f"rejected by {decided.decision.by}")
    if refusal := standing.refusal(order):
        return MissionResult("held", refusal)
    order = standing.approve(offered.trigger)
    context.emit(ev.StandingOrderApproved(order=order, by=decided.decision.by))
    if order.once and order.schedule is not None:
        at = order.schedule.start
        return MissionResult("verified", f"{order.id} will run once at {at:%H:%M:%S}")
    return MissionResult("verified", f"standing order {order.id} is in force until it is revoked")


async def ask_back(
    context: MissionContext, question: NotUnderstood, number: int, decide: Decide
) -> str | MissionResult:
    """Ask the operator what the order means, and return the answer.

    `number` is the number of earlier questions about this mission. The request has no plan, so an
    answer approves nothing.
    """
    context.emit(
        ev.QuestionAsked(question=question.question, said=question.words, choices=question.choices)
    )
    request = request_approval(
        f"{context.mission.id}.0.{number}" if number else f"{context.mission.id}.0",
        0,
        CheckedPlan(Plan(reason="", actions=())),
        OrderAsRead(question=question.question),
    )
    decided = await answered(context, request, decide)
    if decided.decision.kind == "answer":
        return " ".join(decided.decision.asked.split())
    return MissionResult("held", "; ".join(decided.request.blocked_by))


def unknown_place(planned: PlanForDecision, world: World) -> NotUnderstood | None:
    """Return a question about an unknown place in the order; None if that is not its only fault.

    Each choice is the whole order with one of the site's places filled in. There are no choices if
    the reading names an asset that does not exist.
    """
    shown = planned.best
    reading = shown.asked.removeprefix(ASKED)
    if shown.own or reading.count(NOWHERE) != 1 or reading.startswith("if "):
        return None
    if len(planned.readings) > 1:  # another reader has named a place that exists
        return None
    if any(action.verb != "hold" for action in shown.examination.plan.actions):
        return None
    places = (*world.gates, *(name for name in world.frames if name not in world.gates))
    choices = tuple(reading.replace(NOWHERE, place) for place in places)
    parsed = read_asked(shown.asked)
    asks = parsed.asks if parsed is not None else ()
    named = {name for ask in asks for name in ask.who.names}
    offered = len(choices) <= MOST_CHOICES and named <= world.assets.keys()
    return NotUnderstood(
        "no place here is called that. Which one is meant?", choices=choices if offered else ()
    )


def unsettled(planned: PlanForDecision, question: NotUnderstood | None) -> NotUnderstood | None:
    """Return `question`, or None if the models have settled which assets the words describe.

    The models have settled it if the plan's reading is likely, no other reading is plausible, no
    word contradicts the reading, and the plan uses one of the question's choices.
    """
    if question is None:
        return None
    sure, reading = planned.confidence, read_asked(planned.best.asked)
    if sure is None or sure < UNSURE or planned.read_apart or reading is None:
        return question
    actions = planned.best.examination.plan.actions
    named = {name for action in actions for name in (action.agent, action.target)}
    fits = not question.choices or bool(named & {*question.choices})
    return None if fits and not planned.best.all_gaps else question


def rejection(shown: Candidate, decided: AdmissibleDecision) -> MissionResult:
    """Return the result of a mission whose plan was rejected."""
    blocked_by, decision = decided.request.blocked_by, decided.decision
    if shown.examination.blocked:
        return MissionResult("refused", "; ".join(blocked_by))
    if blocked_by:
        return MissionResult("held", "; ".join(blocked_by))
    return MissionResult("rejected", decision.reason or f"rejected by {decision.by}")


def _baseless(context: MissionContext, planned: PlanForDecision, reading_text: str) -> bool:
    """Return whether a reading moves an asset, but has no basis in the order's words."""
    reading, world = read_asked(reading_text), context.services.fleet.world
    if reading is None or all(ask.task in _STILL for ask in reading.asks):
        return False
    rehearsal = planned.best.examination.rehearsal
    before = rehearsal.before if rehearsal is not None else context.services.fleet.picture()
    task, nothing = planned.answered.retrieved.task, Plan(reason="", actions=())
    check = check_mentions(world, before, task.text, reading_text, nothing, follows=task.follows)
    return check.unfounded

"""Answers to the operator's questions about proposed and executed plans.

The facts come from the record, from the picture, and from checks and rehearsals like those of every
plan. No model is used, nothing is decided, and no command is sent.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from pa_console.language.questions import Question
from pa_console.mission.examine import CheckBasis
from pa_console.schema.events import event as ev
from pa_console.schema.events.intake import AnswerLine, QuestionAnswered
from pa_console.schema.telemetry import AssetTelemetry, Picture
from pa_console.schema.text import clock_text
from pa_console.session.mission_trace import Attempt, MissionTrace
from pa_console.session.state import SessionState
from pa_console.session.state_parts import Notice
from pa_console.session.wording import order_in_words
from pa_console.station.answers.alternatives import Alternative, find_alternatives
from pa_console.station.answers.why import (
    asset_lines,
    attempt_of,
    checked_lines,
    end_lines,
    not_in_plan,
    plan_lines,
    why_not_lines,
)

MOST_REMEMBERED = 50
"""The largest number of missions that are kept; a question is about the last one."""
IS_QUESTION = "this is a question: it is answered where it is asked, and does not become a mission"
NO_QUESTION = (
    "this question cannot be answered here; possible questions are Why?, Why ASSET?, Why not "
    "ASSET?, Why is nobody at GATE? and What would you do instead?"
)
_MOST_NOTICES = 4
_GATE_NOTICES = ("covered by ", "no longer covered", "cover unknown")
NOTHING_YET = "nothing has been ordered in this session yet"
NO_PLAN = "there is no plan for it"
NOW = "found in the current picture; this orders nothing"
NO_OTHER = "no other sound plan is known for this order"


class RecentRecord:
    """The state of a session according to its logged events, without old missions."""

    def __init__(self, state: SessionState) -> None:
        """Continue from `state`, which only the record may change from now on."""
        self.state = state

    def take(self, event: ev.Event) -> None:
        """Process one event; transient and unverified events are ignored."""
        if event.data.transient or isinstance(event.data, ev.UNVERIFIED):
            return
        self.state.apply(event)
        if isinstance(event.data, ev.MissionReceived):
            self._forget()

    def _forget(self) -> None:
        missions = self.state.missions
        over = [name for name, trace in missions.items() if trace.status is not None]
        kept = (self.state.active, self.state.last_active)
        for name in over[: max(len(missions) - MOST_REMEMBERED, 0)]:
            if name not in kept:
                del missions[name]


def gate_lines(state: SessionState, gate: str, dt_s: float) -> Iterator[AnswerLine]:
    """Yield the facts about the cover of a gate, from the picture and the events.

    `dt_s` is the duration of a tick, in seconds.
    """
    picture = state.picture
    cover = picture.gates.get(gate) if picture is not None else None
    if picture is None or cover is None:
        yield AnswerLine(about="now", said=f"there are no reports about {gate} yet")
        return
    if cover.covered:
        text = f"{gate} is covered: {', '.join(cover.by)} cover{'s' * (len(cover.by) == 1)} it"
    elif cover.unknown:
        text = f"it is not known whether {gate} is covered"
    else:
        text = f"no asset covers {gate}"
    yield AnswerLine(about="now", said=text)
    if not cover.covered and cover.uncovered_s > 0.0:
        last = max(picture.time_s - cover.uncovered_s, 0.0)
        for_s = f"it has had no guard for {cover.uncovered_s:.0f} s"
        yield AnswerLine(about="since", said=f"{clock_text(last)}: {for_s}")
    yield from _belongs(picture, gate, cover.by)
    yield from _sent_away(state, gate)
    for notice in _known_of(state, gate):
        at = clock_text(notice.tick * dt_s)
        yield AnswerLine(about="told", said=f"at {at}: {notice.text}")


def _belongs(picture: Picture, gate: str, guards: tuple[str, ...]) -> Iterator[AnswerLine]:
    """Yield a line for each asset that is or has its post at the gate but does not cover it."""
    for name, asset in picture.assets.items():
        if gate in (asset.post, asset.at) and name not in guards:
            yield AnswerLine(about=name, said=_how(asset, gate, picture.time_s))


def _how(asset: AssetTelemetry, gate: str, now_s: float) -> str:
    if asset.status == "failed":
        return f"was at {gate} and has failed" if asset.at == gate else "has failed"
    if asset.integrity == "suspect":
        return "its telemetry cannot be right"
    if asset.comms == "lost" or asset.stale:
        return f"has been silent for {now_s - asset.stamp_s:.0f} s"
    if asset.manual:
        return "is under manual control"
    if not asset.available:
        return "is not available"
    if asset.post == gate:
        return f"is on its way to {gate}: {asset.task}"
    return f"is at {gate}, on its way to {asset.post}" if asset.post else f"is at {gate}"


def _sent_away(state: SessionState, gate: str) -> Iterator[AnswerLine]:
    """Yield lines about the last mission that sent a guard of the gate elsewhere."""
    for trace in reversed([*state.missions.values()]):
        lines = [*_left_for(trace, gate)]
        if lines:
            yield from lines
            return


def _left_for(trace: MissionTrace, gate: str) -> Iterator[AnswerLine]:
    attempt = trace.find(trace.executing) if trace.executing else None
    if attempt is None or attempt.plan is None or attempt.rehearsal is None:
        return
    cover = attempt.rehearsal.before.gates.get(gate)
    for action in attempt.plan.actions:
        leaves = action.verb == "return_to_base" or action.target not in (None, gate)
        if cover is None or action.agent not in cover.by or not leaves:
            continue
        approved = [d.decision for d in trace.decisions if d.accepted and d.decision.settles]
        by = f", approved by {approved[-1].by}" if approved else ""
        text = f"covered it until {trace.mission.id} sent it away: {order_in_words(action)}{by}"
        yield AnswerLine(about=action.agent, said=text)


def _known_of(state: SessionState, gate: str) -> list[Notice]:
    """Return the last notices about the cover of the gate, the oldest first."""
    own = [n for n in state.notices if n.subject == gate and n.text.startswith(_GATE_NOTICES)]
    return own[-_MOST_NOTICES:]


@dataclass(frozen=True)
class QueryAnswer:
    """An answer, and the id of the mission that it is about; '' if it is not about a mission."""

    event: QuestionAnswered
    mission: str = ""


async def answer(
    basis: CheckBasis,
    question: Question,
    state: SessionState,
    show: Callable[[Alternative], object] = lambda _: None,
) -> QueryAnswer:
    """Return the answer to `question` in the session `state`.

    The answer is about the waiting plan, or else about the active or last mission. Each alternative
    is passed to `show` as soon as it is rehearsed.
    """
    trace = state.current
    if question.topic == "gate":
        lines = gate_lines(state, question.subjects[0], basis.fleet.world.dt_s)
        return QueryAnswer(_answered(question, [*lines]))
    if trace is None:
        return QueryAnswer(_answered(question, [AnswerLine(about="on record", said=NOTHING_YET)]))
    lines = await _about(basis, question, trace, show)
    return QueryAnswer(_answered(question, lines), trace.mission.id)


def _answered(question: Question, lines: list[AnswerLine]) -> QuestionAnswered:
    return QuestionAnswered(
        question=question.text, topic=question.topic, subjects=question.subjects, lines=tuple(lines)
    )


async def _about(
    basis: CheckBasis,
    question: Question,
    trace: MissionTrace,
    show: Callable[[Alternative], object],
) -> list[AnswerLine]:
    """Return the answer to a question about one mission."""
    world, attempt = basis.fleet.world, attempt_of(trace)
    if question.topic == "plan":
        return [*plan_lines(trace, world)]
    if attempt is None:
        none = AnswerLine(about=trace.mission.id, said=NO_PLAN)
        return [none, *end_lines(trace)]
    match question.topic:
        case "asset":
            if not_in_plan(attempt, question.subjects):
                return _not_sent(trace, attempt, question)
            lines = [*asset_lines(trace, attempt, world, question.subjects)]
            return [*lines, *checked_lines(attempt), *end_lines(trace)]
        case "other_asset":
            why_not = why_not_lines(basis, trace, attempt, question.subjects)
            return [line async for line in why_not]
        case _:
            return await _alternatives(basis, trace, show)


def _not_sent(trace: MissionTrace, attempt: Attempt, question: Question) -> list[AnswerLine]:
    """Return the answer that the plan uses none of the named assets, with the assets it uses."""
    agents = attempt.plan.agents if attempt.plan is not None else ()
    planned = ", ".join(dict.fromkeys(agents)) or "no asset"
    meant = question.subjects[0] if len(question.subjects) == 1 else "none of them"
    no = "has no part" if len(question.subjects) == 1 else "has a part"
    text = f"{meant} {no} in the plan of {trace.mission.id}, which uses {planned}"
    return [AnswerLine(about="plan", said=text)]


async def _alternatives(
    basis: CheckBasis, trace: MissionTrace, show: Callable[[Alternative], object]
) -> list[AnswerLine]:
    lines: list[AnswerLine] = []
    async for alternative in find_alternatives(basis, trace):
        show(alternative)
        lines.append(alternative.line)
    if not lines:
        return [AnswerLine(about=trace.mission.id, said=NO_OTHER)]
    over = [AnswerLine(about="now", said=NOW)] if trace.approval is None else []
    return [*over, *lines]

"""Answers a question of the operator's about what has been proposed or done.

What is told is on record, in the picture, or found by the checks and the rehearsal that every plan
goes through. No model is asked, nothing is decided, and no command is given.
"""

from collections.abc import Callable
from dataclasses import dataclass

from pa_console.language.questions.question import Question
from pa_console.orchestrator.answers.alternatives import Alternative, find_alternatives
from pa_console.orchestrator.answers.gate_cover import gate_lines
from pa_console.orchestrator.answers.planned import attempt_of
from pa_console.orchestrator.answers.why_asset import asset_lines, not_in_plan
from pa_console.orchestrator.answers.why_not import why_not_lines
from pa_console.orchestrator.answers.why_plan import checked_lines, end_lines, plan_lines
from pa_console.orchestrator.planning.safeguards import CheckBasis
from pa_console.schema.events.questions import AnswerLine, QuestionAnswered
from pa_console.session.state.fold import SessionState
from pa_console.session.state.mission_trace import Attempt, MissionTrace

NOTHING_YET = "nothing has been ordered in this session yet"
NO_PLAN = "there is no plan for it"
NOW = "looked for in the picture as it is now; nothing is ordered by that"
NO_OTHER = "no other sound plan is known for this order"


@dataclass(frozen=True)
class Answer:
    """An answer, and the mission that it is about; '' for none."""

    told: QuestionAnswered
    mission: str = ""


async def answer(
    basis: CheckBasis,
    question: Question,
    state: SessionState,
    found: Callable[[Alternative], object] = lambda _: None,
) -> Answer:
    """Return the answer to `question`, as the session stands in `state`.

    It is about the plan that waits, else about the mission that is worked on or was last. Each
    alternative is given to `found` as soon as it is rehearsed.
    """
    trace = state.current
    if question.topic == "gate":
        lines = gate_lines(state, question.subjects[0], basis.fleet.world.dt_s)
        return Answer(_told(question, [*lines]))
    if trace is None:
        return Answer(_told(question, [AnswerLine(about="on record", said=NOTHING_YET)]))
    lines = await _about(basis, question, trace, found)
    return Answer(_told(question, lines), trace.mission.id)


def _told(question: Question, lines: list[AnswerLine]) -> QuestionAnswered:
    return QuestionAnswered(
        question=question.text,
        topic=question.topic,
        subjects=question.subjects,
        lines=tuple(lines),
    )


async def _about(
    basis: CheckBasis,
    question: Question,
    trace: MissionTrace,
    found: Callable[[Alternative], object],
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
            told = why_not_lines(basis, trace, attempt, question.subjects)
            return [line async for line in told]
        case _:
            return await _alternatives(basis, trace, found)


def _not_sent(trace: MissionTrace, attempt: Attempt, question: Question) -> list[AnswerLine]:
    """Return that none of the named assets has a part in the plan, and which assets have."""
    agents = attempt.plan.agents if attempt.plan is not None else ()
    who = ", ".join(dict.fromkeys(agents)) or "nobody"
    meant = question.subjects[0] if len(question.subjects) == 1 else "none of them"
    no = "has no part" if len(question.subjects) == 1 else "has a part"
    said = f"{meant} {no} in the plan of {trace.mission.id}: it is for {who}"
    return [AnswerLine(about="plan", said=said)]


async def _alternatives(
    basis: CheckBasis, trace: MissionTrace, found: Callable[[Alternative], object]
) -> list[AnswerLine]:
    lines: list[AnswerLine] = []
    async for each in find_alternatives(basis, trace):
        found(each)
        lines.append(each.line)
    if not lines:
        return [AnswerLine(about=trace.mission.id, said=NO_OTHER)]
    over = [AnswerLine(about="now", said=NOW)] if trace.approval is None else []
    return [*over, *lines]

"""What the approval panel says: what will happen and what will not, obstacles, and the judge."""

from collections.abc import Iterator, Sequence

from textual.content import Content

from pa_console.schema.event import ApprovalRequested
from pa_console.session.mission_trace import MissionTrace
from pa_console.session.reading_words import meant
from pa_console.session.wording import safety_in_words
from pa_console.tui.trace.rows import Row, row
from pa_console.tui.vocabulary import BAD, GOOD, NOTE, QUIET, WARN, term
from pa_console.tui.words import action_sentence


def approval_rows(trace: MissionTrace) -> Iterator[Row]:
    """Yield what will happen, what of the order will not, what stands in the way, and the judge.

    Before what stands in the way: whether the order may have been misread.
    """
    request = trace.approval
    if request is None:
        return
    attempt = trace.find(request.attempt)
    refused = trace.decisions[-1] if trace.decisions and not trace.decisions[-1].accepted else None
    if refused is not None:
        yield row("✘ ", (f"not accepted: {refused.detail}", BAD))
    yield row(
        "",
        (f"{trace.mission.id} plan {request.attempt}", "bold"),
        (f" {attempt.phase}" if attempt and attempt.phase else "", NOTE),
        (": if you approve,", QUIET),
    )
    picture = attempt.rehearsal.before if attempt and attempt.rehearsal else None
    for number, action in enumerate(request.plan.actions, start=1):
        yield row((f" {number} ", "bold"), action_sentence(action, picture, trace.digest))
    if not request.plan.actions:
        yield row("   ", "nothing moves: the plan has no action")
    if request.if_halted and not request.blocked_by:
        yield row("   ", ("if halted: ", NOTE), safety_in_words(request.if_halted))
    for text in attempt.unmet if attempt else ():
        yield row(("△ ", WARN), ("NOT MET  ", f"bold {WARN}"), text)
    if attempt is not None and attempt.doubt and not request.readings:
        yield _unsure(attempt.doubt)
    elif attempt is not None and attempt.gaps:
        yield _unsure("; ".join(attempt.gaps))
    for reason in request.blocked_by:
        yield row(("✘ ", BAD), ("BLOCKED  ", f"bold {BAD}"), (reason, BAD))
    for rule_id in request.acknowledge:
        yield row(("▲ ", WARN), (f"{rule_id}  ", f"bold {WARN}"), _message(trace, rule_id))
    yield _judge(trace, request)


def _unsure(doubt: str) -> Row:
    return row(("△ ", WARN), ("UNSURE  ", f"bold {WARN}"), doubt)


def _judge(trace: MissionTrace, request: ApprovalRequested) -> Row:
    attempt = trace.find(request.attempt)
    if attempt is None or not attempt.judged:
        return row(("? ", WARN), ("Judge: not asked", f"bold {WARN}"))
    given = attempt.verdict
    mark = term("verdict", given.verdict if given else "none")
    said = given.feedback if given else attempt.judge_error
    return row(
        (f"{mark.glyph} ", mark.style),
        (f"Judge: {mark.word}  ", f"bold {mark.style}"),
        (said, QUIET if mark.style == GOOD else mark.style),
    )


def _message(trace: MissionTrace, rule_id: str) -> str:
    findings = (f for attempt in reversed(trace.attempts) for f in attempt.findings)
    return next((f.message for f in findings if f.rule_id == rule_id), "")


def reading_rows(trace: MissionTrace) -> Iterator[Row]:
    """Yield what the order was read as, where it may mean something else."""
    request = trace.approval
    if request is None or not request.readings:
        return
    attempt, asked = trace.find(request.attempt), meant(request.asked)
    if attempt is not None and attempt.as_chosen:
        yield row(("✎ ", NOTE), "read as you meant it: ", asked)
        return
    sure = f" with {attempt.sure:.0%} confidence" if attempt and attempt.sure is not None else ""
    yield _unsure(f"read{sure} as: {asked}")


def reading_label(number: int, asked: str) -> Content:
    """Return what else the order may mean, after the key that chooses it."""
    return Content.assemble((f"({number}) ", "bold"), ("or: ", QUIET), meant(asked))


def blocked_reason(request: ApprovalRequested, left: Sequence[str], reason: str) -> str:
    """Return in words why Approve is disabled, empty when it is not."""
    if request.blocked_by:
        return "✘ Approve: blocked, nobody may override"
    if left:
        return f"✘ Approve: tick {', '.join(left)} first"
    if request.needs_override and not reason.strip():
        return "✘ Approve: give a reason to override"
    return ""

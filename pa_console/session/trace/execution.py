"""Steps 6 to 8 of a mission's trace: decision, commands, halts, verification, report, outcome."""

from collections.abc import Sequence

from pa_console.orders.plain_words import plain_reading
from pa_console.schema.events.event import DecisionMade, PlanHalted
from pa_console.schema.finding import Verdict
from pa_console.schema.text.quantities import clock_text, duration_text
from pa_console.session.state.mission_trace import CommandTrace, MissionTrace, VerifiedPlan
from pa_console.session.status_words import Status, status_of
from pa_console.session.trace.parts import (
    Block,
    Column,
    Detail,
    Line,
    Section,
    Span,
    TraceOptions,
    labelled,
    said,
    sign,
    table,
)
from pa_console.session.trace.report_table import report_table
from pa_console.session.trace.safeguards import outcome_verdict

_BAR = 14
"""Cells of the bar of the stage that took longest."""


def decisions(made: Sequence[DecisionMade], voided: str) -> Section:
    """What the operator decided, the refused attempts included, and why an approval is void."""
    blocks: list[Block] = []
    for item in made:
        given = item.decision
        mark = sign(status_of("decision", given.kind))
        blocks.append(Line((Span(f"by {given.by}, {_what(item.attempt)}"),), mark=mark))
        if given.override_judge:
            blocks.append(_below("the judge's Failure was overridden"))
        if given.acknowledged:
            blocks.append(_below(f"acknowledged: {', '.join(given.acknowledged)}"))
        if given.asked:
            blocks.append(labelled("meant", plain_reading(given.asked), depth=1))
        if given.reason:
            blocks.append(labelled("reason", given.reason, depth=1))
        if len(given.signatures) > 1:
            blocks.append(labelled("signed", ", ".join(given.signatures), depth=1))
        if not item.accepted and given.signatures:
            blocks.append(_below(f"not accepted yet: {item.detail}"))
        elif not item.accepted:
            blocks.append(Line((Span(f"not accepted: {item.detail}", "bad"),), depth=1))
    if voided:
        blocks.append(said(f"plan void: {voided}", "bad"))
    return Section("decision", "Decision", tuple(blocks), step=6)


def _what(attempt: int) -> str:
    """Return what was decided on: a plan, or with 0 what has none, a question or standing order."""
    return f"plan {attempt}" if attempt else "no plan"


def _below(text: str) -> Line:
    return Line((Span(text, "warn"),), depth=1)


def command_state(command: CommandTrace) -> Status:
    """Return the latest state of a dispatched command."""
    return status_of("reply", command.replies[-1].status if command.replies else "sent")


def commands(given: Sequence[CommandTrace], options: TraceOptions) -> Section:
    """Step 7: every dispatched command with its state, its resends and the device's words."""
    columns = [
        Column("state", 14),
        Column("asset", 11, stress="bold"),
        Column("command", tone="calm"),
        Column("target"),
        Column("sent again", tone="warn"),
        Column("reply", tone="quiet"),
    ]
    rows = [_command(sent) for sent in given]
    if options.detail >= Detail.RECORD:
        columns += [Column("id", tone="quiet"), Column("replies (tick)", tone="quiet")]
        rows = [
            (*row, sent.command.command_id, _replies(sent))
            for row, sent in zip(rows, given, strict=True)
        ]
    done = sum(command_state(sent).word == "done" for sent in given)
    note = f"{done} of {len(given)} done"
    return Section("commands", "Commands", (table(columns, rows),), step=7, note=note)


def _command(sent: CommandTrace) -> tuple[Status | str, ...]:
    command = sent.command
    again = f"sent again {sent.resent}×" if sent.resent else ""
    detail = sent.replies[-1].detail if sent.replies else ""
    return command_state(sent), command.agent, command.verb, command.target or "", again, detail


def _replies(sent: CommandTrace) -> str:
    return ", ".join(f"{reply.status} ({reply.tick})" for reply in sent.replies) or "no reply"


def halts(given: Sequence[PlanHalted]) -> list[Section]:
    """Step 7: why the running plan was stopped, once for every time that it was."""
    return [_halt(item, number) for number, item in enumerate(given)]


def _halt(given: PlanHalted, number: int) -> Section:
    """Tell the reasons, and what each asset was told to be safe."""
    blocks = [Line((Span(reason, "bad"),), mark=Span("✘")) for reason in given.reasons]
    blocks += [labelled("safe state", item) for item in given.safe_state]
    if not given.safe_state:
        blocks.append(labelled("safe state", "nothing was under way", "quiet"))
    title = f"Why plan {given.attempt} was stopped"
    key = f"halt-{given.attempt}" + (f".{number}" if number else "")
    return Section(key, title, tuple(blocks), step=7, mark=status_of("outcome", "halted"))


def verification(given: VerifiedPlan, number: int) -> Section:
    """Step 7: what telemetry showed, as of when, and beside it the judge's verdict on it."""
    blocks: list[Block] = []
    told = given.verification
    if told.actions:
        columns = (
            Column("outcome", 9),
            Column("asset", 11, stress="bold"),
            Column("command"),
            Column("reason", tone="quiet"),
        )
        rows = [
            (status_of("outcome", item.outcome), item.agent, item.command, item.reason)
            for item in told.actions
        ]
        blocks.append(table(columns, rows))
    if told.gates_lost:
        blocks.append(said(f"gates lost: {', '.join(told.gates_lost)}", "bad"))
    if told.gates_unknown:
        blocks.append(said(f"? cover unknown: {', '.join(told.gates_unknown)}", "warn"))
    if told.reason:
        blocks.append(said(told.reason))
    if given.judged:
        blocks += outcome_verdict(given.verdict, given.error)
    note = f"as of {clock_text(told.as_of_s)}" if told.as_of_s else ""
    mark = status_of("outcome", told.outcome)
    key = f"verification-{number}"
    return Section(key, "Verification", tuple(blocks), step=7, mark=mark, note=note)


def judged_outcome(verdict: Verdict | None, error: str) -> Section:
    """The judge's verdict on an outcome of which telemetry said nothing."""
    return Section("judged", "Outcome, judged", outcome_verdict(verdict, error), step=7)


def report(trace: MissionTrace) -> Section:
    """Step 8: the brief after-action report (WF-09)."""
    return Section("report", "After-action report", (report_table(trace.report),), step=8)


def outcome(trace: MissionTrace) -> Section:
    """How the mission ended."""
    mark = status_of("mission", trace.status or "unknown")
    return Section("outcome", "Outcome", (said(trace.reason),), mark=mark)


def timings(trace: MissionTrace, options: TraceOptions) -> Section:
    """Seconds per stage; execution counts simulated time, everything else wall time.

    In brief only the stages that took any are told.
    """
    given = trace.metrics
    if given is None:
        return Section("timings", "Timings")
    stages = [
        ("retrieve", given.retrieval_s),
        ("picture", given.picture_s),
        ("prompt", given.prompt_s),
        ("first token", given.first_token_s),
        ("plan", given.planning_s),
        ("checks", given.checks_s),
        ("rehearsal", given.rehearsal_s),
        ("judge", given.judging_s),
        ("other readings", given.readings_s),
        ("decision", given.decision_s),
        ("dispatch", given.dispatch_s),
        ("execution, simulated", given.execution_s),
        ("outcome", given.outcome_s),
    ]
    longest = max(seconds for _, seconds in stages) or 1.0
    columns = (Column("stage", 20, "quiet"), Column("time", 7, right=True), Column("", tone="calm"))
    rows = [
        (name, duration_text(seconds), "━" * round(_BAR * (seconds / longest)))
        for name, seconds in stages
        if seconds or options.detail >= Detail.FULL
    ]
    note = f"end to end {duration_text(given.end_to_end_s)}, plans tried: {given.attempts}"
    note += f", halted: {given.halts}" if given.halts else ""
    return Section("timings", "Timings", (table(columns, rows),), note=note, collapsed=True)

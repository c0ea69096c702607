"""Steps 7 to 10 of a mission's trace: decision, commands, halts, verification, report, outcome."""

import re
from collections.abc import Sequence

from pa_console.language.canonical.reading import plain_reading
from pa_console.schema.events.event import DecisionMade, PlanHalted, StepsHeld
from pa_console.schema.finding import Verdict
from pa_console.schema.text import clock_text, duration_text
from pa_console.session.mission_trace import CommandTrace, MissionTrace, VerifiedPlan
from pa_console.views.status_words import Status, status_of
from pa_console.views.trace_parts import (
    Block,
    Column,
    Detail,
    Span,
    TraceLine,
    TraceOptions,
    TraceSection,
    TraceTable,
    labelled,
    sign,
    statement,
    table,
)
from pa_console.views.trace_planning import outcome_verdict

_BAR = 14
"""The width in cells of the bar for the longest stage."""


def decisions(made: Sequence[DecisionMade], voided: str) -> TraceSection:
    """Return the operator's decisions, valid or not, and why an approval became void."""
    blocks: list[Block] = []
    for item in made:
        given = item.decision
        mark = sign(status_of("decision", given.kind))
        # Attempt 0 means a decision on a question or a standing order.
        subject = f"plan {item.attempt}" if item.attempt else "no plan"
        blocks.append(TraceLine((Span(f"by {given.by}, {subject}"),), mark=mark))
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
            blocks.append(TraceLine((Span(f"not accepted: {item.detail}", "bad"),), depth=1))
    if voided:
        blocks.append(statement(f"plan void: {voided}", "bad"))
    return TraceSection("decision", "Decision", tuple(blocks), step=7)


def _below(text: str) -> TraceLine:
    return TraceLine((Span(text, "warn"),), depth=1)


def command_state(command: CommandTrace) -> Status:
    """Return the latest state of a dispatched command."""
    return status_of("reply", command.replies[-1].status if command.replies else "sent")


def commands(given: Sequence[CommandTrace], options: TraceOptions) -> TraceSection:
    """Return step 8: every dispatched command with its state, repetitions and reply."""
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
    return TraceSection("commands", "Commands", (table(columns, rows),), step=8, note=note)


def _command(sent: CommandTrace) -> tuple[Status | str, ...]:
    command = sent.command
    again = f"sent again {sent.resent}×" if sent.resent else ""
    detail = sent.replies[-1].detail if sent.replies else ""
    return command_state(sent), command.agent, command.verb, command.target or "", again, detail


def _replies(sent: CommandTrace) -> str:
    return ", ".join(f"{reply.status} ({reply.tick})" for reply in sent.replies) or "no reply"


def halts(given: Sequence[PlanHalted]) -> list[TraceSection]:
    """Return step 8: the reasons of each halt of a running plan."""
    return [_halt(item, number) for number, item in enumerate(given)]


def _halt(given: PlanHalted, number: int) -> TraceSection:
    blocks = [TraceLine((Span(reason, "bad"),), mark=Span("✘")) for reason in given.reasons]
    blocks += [labelled("safe state", item) for item in given.safe_state]
    if not given.safe_state:
        blocks.append(labelled("safe state", "nothing was under way", "quiet"))
    title = f"Why plan {given.attempt} was stopped"
    key = f"halt-{given.attempt}" + (f".{number}" if number else "")
    return TraceSection(key, title, tuple(blocks), step=8, mark=status_of("outcome", "halted"))


def held(given: Sequence[StepsHeld]) -> list[TraceSection]:
    """Return step 8: the unsent actions of a plan with steps, and the reasons."""
    return [
        TraceSection(
            f"held-{item.attempt}.{number}",
            "Not sent",
            (*(labelled("held", order) for order in item.orders), statement(item.reason, "bad")),
            step=8,
            mark=status_of("outcome", "halted"),
        )
        for number, item in enumerate(given)
    ]


def verification(given: VerifiedPlan, number: int) -> TraceSection:
    """Return step 9: the verification by telemetry, its time, and the judge's verdict on it."""
    blocks: list[Block] = []
    verified = given.verification
    if verified.actions:
        columns = (
            Column("outcome", 9),
            Column("asset", 11, stress="bold"),
            Column("command"),
            Column("reason", tone="quiet"),
        )
        rows = [
            (status_of("outcome", item.outcome), item.agent, item.command, item.reason)
            for item in verified.actions
        ]
        blocks.append(table(columns, rows))
    if verified.gates_lost:
        blocks.append(statement(f"gates lost: {', '.join(verified.gates_lost)}", "bad"))
    if verified.gates_unknown:
        blocks.append(statement(f"? cover unknown: {', '.join(verified.gates_unknown)}", "warn"))
    if verified.reason:
        blocks.append(statement(verified.reason))
    if given.judged:
        blocks += outcome_verdict(given.verdict, given.error)
    note = f"as of {clock_text(verified.as_of_s)}" if verified.as_of_s else ""
    mark = status_of("outcome", verified.outcome)
    key, title = f"verification-{number}", "Verification"
    title += f" of step {given.step}" if given.step else ""
    return TraceSection(key, title, tuple(blocks), step=9, mark=mark, note=note)


def judged_outcome(verdict: Verdict | None, error: str) -> TraceSection:
    """Return the judge's verdict on an outcome that telemetry did not verify."""
    return TraceSection("judged", "Outcome, judged", outcome_verdict(verdict, error), step=9)


_ACTION = re.compile(r"- (?P<what>\S+ [^:]+)(?:: (?P<text>.*))?")
_LABEL = re.compile(r"(?P<what>[^:]{1,120}?)(?:: |\. (?=Rationale))(?P<text>.+)")
_COLUMNS = (Column("what", 24, stress="bold"), Column("result"))


def report_table(report: str) -> TraceTable:
    """Return the lines of a report as rows of a label and a text.

    A line without a label is a separate row.
    """
    rows: list[list[str]] = []
    for line in filter(None, (line.strip() for line in report.splitlines())):
        action, labelled = _ACTION.fullmatch(line), _LABEL.fullmatch(line)
        if action is not None:
            rows.append([action["what"], action["text"] or "no telemetry was checked"])
        elif labelled is not None:
            rows.append([labelled["what"], labelled["text"]])
        elif line.startswith("All gates covered"):
            rows.append(["Gates", "all covered"])
        else:
            rows.append(["", line])
    return table(_COLUMNS, ([Span(fact, "", "bold"), Span(text)] for fact, text in rows))


def report(trace: MissionTrace) -> TraceSection:
    """Return step 10: the brief after-action report (WF-09)."""
    return TraceSection("report", "After-action report", (report_table(trace.report),), step=10)


def outcome(trace: MissionTrace) -> TraceSection:
    """Return the end of the mission with its reason."""
    mark = status_of("mission", trace.shown_status)
    return TraceSection("outcome", "Outcome", (statement(trace.reason),), mark=mark)


def timings(trace: MissionTrace, options: TraceOptions) -> TraceSection:
    """Return the seconds of each stage: simulated time for execution, wall time for the others.

    In brief traces, stages that took no time are left out.
    """
    given = trace.metrics
    if given is None:
        return TraceSection("timings", "Timings")
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
    return TraceSection("timings", "Timings", (table(columns, rows),), note=note, collapsed=True)

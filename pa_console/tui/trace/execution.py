"""Steps 6 to 8 of a mission's trace as sections: decision, commands, verification, report."""

from collections.abc import Sequence

from pa_console.orders.plain_words import plain_reading
from pa_console.schema.events.event import DecisionMade, PlanHalted
from pa_console.schema.finding import Verdict
from pa_console.session.state.mission_trace import CommandTrace, MissionTrace, VerifiedPlan
from pa_console.tui.status_words import BAD, QUIET, WARN, Term, term
from pa_console.tui.trace.planning import title
from pa_console.tui.trace.rows import Row, Section, column, row, text_rows
from pa_console.tui.words import clock_text, duration_text

_DECISIONS = {
    "approve": Term("✔", "approved", "$text-success"),
    "reject": Term("✘", "rejected", WARN),
    "modify": Term("✎", "modified", "$text-accent"),
    "choose": Term("✎", "read anew", "$text-accent"),
}


def decisions(made: Sequence[DecisionMade], voided: str = "") -> Section:
    """What the operator decided, the refused attempts included, and why an approval is void."""
    rows: list[Row] = []
    for item in made:
        mark, given = _DECISIONS[item.decision.kind], item.decision
        rows.append(
            row(
                ["  ", (f"{mark.glyph} {mark.word}", mark.style)],
                f" by {given.by}, plan {item.attempt}",
            )
        )
        if given.override_judge:
            rows.append(row("    ", ("the judge's Failure was overridden", WARN)))
        if given.acknowledged:
            rows.append(row("    ", (f"acknowledged: {', '.join(given.acknowledged)}", WARN)))
        if given.asked:
            rows.append(row("    meant: ", plain_reading(given.asked)))
        if given.reason:
            rows.append(row("    reason: ", given.reason))
        if not item.accepted:
            rows.append(row("    ", (f"not accepted: {item.detail}", BAD)))
    if voided:
        rows.append(row("  ", (f"plan void: {voided}", BAD)))
    return Section("decision", title("Decision"), tuple(rows))


def command_state(command: CommandTrace) -> Term:
    """Return the latest state of a dispatched command."""
    return term("reply", command.replies[-1].status if command.replies else "sent")


def commands(given: Sequence[CommandTrace]) -> Section:
    """Step 7: every dispatched command with its state, its resends and the device's words."""
    rows: list[Row] = []
    for sent in given:
        mark, command = command_state(sent), sent.command
        said = sent.replies[-1].detail if sent.replies else ""
        again = f"sent again {sent.resent}× " if sent.resent else ""
        rows.append(
            row(
                [
                    "  ",
                    column(f"{mark.glyph} {mark.word}", 14, mark.style),
                    column(command.agent, 11, "bold"),
                ],
                (command.verb, "$text-primary"),
                f" {command.target or ''} ",
                (again, WARN),
                (said, QUIET),
            )
        )
    done = sum(command_state(sent).word == "done" for sent in given)
    return Section("commands", title("Commands", note=f"{done} of {len(given)} done"), tuple(rows))


def halts(given: Sequence[PlanHalted]) -> list[Section]:
    """Step 7: why the running plan was stopped, once for every time that it was."""
    return [_halt(item, number) for number, item in enumerate(given)]


def _halt(given: PlanHalted, number: int) -> Section:
    """Tell the reasons, and what each asset was told to be safe."""
    rows = [row("  ✘ ", (reason, BAD)) for reason in given.reasons]
    rows += [row("  safe state: ", item) for item in given.safe_state]
    if not given.safe_state:
        rows.append(row("  safe state: ", ("nothing was under way", QUIET)))
    mark = Term("■", "HALTED", BAD)
    head = title(f"Why plan {given.attempt} was stopped", mark)
    key = f"halt-{given.attempt}" + (f".{number}" if number else "")
    return Section(key, head, tuple(rows))


def verification(given: VerifiedPlan, number: int) -> Section:
    """Step 7: what telemetry showed, as of when, and beside it the judge's verdict on it."""
    rows: list[Row] = []
    told = given.verification
    for item in told.actions:
        mark = term("outcome", item.outcome)
        rows.append(
            row(
                [
                    "  ",
                    column(f"{mark.glyph} {mark.word}", 9, mark.style),
                    column(item.agent, 11, "bold"),
                ],
                item.command,
                " ",
                (item.reason, QUIET),
            )
        )
    if told.gates_lost:
        rows.append(row("  ", (f"gates lost: {', '.join(told.gates_lost)}", BAD)))
    if told.gates_unknown:
        rows.append(row("  ", (f"? cover unknown: {', '.join(told.gates_unknown)}", WARN)))
    if told.reason:
        rows.append(row("  ", told.reason))
    if given.judged:
        rows.append(_outcome_verdict(given.verdict, given.error))
    note = f"as of {clock_text(told.as_of_s)}" if told.as_of_s else ""
    head = title("Verification", term("outcome", told.outcome), note)
    return Section(f"verification-{number}", head, tuple(rows))


def outcome_verdict(verdict: Verdict | None, error: str) -> Section:
    """The judge's verdict on an outcome of which telemetry said nothing."""
    return Section("judged", title("Outcome, judged"), (_outcome_verdict(verdict, error),))


def _outcome_verdict(verdict: Verdict | None, error: str) -> Row:
    mark = term("verdict", verdict.verdict if verdict else "none")
    said = verdict.feedback if verdict else error
    return row(["  judge: ", (f"{mark.glyph} {mark.word}  ", mark.style)], said)


def report(trace: MissionTrace) -> Section:
    """Step 8: the brief after-action report (WF-09)."""
    return Section("report", title("After-action report"), text_rows(trace.report))


def outcome(trace: MissionTrace) -> Section:
    """How the mission ended."""
    mark = term("mission", trace.status or "unknown")
    return Section("outcome", title("Outcome", mark), (row("  ", trace.reason),))


def timings(trace: MissionTrace) -> Section:
    """Seconds per stage; execution counts simulated time, everything else wall time."""
    given = trace.metrics
    if given is None:
        return Section("timings", title("Timings"), ())
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
    rows = [
        row(
            ["  ", column(name, 20, QUIET), f"{duration_text(seconds):>7} "],
            ("━" * round(14 * (seconds / longest)), "$text-primary"),
        )
        for name, seconds in stages
    ]
    note = f"end to end {duration_text(given.end_to_end_s)}, plans tried: {given.attempts}"
    note += f", halted: {given.halts}" if given.halts else ""
    return Section("timings", title("Timings", note=note), tuple(rows), collapsed=True)

"""Steps 6 to 8 of a mission's trace as sections: decision, commands, verification, report."""

from pa_console.session.mission_trace import CommandTrace, MissionTrace
from pa_console.tui.trace.planning import title
from pa_console.tui.trace.rows import Row, Section, column, row, text_rows
from pa_console.tui.vocabulary import BAD, QUIET, WARN, Term, term
from pa_console.tui.words import duration_text

_DECISIONS = {
    "approve": Term("✔", "approved", "$text-success"),
    "reject": Term("✘", "rejected", WARN),
    "modify": Term("✎", "modified", "$text-accent"),
}


def decisions(trace: MissionTrace) -> Section:
    """What the operator decided, the refused attempts included."""
    rows: list[Row] = []
    for made in trace.decisions:
        mark = _DECISIONS[made.decision.kind]
        rows.append(
            row(
                ["  ", (f"{mark.glyph} {mark.word}", mark.style)],
                f" by {made.decision.by}, plan {made.attempt}",
            )
        )
        given = made.decision
        if given.override_judge:
            rows.append(row("    ", ("the judge's Failure was overridden", WARN)))
        if given.acknowledged:
            rows.append(row("    ", (f"acknowledged: {', '.join(given.acknowledged)}", WARN)))
        if given.reason:
            rows.append(row("    reason: ", given.reason))
        if not made.accepted:
            rows.append(row("    ", (f"not accepted: {made.detail}", BAD)))
    if trace.voided:
        rows.append(row("  ", (f"plan void: {trace.voided}", BAD)))
    return Section("decision", title("Decision"), tuple(rows))


def command_state(command: CommandTrace) -> Term:
    """Return the latest state of a dispatched command."""
    return term("reply", command.replies[-1].status if command.replies else "sent")


def commands(trace: MissionTrace) -> Section:
    """Step 7: every dispatched command with its state and the device's words."""
    rows: list[Row] = []
    for sent in trace.commands.values():
        mark, command = command_state(sent), sent.command
        said = sent.replies[-1].detail if sent.replies else ""
        rows.append(
            row(
                [
                    "  ",
                    column(f"{mark.glyph} {mark.word}", 14, mark.style),
                    column(command.agent, 11, "bold"),
                ],
                (command.verb, "$text-primary"),
                f" {command.target or ''} ",
                (said, QUIET),
            )
        )
    done = sum(command_state(sent).word == "done" for sent in trace.commands.values())
    return Section(
        "commands", title("Commands", note=f"{done} of {len(trace.commands)} done"), tuple(rows)
    )


def verification(trace: MissionTrace) -> Section:
    """Step 7: what telemetry showed, and the judge's verdict on the outcome."""
    rows: list[Row] = []
    given = trace.verification
    for item in given.actions if given else ():
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
    if given and given.gates_lost:
        rows.append(row("  ", (f"gates lost: {', '.join(given.gates_lost)}", BAD)))
    if given and given.reason:
        rows.append(row("  ", given.reason))
    judged = trace.outcome_verdict
    if judged is not None:
        mark = term("verdict", judged.verdict)
        rows.append(
            row(["  judge: ", (f"{mark.glyph} {mark.word}  ", mark.style)], judged.feedback)
        )
    elif trace.outcome_error:
        rows.append(row("  judge: ", (trace.outcome_error, WARN)))
    mark = term("outcome", given.outcome) if given else None
    return Section("verification", title("Verification", mark), tuple(rows))


def report(trace: MissionTrace) -> Section:
    """Step 8: the brief report."""
    return Section("report", title("Report"), text_rows(trace.report))


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
        ("decision", given.decision_s),
        ("dispatch", given.dispatch_s),
        ("execution, simulated", given.execution_s),
        ("outcome", given.outcome_s),
    ]
    longest = max(seconds for _, seconds in stages) or 1.0
    rows = [
        row(
            ["  ", column(name, 20, QUIET), f"{duration_text(seconds):>7} "],
            ("━" * round(14 * seconds / longest), "$text-primary"),
        )
        for name, seconds in stages
    ]
    note = f"end to end {duration_text(given.end_to_end_s)}, plans tried: {given.attempts}"
    return Section("timings", title("Timings", note=note), tuple(rows), collapsed=True)

"""Puts a mission's trace together: its sections in order, its headline and its progress."""

from textual.content import Content

from pa_console.session.mission_trace import Attempt, MissionTrace
from pa_console.tui.trace import execution, planning
from pa_console.tui.trace.planning import Rules
from pa_console.tui.trace.rows import Section, row
from pa_console.tui.vocabulary import BAD, QUIET, WARN, term

STEPS = (
    "queued", "retrieve", "picture", "prompt", "plan", "safeguards", "judge", "decide",
    "execute", "verify", "report",
)  # fmt: skip


def sections(trace: MissionTrace, rules: Rules) -> list[Section]:
    """Return everything known of the mission, in the order in which it happened.

    Only the chosen attempt is spread out; before it come the others, folded.
    """
    result: list[Section] = []
    if trace.hits:
        result.append(planning.retrieved_rules(trace, rules))
    if trace.digest is not None:
        result.append(planning.digest(trace))
    chosen = chosen_attempt(trace)
    result += [_folded(a, _attempt(a, rules)) for a in trace.attempts if a is not chosen]
    if chosen is not None:
        if len(trace.attempts) > 1:
            result.append(_heading(chosen))
        result += _attempt(chosen, rules)
    if trace.decisions or trace.voided:
        result.append(execution.decisions(trace))
    if trace.commands:
        result.append(execution.commands(trace))
    if trace.verification or trace.outcome_verdict or trace.outcome_error:
        result.append(execution.verification(trace))
    if trace.report:
        result.append(execution.report(trace))
    if trace.status is not None:
        result.append(execution.outcome(trace))
    if trace.metrics is not None:
        result.append(execution.timings(trace))
    return result


def chosen_attempt(trace: MissionTrace) -> Attempt | None:
    """Return the attempt that is up for approval or was decided on, else the latest."""
    number = len(trace.attempts)
    if trace.approval is not None:
        number = trace.approval.attempt
    elif trace.decision is not None and trace.decision.kind != "modify":
        number = next(made.attempt for made in reversed(trace.decisions) if made.accepted)
    return trace.attempts[number - 1] if 0 < number <= len(trace.attempts) else None


def _attempt(attempt: Attempt, rules: Rules) -> list[Section]:
    parts: list[Section] = []
    if attempt.user or attempt.system:
        parts.append(planning.prompt(attempt))
    parts.append(planning.plan(attempt))
    if attempt.rehearsal is not None:
        parts.append(planning.rehearsal(attempt, attempt.rehearsal))
    if attempt.findings:
        parts += planning.checks(attempt, rules)
    if attempt.judged or attempt.judge_text:
        parts.append(planning.verdict(attempt))
    return parts


def _heading(attempt: Attempt) -> Section:
    author = "by the operator" if attempt.author == "operator" else "shown in full"
    title = planning.title(f"Attempt {attempt.number}", note=author)
    return Section(f"heading-{attempt.number}", title, ())


def _folded(attempt: Attempt, parts: list[Section]) -> Section:
    reasons = tuple(row("  ✘ ", (reason, WARN)) for reason in attempt.repair)
    body = [
        item
        for part in parts
        if not part.key.endswith("-rest")
        for item in (row("", part.title), *part.rows)
    ]
    broken = [finding.rule_id for finding in attempt.findings if finding.broken]
    note = ", ".join(broken) or attempt.error or "not used"
    head = Content.assemble((f"Attempt {attempt.number}", "bold"), (f"  ✘ {note}", BAD))
    return Section(f"attempt-{attempt.number}", head, (*reasons, *body), collapsed=True)


def progress(trace: MissionTrace) -> Content:
    """Return the line that shows how far the mission is, or how it ended and why."""
    if trace.status is not None:
        mark = term("mission", trace.status)
        return Content.assemble(
            (f"{mark.glyph} {mark.word}", mark.style), (f"  {trace.reason}", QUIET)
        )
    step = STEPS.index(trace.stage) if trace.stage in STEPS else 0
    last = len(STEPS) - 1
    words = f" step {step} of {last}: {trace.stage}" if step else " waits in the queue"
    return Content.assemble(
        ("━━" * step, "$text-success"),
        ("━╸", "$text-accent"),
        ("──" * (last - step), "$faint"),
        words,
    )


def headline(trace: MissionTrace) -> Content:
    """Return the mission's id and text."""
    return Content.assemble((trace.mission.id, "bold $text-accent"), " ", trace.mission.text)

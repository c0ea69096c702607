"""Puts a mission's trace together: its sections in order, its headline and its progress."""

from textual.content import Content

from pa_console.session.fold import Attempt, MissionTrace
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

    Earlier attempts are folded to what was wrong with them; only the latest is spread out.
    """
    result: list[Section] = []
    if trace.hits:
        result.append(planning.retrieved_rules(trace, rules))
    if trace.digest is not None:
        result.append(planning.digest(trace))
    for attempt in trace.attempts:
        parts = _attempt(attempt, rules)
        if attempt is not trace.attempts[-1]:
            parts = [_folded(attempt, parts)]
        elif attempt.number > 1:
            parts.insert(0, _heading(attempt))
        result += parts
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
    author = "changed by the operator" if attempt.author == "operator" else "repaired"
    return Section(
        f"attempt-{attempt.number}", planning.title(f"Attempt {attempt.number}", note=author), ()
    )


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


def progress(trace: MissionTrace, width: int) -> Content:
    """Return the line that shows how far the mission is, and the name of its stage."""
    if trace.status is not None:
        mark = term("mission", trace.status)
        return Content.assemble(
            (f"{mark.glyph} {mark.word}", mark.style), (f"  {trace.reason}", QUIET)
        ).truncate(width, ellipsis=True)
    step = STEPS.index(trace.stage) if trace.stage in STEPS else 0
    done = "━━" * step
    words = f" step {step} of {len(STEPS) - 1}: {trace.stage}" if step else " waits in the queue"
    return Content.assemble(
        (done, "$text-success"),
        ("━╸", "$text-accent"),
        ("──" * (len(STEPS) - 1 - step), "$faint"),
        words,
    ).truncate(width)


def headline(trace: MissionTrace) -> Content:
    """Return the mission's id and text."""
    return Content.assemble((trace.mission.id, "bold $text-accent"), " ", trace.mission.text)

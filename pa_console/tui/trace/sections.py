"""Puts a mission's trace together: its sections in order, its headline and its progress."""

from textual.content import Content

from pa_console.session.state.mission_trace import Attempt, MissionTrace
from pa_console.tui.status_words import BAD, NOTE, QUIET, WARN, term
from pa_console.tui.trace import execution, planning, workflow
from pa_console.tui.trace.planning import Rules
from pa_console.tui.trace.rounds import Round, earlier, latest
from pa_console.tui.trace.rows import Row, Section, row

STEPS = (
    "queued", "retrieve", "picture", "prompt", "plan", "safeguards", "judge", "decide",
    "execute", "verify", "report",
)  # fmt: skip


def sections(trace: MissionTrace, rules: Rules) -> list[Section]:
    """Return everything known of the mission, in the order in which it happened.

    Only the last plan is spread out, with the chosen of its attempts; before it come, folded,
    the plans that were carried out earlier, phase by phase, and the attempts not chosen.
    """
    result: list[Section] = []
    if trace.workflow:
        result.append(workflow.section(trace))
    if trace.hits:
        result.append(planning.retrieved_rules(trace, rules))
    if trace.digest is not None:
        result.append(planning.digest(trace.digest))
        if trace.digest.selection is not None:
            result.append(planning.selection(trace.digest.selection))
    before, now = earlier(trace), latest(trace)
    result += [_folded_round(given, rules) for given in before]
    if before:
        result += execution.halts(before[-1].halts)
    chosen = chosen_attempt(trace, now)
    result += [_folded(a, _attempt(a, rules)) for a in now.attempts if a is not chosen]
    if chosen is not None:
        if len(trace.attempts) > 1:
            result.append(_heading(chosen))
        result += _attempt(chosen, rules)
    result += _executed(now)
    if trace.unasked_verdict is not None or trace.unasked_error:
        result.append(execution.outcome_verdict(trace.unasked_verdict, trace.unasked_error))
    if trace.report:
        result.append(execution.report(trace))
    if trace.status is not None:
        result.append(execution.outcome(trace))
    if trace.metrics is not None:
        result.append(execution.timings(trace))
    return result


def chosen_attempt(trace: MissionTrace, now: Round) -> Attempt | None:
    """Return the attempt that is up for approval or was decided on, else the latest."""
    number = None
    if trace.approval is not None:
        number = trace.approval.attempt
    else:
        taken = [made for made in now.decisions if made.accepted and made.decision.settles]
        number = taken[-1].attempt if taken else None
    found = next((attempt for attempt in now.attempts if attempt.number == number), None)
    return found or (now.attempts[-1] if now.attempts else None)


def _executed(given: Round) -> list[Section]:
    """What was decided on a plan, and what came of it; the last verification first."""
    result: list[Section] = []
    if given.decisions or given.voided:
        result.append(execution.decisions(given.decisions, given.voided))
    if given.commands:
        result.append(execution.commands(given.commands))
    result += execution.halts(given.halts)
    numbered = list(enumerate(given.verified, start=1))
    result += [execution.verification(item, number) for number, item in reversed(numbered)]
    return result


def _attempt(attempt: Attempt, rules: Rules) -> list[Section]:
    parts: list[Section] = []
    if attempt.user or attempt.system:
        parts.append(planning.prompt(attempt))
    if attempt.user or attempt.text or attempt.plan or attempt.error or not attempt.findings:
        parts.append(planning.plan(attempt))
    if attempt.rehearsal is not None:
        parts.append(planning.rehearsal(attempt, attempt.rehearsal))
    if attempt.findings:
        parts += planning.checks(attempt, rules)
    if attempt.judged or attempt.judge_text:
        parts.append(planning.verdict(attempt))
    return parts


def _heading(attempt: Attempt) -> Section:
    how = "by the operator" if attempt.author == "operator" else "shown in full"
    if attempt.instead_of is not None:
        how = f"instead of {attempt.instead_of}"
    origin = attempt.origin.removeprefix(", ")
    rows = (row("  ", (origin, QUIET)),) if origin else ()
    title = Content.assemble(
        (f"Attempt {attempt.number}", "bold"),
        (f"  {attempt.phase}" if attempt.phase else "", NOTE),
        (f"  {how}", QUIET),
    )
    return Section(f"heading-{attempt.number}", title, rows)


def _folded(attempt: Attempt, parts: list[Section]) -> Section:
    reasons = tuple(row("  ✘ ", (reason, WARN)) for reason in attempt.repair)
    broken = [finding.rule_id for finding in attempt.findings if finding.broken]
    objected = attempt.verdict is not None and attempt.verdict.verdict == "Failure"
    unused = "the judge objects" if objected else "not used"
    note = ", ".join(broken) or attempt.error or unused
    other = f"  instead of {attempt.instead_of}" if attempt.instead_of is not None else ""
    head = Content.assemble(
        (f"Attempt {attempt.number}", "bold"), (other, QUIET), (f"  ✘ {note}", BAD)
    )
    rows = (*reasons, *_spread(parts))
    return Section(f"attempt-{attempt.number}", head, rows, collapsed=True)


def _folded_round(given: Round, rules: Rules) -> Section:
    """Everything of a plan that was carried out before the present one."""
    rows: list[Row] = []
    for attempt in given.attempts:
        rows.append(row("", (f"Attempt {attempt.number}", "bold")))
        rows += _spread(_attempt(attempt, rules))
    rows += _spread(_executed(given))
    return Section(f"round-{given.number}", given.title, tuple(rows), collapsed=True)


def _spread(parts: list[Section]) -> list[Row]:
    """Return the rows of sections under their titles; rules that merely stand are left out."""
    return [
        item
        for part in parts
        if not part.key.endswith("-rest")
        for item in (row("", part.title), *part.rows)
    ]


def progress(trace: MissionTrace) -> Content:
    """Return the line that shows how far the mission is, or how it ended and why."""
    if trace.status is not None:
        mark = term("mission", trace.status)
        return Content.assemble(
            (f"{mark.glyph} {mark.word}", mark.style), (f"  {trace.reason}", QUIET)
        )
    step = STEPS.index(trace.stage) if trace.stage in STEPS else 0
    last = len(STEPS) - 1
    waits = f" waits: {trace.preempted}" if trace.preempted else " waits in the queue"
    words = f" step {step} of {last}: {trace.stage}" if step else waits
    return Content.assemble(
        ("━━" * step, "$text-success"),
        ("━╸", "$text-accent"),
        ("──" * (last - step), "$faint"),
        words,
    )


def headline(trace: MissionTrace) -> list[Row]:
    """Return the mission's id, origin and text, and where it stands in each workflow."""
    origin = " by alarm" if trace.mission.source == "alarm" else ""
    mission = trace.mission
    head = [(mission.id, "bold $text-accent"), (origin, WARN), f" {mission.said}"]
    return [
        row("", *head),
        *([row("", (f"read as: {mission.text}", "$text-muted"))] if mission.typed else []),
        *(row("", workflow.standing(m)) for m in workflow.by_track(trace).values()),
    ]

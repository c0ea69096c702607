"""Puts a mission's trace together: its sections, in the order in which things happened."""

from dataclasses import replace

from pa_console.schema.telemetry import Digest
from pa_console.schema.text.quantities import count
from pa_console.session.state.mission_trace import (
    Attempt,
    MissionTrace,
    Round,
    chosen_attempt,
    rounds,
)
from pa_console.session.state.rule_trail import evidence_of
from pa_console.session.status_words import Status, status_of
from pa_console.session.trace import execution, planning, safeguards
from pa_console.session.trace.parts import (
    Block,
    Detail,
    Line,
    Section,
    Span,
    TraceOptions,
    said,
)
from pa_console.session.trace.planning import Rules
from pa_console.session.trace.questions import answered
from pa_console.session.trace.standing import standing_order, workflow


def lay_out(trace: MissionTrace, rules: Rules, options: TraceOptions) -> list[Section]:
    """Return everything known of the mission, in the order in which it happened.

    Only the last plan is spread out, with the chosen of its attempts; before it come, collapsed,
    the plans that were carried out earlier, phase by phase, and the attempts not chosen.
    """
    result = [workflow(trace, options)] if trace.workflow else []
    result += _given(trace, rules, options)
    *before, now = rounds(trace)
    before = [given for given in before if given.attempts or given.commands]
    result += [_earlier_round(given, trace, rules, options) for given in before]
    if before and options.detail is Detail.FULL:
        result += execution.halts(before[-1].halts)
    chosen = chosen_attempt(trace, now)
    for attempt in now.attempts:
        if attempt is not chosen:
            result.append(_not_chosen(attempt, trace, rules, options))
    if chosen is not None:
        result += _chosen(chosen, trace, rules, options)
    if trace.approval is not None and options.detail >= Detail.RECORD:
        result.append(safeguards.approval(trace.approval))
    result += _carried_out(now, options)
    if trace.unasked_verdict is not None or trace.unasked_error:
        result.append(execution.judged_outcome(trace.unasked_verdict, trace.unasked_error))
    if trace.report:
        result.append(execution.report(trace))
    if trace.status is not None:
        result.append(execution.outcome(trace))
    if trace.metrics is not None:
        result.append(execution.timings(trace, options))
    return result + answered(trace.answers)


def lay_out_proposal(
    trace: MissionTrace, number: int, rules: Rules, options: TraceOptions
) -> list[Section]:
    """Return what is known of attempt `number`, for who decides about it."""
    attempt = trace.find(number)
    result = _given(trace, rules, options)
    return result + (_chosen(attempt, trace, rules, options) if attempt is not None else [])


def _given(trace: MissionTrace, rules: Rules, options: TraceOptions) -> list[Section]:
    """Steps 2 and 3: what the mission was planned by."""
    result: list[Section] = []
    if trace.standing is not None:
        result.append(standing_order(trace.standing))
    if trace.hits:
        result.append(planning.retrieved_rules(trace, rules, options))
    if trace.digest is not None and options.detail >= Detail.FULL:
        result += planning.pictures(trace.digest, options)
    return result


def _chosen(
    attempt: Attempt, trace: MissionTrace, rules: Rules, options: TraceOptions
) -> list[Section]:
    """The attempt that counts: under a heading where it is one of several, or not as usual."""
    parts = _attempt(attempt, trace.digest, rules, options, with_rest=True)
    beside = len(trace.attempts) > 1
    if not (beside or attempt.origin or attempt.repair):
        return parts
    how = f"by the {attempt.author}"
    if attempt.instead_of is not None:
        how = f"instead of {attempt.instead_of}"
    elif beside and attempt.author == "planner" and options.detail is Detail.FULL:
        how = "shown in full"
    note = ", ".join(words for words in (attempt.phase, how) if words)
    key = f"heading-{attempt.number}"
    return [_heading(attempt, Section(key, f"Attempt {attempt.number}", note=note), parts)]


def _not_chosen(
    attempt: Attempt, trace: MissionTrace, rules: Rules, options: TraceOptions
) -> Section:
    """An attempt that came to nothing, under the reason why."""
    broken = [finding.rule_id for finding in attempt.findings if finding.broken]
    objected = attempt.verdict is not None and attempt.verdict.verdict == "Failure"
    unused = "the judge objects" if objected else "not used"
    mark = Status("✘", ", ".join(broken) or attempt.error or unused, "bad")
    note = f"instead of {attempt.instead_of}" if attempt.instead_of is not None else ""
    key, title = f"attempt-{attempt.number}", f"Attempt {attempt.number}"
    section = Section(key, title, mark=mark, note=note, collapsed=True)
    return _heading(attempt, section, _folded_attempt(attempt, trace, rules, options))


def _heading(attempt: Attempt, section: Section, parts: list[Section]) -> Section:
    """Put the parts of an attempt under its title, after who else had a part in it."""
    blocks: list[Block] = []
    if origin := attempt.origin.removeprefix(", "):
        blocks.append(said(origin, "quiet"))
    blocks += [Line((Span(reason, "warn"),), mark=Span("✘")) for reason in attempt.repair]
    return replace(section, blocks=tuple(blocks), parts=tuple(parts))


def _earlier_round(
    given: Round, trace: MissionTrace, rules: Rules, options: TraceOptions
) -> Section:
    """Everything of a plan that was carried out before the present one."""
    parts = [
        _heading(
            attempt,
            Section(f"attempt-{attempt.number}", f"Attempt {attempt.number}"),
            _folded_attempt(attempt, trace, rules, options),
        )
        for attempt in given.attempts
    ]
    numbers = ", ".join(str(attempt.number) for attempt in given.attempts)
    dispatched = count(len(given.commands), "command")
    return Section(
        f"round-{given.number}",
        given.name,
        mark=status_of("outcome", given.outcome),
        note=f"attempt {numbers}; {dispatched}",
        parts=(*parts, *_carried_out(given, options)),
        collapsed=True,
        tone="note",
    )


def _folded_attempt(
    attempt: Attempt, trace: MissionTrace, rules: Rules, options: TraceOptions
) -> list[Section]:
    """The sections of an attempt that is not the one that counts; rules that stand are left out."""
    with_rest = options.detail >= Detail.RECORD
    return _attempt(attempt, trace.digest, rules, options, with_rest=with_rest)


def _attempt(
    attempt: Attempt,
    shown: Digest | None,
    rules: Rules,
    options: TraceOptions,
    *,
    with_rest: bool,
) -> list[Section]:
    """Steps 3 to 6 of one attempt; its picture only where it is another than the one `shown`."""
    full, record = options.detail >= Detail.FULL, options.detail >= Detail.RECORD
    number = attempt.number
    parts: list[Section] = []
    if record and attempt.digest is not None and attempt.digest != shown:
        parts += planning.pictures(attempt.digest, options, f"-{number}")
    if full and (attempt.user or attempt.system):
        parts.append(planning.prompt(attempt))
    if attempt.user or attempt.text or attempt.plan or attempt.error or not attempt.findings:
        parts.append(planning.plan(attempt))
    if options.detail is Detail.FULL and attempt.text and attempt.plan is not None:
        parts.append(planning.plan_json(attempt))
    if record and attempt.text and attempt.plan is not None:
        title = f"The {attempt.author}'s answer"
        parts.append(
            planning.answer(f"answer-{number}", title, attempt.text, attempt.usage, step=5)
        )
    if attempt.rehearsal is not None:
        parts.append(safeguards.rehearsal(attempt, attempt.rehearsal, options))
    if attempt.findings:
        parts += safeguards.checks(attempt, rules, with_rest=full and with_rest)
    decided_by = evidence_of(attempt) if options.evidence else None
    if decided_by is not None:
        parts.append(safeguards.evidence(attempt, decided_by))
    if attempt.judged or attempt.judge_text:
        parts.append(safeguards.verdict(attempt))
    if attempt.read_again is not None:
        parts.append(safeguards.second_reading(attempt, attempt.read_again))
    if record and attempt.judged and attempt.judge_text:
        key, usage = f"judge-answer-{number}", attempt.judge_usage
        parts.append(planning.answer(key, "The judge's answer", attempt.judge_text, usage, step=6))
    return parts


def _carried_out(given: Round, options: TraceOptions) -> list[Section]:
    """What was decided on a plan, and what came of it; the last verification first."""
    result: list[Section] = []
    if given.decisions or given.voided:
        result.append(execution.decisions(given.decisions, given.voided))
    if given.commands:
        result.append(execution.commands(given.commands, options))
    result += execution.halts(given.halts)
    numbered = list(enumerate(given.verified, start=1))
    result += [execution.verification(item, number) for number, item in reversed(numbered)]
    return result

"""The layout of a mission's trace, with sections in the order of the events, and its progress."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from pa_console.schema.events.event import StandingOrderRead, WorkflowMoved
from pa_console.schema.events.intake import AnswerLine, QuestionAnswered
from pa_console.schema.text import count
from pa_console.session.mission_trace import Attempt, MissionTrace, Round, chosen_attempt, rounds
from pa_console.views import trace_execution as execution
from pa_console.views import trace_planning as planning
from pa_console.views.event_words import asked_in_words, moments_in_words, references_in_words
from pa_console.views.rule_trail import evidence_of
from pa_console.views.status_words import Status, status_of
from pa_console.views.trace_parts import (
    Block,
    Column,
    Detail,
    Span,
    Spans,
    TraceLine,
    TraceOptions,
    TraceSection,
    labelled,
    statement,
    table,
)
from pa_console.views.trace_planning import Rules

_MOST_LABEL = 15
"""The maximum width of the labels in an answer, in cells."""
STEPS = (
    "submit", "understand", "retrieve", "plan", "examine", "judge", "decide", "execute",
    "verify", "report",
)  # fmt: skip
"""The steps of a mission, in order."""
_STEPS_OF_STAGES = {
    "retrieve": "understand", "picture": "retrieve", "prompt": "plan", "safeguards": "examine",
}  # fmt: skip
"""The steps of the stages that are not named after their step.

A mission is at the stage `retrieve` until its rules have been retrieved.
"""


def lay_out(trace: MissionTrace, rules: Rules, options: TraceOptions) -> list[TraceSection]:
    """Return the whole trace of the mission, in the order of its events.

    The last plan is expanded, with its chosen attempt. Earlier plans, phase by phase, and attempts
    that were not chosen come first, collapsed.
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
        result.append(planning.approval(trace.approval))
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
) -> list[TraceSection]:
    """Return the trace of attempt `number` for the person who decides on it."""
    attempt = trace.find(number)
    result = _given(trace, rules, options)
    return result + (_chosen(attempt, trace, rules, options) if attempt is not None else [])


def _given(trace: MissionTrace, rules: Rules, options: TraceOptions) -> list[TraceSection]:
    """Return steps 2 and 3: the standing order, and the rules and picture used for planning."""
    result: list[TraceSection] = []
    if trace.standing is not None:
        result.append(standing_order(trace.standing))
    if trace.hits:
        result.append(planning.retrieved_rules(trace, rules, options))
    if trace.digest is not None and options.detail >= Detail.FULL:
        result += planning.pictures(trace.digest, options)
    return result


def _chosen(
    attempt: Attempt, trace: MissionTrace, rules: Rules, options: TraceOptions
) -> list[TraceSection]:
    """Return the chosen attempt, with a heading if it is one of several or has an origin."""
    parts = _attempt(attempt, trace, rules, options, with_rest=True)
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
    return [_heading(attempt, TraceSection(key, f"Attempt {attempt.number}", note=note), parts)]


def _not_chosen(
    attempt: Attempt, trace: MissionTrace, rules: Rules, options: TraceOptions
) -> TraceSection:
    """Return an attempt that was not chosen, collapsed, with the reason as its mark."""
    broken = [finding.rule_id for finding in attempt.findings if finding.broken]
    objected = attempt.verdict is not None and attempt.verdict.verdict == "Failure"
    unused = "the judge objects" if objected else "not used"
    mark = Status("✘", ", ".join(broken) or attempt.error or unused, "bad")
    if attempt.step and not (broken or attempt.error or objected):
        mark = Status("·", "a step of the plan", "quiet")
    note = f"instead of {attempt.instead_of}" if attempt.instead_of is not None else attempt.step
    key, title = f"attempt-{attempt.number}", f"Attempt {attempt.number}"
    section = TraceSection(key, title, mark=mark, note=note, collapsed=True)
    return _heading(attempt, section, _folded_attempt(attempt, trace, rules, options))


def _heading(attempt: Attempt, section: TraceSection, parts: list[TraceSection]) -> TraceSection:
    """Add the parts of an attempt to its section, after its origin and the reasons for a repair."""
    blocks: list[Block] = []
    if origin := attempt.origin.removeprefix(", "):
        blocks.append(statement(origin, "quiet"))
    blocks += [TraceLine((Span(reason, "warn"),), mark=Span("✘")) for reason in attempt.repair]
    return replace(section, blocks=tuple(blocks), parts=tuple(parts))


def _earlier_round(
    given: Round, trace: MissionTrace, rules: Rules, options: TraceOptions
) -> TraceSection:
    """Return an earlier plan, collapsed."""
    parts = [
        _heading(
            attempt,
            TraceSection(f"attempt-{attempt.number}", f"Attempt {attempt.number}"),
            _folded_attempt(attempt, trace, rules, options),
        )
        for attempt in given.attempts
    ]
    numbers = ", ".join(str(attempt.number) for attempt in given.attempts)
    dispatched = count(len(given.commands), "command")
    return TraceSection(
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
) -> list[TraceSection]:
    """Return the sections of a collapsed attempt; only a full record lists unbroken rules."""
    with_rest = options.detail >= Detail.RECORD
    return _attempt(attempt, trace, rules, options, with_rest=with_rest)


def _attempt(
    attempt: Attempt, trace: MissionTrace, rules: Rules, options: TraceOptions, *, with_rest: bool
) -> list[TraceSection]:
    """Return steps 3 to 6 of one attempt, with its picture if it is not that of the mission."""
    full, record = options.detail >= Detail.FULL, options.detail >= Detail.RECORD
    number, over = attempt.number, trace.status is not None
    parts: list[TraceSection] = []
    if record and attempt.digest is not None and attempt.digest != trace.digest:
        parts += planning.pictures(attempt.digest, options, f"-{number}")
    if full and (attempt.user or attempt.system):
        parts.append(planning.prompt(attempt))
    if attempt.user or attempt.text or attempt.plan or attempt.error or not attempt.findings:
        parts.append(planning.plan(attempt, over=over))
    if options.detail is Detail.FULL and attempt.text and attempt.plan is not None:
        parts.append(planning.plan_json(attempt))
    if record and attempt.text and attempt.plan is not None:
        title = f"The {attempt.author}'s answer"
        parts.append(
            planning.answer(f"answer-{number}", title, attempt.text, attempt.usage, step=4)
        )
    if attempt.rehearsal is not None:
        parts.append(planning.rehearsal(attempt, attempt.rehearsal, options))
    if attempt.findings:
        parts += planning.checks(attempt, rules, with_rest=full and with_rest)
    decided_by = evidence_of(attempt) if options.evidence else None
    if decided_by is not None:
        parts.append(planning.evidence(attempt, decided_by))
    if attempt.judged or attempt.judge_text:
        parts.append(planning.verdict(attempt, over=over))
    if attempt.read_again is not None:
        parts.append(planning.second_reading(attempt, attempt.read_again))
    if record and attempt.judged and attempt.judge_text:
        key, usage = f"judge-answer-{number}", attempt.judge_usage
        parts.append(planning.answer(key, "The judge's answer", attempt.judge_text, usage, step=6))
    return parts


def _carried_out(given: Round, options: TraceOptions) -> list[TraceSection]:
    """Return decisions, commands and halts of a plan, and its verifications, the last first."""
    result: list[TraceSection] = []
    if given.decisions or given.voided:
        result.append(execution.decisions(given.decisions, given.voided))
    if given.commands:
        result.append(execution.commands(given.commands, options))
    result += execution.halts(given.halts)
    result += execution.held(given.held)
    numbered = list(enumerate(given.verified, start=1))
    result += [execution.verification(item, number) for number, item in reversed(numbered)]
    return result


def answered(given: Sequence[QuestionAnswered]) -> list[TraceSection]:
    """Return a section for each question of the operator; all but the last are collapsed."""
    return [
        TraceSection(
            f"asked-{number}",
            f"You asked: {answer.question}",
            tuple(_answer_lines(answer.lines)),
            collapsed=number < len(given),
            tone="note",
        )
        for number, answer in enumerate(given, start=1)
    ]


def _answer_lines(given: Sequence[AnswerLine]) -> Iterator[TraceLine]:
    """Yield the lines of an answer with their subjects; a repeated subject is left out."""
    width = min(max((len(line.about) for line in given), default=0), _MOST_LABEL)
    before = ""
    for line in given:
        label = " " if line.about == before else line.about
        before = line.about
        yield TraceLine((Span(line.said),), label, "quiet", width=width)


def headline(trace: MissionTrace) -> tuple[Spans, ...]:
    """Return lines with the mission's id, origin and text, its reading, and its phases."""
    mission = trace.mission
    origin = (Span(f" {mission.origin}", "warn"),) if mission.origin else ()
    head = (Span(mission.id, "note", "bold"), *origin, Span(f" {mission.said}"))
    read = ((Span(f"read as: {mission.text}", "quiet"),),) if mission.typed else ()
    meant = references_in_words(trace.references)
    read += ((Span(f"where {meant}", "quiet"),),) if meant else ()
    return (head, *read, *(standing(moves) for moves in by_track(trace).values()))


def step_name(trace: MissionTrace) -> str:
    """Return the mission's current step; its stage if it is queued or finished."""
    return _STEPS_OF_STAGES.get(trace.stage, trace.stage)


def step_of(trace: MissionTrace) -> int:
    """Return the number of the mission's current step; 0 if it is queued or finished."""
    name = step_name(trace)
    return STEPS.index(name) + 1 if name in STEPS else 0


def progress(trace: MissionTrace) -> Spans:
    """Return the mission's step in words, or its end with the reason."""
    if trace.status is not None:
        mark = status_of("mission", trace.shown_status)
        return Span(mark.text, mark.tone), Span(f"  {trace.reason}", "quiet")
    if step := step_of(trace):
        return (Span(f"step {step} of {len(STEPS)}: {step_name(trace)}"),)
    return (Span(f"waits: {trace.preempted}" if trace.preempted else "waits in the queue"),)


def phase_mark(moves: Sequence[WorkflowMoved], number: int) -> Status:
    """Return the status of phase `number` after `moves`: done, current, skipped or to come.

    If a workflow ended early, the phases after its last one count as skipped.
    """
    last = moves[-1]
    if last.phases[number] in last.skipped:
        return status_of("phase", "skipped")
    if number == last.phase:
        return status_of("phase", "current")
    if last.phase < len(last.phases):
        return status_of("phase", "done" if number < last.phase else "pending")
    reached = max((move.phase for move in moves[:-1]), default=-1)
    return status_of("phase", "done" if number <= reached or not last.outcome else "skipped")


def standing(moves: Sequence[WorkflowMoved]) -> Spans:
    """Return the track of `moves` and every phase with its sign, on one line."""
    move = moves[-1]
    parts = [Span(move.track, "note", "bold")]
    for number, name in enumerate(move.phases):
        mark = phase_mark(moves, number)
        stress = "bold" if number == move.phase else ""
        parts.append(Span(f" {mark.glyph} {name}", mark.tone, stress))
    if move.outcome:
        parts.append(Span(f" ■ {move.outcome}", "note"))
    return tuple(parts)


def by_track(trace: MissionTrace) -> dict[str, list[WorkflowMoved]]:
    """Return the moves of each track's workflow, oldest first."""
    result: dict[str, list[WorkflowMoved]] = {}
    for move in trace.workflow:
        result.setdefault(move.track, []).append(move)
    return result


def workflow(trace: MissionTrace, options: TraceOptions) -> TraceSection:
    """Return every phase of every workflow, its current command and its outcome."""
    blocks: list[Block] = []
    for moves in by_track(trace).values():
        move = moves[-1]
        blocks.append(TraceLine(standing(moves)))
        if move.command:
            blocks.append(labelled("now", move.command, depth=1))
        if move.skipped:
            blocks.append(labelled("skipped", ", ".join(move.skipped), "quiet", depth=1))
        if move.outcome:
            blocks.append(labelled("outcome", move.outcome, depth=1))
    if options.detail >= Detail.RECORD:
        heads = (Column("track", 11, stress="bold"), Column("phase", 10), Column("command"))
        blocks.append(
            table(heads, ((move.track, _phase(move), move.command) for move in trace.workflow))
        )
    rules = ", ".join(dict.fromkeys(move.rule_id for move in trace.workflow))
    return TraceSection("workflow", "Workflow", tuple(blocks), note=f"by {rules}")


def standing_order(read: StandingOrderRead) -> TraceSection:
    """Return the reading of a standing order: condition, order, and missions to start now."""
    order = read.order
    timed = order.schedule is not None
    if order.ban is not None:
        ban = (labelled("ban", order.order), labelled("holds", order.words))
        return TraceSection("standing", f"Standing order {order.id}", ban, step=2)
    trigger = [labelled("moments", order.words), labelled("next", moments_in_words(read.moments))]
    state = [labelled("whenever", order.words), labelled("in CEL", order.condition, "calm")]
    blocks: list[Block] = [
        *(trigger if timed else state),
        labelled("it starts", order.order_in_words),
        labelled("approval", asked_in_words(order, read.allowed)),
    ]
    if not timed:
        blocks.append(labelled("limit", f"{count(order.most_an_hour, 'start')} an hour"))
    for start in read.now:
        about = f"{start.subject}: " * bool(start.subject)
        blocks.append(labelled("now", f"{about}{start.order}", "warn"))
    if not read.now:
        blocks.append(
            labelled("now", "the condition is not met, so no mission would start", "quiet")
        )
    return TraceSection("standing", f"Standing order {order.id}", tuple(blocks), step=2)


def _phase(move: WorkflowMoved) -> str:
    return move.phases[move.phase] if 0 <= move.phase < len(move.phases) else "over"

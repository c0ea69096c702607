"""The progress of a mission: its headline, its step, and its phase in each workflow (WF-01)."""

from collections.abc import Sequence

from pa_console.schema.events.event import StandingOrderRead, WorkflowMoved
from pa_console.schema.text.quantities import count
from pa_console.session.state.mission_trace import MissionTrace
from pa_console.session.status_words import Status, status_of
from pa_console.session.trace.parts import (
    Block,
    Column,
    Detail,
    Line,
    Section,
    Span,
    Spans,
    TraceOptions,
    labelled,
    table,
)
from pa_console.session.wording import asked_in_words, references_in_words

STEPS = (
    "queued", "retrieve", "picture", "prompt", "plan", "safeguards", "judge", "decide",
    "execute", "verify", "report",
)  # fmt: skip
"""The stages of a mission, in order."""


def headline(trace: MissionTrace) -> tuple[Spans, ...]:
    """Return lines with the mission's id, origin and text, its reading, and its phases."""
    mission = trace.mission
    origin = (Span(" by alarm", "warn"),) if mission.source == "alarm" else ()
    if mission.standing:
        origin = (Span(f" by standing order {mission.standing}", "warn"),)
    head = (Span(mission.id, "note", "bold"), *origin, Span(f" {mission.said}"))
    read = ((Span(f"read as: {mission.text}", "quiet"),),) if mission.typed else ()
    meant = references_in_words(trace.references)
    read += ((Span(f"where {meant}", "quiet"),),) if meant else ()
    return (head, *read, *(standing(moves) for moves in by_track(trace).values()))


def step_of(trace: MissionTrace) -> int:
    """Return the number of STEPS that the mission has behind it."""
    return STEPS.index(trace.stage) if trace.stage in STEPS else 0


def progress(trace: MissionTrace) -> Spans:
    """Return the mission's step in words, or its end with the reason."""
    if trace.status is not None:
        mark = status_of("mission", trace.status)
        return Span(mark.text, mark.tone), Span(f"  {trace.reason}", "quiet")
    if step := step_of(trace):
        return (Span(f"step {step} of {len(STEPS) - 1}: {trace.stage}"),)
    return (Span(f"waits: {trace.preempted}" if trace.preempted else "waits in the queue"),)


def phase_mark(moves: Sequence[WorkflowMoved], number: int) -> Status:
    """Return the status of phase `number` after `moves`: done, current, skipped or to come.

    The phases after the last one of a workflow that ended early count as skipped.
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
    """Return the track of `moves` and every phase with its sign, in one line."""
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


def workflow(trace: MissionTrace, options: TraceOptions) -> Section:
    """Return every phase of every workflow, its present command and its outcome."""
    blocks: list[Block] = []
    for moves in by_track(trace).values():
        move = moves[-1]
        blocks.append(Line(standing(moves)))
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
    return Section("workflow", "Workflow", tuple(blocks), step=1, note=f"by {rules}")


def standing_order(read: StandingOrderRead) -> Section:
    """Return a standing order as it was read: its condition, its order, its immediate starts."""
    order = read.order
    blocks: list[Block] = [
        labelled("whenever", order.words),
        labelled("in CEL", order.condition, "calm"),
        labelled("it starts", order.order_in_words),
        labelled("approval", asked_in_words(order, read.allowed)),
        labelled("limit", f"{count(order.most_an_hour, 'start')} an hour"),
    ]
    blocks += [labelled("now", f"{start.subject}: {start.order}", "warn") for start in read.now]
    if not read.now:
        blocks.append(labelled("now", "it would start nothing", "quiet"))
    return Section("standing", f"Standing order {order.id}", tuple(blocks), step=1)


def _phase(move: WorkflowMoved) -> str:
    return move.phases[move.phase] if 0 <= move.phase < len(move.phases) else "over"

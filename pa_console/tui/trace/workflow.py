"""Where a mission stands in the workflows that rules prescribe (WF-01), track by track."""

from collections.abc import Sequence

from textual.content import Content

from pa_console.schema.events.event import WorkflowMoved
from pa_console.session.state.mission_trace import MissionTrace
from pa_console.tui.status_words import NOTE, QUIET, Term, term
from pa_console.tui.trace.planning import title
from pa_console.tui.trace.rows import Row, Section, row


def phase_mark(moves: Sequence[WorkflowMoved], number: int) -> Term:
    """Return whether phase `number` is done, current, skipped or to come, after `moves`.

    A workflow that ended early never came to the phases after its last one: they are skipped.
    """
    last = moves[-1]
    if last.phases[number] in last.skipped:
        return term("phase", "skipped")
    if number == last.phase:
        return term("phase", "current")
    if last.phase < len(last.phases):
        return term("phase", "done" if number < last.phase else "pending")
    reached = max((move.phase for move in moves[:-1]), default=-1)
    return term("phase", "done" if number <= reached or not last.outcome else "skipped")


def standing(moves: Sequence[WorkflowMoved]) -> Content:
    """Return the track of `moves` and every phase with its sign, in one line."""
    move = moves[-1]
    parts: list[tuple[str, str]] = [(move.track, "bold $text-accent")]
    for number, name in enumerate(move.phases):
        mark = phase_mark(moves, number)
        current = f"bold {mark.style}" if number == move.phase else mark.style
        parts.append((f" {mark.glyph} {name}", current))
    if move.outcome:
        parts.append((f" ■ {move.outcome}", NOTE))
    return Content.assemble(*parts)


def by_track(trace: MissionTrace) -> dict[str, list[WorkflowMoved]]:
    """Return the moves of each track's workflow, oldest first."""
    result: dict[str, list[WorkflowMoved]] = {}
    for move in trace.workflow:
        result.setdefault(move.track, []).append(move)
    return result


def section(trace: MissionTrace) -> Section:
    """Every phase of every workflow, what it is about now, and what came of it."""
    rows: list[Row] = []
    for moves in by_track(trace).values():
        move = moves[-1]
        rows.append(row("  ", standing(moves)))
        if move.command:
            rows.append(row("    now: ", move.command))
        if move.skipped:
            rows.append(row("    skipped: ", (", ".join(move.skipped), QUIET)))
        if move.outcome:
            rows.append(row("    outcome: ", move.outcome))
    rules = ", ".join(dict.fromkeys(move.rule_id for move in trace.workflow))
    return Section("workflow", title("Workflow", note=f"by {rules}"), tuple(rows))

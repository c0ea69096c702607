"""A mission on the terminal: each step as a line, and its whole trace."""

from collections.abc import Iterable

from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from pa_console.schema.events import event as ev
from pa_console.schema.events.intake import QuestionAnswered
from pa_console.schema.text import visible
from pa_console.session.mission_trace import MissionTrace
from pa_console.views.event_words import event_in_words
from pa_console.views.status_words import Tone
from pa_console.views.trace_layout import answered, headline, lay_out, lay_out_proposal, progress
from pa_console.views.trace_parts import (
    Detail,
    HangingRow,
    Span,
    TraceOptions,
    TraceSection,
    rows_of,
    title_of,
)

_STEPS: dict[str, str] = {
    "mission_received": "mission",
    "standing_order_read": "standing order",
    "standing_order_approved": "in force",
    "standing_order_started": "started",
    "order_step_read": "read",
    "rules_retrieved": "rules found",
    "plan_proposed": "plan",
    "plan_checked": "safeguards",
    "plan_judged": "judge",
    "repair_requested": "planned again",
    "plan_voided": "plan void",
    "command_sent": "sent",
    "command_refused": "refused",
    "plan_halted": "plan halted",
    "steps_held": "not sent",
    "steps_paused": "steps",
    "mission_verified": "telemetry",
    "outcome_judged": "judge on the outcome",
    "mission_preempted": "waits again",
    "mission_finished": "finished",
}
"""The steps that are shown, and their names."""


def step_line(event: ev.Event) -> str:
    """Return the meaning of `event` in one line; empty if it is no step of a mission.

    Changes of a model's server, and of its replacement, are shown too.
    """
    match event.data:
        case ev.ServerChanged(state=state) if state != "probing":
            return f"model server: {event_in_words(event.data)}"
        case ev.Noticed(subject="model server", text=text):
            return f"model server: {text}"
        case _:
            pass
    name = _STEPS.get(event.data.kind)
    if name is None or event.mission is None:
        return ""
    said = event_in_words(event.data)
    return f"{event.mission}  {name}: {said}" if said else f"{event.mission}  {name}"


COLOURS: dict[Tone, str] = {
    "": "",
    "good": "green",
    "bad": "red",
    "warn": "yellow",
    "calm": "cyan",
    "quiet": "dim",
    "note": "magenta",
}
"""The terminal's colour for every tone."""

_OPTIONS = TraceOptions(Detail.BRIEF, evidence=True)


def print_trace(console: Console, trace: MissionTrace) -> None:
    """Print `trace` in the order of the eight steps, its end first."""
    _print_head(console, trace)
    console.print(_text(progress(trace)))
    _print_sections(console, lay_out(trace, {}, _OPTIONS))


def print_proposal(console: Console, trace: MissionTrace, number: int) -> None:
    """Print the rules and attempt `number` of a mission that waits for approval."""
    _print_head(console, trace)
    _print_sections(console, lay_out_proposal(trace, number, {}, _OPTIONS))


def print_answer(console: Console, told: QuestionAnswered) -> None:
    """Print the answer to a question that is about no mission, or about one printed before."""
    _print_sections(console, answered((told,)))


def _print_head(console: Console, trace: MissionTrace) -> None:
    console.print()
    for line in headline(trace):
        console.print(_text(line))


def _print_sections(console: Console, sections: Iterable[TraceSection], indent: int = 0) -> None:
    """Print each section under its title, and the parts of it further in."""
    for section in sections:
        console.print(Padding(_text(title_of(section)), (0, 0, 0, indent), expand=False))
        for row in rows_of(section):
            console.print(Padding(_hanging(row), (0, 0, 0, indent), expand=False))
        _print_sections(console, section.parts, indent + 2)


def _hanging(row: HangingRow) -> Table:
    """Return a row whose body wraps beside its lead."""
    lead = _text(row.lead)
    grid = Table.grid()
    grid.add_column(no_wrap=True, overflow="fold")
    grid.add_column(overflow="fold")
    grid.add_row(lead, _text(row.body))
    return grid


def _text(spans: Iterable[Span]) -> Text:
    """Return a laid out text in the terminal's colours; what a terminal obeys is its escape."""
    return Text.assemble(
        *((visible(span.text), f"{span.stress} {COLOURS[span.tone]}".strip()) for span in spans)
    )

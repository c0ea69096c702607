"""The difference between two recordings as rows: a heading, the events around it, the values."""

from textual.content import Content

from pa_console.schema.text import clock_text, count
from pa_console.session.recording import Recording
from pa_console.tui.status_words import BAD, GOOD, NOTE, QUIET, WARN
from pa_console.tui.trace.rows import Row, row
from pa_console.views.comparison import ENDED, EventDifference, SessionComparison
from pa_console.views.event_words import event_in_words, kind_in_words

SHORT = 40
"""Two values that are no longer than this together stand in one row."""

BEFORE, AFTER = 6, 3
"""The numbers of events shown before and after the one that differs."""


def heading(
    found: SessionComparison | None, shown: EventDifference | None, problem: str, *, beyond: bool
) -> Content:
    """Return the heading with the place where the recordings part."""
    parts: list[tuple[str, str] | str] = [(" COMPARE ", "bold reverse $text-warning"), "  "]
    if problem or found is None:
        parts.append((problem, BAD))
    elif shown is None and found.first is None:
        same = "they were started differently" if found.started else "nothing differs"
        parts.append((same, f"bold {WARN if found.started else GOOD}"))
    elif shown is not None:
        what = "first difference beyond telemetry" if beyond else "first difference"
        numbers = f"{shown.a + 1}" if shown.a == shown.b else f"{shown.a + 1} | {shown.b + 1}"
        parts += [(what, f"bold {WARN}"), f" at event {numbers}"]
        if found.beyond is None and not beyond:
            parts.append((f", {count(len(shown.changes), 'value')}", QUIET))
        else:
            parts.append(("; n: the other one", QUIET))
    return Content.assemble(*parts)


def around(recording: Recording, at: int, width: int) -> tuple[Row, ...]:
    """Return a row, `width` cells wide, for the events before `at`, for it, and for those after."""
    rows: list[Row] = []
    for index in range(max(at - BEFORE, 0), min(at + AFTER + 1, len(recording))):
        event = recording[index]
        when = f"{clock_text(recording.timeline.seconds[index])} "
        kind, text = kind_in_words(event.data.kind), event_in_words(event.data)
        line = Content.assemble(
            (when, QUIET), (event.mission or "", "bold"), " " if event.mission else "",
            (f"{kind} ", NOTE), " ".join(text.split()),
        )  # fmt: skip
        line = line.truncate(width, ellipsis=True)
        if index == at:
            line = line.pad_right(max(0, width - line.cell_length)).stylize("reverse")
        rows.append(Row(Content(), line))
    if at >= len(recording):
        rows.append(row("", (ENDED.center(width), "reverse")))
    return tuple(rows)


def change_rows(
    found: SessionComparison, shown: EventDifference | None, names: tuple[str, str]
) -> tuple[Row, ...]:
    """Return what differs in how the sessions were started, and at the difference, A over B."""
    rows: list[Row] = []
    if found.started:
        rows.append(row("", ("They were started differently", f"bold {NOTE}")))
    rows += [
        row(["  "], (f"{change.path}  ", "bold"), f"{change.a}  |  {change.b}")
        for change in found.started
    ]
    if shown is None:
        if found.first is None:
            rows.append(row("", ("Every event means the same in both.", GOOD)))
        return tuple(rows)
    for change in shown.changes:
        path = (f"{change.path}  ", f"bold {NOTE}")
        if len(change.a) + len(change.b) <= SHORT:
            rows.append(row([path], ("A ", "bold"), f"{change.a}  ", ("B ", "bold"), change.b))
        else:
            rows.append(row([path]))
            rows += [row([(f"  {side}  ", "bold")], text) for side, text in
                     (("A", change.a), ("B", change.b))]  # fmt: skip
    rows.append(row("", (f"A {names[0]}   B {names[1]}", QUIET)))
    return tuple(rows)

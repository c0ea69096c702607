"""The schedule of a plan as a Gantt chart: who is under way or at work when, who guards a gate."""

from collections.abc import Iterator, Sequence
from itertools import groupby

from textual.content import Content

from pa_console.tui.plan_preview.action_rows import place_words
from pa_console.tui.plan_preview.preview import PlanPreview
from pa_console.tui.status_words import BAD, CALM, GOOD, NOTE, QUIET

MOST_LABEL = 12
LEAST_BARS = 12
"""The number of columns below which a chart's bars mean nothing."""

MOST_AGENTS = 8
"""The number of agents with a bar of their own; the schedule of a larger team is that of its
last."""

_GOES, _WORKS, _DONE, _FAILS, _NOW = "━", "─", "✔", "✘", "▼"
_DIGITS = 9


def schedule_lines(preview: PlanPreview, width: int, now_s: float | None = None) -> list[Content]:
    """Return the chart, `width` cells wide: a time axis, a bar an agent, a line a gate.

    A bar is thick while its agent goes and thin while it works at the place. A gate's line tells
    the number of its guards. With `now_s` the axis points at that moment.
    """
    agents = [a for a in dict.fromkeys(preview.plan.agents) if a in preview.ways]
    agents.sort(key=lambda name: preview.arrival_s(name) or 0.0)
    gates = [gate for gate in preview.before.gates if gate in preview.involved]
    labels = [*agents[:MOST_AGENTS], *map(place_words, gates)]
    lead = min(max((len(label) for label in labels), default=0), MOST_LABEL) + 1
    columns = width - lead
    if not labels or columns < LEAST_BARS or preview.duration_s <= 0.0:
        return []
    chart = _Chart(preview, columns)
    lines = [Content(" " * lead) + chart.axis(now_s)]
    shown = agents if len(agents) <= MOST_AGENTS else agents[-MOST_AGENTS:]
    lines += [_label(name, lead) + chart.bar(name) for name in shown]
    lines += [_label(place_words(gate), lead) + chart.guards(gate) for gate in gates]
    return lines


def _label(text: str, width: int) -> Content:
    cut = text if len(text) < width else f"{text[: width - 2]}…"
    return Content.styled(f"{cut:<{width}}", QUIET)


class _Chart:
    """Maps the seconds of a plan to columns."""

    def __init__(self, preview: PlanPreview, columns: int) -> None:
        self._preview, self._columns = preview, columns

    def _column(self, time_s: float) -> int:
        share = time_s / self._preview.duration_s
        return min(max(int(share * self._columns), 0), self._columns - 1)

    def _time_s(self, column: int) -> float:
        return (column + 0.5) / self._columns * self._preview.duration_s

    def axis(self, now_s: float | None) -> Content:
        """Return where the plan begins and ends, or what moment it is now."""
        if now_s is None:
            end = f"{self._preview.duration_s:.0f} s"
            return Content.styled(f"0 s{end:>{self._columns - 3}}", QUIET)
        at, words = self._column(now_s), f"{now_s:.0f} s"
        if at + len(words) + 1 < self._columns:
            text = f"{' ' * at}{_NOW} {words}"
        else:
            text = f"{words} {_NOW}".rjust(at + 1)
        return Content.styled(text.ljust(self._columns), NOTE)

    def bar(self, agent: str) -> Content:
        """Return when an agent goes and works, and at its end whether it was done."""
        motion, preview = self._preview.rehearsal.motion, self._preview
        ended_s = motion.ended_s.get(agent, preview.duration_s)
        arrived_s = motion.arrived_s.get(agent, ended_s)
        there, end = self._column(arrived_s), self._column(ended_s)
        done = preview.finished(agent)
        mark = (_DONE, GOOD) if done else (_FAILS, BAD)
        bar = (_GOES * there, CALM), (_WORKS * (end - there), CALM), mark
        return Content.assemble(*bar, " " * (self._columns - end - 1))

    def guards(self, gate: str) -> Content:
        """Return how many guards a gate has in each column."""
        counts = [
            len(self._preview.guards_at(gate, self._time_s(column)))
            for column in range(self._columns)
        ]
        return Content.assemble(*_runs(counts))


def _runs(counts: Sequence[int]) -> Iterator[tuple[str, str]]:
    """Yield the number of guards where it changes, and a line as long as it stays."""
    for count, columns in groupby(counts):
        length = sum(1 for _ in columns)
        digit = str(count) if count <= _DIGITS else "+"
        line = "·" if count else " "
        yield f"{digit}{line * (length - 1)}", "" if count else f"bold {BAD}"

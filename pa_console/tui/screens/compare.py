"""Two recordings side by side, at the first event in which they differ."""

from functools import partial
from pathlib import Path

from textual import events
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.content import Content
from textual.screen import ModalScreen, Screen
from textual.widgets import Label, Static

from pa_console.schema.text import clock_text, count
from pa_console.session.log.chain import LogError
from pa_console.session.recording import Player, Recording
from pa_console.tui.recordings import KnownWorld, OpenedLog, PlayableLog, open_compared
from pa_console.tui.rows import WrappedRow, row
from pa_console.tui.screens.dialogs import open_beside
from pa_console.tui.screens.recording import RecordingScreen
from pa_console.tui.status_words import BAD, GOOD, NOTE, QUIET, WARN
from pa_console.tui.surroundings import SecondsClock
from pa_console.tui.widgets.bars import KeyFooter
from pa_console.tui.widgets.map_view import MapView
from pa_console.tui.widgets.row_views import TextRows
from pa_console.views.comparison import ENDED, EventDifference, SessionComparison, compare_sessions
from pa_console.views.event_words import event_in_words, kind_in_words

TALL = 30
"""The minimum height of a screen with maps, in rows."""

SHORT = 40
"""The maximum length of two values together that share a row."""

BEFORE, AFTER = 6, 3
"""The numbers of events shown before and after the first difference."""


class CompareScreen(ModalScreen[None]):
    """The events around a difference, the maps if there is room, and the values that differ."""

    BINDINGS = [
        Binding("escape,q", "dismiss", "Back"),
        Binding("n", "other", "Beyond telemetry"),
        Binding("a", "open(0)", "Open A"),
        Binding("b", "open(1)", "Open B"),
    ]

    def __init__(self, a: OpenedLog, b: OpenedLog, clock: SecondsClock) -> None:
        super().__init__()
        self._sides, self._clock = (a, b), clock
        self._found: SessionComparison | None = None
        self._beyond = False
        self._problem = ""

    def compose(self) -> ComposeResult:
        """Yield the title, a column for each recording, and the values that differ."""
        yield Static(" COMPARE  reading …", id="compare-title", markup=False)
        with Horizontal(id="compare-sides"):
            for place, side in enumerate(self._sides):
                with Vertical(classes="compare-side"):
                    yield Static(id=f"compare-name-{place}", markup=False)
                    if side.world is not None:
                        yield MapView(side.world, id=f"compare-map-{place}")
                    else:
                        missing = f"No map: {side.note}.\n{side.how_to_see}."
                        yield Label(missing, classes="compare-no-map", markup=False)
                    yield TextRows(id=f"compare-events-{place}")
        with VerticalScroll(id="compare-changes"):
            yield TextRows(id="compare-rows")
        yield KeyFooter()

    def on_mount(self) -> None:
        """Compare the recordings, once the screen is mounted."""
        self.query_one("#compare-changes").border_title = "What differs"
        self.query_one("#compare-changes").focus()
        self.run_worker(self._compare, thread=True, exit_on_error=False)

    def _compare(self) -> None:
        try:
            self._found = compare_sessions(self._sides[0].recording, self._sides[1].recording)
        except LogError as error:
            self._problem = str(error)
        self.app.call_from_thread(self._show)

    def on_resize(self, event: events.Resize) -> None:
        """Show the maps only if there is room for them."""
        self.set_class(event.size.height < TALL, "-low")
        self.call_after_refresh(self._show)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Offer the second difference only if there is one."""
        if action == "other":
            return self._found is not None and self._found.beyond is not None
        return super().check_action(action, parameters)

    @property
    def shown(self) -> EventDifference | None:
        """The shown difference; None if there is none."""
        if self._found is None:
            return None
        return self._found.beyond if self._beyond else self._found.first

    def action_other(self) -> None:
        """Switch between the first difference and the first one beyond telemetry."""
        self._beyond = not self._beyond
        self._show()

    def action_open(self, place: int) -> None:
        """Open one of the recordings at the difference."""
        side = self._sides[place]
        if side.world is None:
            self.notify(f"{side.note}; {side.how_to_see}", title="Not opened", severity="error",
                        markup=False)  # fmt: skip
            return
        player = Player(side.recording)
        player.to_event(self._at(place))
        self.app.push_screen(
            RecordingScreen(side.world, side.rules, player, self._clock, over=True)
        )

    def _at(self, place: int) -> int:
        """Return the number of the event at the difference, or of the last event."""
        last = len(self._sides[place].recording) - 1
        if self.shown is None:
            return last
        return min((self.shown.a, self.shown.b)[place], last)

    def _show(self) -> None:
        if not self.is_attached or (self._found is None and not self._problem):
            return
        self.query_one("#compare-title", Static).update(
            heading(self._found, self.shown, self._problem, beyond=self._beyond)
        )
        try:
            for place, side in enumerate(self._sides):
                self._show_side(place, side)
        except LogError as error:
            self.notify(str(error), title="Compare", severity="error", markup=False)
        names = (self._sides[0].name, self._sides[1].name)
        rows = change_rows(self._found, self.shown, names) if self._found is not None else ()
        self.query_one("#compare-rows", TextRows).show(rows)
        self.refresh_bindings()

    def _show_side(self, place: int, side: OpenedLog) -> None:
        at = (self.shown.a, self.shown.b)[place] if self.shown else len(side.recording)
        sheet = self.query_one(f"#compare-events-{place}", TextRows)
        sheet.show(around(side.recording, at, max(sheet.size.width, 20)))
        if side.world is not None:
            player = Player(side.recording)
            player.to_event(self._at(place))
            self.query_one(f"#compare-map-{place}", MapView).show(
                player.state.picture, player.state.reported_contacts.values()
            )
        name = self.query_one(f"#compare-name-{place}", Static)
        note = f"  {side.note}" if side.note else ""
        name.update(f"{'AB'[place]}  {side.name}{note}")


def open_comparison(over: Screen[None], own: PlayableLog, other: Path, clock: SecondsClock) -> None:
    """Open the log `other` and show where it differs from `own`; show any error."""
    opening = partial(open_compared, other, KnownWorld.of(own.world, own.recording))

    def show(opened: OpenedLog) -> None:
        over.app.push_screen(CompareScreen(own, opened, clock))

    open_beside(over, other, opening, show, "Not opened")


def heading(
    comparison: SessionComparison | None,
    shown: EventDifference | None,
    problem: str,
    *,
    beyond: bool,
) -> Content:
    """Return the heading, with the event at which the recordings differ."""
    parts: list[tuple[str, str] | str] = [(" COMPARE ", "bold reverse $text-warning"), "  "]
    if problem or comparison is None:
        parts.append((problem, BAD))
    elif shown is None and comparison.first is None:
        same = "they were started differently" if comparison.started else "nothing differs"
        parts.append((same, f"bold {WARN if comparison.started else GOOD}"))
    elif shown is not None:
        difference = "first difference beyond telemetry" if beyond else "first difference"
        numbers = f"{shown.a + 1}" if shown.a == shown.b else f"{shown.a + 1} | {shown.b + 1}"
        parts += [(difference, f"bold {WARN}"), f" at event {numbers}"]
        if comparison.beyond is None and not beyond:
            parts.append((f", {count(len(shown.changes), 'value')}", QUIET))
        else:
            parts.append(("; n shows the other", QUIET))
    return Content.assemble(*parts)


def around(recording: Recording, at: int, width: int) -> tuple[WrappedRow, ...]:
    """Return rows, `width` cells wide, for event `at` and the events just before and after it."""
    rows: list[WrappedRow] = []
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
        rows.append(WrappedRow(Content(), line))
    if at >= len(recording):
        rows.append(row("", (ENDED.center(width), "reverse")))
    return tuple(rows)


def change_rows(
    comparison: SessionComparison, shown: EventDifference | None, names: tuple[str, str]
) -> tuple[WrappedRow, ...]:
    """Return the differences at the start of the sessions and at the shown event, A above B."""
    rows: list[WrappedRow] = []
    if comparison.started:
        rows.append(row("", ("They were started differently", f"bold {NOTE}")))
    rows += [
        row(["  "], (f"{change.path}  ", "bold"), f"{change.a}  |  {change.b}")
        for change in comparison.started
    ]
    if shown is None:
        if comparison.first is None:
            rows.append(row("", ("All events are equivalent in both.", GOOD)))
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

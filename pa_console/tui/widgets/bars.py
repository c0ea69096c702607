"""The bars of the screen: status, views of a small terminal, position of a replay, and keys."""

from dataclasses import dataclass
from itertools import groupby
from typing import NamedTuple

from textual import events
from textual.binding import Binding
from textual.content import Content
from textual.message import Message
from textual.widgets import Footer, Static

from pa_console.schema.rule import RulesSeal
from pa_console.schema.text import clock_text, count, few
from pa_console.session.state import SessionState
from pa_console.session.state_parts import TakTrace
from pa_console.session.timeline import MarkKind, RecordingTimeline
from pa_console.tui.actions import first_key
from pa_console.tui.status_words import NOTE, QUIET, WARN, cover_state, short_names, term
from pa_console.views.trace_layout import step_name

LEAST = 10

VIEWS = (
    ("map", "F2 Map"), ("assets", "F3 Assets"), ("trace", "F4 Trace"), ("events", "F5 Events"),
    ("alarms", "5 Alarms"),
)  # fmt: skip
STALE_AFTER_S = 5.0
"""The default number of wall seconds without telemetry after which telemetry is stale."""

JOINED = "JOINED"
"""The beginning of the mode of a joined console; the station's name follows."""

RELIEVED = " NOT IN COMMAND: NOTHING IS SENT "
_ALARM = "bold reverse $text-error"
UNLOGGED = " LOG NOT WRITTEN: NOTHING IS DISPATCHED "


class Scrubber(Static):
    """A bar with a cell for each part of a recording, which shows the worst mark in that part."""

    @dataclass
    class PlaceClicked(Message):
        """Posted when the bar is clicked.

        `share` is the part of the recording before the clicked place, from 0 to 1.
        """

        share: float

    def __init__(self, timeline: RecordingTimeline, **kwargs: str) -> None:
        super().__init__(id=kwargs.get("id"), markup=False)
        self._timeline = timeline
        self._marks: list[MarkKind | None] = []
        self._position = 0.0

    @property
    def places(self) -> int:
        """The number of cells of the bar."""
        return max(self.content_size.width, LEAST)

    def show(self, position: float) -> None:
        """Show the `position` of the replay, in seconds from the first event."""
        self._position = position
        if len(self._marks) != self.places:
            self._marks = self._timeline.marks_by_place(self.places)
        duration = self._timeline.duration
        share = position / duration if duration > 0 else 0.0
        now = min(int(share * self.places), self.places - 1)
        parts: list[tuple[str, str]] = []
        for place, kind in enumerate(self._marks):
            glyph, style = ("━", WARN) if place < now else ("─", QUIET)
            if kind is not None:
                mark = term("mark", kind)
                glyph, style = mark.glyph, f"bold {mark.style}"
            elif place == now:
                glyph, style = "┃", f"bold {WARN}"
            parts.append((glyph, f"{style} reverse" if place == now else style))
        runs = groupby(parts, key=lambda part: part[1])
        joined = (("".join(glyph for glyph, _ in run), style) for style, run in runs)
        self.update(Content.assemble(*joined), layout=False)

    def on_resize(self, _event: events.Resize) -> None:
        """Fit the bar to the new width."""
        self.show(self._position)

    def on_click(self, event: events.Click) -> None:
        """Post the clicked place."""
        place = event.get_content_offset(self)
        if place is not None:
            self.post_message(self.PlaceClicked((place.x + 0.5) / self.places))


class ViewBar(Static):
    """The names of the views, with the shown one marked; a click on a name chooses the view."""

    @dataclass
    class ViewChosen(Message):
        """Posted when the name of a view is clicked."""

        view: str

    def show(self, current: str) -> None:
        """Mark the view `current`."""
        parts: list[tuple[str, str]] = []
        for view, label in VIEWS:
            text = f" {label} "
            parts.append((text, "bold reverse $text-primary" if view == current else "$quiet"))
        self.update(Content.assemble(*parts))

    def on_click(self, event: events.Click) -> None:
        """Post the view whose name was clicked."""
        end = 0
        plain = str(self.content)
        for view, label in VIEWS:
            end = plain.find(label, end) + len(label) + 2
            if event.x < end:
                self.post_message(self.ViewChosen(view))
                return


class StatusBar(Static):
    """The state of the session: whether it is live, the picture's age, the model, the mission."""

    stale_after_s = STALE_AFTER_S

    def show(
        self, state: SessionState, title: str, mode: str, rate: float, silent_s: float
    ) -> None:
        """Show the session; `silent_s` is the wall time since the last telemetry."""
        wide = self.size.width >= 100
        time = clock_text(state.picture.time_s) if state.picture else "--:--"
        stale = silent_s > self.stale_after_s and (mode == "LIVE" or mode.startswith(JOINED))
        worker = term("worker", state.worker.state if state.worker else "none")
        idle = state.active is None and state.stop is None
        manual = self._manual(state)
        items: list[_Item] = []

        def add(rank: int, *parts: str | tuple[str, str] | Content, short: str = "") -> None:
            items.append(_Item(rank, Content.assemble(*parts), short))

        if wide:
            add(8, ("PA Console  ", "bold $text-primary"))
        if wide and state.active is None:
            add(9, (f"{title}  ", QUIET))
        add(0, self._mode(mode))
        add(1, "  ", ("session ", QUIET) if mode == "REPLAY" else "", f"{time} ")
        add(4, (f"×{rate:g}", QUIET))
        if state.started is not None and (alarm := _rules_alarm(state.started.rules_seal)):
            add(0, "  ", (f" {alarm} ", _ALARM))
        if state.log_problem:
            add(0, "  ", (UNLOGGED, _ALARM), short=" LOG NOT WRITTEN ")
        if state.relieved:
            add(0, "  ", (RELIEVED, _ALARM), short=" NOT IN COMMAND ")
        if stale:
            add(0, (f"  ▲ no telemetry for {silent_s:.0f} s", "bold $text-error"), short="▲ silent")
        if wide or worker.word != "ready":
            add(5 if worker.word == "ready" else 1, ("  model ", QUIET), worker.part)
        if servers := self._servers(state):
            ready = all(server.state == "ready" for server in state.servers.values())
            add(5 if ready else 1, *servers)
        gates, fewer = self._gates(state)
        add(0 if fewer else 6, "  ", gates, short=fewer)
        tak = _Item(2 if state.tak.away else 4, Content.assemble(*self._tak(state.tak, wide=wide)))
        if idle and state.tak.away:
            items.append(tak)
        # A narrow bar has no room for both the manual assets and "no mission".
        if not (manual and idle and not state.ended):
            mission, waits = self._mission(state, mode)
            add(3 if state.active is not None and state.stop is None else 0, "  ", mission)
            if waits:
                add(0, (waits, "bold $text-accent"))
        if not (idle and state.tak.away):
            items.append(tak)
        if manual:
            add(2, *manual)
        if following := self._next_start(state):
            add(7, following)
        self.update(_fitted(items, self.content_size.width), layout=False)

    def _next_start(self, state: SessionState) -> Content | None:
        """Return the countdown to the next start of a standing order, or else their number."""
        in_force = [standing for standing in state.standing.values() if standing.in_force]
        if not in_force or state.ended:
            return None
        coming = [
            (standing.next.at_s - state.time_s, standing.order.id)
            for standing in in_force
            if not standing.paused and standing.next and standing.next.at_s is not None
        ]
        text = f"  {count(len(in_force), 'standing order')}"
        if coming:
            left_s, order = min(coming)
            text = f"  {order} in {clock_text(max(left_s, 0.0))}"
        return Content.styled(text, NOTE)

    def _servers(self, state: SessionState) -> list[tuple[str, str] | Content | str]:
        """Return the state of the models on servers; of several states, the worst."""
        if not state.servers:
            return []
        order = ("away", "probing", "unconstrained", "ready")
        worst = min((server.state for server in state.servers.values()), key=order.index)
        return [("  server ", QUIET), term("server", worst).part]

    def _tak(self, tak: TakTrace, *, wide: bool) -> list[tuple[str, str] | Content | str]:
        """Return the state of the connection to the TAK server, and its number of contacts."""
        if tak.connection is None or tak.since is None:
            return []
        mark, number = term("tak", tak.connection.state), len(tak.contacts)
        words = mark.word if wide else ""
        if tak.away:
            words += f" since {tak.since:%H:%M}"
        elif number:
            words = count(number, "contact") if wide else str(number)
        return [("  TAK ", QUIET), (f"{mark.glyph} {words.strip()}".strip(), mark.style)]

    def _mode(self, mode: str) -> Content:
        style = {"LIVE": "bold $text-success"}.get(mode, "bold reverse $text-warning")
        return Content.styled("● LIVE" if mode == "LIVE" else f" {mode} ", style)

    def _gates(self, state: SessionState) -> tuple[Content, str]:
        """Return the uncovered gates in words, and a shorter text; it is '' if all are covered.

        A gate with unknown cover counts as not covered.
        """
        if state.picture is None:
            return Content.styled("? gates unknown", "$text-warning"), "? gates"
        by: dict[str, list[str]] = {"uncovered": [], "unknown": [], "covered": []}
        for name, cover in state.picture.gates.items():
            by[cover_state(cover)].append(name)
        parts: list[tuple[str, str]] = []
        short: list[str] = []
        for name in ("uncovered", "unknown"):
            if by[name]:
                mark = term("gate", name)
                gap = ", " if parts else ""
                words = f"{gap}{mark.glyph} {few(by[name], 2)} {mark.word}"
                parts.append((words, f"bold {mark.style}"))
                short.append(f"{mark.glyph} {len(by[name])} {mark.word}")
        if parts:
            return Content.assemble(*parts), " ".join(short)
        mark = term("gate", "covered")
        return Content.styled(f"{mark.glyph} all gates covered", mark.style), ""

    def _manual(self, state: SessionState) -> list[tuple[str, str]]:
        """Return the assets under manual control."""
        assets = state.picture.assets if state.picture is not None else {}
        short, mark = short_names(assets), term("asset", "manual")
        names = [short[name] for name, asset in assets.items() if asset.manual]
        words = f"  {mark.glyph} {few(names, 2)} {mark.word}"
        return [(words, f"bold {mark.style}")] if names else []

    def _mission(self, state: SessionState, mode: str) -> tuple[Content, str]:
        """Return the active mission, and a sign if it waits for a decision."""
        if state.ended:
            return Content.styled(f"session ended: {state.ended}", "$text-warning"), ""
        if state.stop is not None:
            how = f": {first_key('release')} releases it" if mode == "LIVE" else ""
            return Content.styled(f"■ STOPPED{how}", "bold $text-error"), ""
        if state.active is None:
            return Content.styled("no mission", QUIET), ""
        trace = state.missions[state.active]
        waiting = " ▲ WAITS FOR YOU" if trace.approval else ""
        if trace.approval and mode.startswith(JOINED):
            station = mode.removeprefix(JOINED).strip()
            waiting = " ▲ TO SIGN" if trace.approval.approvals else f" waits for {station}"
        phase = f" {trace.phase}:" if trace.phase else ""
        return Content(f"{trace.mission.id}{phase} {step_name(trace)}"), waiting


class _Item(NamedTuple):
    """A part of the status bar; higher ranks are left out first, and rank 0 is never left out."""

    rank: int
    content: Content
    short: str = ""
    """A shorter text for a part that is never left out."""


def _fitted(items: list[_Item], width: int) -> Content:
    """Return the parts in one line; if room is short, leave out parts, then shorten the others."""
    shown = list(items)
    while _cells(shown) > width and (least := max((item.rank for item in shown), default=0)) > 0:
        shown = [item for item in shown if item.rank < least]
    for number, item in enumerate(shown):
        if _cells(shown) <= width:
            break
        if item.short:
            style = item.content.spans[-1].style if item.content.spans else ""
            shown[number] = item._replace(content=Content.assemble(" ", (item.short, style)))
    return Content.assemble(*(item.content for item in shown))


def _cells(items: list[_Item]) -> int:
    return sum(item.content.cell_length for item in items)


def _rules_alarm(seal: RulesSeal | None) -> str:
    """Return the alarm for a fault of the rules in force; '' if they have no fault."""
    if seal is None:
        return ""
    if seal.altered:
        return "RULES ALTERED"
    if seal.no_critical_check:
        return "RULES: NO CRITICAL CHECK"
    return "RULES ACCEPTED, NOT VERIFIED" if seal.accepted else ""


class KeyFooter(Footer):
    """The keys that are legal now; they are composed again only if one of them has changed.

    Textual reports a change whenever the focus moves.
    """

    def __init__(self) -> None:
        super().__init__(show_command_palette=False, compact=True)
        self._shown: list[tuple[Binding, bool, str]] | None = None

    async def recompose(self) -> None:
        """Compose the keys if they have changed; do nothing on a screen that is closing."""
        if not self.is_attached:
            return
        active = self.screen.active_bindings.values()
        shown = [(key, enabled, tip) for _, key, enabled, tip in active if key.show]
        if shown != self._shown:
            self._shown = shown
            await super().recompose()
            self.call_after_refresh(self._leave_out_cut)

    def on_resize(self) -> None:
        """Show the keys for which there is room now."""
        self.call_after_refresh(self._leave_out_cut)

    def _leave_out_cut(self) -> None:
        """Hide the keys that would be cut off at the end of the line."""
        end = 0
        for key in self.children:
            end += key.get_content_width(self.size, self.size) + key.gutter.width
            key.visible = end <= self.size.width
            end += key.styles.margin.right

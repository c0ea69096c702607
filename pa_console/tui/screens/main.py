"""The main screen, live and in a replay: map, assets, events, trace, approval, prompt."""

from collections.abc import Mapping
from pathlib import Path
from typing import cast

from textual import events
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, Vertical
from textual.screen import Screen
from textual.timer import Timer
from textual.widgets import Button, Input, Static

from pa_console.schema.events.event import CameraStill
from pa_console.schema.rule import Rule
from pa_console.schema.world import World
from pa_console.session.state import MissionTrace, SessionState
from pa_console.session.stills import read_still
from pa_console.tui.actions import READING_KEYS, ActionHost, first_own_key
from pa_console.tui.approval.inputs import DECISION_KEYS
from pa_console.tui.approval.panel import ApprovalPanel
from pa_console.tui.approval.plan_view import PlanSchedule
from pa_console.tui.kept_input import History
from pa_console.tui.order_templates import OrderNames, example_orders
from pa_console.tui.plan_preview import PlanPreview, Playback, waiting_plan
from pa_console.tui.surroundings import JoinedTo, SecondsClock
from pa_console.tui.widgets.alarms import AlarmBar, AlarmPane
from pa_console.tui.widgets.assets import AssetPane
from pa_console.tui.widgets.bars import VIEWS, KeyFooter, StatusBar, ViewBar
from pa_console.tui.widgets.map_view import MapView
from pa_console.tui.widgets.mission_prompt import (
    ExampleLine,
    ExampleOrders,
    MissionPrompt,
    ReadingLine,
)
from pa_console.tui.widgets.row_views import EventList
from pa_console.tui.widgets.trace_pane import NO_MISSION, TracePane

PLAY_FRAME_S = 0.1
"""The interval between two frames of a playback, in seconds."""

LEAST_SIZE = (60, 18)
WIDE_SIZE = (100, 30)
_HELPING_TO_WRITE = (
    ("history", "earlier orders"),
    ("favourites", "favourites and templates"),
    ("thing", "assets and places"),
)
"""The actions that type an order, with the words that the prompt shows for each."""
_KEYS_GO_TO = {"trace": "#trace-body", "assets": "#asset-rows"}
"""The part of a view that takes the keys, if it is not the view itself."""

TOO_SMALL = (
    "PA Console needs 60 x 18 cells.\nThis terminal has {width} x {height}:\nmake it larger."
)


class MainScreen(Screen[None]):
    """The screen that lays out the panes for the terminal's size and passes the state to them."""

    BINDINGS = [
        Binding(",".join((*DECISION_KEYS, "alt+c")), "where_to_decide", show=False),
        *(
            Binding(key, f"numbered({number})", show=False)
            for number, key in enumerate(READING_KEYS, start=1)
        ),
    ]

    def __init__(
        self,
        world: World,
        rules: Mapping[str, Rule],
        history: History,
        *,
        closed: str,
        mode: str,
        clock: SecondsClock,
        joined: JoinedTo | None = None,
    ) -> None:
        """Open the screen; `closed` is the reason why no mission is accepted here, or ''.

        `mode` is LIVE, READ-ONLY, REPLAY, or JOINED with the name of the station whose session is
        shown. `joined` is that session.
        """
        # The first view's class is set here: setting it after mounting would style all again.
        super().__init__(classes="-view-map")
        self._joined = joined
        self._decides = bool(joined.signer) if joined is not None else not closed
        self._world, self.rules, self._history = world, rules, history
        self._closed_why, self.mode, self._clock = closed, mode, clock
        self._names = OrderNames(world)
        self._view = "map"
        self._selected: str | None = None
        self._waits: tuple[object, PlanPreview | None] | None = None
        self._plan: PlanPreview | None = None
        self._playback: Playback | None = None
        self._play_timer: Timer | None = None
        self.log_file: Path | None = None
        """The log of the shown session; None if it is not available."""

    def compose(self) -> ComposeResult:
        """Yield all panes; the style sheet decides which are visible."""
        yield StatusBar(id="status", markup=False)
        yield AlarmBar(id="alarm-bar")
        yield ViewBar(id="views", markup=False)
        with Horizontal(id="body"):
            with Vertical(id="left"):
                yield MapView(self._world, id="map")
                with Vertical(id="lower"):
                    yield PlanSchedule(id="schedule")
                    yield AlarmPane(id="alarms")
                    yield AssetPane(self._world, id="assets")
                    yield EventList(all_known=self.mode == "REPLAY", id="events")
            with Vertical(id="right"):
                yield TracePane(
                    self.rules, "No mission yet." if self._closed_why else NO_MISSION, id="trace"
                )
                if not self._closed_why:
                    yield ExampleOrders(example_orders(self._world), id="examples")
                yield ApprovalPanel(
                    self._clock,
                    decides=self._decides,
                    joined=self._joined,
                    read_still=self.read_still,
                )
        yield from self.replay_line()
        yield MissionPrompt(
            self._history, self._names, self._clock, self._closed_why, asks=self._joined is not None
        )
        yield KeyFooter()
        yield ReadingLine(id="live-reading", markup=False)
        yield Static(id="too-small", markup=False)

    def replay_line(self) -> ComposeResult:
        """Yield the line with the position of a recording; a live session has none."""
        yield from ()

    def read_still(self, still: CameraStill) -> bytes | None:
        """Return the file of a still; None if it is missing or has changed."""
        return read_still(self.log_file, still)

    def on_mount(self) -> None:
        """Focus the mission field, or the first view if no mission is accepted."""
        self.set_class(self.mode == "REPLAY", "-replay")
        self.focus_view(self._view)
        if not self._closed_why:
            self.query_one(MissionPrompt).take_cursor()

    def on_resize(self, event: events.Resize) -> None:
        """Choose the layout for the terminal's size."""
        width, height = event.size
        small = width < LEAST_SIZE[0] or height < LEAST_SIZE[1]
        self.set_class(small, "-too-small")
        self.set_class(width < WIDE_SIZE[0] or height < WIDE_SIZE[1], "-compact")
        if small:
            text = TOO_SMALL.format(width=width, height=height)
            self.query_one("#too-small", Static).update(text)
        self.call_after_refresh(self.query_one(ApprovalPanel).fit)

    def use_delays(self, approval_s: float, stale_s: float) -> None:
        """Set the user's approval delay and the age at which telemetry is stale, in seconds."""
        self.query_one(ApprovalPanel).arm_delay_s = approval_s
        self.query_one(StatusBar).stale_after_s = stale_s

    def name_keys(self) -> None:
        """Show at the prompt the user's keys for typing an order."""
        if not self._closed_why:
            keys = cast(ActionHost, self.app).keys
            named = (f"{first_own_key(name, keys)} {effect}" for name, effect in _HELPING_TO_WRITE)
            self.query_one(MissionPrompt).show_keys(" · ".join(named))

    @property
    def compact(self) -> bool:
        """True if one pane is shown at a time."""
        return self.has_class("-compact")

    def go_to(self, view: str) -> None:
        """Show a view; the focus stays where it is."""
        self._view = view
        for name, _ in VIEWS:
            self.set_class(name == view, f"-view-{name}")
        self.query_one(ViewBar).show(view)

    def focus_view(self, view: str) -> None:
        """Show a view and focus it."""
        self.go_to(view)
        self.set_focus(self.query_one(_KEYS_GO_TO.get(view, f"#{view}")))

    def show_alarms(self) -> AlarmPane:
        """Return the alarms; if one pane is shown at a time, show them first."""
        if self.compact:
            self.go_to("alarms")
        return self.query_one(AlarmPane)

    def show_assets(self) -> AssetPane:
        """Show the table of assets and return it."""
        self.go_to("assets")
        return self.query_one(AssetPane)

    def on_view_bar_view_chosen(self, message: ViewBar.ViewChosen) -> None:
        """Focus the chosen view."""
        self.focus_view(message.view)

    def selected(self, state: SessionState) -> MissionTrace | None:
        """Return the mission whose trace is shown: the selected one, or else the current one."""
        return state.missions.get(self._selected or "") or state.current

    def show_mission(self, state: SessionState, mission: str) -> None:
        """Show the trace of a mission and focus it."""
        self._selected = mission
        self.refresh_views(state, frozenset(("trace",)), 1.0, 0.0)
        self.focus_view("trace")

    def select(self, state: SessionState, by: int) -> None:
        """Select the previous or next mission; past the last one, follow the current mission."""
        ids = list(state.missions)
        shown = self.selected(state)
        if shown is None:
            return
        index = ids.index(shown.mission.id) + by
        self._selected = ids[max(index, 0)] if index < len(ids) - 1 else None
        self.refresh_views(state, frozenset(("trace",)), 1.0, 0.0)

    def refresh_views(
        self, state: SessionState, views: frozenset[str], rate: float, silent_s: float
    ) -> None:
        """Update the panes in `views`; leave the others as they are."""
        if "status" in views:
            bar = self.query_one(StatusBar)
            bar.show(state, self._world.title, self.mode, rate, silent_s)
            self.query_one(AlarmBar).show(state)
            if state.picture is not None:
                self.query_one(ApprovalPanel).tell_age(state.picture.time_s)
        if "map" in views:
            self._names.use_tracks(state.picture.tracks if state.picture is not None else ())
            self.query_one(MapView).show(
                state.picture,
                state.reported_contacts.values(),
                live=self.mode == "LIVE" or self._joined is not None,
            )
        if "assets" in views:
            self.query_one(AssetPane).show(state.picture)
        if "alarms" in views:
            self._mark_lower("-alarmed", bool(state.alarms or state.queue))
            self.query_one(AlarmPane).show(state)
        if "events" in views:
            self.query_one(EventList).show(state.notices)
        if "trace" in views:
            self.query_one(TracePane).show(self.selected(state))
            for examples in self.query(ExampleOrders):
                examples.set_class(bool(state.missions) or state.stop is not None, "-over")
            self._show_approval(state)

    def show_waiting(self, text: str) -> None:
        """Show `text`, which describes a wait; do nothing if the screen is being closed."""
        for prompt in self.query(MissionPrompt):
            prompt.show_waiting(text)

    def show_reading(self, text: str, reading: str) -> None:
        """Show the `reading` of `text` if the prompt has that text; '' hides the line."""
        typed = " ".join(self.query_one(MissionPrompt).draft.split())
        self.query_one(ReadingLine).show(text, reading if typed == text else "")

    def typing(self, text: str) -> None:
        """Hide the shown reading if it is not the reading of `text`."""
        line = self.query_one(ReadingLine)
        if line.text != " ".join(text.split()):
            line.show("", "")

    def _show_approval(self, state: SessionState) -> None:
        """Show or withdraw the open request; keep the focus while the operator is typing."""
        panel, prompt = self.query_one(ApprovalPanel), self.query_one(MissionPrompt)
        had_keys, in_reason = panel.has_focus_within, isinstance(self.focused, Input)
        plan = self._plan_that_waits(state)
        before = self._plan
        appeared = panel.show(state.current, plan)
        other = plan is not before and not panel.looks_at_reading and self._playback is None
        if appeared or not panel.display or other:
            self.show_plan(plan)
        if not self._decides:
            return
        if appeared:
            self._selected = None
            self.query_one(TracePane).show(state.current)
            if self.compact and self._view not in ("map", "trace"):
                self.go_to("trace")
            if prompt.has_cursor and prompt.draft:
                there = f"A plan waits for your decision; {self._key_to_approval} goes to it"
                self.notify(there, title="Approval", markup=False)
            else:
                panel.take_focus()
        elif not panel.display and had_keys:
            if prompt.draft or in_reason:  # text typed next is not a mission
                self.focus_view(self._view)
            elif not self._closed_why:
                prompt.take_cursor()

    def _plan_that_waits(self, state: SessionState) -> PlanPreview | None:
        """Return the preview of the waiting plan; it is the same object while the plan waits."""
        trace = state.current
        request = trace.approval if trace is not None else None
        if trace is None or request is None:
            self._waits = None
        else:
            attempt = trace.find(request.attempt)
            key = request, attempt.rehearsal if attempt is not None else None
            if self._waits is None or self._waits[0] != key:
                self._waits = key, waiting_plan(self._world, trace)
        return self._waits[1] if self._waits is not None else None

    def show_plan(self, plan: PlanPreview | None) -> None:
        """Show a plan that has not run on the map and as a schedule; end any playback."""
        self._plan, self._playback = plan, None
        self._show_moment()

    def look_at(self, asked: str, plan: PlanPreview | None, faults: tuple[str, ...] = ()) -> None:
        """Show the plan for another reading; without `asked`, show the waiting plan again."""
        waits = self._waits[1] if self._waits is not None else None
        self.query_one(ApprovalPanel).show_reading(asked, plan, faults)
        self.show_plan(plan if asked else waits)

    def on_approval_panel_asked(self, message: ApprovalPanel.Asked) -> None:
        """Play the rehearsal of the shown plan, or stop it."""
        if message.wish != "play":
            return
        message.stop()
        if self._playback is not None or self._plan is None:
            self._playback = None
        else:
            self._playback = Playback(self._plan, self._clock, self._clock())
            if self.compact and self._view != "map":
                self.go_to("map")
        self._show_moment()

    def _play_on(self) -> None:
        if self._playback is not None and self._playback.is_over:
            self._playback = None
        self._show_moment()

    def _show_moment(self) -> None:
        playback = self._playback
        moment_s = playback.time_s if playback is not None else None
        if playback is not None and self._play_timer is None:
            self._play_timer = self.set_interval(PLAY_FRAME_S, self._play_on)
        elif playback is None and self._play_timer is not None:
            self._play_timer.stop()
            self._play_timer = None
        self._mark_lower("-planned", self._plan is not None)
        self.query_one(MapView).show_plan(self._plan, moment_s)
        self.query_one("#schedule", PlanSchedule).show(self._plan, moment_s)
        self.query_one(ApprovalPanel).show_moment(self._plan, moment_s)

    def _mark_lower(self, name: str, on: bool) -> None:
        """Set a style class on the panes below the map; setting it on the screen is slower."""
        self.query_one("#lower").set_class(on, name)

    def action_numbered(self, number: int) -> None:
        """Type the example with this number if examples are shown; else, show where to decide."""
        if not self.type_example(number):
            self.action_where_to_decide()

    def type_example(self, number: int) -> bool:
        """Fill in an example by number; return False if it is not shown or the field has text."""
        for examples in self.query(ExampleOrders):
            prompt = self.query_one(MissionPrompt)
            free = prompt.draft.strip() in ("", *examples.orders)
            if examples.display and free and number <= len(examples.orders):
                prompt.put(examples.orders[number - 1])
                return True
        return False

    def on_example_line_clicked(self, message: ExampleLine.Clicked) -> None:
        """Type the example that was clicked."""
        message.stop()
        self.query_one(MissionPrompt).put(message.order)

    def action_where_to_decide(self) -> None:
        """Show where a decision key has an effect."""
        if not self._decides:
            self.notify(self._closed_why, title="Decision", severity="warning", markup=False)
        elif self.query_one(ApprovalPanel).display:
            where = f"{self._key_to_approval} goes to the waiting plan, where you can decide"
            self.notify(where, title="Decision", markup=False)
        else:
            self.notify("no plan is waiting for a decision", title="Decision", markup=False)

    @property
    def _key_to_approval(self) -> str:
        return first_own_key("approval", cast(ActionHost, self.app).keys)

    def leave_field(self) -> None:
        """Leave the prompt or a field of the approval panel; nothing typed is lost."""
        panel = self.query_one(ApprovalPanel)
        reading = panel.looks_at_reading
        if panel.display and (reading or not isinstance(self.focused, Button)):
            panel.take_focus()
        else:
            self.focus_view(self._view)

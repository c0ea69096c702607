"""The approval panel, which shows the effects of a plan and guards the decision from stray keys."""

import time
from dataclasses import dataclass
from typing import Literal

from textual import events, on
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Vertical
from textual.message import Message
from textual.widget import Widget
from textual.widgets import Button, Input

from pa_console.schema.events.event import ApprovalRequested
from pa_console.schema.mission import Decision
from pa_console.session.mission_trace import MissionTrace
from pa_console.tui.actions import READING_KEYS
from pa_console.tui.approval.inputs import (
    DECISION_KEYS,
    DecisionButtons,
    GivenFields,
    MeaningButton,
    ReasonField,
    answering,
    blocked_reason,
    decision_of,
    is_free,
    may_modify,
    not_to_sign,
    reading_of,
)
from pa_console.tui.approval.plan_view import PlanText, panel_rows
from pa_console.tui.approval.plan_words import age_words, approval_rows, looked_at_rows
from pa_console.tui.plan_preview import PlanPreview
from pa_console.tui.status_words import term
from pa_console.tui.surroundings import JoinedTo, SecondsClock
from pa_console.tui.widgets.fields import CheckBox
from pa_console.tui.widgets.still import ReadStill, StillView

ARM_DELAY_S = 0.6
"""The default number of seconds without a key press after which the panel accepts keys.

A key that is pressed earlier is dropped and restarts the delay.
"""

_TITLE_MARGIN = 4


class ApprovalPanel(Vertical, can_focus=True):
    """The panel to reject, modify or approve a plan, or to choose another reading of the order.

    The panel posts decisions as messages and changes nothing itself. While no key may decide,
    the panel itself has the focus: Enter then does nothing, and letters have the same effect as at
    the buttons. In a recording or a read-only console, it shows the plan without buttons.
    """

    BINDINGS = [
        *(
            Binding(key, f"go_to('{button}')", button.title(), show=False, id=f"approval.{button}")
            for key, button in DECISION_KEYS.items()
        ),
        *(
            Binding(key, f"look_at({n})", "Preview another reading", show=False, priority=True)
            for n, key in enumerate(READING_KEYS, start=1)
        ),
        Binding("space", "play", "Play the rehearsal", show=False),
        Binding("alt+c", "compare", "Plans side by side", show=False, priority=True),
        Binding("pagedown", "scroll_plan(1)", "Rest of the plan", show=False),
        Binding("pageup", "scroll_plan(-1)", "Previous part of the plan", show=False),
        Binding("tab", "cycle(1)", "Next field", show=False),
        Binding("shift+tab", "cycle(-1)", "Previous field", show=False),
    ]

    @dataclass
    class Decided(Message):
        """Posted when the operator decides."""

        decision: Decision

    @dataclass
    class Asked(Message):
        """Posted when the operator asks to change the plan, compare plans or play a rehearsal."""

        wish: Literal["modify", "compare", "play"]

    @dataclass
    class LookedAt(Message):
        """Posted when the operator looks at another reading; `asked` is '' for the plan itself."""

        asked: str

    def __init__(
        self,
        clock: SecondsClock = time.monotonic,
        *,
        decides: bool = True,
        joined: JoinedTo | None = None,
        read_still: ReadStill = lambda _: None,
    ) -> None:
        """Build a panel that countersigns plans of a `joined` session, or else decides on plans.

        `read_still` returns the file of a still.
        """
        shown = "-joined" if joined is not None else ""
        super().__init__(id="approval", classes=shown if decides else "-closed")
        self._decides, self._joined = decides, joined
        self.can_focus = decides
        self._body, self._given_fields = PlanText(), GivenFields()
        self._still = StillView(read_still)
        self._reason, self._buttons = ReasonField(), DecisionButtons(joined=joined is not None)
        self.arm_delay_s = ARM_DELAY_S
        """The seconds without a key press after which the panel accepts keys."""
        self._clock, self._quiet_since = clock, 0.0
        self._sent = False
        """True if a decision about the shown plan was sent."""
        self._trace: MissionTrace | None = None
        self._shown: tuple[object, ...] | None = None
        self._age = "", ""
        self._foreseen = "", ""
        """The id of a request for a timed order, and the order's plan as of now, in words."""
        self._width = 0
        self._looked_at = ""
        self._playing = False

    def compose(self) -> ComposeResult:
        """Yield the still, the plan, the inputs and the buttons."""
        yield from (self._still, self._body, self._given_fields, self._reason, self._buttons)

    def on_mount(self) -> None:
        """Hide the panel until a plan waits."""
        self.watch(self._body, "scroll_y", self.refresh_state, init=False)
        self.watch(self._body, "virtual_size", self.refresh_state, init=False)
        self.display = False

    def show(self, trace: MissionTrace | None, preview: PlanPreview | None = None) -> bool:
        """Show the open request of `trace`, or hide the panel; return True for a new request.

        `preview` is the preview of its rehearsed plan.
        """
        request = trace.approval if trace is not None else None
        if trace is None or request is None:
            self._trace, self._shown = None, None
            self.display = False
            return False
        blocked, warned = bool(request.blocked_by), request.acknowledge
        key = (trace.mission.id, request.attempt, len(trace.decisions), blocked, warned)
        self._trace = trace
        if key == self._shown:
            self._tell(trace, preview)
            if not self._looked_at and not self._playing:
                self._body.schedule(preview)
            return False
        self._shown, self._sent, self._looked_at = key, False, ""
        self.display = True
        self._tell(trace, preview)
        self._body.schedule(preview)
        self._given_fields.ask(trace, request)
        self.set_class(bool(trace.choices or request.readings), "-unclear")
        self._reason.ask(request)
        self._body.begin()
        self.call_after_refresh(self.fit)
        self.call_after_refresh(self.refresh_state)
        self.disarm()
        return True

    def _tell(self, trace: MissionTrace, preview: PlanPreview | None) -> None:
        """Show the facts again; some may have changed, for example the phase of a workflow."""
        request_id, foreseen = self._foreseen
        asked = trace.approval.request_id if trace.approval is not None else ""
        self._body.tell(
            tuple(approval_rows(trace, preview, foreseen if asked == request_id else ""))
        )
        if self._still.show(trace.still):  # the lines and the effects of keys have changed
            self.set_class(self._still.has_room, "-pictured")
            self._body.begin_anew()
            self.disarm()
            self.call_after_refresh(self.fit)

    def tell_foreseen(self, request_id: str, foreseen: str) -> None:
        """Show the plan that the timed order of a request would have now."""
        self._foreseen = request_id, foreseen
        if self._trace is not None and self._request is not None:
            self._tell(self._trace, None)

    def tell_age(self, now_s: float) -> None:
        """Show the age of the plan in the title; `now_s` is the time of the session's clock."""
        self._still.tell_age(now_s)
        age = age_words(self._trace, now_s) if self._trace is not None else ("", "")
        if age != self._age:
            self._age = age
            self._tell_state()

    def show_moment(self, preview: PlanPreview | None, now_s: float | None) -> None:
        """Show the schedule of the selected plan; `now_s` is the moment of a playback."""
        self._body.schedule(preview, now_s)
        if self._playing != (now_s is not None):
            self._playing = now_s is not None
            self.set_class(self._playing, "-playing")
            self.call_after_refresh(self.fit)
            if self._playing:
                self._body.keep()
            else:
                self.call_after_refresh(self._recall)
        self.refresh_state()

    def _recall(self) -> None:
        """Restore the count of lines that were read before a rehearsal was played."""
        self._body.recall()
        self.refresh_state()

    def show_reading(
        self, asked: str, preview: PlanPreview | None, faults: tuple[str, ...] = ()
    ) -> None:
        """Show the consequences of the reading `asked`; they are unknown if `preview` is None."""
        self._given_fields.show_reading(tuple(looked_at_rows(preview, faults)) if asked else ())
        self.call_after_refresh(self.fit)

    @property
    def _request(self) -> ApprovalRequested | None:
        """The request that waits for a decision."""
        return self._trace.approval if self._trace is not None else None

    def on_resize(self, event: events.Resize) -> None:
        """Restart the count of read lines if a new width has changed the lines."""
        if event.size.width != self._width:
            self._width = event.size.width
            self._body.begin_anew()
        self.call_after_refresh(self.fit)
        self.call_after_refresh(self.refresh_state)

    def fit(self) -> None:
        """Give the plan the rows that the buttons and inputs do not take."""
        others = [
            child
            for child in self.children
            if child is not self._body and child.display and child.styles.dock == "none"
        ]
        taken = sum(child.outer_size.height + child.styles.margin.height for child in others)
        taken += self.gutter.height
        compact = self.screen.has_class("-compact")
        rows = panel_rows(self.screen.size.height, taken, compact=compact)
        self.styles.max_height = rows
        if self._body.fit(rows - taken):
            self.call_after_refresh(self.refresh_state)

    def action_scroll_plan(self, pages: int) -> None:
        """Scroll the plan by a number of pages."""
        self.refresh_state()
        self._body.scroll_pages(pages)

    def take_focus(self) -> None:
        """Focus Reject, the safe answer; in a joined session, focus the panel itself."""
        safe = self if self._joined is not None else self._buttons.of("reject")
        safe.focus()

    @property
    def armed(self) -> bool:
        """True if the panel accepts decisions: after a quiet moment, and until a decision is sent.

        A key meant for another purpose therefore decides nothing.
        """
        return not self._sent and self._clock() - self._quiet_since >= self.arm_delay_s

    def disarm(self) -> None:
        """Wait for another quiet moment, because a plan is new or a key came too early."""
        self._quiet_since = self._clock()
        self.set_timer(self.arm_delay_s + 0.05, self.refresh_state)
        self.refresh_state()

    def refresh_state(self) -> None:
        """Enable Approve, or show why it is disabled.

        Lines seen before the panel takes keys do not count, because they may not be laid out yet.
        """
        if self._trace is None:
            return
        if self.armed:
            self._body.note_seen()
        if not self._decides:
            self.border_subtitle = "nothing is decided here"
            self._tell_state()
            return
        why = self._why_not()
        self._buttons.of("approve").disabled = bool(why)
        waiting = "" if self.armed else "keys are ignored for a moment"
        meaning = self._meaning_key() if self.armed else ""
        line = "decision sent" if self._sent else meaning or why or waiting or self._next_key()
        self.border_subtitle = "Space stops the rehearsal" if self._playing else line
        self._tell_state()

    def _next_key(self) -> str:
        """Return the effect of the next key, if the focus alone does not show it."""
        joined = self._joined is not None
        if self.has_focus:
            return "a selects Countersign" if joined else "r, m or a selects a button"
        if self._buttons.of("approve").has_focus:
            return "Enter signs it" if joined else "Enter approves, r selects Reject"
        plays = self._request is not None and self._request.standing is None
        return "Space plays it, Alt+C compares plans" if plays and self.has_focus_within else ""

    def _meaning_key(self) -> str:
        """Return the effect of Enter on the focused meaning of the order; '' if none is focused."""
        focused = self.screen.focused
        if not isinstance(focused, MeaningButton):
            return ""
        if focused.answers:
            return "Enter gives this answer, Esc goes back"
        return "Enter takes this reading, Esc goes back to the plan"

    def on_descendant_focus(self) -> None:
        """Hide a reading when its button loses the focus, and show the effect of the next key.

        A button that is pressed with the mouse must stay in place, so its consequences are not
        shown.
        """
        focused = self.screen.focused
        if focused is None or reading_of(focused) != self._looked_at:
            self._look("")
        self.refresh_state()

    @property
    def looks_at_reading(self) -> bool:
        """True if the panel shows a reading other than the plan's."""
        return bool(self._looked_at)

    def _look(self, asked: str) -> None:
        if asked != self._looked_at:
            self._looked_at = asked
            self.post_message(self.LookedAt(asked))

    @on(events.DescendantBlur)
    @on(events.Focus)
    def _focus_moved(self) -> None:
        """Show the effect of the next key; if the focus has left, hide any other reading."""
        if not self.has_focus_within:
            self._look("")
        self.refresh_state()

    def _tell_state(self) -> None:
        """Show the state of the request in the title and in the colour of the frame."""
        request = self._request
        if request is None:  # decided: the panel closes with the next frame
            return
        state = request.state or "none"
        mark = term("approval", state)
        titles = [f"{mark.glyph} {mark.word} · {age}".removesuffix(" · ") for age in self._age]
        self.border_title = titles[len(titles[0]) + _TITLE_MARGIN > self.size.width]
        refused = bool(request.blocked_by) and state != "not_understood"
        self.set_class(refused or state == "judge_objects", "-blocked")
        self.set_class(state == "approve", "-sure")
        self._buttons.of("modify").disabled = not may_modify(request)

    def _why_not(self) -> str:
        """Return the reason why Approve is disabled, ignoring the arm delay; '' if enabled."""
        request = self._request
        if request is None:
            return "no plan waits"
        made = self._trace.decisions if self._trace is not None else []
        if self._joined is not None and (why := not_to_sign(self._joined, request, made)):
            return why
        left = [box.name or "" for box in self._given_fields.unticked]
        if why := blocked_reason(request, left, self._reason.value):
            return why
        unread = request.state != "approve" and not self._body.read
        return "✘ Approve: read to the end first (PgDn)" if unread else ""

    def on_key(self, event: events.Key) -> None:
        """Drop keys that are typed before the panel is armed; each restarts the delay."""
        if not self.armed and not is_free(event.key) and not isinstance(self.app.focused, Input):
            event.stop()
            event.prevent_default()
            self.disarm()

    def action_cycle(self, step: int) -> None:
        """Focus the next or previous field of this panel, wrapping around; Esc leaves the panel."""
        chain = [widget for widget in self.screen.focus_chain if self in widget.ancestors]
        outside = -1 if step > 0 else 0
        at = chain.index(self.app.focused) if self.app.focused in chain else outside
        if chain:
            self._focus_and_look(chain[(at + step) % len(chain)])

    def _focus_and_look(self, widget: Widget) -> None:
        """Focus a field of the panel; if it is the button of a reading, show the reading."""
        self.screen.set_focus(widget)
        self._look(reading_of(widget))

    def action_go_to(self, button: str) -> None:
        """Focus a button, so that Enter presses it, or the input that Approve still needs.

        If the button cannot be pressed, focus the panel itself, so that Enter presses no other
        button.
        """
        request = self._request
        if request is None or not self.armed:
            return
        target: Widget = self._buttons.of(button)
        if target.disabled or (self._joined is not None and button != "approve"):
            target = self._needed(request) if button == "approve" else self
        self.screen.set_focus(target)

    def _needed(self, request: ApprovalRequested) -> Widget:
        """Return the input that Approve still needs; if none, scroll and return the panel."""
        unticked = self._given_fields.unticked
        if request.blocked_by or request.state == "not_understood":
            return self
        if unticked:
            return unticked[0]
        if request.needs_override and not self._reason.text:
            return self._reason
        self.action_scroll_plan(1)
        return self

    def action_look_at(self, number: int) -> None:
        """Focus and show another reading of the order, or focus an answer; Enter chooses it."""
        if not self.armed:
            self.disarm()
            return
        for button in self._given_fields.meanings[number - 1 : number]:
            self._focus_and_look(button)

    def action_play(self) -> None:
        """Play the rehearsal of the shown plan on the map, or stop the playback."""
        if self.armed:
            self.post_message(self.Asked("play"))

    def action_compare(self) -> None:
        """Show other plans beside the waiting one."""
        if self.armed:
            self.post_message(self.Asked("compare"))
        else:
            self.disarm()

    def end_text(self) -> None:
        """Focus the panel at the end of a text, so that another Enter presses no button."""
        self.screen.set_focus(self)
        self.disarm()

    def write_reason(self, text: str) -> None:
        """Focus the reason field, and append the text typed at the buttons."""
        self.screen.set_focus(self._reason)
        self._reason.add(text)

    def on_paste(self, event: events.Paste) -> None:
        """Use text pasted at the buttons as the reason."""
        event.stop()
        if self.armed:
            self.write_reason(" ".join(event.text.split()))
        else:
            self.disarm()

    @on(Button.Pressed)
    def _pressed(self, event: Button.Pressed) -> None:
        event.stop()
        self._choose(event.button)

    @on(CheckBox.Changed)
    @on(Input.Changed)
    def _given(self, event: CheckBox.Changed | Input.Changed) -> None:
        event.stop()
        self.refresh_state()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Send the answer, if any, and focus the panel, where another Enter decides nothing."""
        event.stop()
        if event.value.strip():
            self._answer(event.value.strip())
        self.screen.set_focus(self)

    def _choose(self, button: Button) -> None:
        request, choice = self._request, button.id
        if request is None or not self.armed:
            return
        if self._joined is not None and choice != "approve":
            return
        if choice == "modify" and may_modify(request):
            self.post_message(self.Asked("modify"))
        elif choice != "approve" or not self._why_not():
            self._send(decision_of(request, button, self._reason.text))

    def _answer(self, answer: str) -> None:
        """Send an answer to a question about the order; do nothing if a plan waits."""
        request = self._request
        if request is not None and self.armed:
            self._send(answering(request, answer))

    def _send(self, decision: Decision | None) -> None:
        if decision is None:
            return
        self._sent = True
        self.refresh_state()
        self.post_message(self.Decided(decision))

    def refused(self) -> None:
        """Accept decisions again, because the last one could not be delivered."""
        self._sent = False
        self.disarm()

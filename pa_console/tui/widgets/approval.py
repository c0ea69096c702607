"""The operator's decision on a plan: says what will happen, and cannot be hit by a stray key."""

import time
from collections.abc import Iterator, Sequence

from textual import events, on
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, ItemGrid, Vertical, VerticalScroll
from textual.content import Content
from textual.message import Message
from textual.widget import Widget
from textual.widgets import Button, Input

from pa_console.orders.clauses import ASKED
from pa_console.orders.plain_words import plain_reading
from pa_console.orders.reading import asked_words
from pa_console.schema.events.event import ApprovalRequested
from pa_console.schema.mission import Decision, Mission
from pa_console.session.state.mission_trace import MissionTrace
from pa_console.session.wording import safety_in_words
from pa_console.tui.actions.keymap import READING_KEYS
from pa_console.tui.protocols import Clock
from pa_console.tui.status_words import BAD, GOOD, NOTE, QUIET, WARN, term
from pa_console.tui.trace.rows import Row, row
from pa_console.tui.widgets.fields import CheckBox, LineField
from pa_console.tui.widgets.row_views import TextRows
from pa_console.tui.words import action_sentence


def approval_rows(trace: MissionTrace) -> Iterator[Row]:
    """Yield the order and its reading, what of it will not happen, what will, and the judge.

    Whether the order may have been misread comes before what will happen.
    """
    request = trace.approval
    if request is None:
        return
    attempt = trace.find(request.attempt)
    refused = trace.decisions[-1] if trace.decisions and not trace.decisions[-1].accepted else None
    if refused is not None:
        yield row("✘ ", (f"not accepted: {refused.detail}", BAD))
    yield from _order(trace, request)
    if request.state == "not_understood":
        told = "; ".join(request.blocked_by).removeprefix("not understood: ")
        yield row(("? ", WARN), (told, WARN))
        told = "Choose or write what is meant" if trace.choices else "Write what is meant"
        yield row("  ", f"Nobody moves. {told}, or reject this.")
        return
    for text in attempt.unmet if attempt else ():
        yield row(("△ ", WARN), ("NOT DONE  ", f"bold {WARN}"), text)
    if attempt is not None and attempt.doubt and not request.readings:
        yield _unsure(attempt.doubt)
    elif attempt is not None and attempt.gaps:
        yield _unsure("; ".join(attempt.gaps))
    yield row(
        "",
        (f"{trace.mission.id} plan {request.attempt}", "bold"),
        (f" {attempt.phase}" if attempt and attempt.phase else "", NOTE),
        (": if you approve,", QUIET),
    )
    picture = attempt.rehearsal.before if attempt and attempt.rehearsal else None
    for number, action in enumerate(request.plan.actions, start=1):
        yield row((f" {number} ", "bold"), action_sentence(action, picture, trace.digest))
    if not request.plan.actions:
        yield row("   ", "nothing moves: the plan has no action")
    if request.if_halted and not request.blocked_by:
        yield row("   ", ("if halted: ", NOTE), safety_in_words(request.if_halted))
    for reason in request.blocked_by:
        yield row(("✘ ", BAD), ("BLOCKED  ", f"bold {BAD}"), (reason, BAD))
    for rule_id in request.acknowledge:
        yield row(("▲ ", WARN), (f"{rule_id}  ", f"bold {WARN}"), _message(trace, rule_id))
    yield _judge(trace, request)


def _order(trace: MissionTrace, request: ApprovalRequested) -> Iterator[Row]:
    """Yield the words of the order as they were typed, and what they were read as."""
    mission, attempt = trace.mission, trace.find(request.attempt)
    who = "typed  " if mission.source == "operator" else "alarm  "
    yield row((who, QUIET), *typed_words(mission))
    asked = asked_words(attempt.plan.reason).rstrip("; ") if attempt and attempt.plan else ""
    if asked and not request.readings:
        yield row(("read   ", QUIET), plain_reading(asked))


def typed_words(mission: Mission) -> Iterator[str | tuple[str, str]]:
    """Yield an order as it was typed; after each word that is read otherwise, how."""
    typed, read = mission.said.split(), mission.text.split()
    if len(typed) != len(read):
        yield mission.said
        if typed != read:
            yield (f" (read: {mission.text})", WARN)
        return
    for number, (one, other) in enumerate(zip(typed, read, strict=True)):
        yield f"{' ' * bool(number)}{one}"
        if one != other:
            yield (f" (read: {other})", WARN)


def _unsure(doubt: str) -> Row:
    return row(("△ ", WARN), ("UNSURE  ", f"bold {WARN}"), doubt)


def _judge(trace: MissionTrace, request: ApprovalRequested) -> Row:
    attempt = trace.find(request.attempt)
    if attempt is None or not attempt.judged:
        return row(("? ", WARN), ("Judge: not asked", f"bold {WARN}"))
    given = attempt.verdict
    mark = term("verdict", given.verdict if given else "none")
    if given is not None and given.verdict == "Success":
        style = GOOD if request.state == "approve" else QUIET
        return row(
            (f"{mark.glyph} " if style == GOOD else "· ", style),
            ("Judge, on the rules: no objection", style),
        )
    return row(
        (f"{mark.glyph} ", mark.style),
        (f"Judge: {mark.word}  ", f"bold {mark.style}"),
        (given.feedback if given else attempt.judge_error, mark.style),
    )


def _message(trace: MissionTrace, rule_id: str) -> str:
    findings = (f for attempt in reversed(trace.attempts) for f in attempt.findings)
    return next((f.message for f in findings if f.rule_id == rule_id), "")


def reading_rows(trace: MissionTrace) -> Iterator[Row]:
    """Yield what the order was read as, where it may mean something else."""
    request = trace.approval
    if request is None or not request.readings:
        return
    attempt, asked = trace.find(request.attempt), plain_reading(request.asked)
    if attempt is not None and attempt.as_chosen:
        yield row(("✎ ", NOTE), "read as you meant it: ", asked)
        return
    sure = f" with {attempt.sure:.0%} confidence" if attempt and attempt.sure is not None else ""
    yield _unsure(f"read{sure} as: {asked}")


def reading_label(number: int, asked: str) -> Content:
    """Return what else the order may mean, after the key that chooses it."""
    or_ = ("or: ", QUIET) if asked.startswith(ASKED) else ""
    return Content.assemble((f"(Alt+{number}) ", "bold"), or_, plain_reading(asked))


def blocked_reason(request: ApprovalRequested, left: Sequence[str], reason: str) -> str:
    """Return in words why Approve is disabled, empty when it is not."""
    if request.state == "not_understood":
        return "✘ Approve: not understood, nothing is proposed"
    if request.blocked_by:
        return "✘ Approve: blocked, nobody may override"
    if left:
        return f"✘ Approve: tick {', '.join(left)} first"
    if request.needs_override and not reason.strip():
        return "✘ Approve: give a reason to override"
    return ""


ARM_DELAY_S = 0.6
"""Quiet seconds before the panel takes keys; every key before that is dropped and counts anew.

The user may choose another delay."""

DECISION_KEYS = {"r": "reject", "m": "modify", "a": "approve"}
"""The button that each of the panel's letters goes to; Enter presses it."""

REASON = "approval-reason"
_MEANT = "meant-"
_FREE_KEYS = ("tab", "shift+tab", "escape", "pageup", "pagedown")


class ApprovalPanel(Vertical, can_focus=True):
    """Reject, Modify or Approve, or another reading of the order.

    Decisions leave as messages, the panel itself changes nothing. It has the focus itself where no
    key may decide: Enter does nothing there, letters do what they do at its buttons.
    """

    BINDINGS = [
        *(
            Binding(key, f"go_to('{button}')", button.title(), show=False, id=f"approval.{button}")
            for key, button in DECISION_KEYS.items()
        ),
        *(
            Binding(key, f"read_as({n})", "Read it so", show=False, priority=True)
            for n, key in enumerate(READING_KEYS, start=1)
        ),
        Binding("pagedown", "scroll_plan(1)", "Rest of the plan", show=False),
        Binding("pageup", "scroll_plan(-1)", "Back in the plan", show=False),
        Binding("tab", "cycle(1)", "Next field", show=False),
        Binding("shift+tab", "cycle(-1)", "Field before", show=False),
    ]

    class Decided(Message):
        """The operator decided."""

        def __init__(self, decision: Decision) -> None:
            super().__init__()
            self.decision = decision

    class ModifyAsked(Message):
        """The operator wants to change the plan."""

    def __init__(self, clock: Clock = time.monotonic) -> None:
        super().__init__(id="approval")
        self._clock = clock
        self.arm_delay_s = ARM_DELAY_S
        self._trace: MissionTrace | None = None
        self._shown: tuple[str, int, int] | None = None
        self._quiet_since = 0.0
        self._sent = False
        self._seen = 0.0
        """So many lines of the plan have been on screen, from the first on."""

    def compose(self) -> ComposeResult:
        """Yield the consequences, what must be given, and the buttons."""
        with VerticalScroll(id="approval-body", can_focus=False):
            yield TextRows(id="approval-text")
        with VerticalScroll(id="approval-given", can_focus=False):
            yield TextRows(id="approval-reading")
            yield Vertical(id="approval-readings")
            yield ItemGrid(id="approval-warnings", min_column_width=18)
        yield LineField(compact=True, id=REASON, select_on_focus=False)
        with Horizontal(id="approval-buttons"):
            yield Button("Reject (r)", id="reject", variant="error", compact=True)
            yield Button("Modify (m)", id="modify", compact=True)
            yield Button("Approve (a)", id="approve", variant="success", compact=True)

    def on_mount(self) -> None:
        """Hide until a plan waits."""
        self.query_one(f"#{REASON}", Input).cursor_blink = False
        self.watch(self._body, "scroll_y", self._saw, init=False)
        self.watch(self._body, "virtual_size", self._saw, init=False)
        self.display = False

    def show(self, trace: MissionTrace | None) -> bool:
        """Show the open request of `trace`, or hide; returns whether a new one has appeared."""
        request = trace.approval if trace else None
        if trace is None or request is None:
            self._trace, self._shown = None, None
            self.display = False
            return False
        key = (trace.mission.id, request.attempt, len(trace.decisions))
        self._trace = trace
        if key == self._shown:
            return False
        self._shown, self._sent = key, False
        self.display = True
        self._fill(trace)
        self._disarm()
        return True

    def _fill(self, trace: MissionTrace) -> None:
        request = trace.approval
        assert request is not None
        self.query_one("#approval-text", TextRows).show(tuple(approval_rows(trace)))
        self.query_one("#approval-reading", TextRows).show(tuple(reading_rows(trace)))
        readings = self.query_one("#approval-readings", Vertical)
        readings.remove_children()
        readings.mount_all(
            Button(reading_label(number, asked), name=f"meant-{number}", compact=True)
            for number, asked in enumerate(trace.choices or request.readings, start=1)
        )
        self.set_class(bool(trace.choices or request.readings), "-unclear")
        warnings = self.query_one("#approval-warnings", ItemGrid)
        warnings.remove_children()
        warnings.mount_all(
            CheckBox(f"accept {rule}", rule)
            for rule in request.acknowledge
            if not request.blocked_by
        )
        reason = self.query_one(f"#{REASON}", Input)
        reason.value = ""
        reason.placeholder = (
            "Why override the judge? (required)"
            if request.needs_override and not request.blocked_by
            else "Your answer, Enter sends it"
            if request.state == "not_understood"
            else "Reason (optional)"
        )
        self._body.scroll_home(animate=False)
        self._seen = 0.0
        self.call_after_refresh(self._saw)

    @property
    def _body(self) -> VerticalScroll:
        return self.query_one("#approval-body", VerticalScroll)

    def on_resize(self) -> None:
        """Begin anew to tell what was on screen: the lines are others."""
        self._seen = 0.0
        self.call_after_refresh(self._saw)

    def _saw(self) -> None:
        """Note which lines of the plan are on screen, as far as none before them was left out."""
        body = self._body
        if body.scroll_offset.y <= self._seen:
            bottom = body.scroll_offset.y + body.scrollable_content_region.height
            self._seen = max(self._seen, bottom)
        self.refresh_state()

    @property
    def _unseen(self) -> bool:
        """Whether a plan that needs to be read first has not been on screen as a whole."""
        request, height = self._trace.approval if self._trace else None, self._body.virtual_size[1]
        sure = request is not None and request.state == "approve"
        return not sure and not 0 < height <= self._seen

    def action_scroll_plan(self, pages: int) -> None:
        """Show what follows of the plan, or what comes before."""
        body = self._body
        step = max(body.scrollable_content_region.height - 1, 1)
        body.scroll_to(y=body.scroll_offset.y + pages * step, animate=False)

    def take_focus(self) -> None:
        """Put the focus on Reject, the safe answer."""
        self.query_one("#reject", Button).focus()

    def _disarm(self) -> None:
        self._quiet_since = self._clock()
        self.set_timer(self.arm_delay_s + 0.05, self.refresh_state)
        self.refresh_state()

    @property
    def armed(self) -> bool:
        """Whether the panel takes decisions: quiet for long enough, and none was sent yet."""
        return not self._sent and self._clock() - self._quiet_since >= self.arm_delay_s

    def refresh_state(self) -> None:
        """Say why Approve is not possible, and enable it when it is."""
        if self._trace is None:
            return
        why = self._why_not()
        self.query_one("#approve", Button).disabled = bool(why)
        waiting = "" if self.armed else "one moment: keys are ignored until you have seen this"
        line = "decision sent" if self._sent else why or waiting or self._next_key()
        self.border_subtitle = line
        self._tell_state()

    def _next_key(self) -> str:
        """Return what the next key does, where the focus alone does not say it."""
        if self.has_focus:
            return "r, m or a goes to a button"
        approve = self.query_one("#approve", Button)
        return "Enter approves, r goes back to Reject" if approve.has_focus else ""

    def on_descendant_focus(self) -> None:
        """Say what the next key does."""
        self.refresh_state()

    def on_descendant_blur(self) -> None:
        """Say no longer what the next key did there."""
        self.refresh_state()

    def on_focus(self) -> None:
        """Say what the next key does."""
        self.refresh_state()

    def _tell_state(self) -> None:
        """Say in the title and by the colour of the frame what has to be known first."""
        request = self._trace.approval if self._trace else None
        state = (request.state if request else None) or "none"
        mark = term("approval", state)
        self.border_title = f"{mark.glyph} {mark.word}"
        refused = request is not None and bool(request.blocked_by) and state != "not_understood"
        self.set_class(refused or state == "judge_objects", "-blocked")
        self.set_class(state == "approve", "-sure")
        self.query_one("#modify", Button).disabled = state == "not_understood"

    def _why_not(self) -> str:
        """Return why Approve is not admissible, apart from the arm delay."""
        request = self._trace.approval if self._trace else None
        if request is None:
            return "no plan waits"
        left = [box.name or "" for box in self.query(CheckBox) if not box.ticked]
        why = blocked_reason(request, left, self.query_one(f"#{REASON}", Input).value)
        return why or ("✘ Approve: read to the end first (PgDn)" if self._unseen else "")

    def on_key(self, event: events.Key) -> None:
        """Drop keys typed ahead; each makes the panel wait anew."""
        free = event.key in _FREE_KEYS or (event.key[0] == "f" and event.key[1:].isdigit())
        if not self.armed and not free and not isinstance(self.app.focused, Input):
            event.stop()
            event.prevent_default()
            self._disarm()

    def action_cycle(self, step: int) -> None:
        """Go from field to field of this panel and round again; Esc leaves it."""
        chain = [each for each in self.screen.focus_chain if self in each.ancestors]
        outside = -1 if step > 0 else 0
        at = chain.index(self.app.focused) if self.app.focused in chain else outside
        if chain:
            chain[(at + step) % len(chain)].focus()

    def action_go_to(self, button: str) -> None:
        """Go to a button, which Enter presses; to what Approve still needs, where it needs it.

        Where it cannot be pressed the panel itself has the focus, so that Enter presses no other.
        """
        request = self._trace.approval if self._trace else None
        if request is None or not self.armed:
            return
        target: Widget = self.query_one(f"#{button}", Button)
        if target.disabled:
            target = self._needed(request) if button == "approve" else self
        self.screen.set_focus(target)

    def _needed(self, request: ApprovalRequested) -> Widget:
        """Return where the operator gives what Approve still needs; here if nobody can."""
        unticked = [box for box in self.query(CheckBox) if not box.ticked]
        reason = self.query_one(f"#{REASON}", Input)
        if request.blocked_by or request.state == "not_understood":
            return self
        if unticked:
            return unticked[0]
        if request.needs_override and not reason.value.strip():
            return reason
        self.action_scroll_plan(1)
        return self

    def action_read_as(self, number: int) -> None:
        """Ask for a plan for another reading of the order."""
        if not self.armed:
            self.type_ahead()
        else:
            self._choose(f"{_MEANT}{number}")

    def type_ahead(self) -> None:
        """Drop a key that came too early; the panel waits anew."""
        self._disarm()

    def end_text(self) -> None:
        """Drop the Enter at the end of a text; one that follows it presses no button either."""
        self.screen.set_focus(self)
        self._disarm()

    def write_reason(self, text: str) -> None:
        """Go to the reason and add to it what was typed at the buttons."""
        reason = self.query_one(f"#{REASON}", Input)
        self.screen.set_focus(reason)
        reason.cursor_position = len(reason.value)
        reason.insert_text_at_cursor(text)

    def on_paste(self, event: events.Paste) -> None:
        """Take what is pasted at the buttons for the reason."""
        event.stop()
        if self.armed:
            self.write_reason(" ".join(event.text.split()))
        else:
            self._disarm()

    @on(Button.Pressed)
    def _pressed(self, event: Button.Pressed) -> None:
        event.stop()
        self._choose(event.button.id or event.button.name or "")

    @on(CheckBox.Changed)
    @on(Input.Changed)
    def _given(self, event: CheckBox.Changed | Input.Changed) -> None:
        event.stop()
        self.refresh_state()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Enter leads out of the reason, or sends the answer; another Enter decides nothing."""
        event.stop()
        if event.value.strip():
            self._answer(event.value.strip())
        self.screen.set_focus(self)

    def _choose(self, choice: str) -> None:
        request = self._trace.approval if self._trace else None
        if request is None or not self.armed:
            return
        reason = self.query_one(f"#{REASON}", Input).value.strip()
        if choice == "modify" and request.state != "not_understood":
            self.post_message(self.ModifyAsked())
        elif choice.startswith(_MEANT) and request.state == "not_understood":
            number = int(choice.removeprefix(_MEANT))
            for answer in (self._trace.choices if self._trace else ())[number - 1 : number]:
                self._answer(answer)
        elif choice.startswith(_MEANT):
            number = int(choice.removeprefix(_MEANT))
            for asked in request.readings[number - 1 : number]:
                self._send(Decision(kind="choose", request_id=request.request_id, asked=asked))
        elif choice == "reject":
            self._send(Decision(kind="reject", request_id=request.request_id, reason=reason))
        elif choice == "approve" and not self._why_not():
            self._send(
                Decision(
                    kind="approve",
                    request_id=request.request_id,
                    reason=reason,
                    override_judge=request.needs_override,
                    acknowledged=request.acknowledge,
                )
            )

    def _answer(self, answer: str) -> None:
        """Answer what is asked about the order; nothing where a plan waits."""
        request = self._trace.approval if self._trace else None
        if request is not None and request.state == "not_understood" and self.armed:
            self._send(Decision(kind="answer", request_id=request.request_id, asked=answer))

    def _send(self, decision: Decision) -> None:
        self._sent = True
        self.refresh_state()
        self.post_message(self.Decided(decision))

    def refused(self) -> None:
        """Take decisions again after the last one could not be delivered."""
        self._sent = False
        self._disarm()

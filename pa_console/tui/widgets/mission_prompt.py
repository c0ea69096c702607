"""The prompt for missions: several lines, history, completion, and example orders.

A text put here by a menu, an example or an earlier order is only typed: `Enter` sends it, unless
that `Enter` comes so soon that it may have been meant for the menu.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from textual import events, on
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, Vertical
from textual.content import Content
from textual.message import Message
from textual.widgets import Static, TextArea
from textual.widgets.text_area import Selection

from pa_console.tui.actions import key_text
from pa_console.tui.kept_input import History
from pa_console.tui.order_templates import Completion, OrderNames, Slot, next_slot, slots
from pa_console.tui.refresh import retitle
from pa_console.tui.status_words import NOTE, QUIET
from pa_console.tui.surroundings import SecondsClock
from pa_console.tui.widgets.fields import TextField

ELSEWHERE = "Say in plain words what is to be done; / brings you here"
"""The text of the empty, unfocused prompt: the first line that an operator reads."""

_HERE = "Say in plain words what is to be done; Enter sends it"

_ASK = "Why?   Why not ASSET?   What would you do instead?   Enter asks it"
"""The text of the empty prompt if only questions are accepted."""

PUT_S = 0.5
"""The time in seconds for which `Enter` does not send a text that was put here.

An `Enter` within this time restarts it.
"""

MOST_SHOWN = 6
"""The maximum number of names that are shown for a slot; the rest are counted."""

HEADING = "To begin: press a key, then Enter to send it"


class _TriedCompletion(NamedTuple):
    """A completion written by Tab, the number of its name, and the text and cursor afterwards."""

    completion: Completion
    number: int
    text: str
    cursor: tuple[int, int]


class MissionInput(TextField):
    """A field of a few lines; its text is kept until the mission is accepted."""

    BINDINGS = [
        Binding("tab", "complete", "Complete the name, or go to the next slot", show=False),
        Binding("enter", "send", "Send", show=False),
        Binding("ctrl+j,alt+enter,shift+enter", "new_line", "New line", show=False),
        Binding("up", "earlier", "Earlier mission", show=False),
        Binding("down", "later", "Later mission", show=False),
    ]

    @dataclass
    class Sent(Message):
        """Posted when Enter sends `text`, the text at that moment."""

        text: str

    class CursorMoved(Message):
        """Posted when the cursor or the text around it has changed."""

    _instead = ""

    def __init__(
        self,
        history: History,
        names: OrderNames,
        clock: SecondsClock,
        *,
        here: str = _HERE,
        elsewhere: str = ELSEWHERE,
    ) -> None:
        """Show `here` in the empty field while it has the focus, `elsewhere` otherwise."""
        self._names, self._clock = names, clock
        self._here, self._elsewhere = here, elsewhere
        self._put_at_s: float | None = None
        self._tried: _TriedCompletion | None = None
        super().__init__(
            compact=True,
            id="mission-input",
            placeholder=elsewhere,
            tab_behavior="focus",
            highlight_cursor_line=False,
        )
        self.cursor_blink = False
        self._missions = history

    def watch_has_focus(self, focus: bool) -> None:
        """Show the key that leads here only while the focus is elsewhere."""
        self._watch_has_focus(focus)
        self._say()

    def say_instead(self, text: str) -> None:
        """Show `text` in the empty field; with an empty text, the field's purpose."""
        self._instead = text
        self._say()

    def _say(self) -> None:
        text = self._instead or (self._here if self.has_focus else self._elsewhere)
        if self.placeholder != text:
            self.placeholder = text

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Leave the function keys, with which a text area selects, to the console."""
        if action in ("select_line", "select_all"):
            return False
        return super().check_action(action, parameters)

    async def on_key(self, event: events.Key) -> None:
        """Drop a slash as the first character, because it is the key that leads here."""
        if event.key == "slash" and not self.text:
            event.stop()
            event.prevent_default()

    def action_send(self) -> None:
        """Post the text for sending, unless Enter is held down or was meant for another purpose.

        Such an Enter restarts the wait.
        """
        now_s = self._clock()
        if self._put_at_s is not None and now_s - self._put_at_s < PUT_S:
            self._put_at_s = now_s
        else:
            self._put_at_s = None
            self.post_message(self.Sent(self.text))

    # Texts that are put here

    def put(self, text: str) -> None:
        """Type `text` in place of the current text, which `ctrl+z` restores."""
        if self.text:
            self.replace(text, self.document.start, self.document.end)
        else:
            self.insert(text)
        self._put_at_s = self._clock()
        if not self.select_slot(0):
            self.move_cursor(self.document.end)

    @property
    def slot(self) -> Slot | None:
        """The open slot at the cursor, or else the next one after it, or else the first."""
        start = min(self._index(self.selection.start), self._index(self.selection.end))
        return next_slot(self.text, start)

    def select_slot(self, after: int) -> bool:
        """Select the first open slot at or after the index `after`; return whether there is one.

        Text that is typed then replaces the slot.
        """
        slot = next_slot(self.text, after)
        if slot is not None:
            self.selection = Selection(self._location(slot.start), self._location(slot.end))
        return slot is not None

    def fill(self, slot: Slot, name: str) -> None:
        """Put `name` into an open slot and go to the next."""
        self.replace(name, self._location(slot.start), self._location(slot.end))
        self._put_at_s = self._clock()
        if not self.select_slot(slot.start + len(name)):
            self.move_cursor(self.document.end)

    def _index(self, location: tuple[int, int]) -> int:
        row, column = location
        return sum(len(line) + 1 for line in self.text.split("\n")[:row]) + column

    def _location(self, index: int) -> tuple[int, int]:
        before = self.text[:index]
        return before.count("\n"), index - before.rfind("\n") - 1

    # Names

    def update_suggestion(self) -> None:
        """Show the rest of the name that is being typed."""
        completion = self._completion()
        self.suggestion = completion.rest if completion is not None else ""
        self.post_message(self.CursorMoved())

    def on_text_area_selection_changed(self) -> None:
        """Update the suggestion for the new place of the cursor."""
        self.update_suggestion()

    def _completion(self) -> Completion | None:
        row, column = self.cursor_location
        line = self.document.get_line(row)
        inside = line[column : column + 1]
        if not self.selection.is_empty or inside.isalnum() or inside == "_":
            return None
        return self._names.completion(line[:column])

    def action_complete(self) -> None:
        """Complete the name, go to the next slot, try the next name, or leave the field."""
        completion, tried = self._completion(), self._tried
        if completion is not None:
            self._write_name(completion, 0, len(completion.typed))
        elif slots(self.text):
            self.select_slot(max(map(self._index, self.selection)))
        elif (
            tried is not None
            and (self.text, self.cursor_location) == tried[2:]
            and len(tried.completion.names) > 1
        ):
            names = tried.completion.names
            number = (tried.number + 1) % len(names)
            self._write_name(tried.completion, number, len(names[tried.number]))
        else:
            self.screen.focus_next()

    def action_cursor_right(self, select: bool = False) -> None:
        """Complete the name that is shown, or else move the cursor right."""
        completion = self._completion()
        if completion is not None and not select:
            self._write_name(completion, 0, len(completion.typed))
            return
        self.suggestion = ""
        super().action_cursor_right(select)

    def _write_name(self, completion: Completion, number: int, written: int) -> None:
        """Write a name in place of the `written` characters before the cursor."""
        row, column = self.cursor_location
        self.replace(completion.names[number], (row, column - written), (row, column))
        self._tried = _TriedCompletion(completion, number, self.text, self.cursor_location)
        self.suggestion = ""

    def action_new_line(self) -> None:
        """Begin a new line."""
        self.insert("\n")

    def action_earlier(self) -> None:
        """Move a line up; from the first line, recall the previous mission."""
        if self.cursor_at_first_line:
            self._recall(-1)
        else:
            self.action_cursor_up()

    def action_later(self) -> None:
        """Move a line down; from the last line, recall the next mission."""
        if self.cursor_at_last_line:
            self._recall(1)
        else:
            self.action_cursor_down()

    def _recall(self, by: int) -> None:
        self.text = self._missions.move(by, self.text)
        self.move_cursor(self.document.end)


class ReadingLine(Static):
    """The line that shows the reading of the order in the prompt.

    It replaces the footer, so the layout does not shift. It takes no keys, so it cannot approve
    anything.
    """

    DEFAULT_CSS = """
    ReadingLine {
        dock: bottom; width: 100%; height: 1; padding: 0 1; display: none;
        text-wrap: nowrap; text-overflow: ellipsis;
    }
    """

    text = ""
    """The text whose reading is shown; '' for none."""

    def show(self, text: str, reading: str) -> None:
        """Show the reading of `text`, or hide the line if there is none."""
        self.text = text if reading else ""
        self.display = bool(reading)
        self.update(Content.styled(reading, QUIET), layout=False)


class MissionPrompt(Horizontal):
    """The prompt; if it is closed, it shows the reason and accepts at most questions."""

    @dataclass
    class Given(Message):
        """Posted when the operator sends a mission."""

        text: str

    @dataclass
    class Typed(Message):
        """Posted when the typed text changes; `text` is '' once it is deleted."""

        text: str

    def __init__(
        self,
        history: History,
        names: OrderNames,
        clock: SecondsClock,
        closed: str = "",
        *,
        asks: bool = False,
    ) -> None:
        """Build the prompt; `closed` is the reason why no missions are accepted, empty if they are.

        If `asks` is True, questions are still accepted.
        """
        super().__init__(id="prompt")
        self._history, self._closed_why = history, closed
        self._takes = asks or not closed
        self._names, self._clock = names, clock
        self._waiting = self._hint = self._keys = ""

    def compose(self) -> ComposeResult:
        """Yield the label and the field."""
        if not self._takes:
            yield Static(Content.styled(f" {self._closed_why} ", "bold"), id="prompt-closed")
        elif self._closed_why:
            yield Static("Ask ❯ ", id="prompt-label")
            yield MissionInput(
                self._history, self._names, self._clock, here=_ASK, elsewhere=self._closed_why
            )
        else:
            yield Static("Mission ❯ ", id="prompt-label")
            yield MissionInput(self._history, self._names, self._clock)

    def on_text_area_changed(self, event: TextArea.Changed) -> None:
        """Post the text as it is typed or deleted."""
        event.stop()
        self.post_message(self.Typed(self.draft))

    def on_mission_input_sent(self, event: MissionInput.Sent) -> None:
        """Post the text as a mission, unless it is empty or has an open slot."""
        event.stop()
        field = self.query_one(MissionInput)
        if slots(event.text):
            field.select_slot(0)
            kind = field.slot.kind if field.slot is not None else "slot"
            self.notify(
                f"{{{kind}}} is still open: type a name, or click it on the map",
                title="Not sent", severity="warning", markup=False,
            )  # fmt: skip
        elif event.text.strip():
            self.post_message(self.Given(event.text))

    @on(events.DescendantFocus)
    @on(events.DescendantBlur)
    def _keys_go_elsewhere(self) -> None:
        """Show the help for writing, or hide it while the focus is elsewhere."""
        self._say_above()

    def on_mission_input_cursor_moved(self, event: MissionInput.CursorMoved) -> None:
        """Show the effect of Tab at the cursor."""
        event.stop()
        field = self.query_one(MissionInput)
        slot = field.slot
        if field.suggestion:
            self._hint = "Tab or → completes the name, Tab again tries the next"
        elif slot is not None:
            names = self._names.for_slot(slot.kind)
            more = f" and {len(names) - MOST_SHOWN} more" if len(names) > MOST_SHOWN else ""
            fitting = f" {', '.join(names[:MOST_SHOWN])}{more}" if names else " any words"
            self._hint = f"{{{slot.kind}}}:{fitting} · type it or click it; Tab: next slot"
        else:
            self._hint = ""
        self._say_above()

    def show_keys(self, text: str) -> None:
        """Show, in the line above, the keys that help to write, while that line is free."""
        self._keys = text
        self._say_above()

    def put(self, text: str) -> None:
        """Type a text into the field in place of the current text; nothing is sent."""
        if self._takes:
            self.query_one(MissionInput).put(text)
            self.take_cursor()

    def fill(self, names: Sequence[str]) -> bool:
        """Put the first of `names` that fits into an open slot; return whether one fits."""
        fitting = self.fitting(names)
        if fitting is None:
            return False
        field = self.query_one(MissionInput)
        field.fill(*fitting)
        self.take_cursor()
        return True

    def fitting(self, names: Sequence[str]) -> tuple[Slot, str] | None:
        """Return an open slot that one of `names` fits, and that name; prefer the cursor's slot."""
        if not self._takes:
            return None
        field = self.query_one(MissionInput)
        first = field.slot
        others = (slot for slot in slots(field.text) if slot != first)
        for slot in (first, *others) if first is not None else ():
            for name in names:
                if self._names.fits(name, slot.kind):
                    return slot, name
        return None

    def taken(self, text: str) -> None:
        """Remove `text` from the field after it was accepted, and add it to the history.

        Text that was typed after it in the meantime stays in the field.
        """
        self._history.add(text)
        field = self.query_one(MissionInput)
        field.text = field.text.removeprefix(text) if field.text.startswith(text) else ""
        field.move_cursor(field.document.end)

    def show_waiting(self, text: str) -> None:
        """Show `text`, which describes a wait, in the line above, or else in the field.

        A text that is being typed is never covered.
        """
        self._waiting = f"◔ {text}" if text else ""
        self._say_above()

    def _say_above(self) -> None:
        """Show the effect of Tab in the line above, or else the text of `show_waiting`."""
        above = bool(self.styles.border_top[0])
        keys = self._keys if self.has_cursor and not self.draft else ""
        text = self._hint or self._waiting
        self.set_class(not text, "-keys")
        retitle(self, (text or keys) if above else "")
        for field in self.query(MissionInput):
            field.say_instead("" if above else self._waiting)

    @property
    def draft(self) -> str:
        """The typed text that is not sent yet."""
        return self.query_one(MissionInput).text if self._takes else ""

    @property
    def has_cursor(self) -> bool:
        """True if the field has the focus."""
        return self._takes and self.query_one(MissionInput).has_focus

    def take_cursor(self) -> None:
        """Focus the field at once, so that it takes the very next key."""
        if self._takes:
            self.screen.set_focus(self.query_one(MissionInput))


class ExampleLine(Static):
    """The line of an example order."""

    @dataclass
    class Clicked(Message):
        """Posted when the order is clicked."""

        order: str

    def __init__(self, number: int, order: str) -> None:
        key = key_text(f"alt+{number}")
        super().__init__(Content.assemble((f"{key}  ", f"bold {NOTE}"), order))
        self._order = order

    def on_click(self) -> None:
        """Post the order of the clicked line."""
        self.post_message(self.Clicked(self._order))


class ExampleOrders(Vertical):
    """The example orders, shown until the first mission of a session."""

    def __init__(self, orders: Sequence[str], **kwargs: str) -> None:
        super().__init__(id=kwargs.get("id"))
        self.orders = tuple(orders)

    def compose(self) -> ComposeResult:
        """Yield the heading and a line for each order."""
        yield Static(Content.styled(HEADING, QUIET))
        for number, order in enumerate(self.orders, start=1):
            yield ExampleLine(number, order)

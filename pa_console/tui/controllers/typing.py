"""The effect of a key that no field takes: it acts, it waits for Enter, or it is text.

A letter never acts in the middle of a text. A letter with a command may be the first of a text,
however slowly the text is typed. The letter therefore only chooses the command, and Enter gives it.
While the approval panel has the focus, letters other than its own begin the reason.
"""

from collections.abc import Callable
from dataclasses import dataclass

from textual import events
from textual.content import Content
from textual.timer import Timer
from textual.widgets import Input, Static, TextArea

from pa_console.tui.actions import ALT_DIGITS, ConsoleAction, first_own_key, key_text, with_call
from pa_console.tui.approval.inputs import DECISION_KEYS, REASON
from pa_console.tui.approval.panel import ApprovalPanel
from pa_console.tui.controllers.console_session import ConsoleSession
from pa_console.tui.controllers.settings import SettingsController

TEXT_S = 0.5
"""The longest time between two keys of a text, in seconds.

Two different printable keys within this time are text if at least one of them is a letter.
"""

CHOSEN_S = 5.0
"""The time for which a command waits for Enter and a notice about keys is shown, in seconds."""

KeyTime = Callable[[events.Key], float]
"""A function that returns the time of a key, in seconds of a monotonic clock; tests replace it."""


class TypedText:
    """A series of printable keys that closely follow one another.

    The same key repeated is not text, and neither are digits and signs without a letter.
    """

    def __init__(self) -> None:
        self.keys = ""
        """The keys typed without a pause."""
        self.is_text = False
        """True if the keys are text; then neither they nor the Enter after them is a command."""
        self._last_s = 0.0

    def add(self, character: str, time_s: float) -> None:
        """Add a printable key that was pressed at `time_s` seconds."""
        goes_on = bool(self.keys) and time_s - self._last_s < TEXT_S
        self.keys = self.keys + character if goes_on else character
        self._last_s = time_s
        letters = any(key.isalpha() for key in self.keys)
        self.is_text = (goes_on and self.is_text) or (letters and len(set(self.keys)) > 1)

    def add_in_field(self, character: str, time_s: float) -> None:
        """Add a key that went into a field; keys that closely follow it elsewhere are text too."""
        self.add(character, time_s)
        self.is_text = True

    def goes_on(self, time_s: float) -> bool:
        """Return whether a key at `time_s` seconds closely follows the previous key."""
        return bool(self.keys) and time_s - self._last_s < TEXT_S

    def forget(self) -> None:
        """Forget the keys, because the mouse or a key that prints nothing was used."""
        self.keys, self.is_text = "", False


class KeyLine(Static):
    """A line about keys in place of the footer; the rest of the screen does not move."""

    DEFAULT_CSS = """
    KeyLine {
        dock: bottom; width: 100%; height: 1; padding: 0 1;
        background: $warning; color: $background; text-wrap: nowrap; text-overflow: ellipsis;
    }
    """

    def show(self, key: str, text: str) -> None:
        """Show a text about a key, or about typing in general if `key` is empty."""
        self.update(Content.assemble((f"{key}  " if key else "", "bold"), text), layout=False)


@dataclass(frozen=True)
class _PressedAction:
    action: ConsoleAction
    time_s: float


class TypingController:
    """The handler that receives every key first, on a console that accepts typed text."""

    def __init__(
        self, session: ConsoleSession, settings: SettingsController, key_time: KeyTime
    ) -> None:
        self._session, self._app, self._settings = session, session.app, settings
        self._key_time = key_time
        self._typed = TypedText()
        self._chosen: _PressedAction | None = None
        self._line: KeyLine | None = None
        self._timer: Timer | None = None
        self._told = False

    async def takes(self, event: events.Key) -> bool:
        """Handle a key that is a command or text; return True if it goes no further."""
        if not self._session.asks:
            return False
        (chosen, self._chosen), self._told = (self._chosen, None), False
        taken = await self._takes(event, chosen)
        if not self._told:
            self._drop_line()
        return taken

    async def _takes(self, event: events.Key, chosen: _PressedAction | None) -> bool:
        time_s = self._key_time(event)
        if self._takes_alt_digit(event):
            return True
        if not _prints(event):
            return await self._takes_other(event, chosen, time_s)
        character, focused = event.character or "", self._app.focused
        if focused is not None and focused.check_consume_key(event.key, character):
            self._lead_in(time_s)
            self._typed.add_in_field(character, time_s)
            return False
        self._typed.add(character, time_s)
        panel = self._panel
        if panel is not None:
            return self._takes_at_panel(panel, character)
        if self._session.recording is None and self._typed.is_text:
            self._say_it_is_text()
            return True
        return self._chooses(event, time_s)

    def _takes_alt_digit(self, event: events.Key) -> bool:
        """Handle Alt and a digit as some terminals send it; return whether this had an effect.

        At the approval panel, the key shows a reading; in the empty mission field, it types an
        example.
        """
        if event.key not in ALT_DIGITS:
            return False
        number, panel, main = ALT_DIGITS.index(event.key) + 1, self._panel, self._session.main
        if panel is not None and not isinstance(self._app.focused, Input):
            self._typed.forget()
            panel.action_look_at(number)
            return True
        return main is not None and self._app.screen is main and main.type_example(number)

    def forget(self) -> None:
        """Reset after mouse input."""
        self._chosen = None
        self._drop_line()
        self._typed.forget()

    async def _takes_other(
        self, event: events.Key, chosen: _PressedAction | None, time_s: float
    ) -> bool:
        """Let Enter give the chosen command or end a text; return whether the key was used."""
        in_field = isinstance(self._app.focused, Input | TextArea)
        ends_text = event.key == "enter" and self._typed.is_text and not in_field
        self._typed.forget()
        if event.key != "enter" or in_field:
            return False
        if chosen is not None and time_s - chosen.time_s <= CHOSEN_S:
            await self._app.run_action(f"app.{chosen.action.action}")
            return True
        if ends_text and (panel := self._panel) is not None:
            panel.end_text()
        return ends_text

    # The approval panel

    @property
    def _panel(self) -> ApprovalPanel | None:
        """The approval panel while one of its buttons or boxes has the focus; else None."""
        main = self._session.main
        if main is None or self._app.screen is not main:
            return None
        panel = main.query_one(ApprovalPanel)
        return panel if panel.display and panel.has_focus_within else None

    def _takes_at_panel(self, panel: ApprovalPanel, character: str) -> bool:
        if not panel.armed:
            panel.disarm()
            return True
        if self._typed.is_text:
            panel.write_reason(self._typed.keys)
            return True
        if character == " ":  # ticks a box, or plays the rehearsal
            self._typed.forget()
            return False
        if character.isalpha() and character not in DECISION_KEYS:
            panel.write_reason(character)
            return True
        return False

    def _lead_in(self, time_s: float) -> None:
        """Insert the first letter of a reason if the letter was taken as a key of the panel."""
        first, field = self._typed.keys, self._app.focused
        leads = self._typed.goes_on(time_s) and not self._typed.is_text
        if leads and first in DECISION_KEYS and isinstance(field, Input) and field.id == REASON:
            field.insert_text_at_cursor(first)

    # Commands elsewhere

    def _chooses(self, event: events.Key, time_s: float) -> bool:
        bound = self._app.screen.active_bindings.get(event.key)
        if bound is None or bound.node is not self._app:
            return False
        action = with_call(bound.binding.action)
        if action is None or not action.confirmed:
            return False
        self._chosen = _PressedAction(action, time_s)
        self._say(key_text(event.key), f"then Enter: {action.help}. Any other key cancels it")
        return True

    def _say_it_is_text(self) -> None:
        keys = self._settings.keys
        waits = self._session.situation.approval
        plan = f", {first_own_key('approval', keys)} to the waiting plan" if waits else ""
        mission = first_own_key("prompt", keys)
        self._say("", f"Typed text is not a command. {mission} goes to the mission field{plan}")

    def _say(self, key: str, text: str) -> None:
        self._told = True
        if self._line is None or self._line not in self._app.screen.children:
            self._drop_line()
            self._line = KeyLine()
            self._app.screen.mount(self._line)
        self._line.show(key, text)
        if self._timer is not None:
            self._timer.stop()
        self._timer = self._app.set_timer(CHOSEN_S, self._drop_line)

    def _drop_line(self) -> None:
        if self._timer is not None:
            self._timer.stop()
        if self._line is not None and self._line.is_attached:
            self._line.remove()
        self._line = self._timer = None


def _prints(event: events.Key) -> bool:
    """Return whether the key types a character; a key with Alt has a character but types none."""
    return event.is_printable and "+" not in event.key

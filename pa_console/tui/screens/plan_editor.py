"""Lets the operator change a plan's JSON, checked while it is typed: the form's other side."""

import json

from pydantic import ValidationError
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, Vertical
from textual.screen import ModalScreen
from textual.widgets import Button, Static, TextArea

from pa_console.schema.command import COMMANDS
from pa_console.schema.plan import Plan
from pa_console.tui.widgets.fields import TextField


def plan_json(plan: Plan) -> str:
    """Write a plan as JSON for editing: one action a line."""
    actions = ",\n".join(f"    {json.dumps(a.model_dump())}" for a in plan.actions)
    listed = f"[\n{actions}\n  ]" if plan.actions else "[]"
    return f'{{\n  "reason": {json.dumps(plan.reason)},\n  "actions": {listed}\n}}'


def read_plan(text: str) -> Plan | str:
    """Return the plan in `text`, or its fault and the place of it."""
    try:
        return Plan.model_validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(str(part) for part in first["loc"])
        return f"{place}: {first['msg']}" if place else first["msg"]


FORM = "form"
"""The answer that goes back to the form."""


class PlanField(TextField):
    """The text of a plan, which one key selects as a whole, to be replaced by another."""

    BINDINGS = [Binding("ctrl+a", "select_all", "Select all", show=False)]


class PlanEditor(ModalScreen["Plan | str | None"]):
    """Returns the changed plan, FORM, or None; the draft survives in `draft` when it is left."""

    BINDINGS = [
        Binding("escape", "dismiss", "Back, keep the draft"),
        Binding("ctrl+s,f10", "send", "Send to the safeguards"),
        Binding("ctrl+r", "revert", "The plan as it was proposed"),
        Binding("f4", "form", "As a form"),
    ]

    def __init__(self, proposed: str, draft: str) -> None:
        """Begin with `draft`; `proposed` is what one can always go back to."""
        super().__init__()
        self._proposed, self.draft = proposed, draft

    def compose(self) -> ComposeResult:
        """Yield the editor, the verdict on its text, and the buttons."""
        with Vertical(id="editor"):
            yield Static("The changed plan goes through all safeguards again.", id="editor-note")
            yield PlanField(self.draft, id="editor-text", tab_behavior="focus", compact=True)
            yield Static(id="editor-error", markup=False)
            yield Static("commands: " + ", ".join(_usage()), id="editor-help", markup=False)
            with Horizontal(id="editor-buttons"):
                yield Button("Back (Esc)", id="leave", compact=True)
                yield Button("Send (^S)", id="send", variant="primary", compact=True)

    def on_mount(self) -> None:
        """Start in the text."""
        self.query_one(TextArea).cursor_blink = False
        editor = self.query_one("#editor")
        editor.border_title = "Modify the plan"
        editor.border_subtitle = "^A selects all   ^R plan as proposed   ^Z undo   F4 form"
        self.query_one(TextArea).focus()
        self._check()

    def on_text_area_changed(self) -> None:
        """Check the typed text at once."""
        self._check()

    def _check(self) -> Plan | None:
        self.draft = self.query_one(TextArea).text
        read = read_plan(self.draft)
        error = self.query_one("#editor-error", Static)
        good = isinstance(read, Plan)
        error.update("✔ the plan can be read" if good else f"✘ {read}")
        error.set_class(good, "-good")
        self.query_one("#send", Button).disabled = not good
        return read if isinstance(read, Plan) else None

    def on_button_pressed(self, event: Button.Pressed) -> None:
        """Send or leave."""
        if event.button.id == "send":
            self.action_send()
        else:
            self.dismiss(None)

    def action_send(self) -> None:
        """Return the plan if it can be read."""
        plan = self._check()
        if plan is not None:
            self.dismiss(plan)

    def action_form(self) -> None:
        """Go back to the form, if the text is a plan."""
        if self._check() is not None:
            self.dismiss(FORM)

    def action_revert(self) -> None:
        """Put the proposed plan back; what was typed comes again with an undo."""
        area = self.query_one(TextArea)
        area.replace(self._proposed, area.document.start, area.document.end)


def _usage() -> list[str]:
    return [f"{verb} FRAME" if spec.takes_frame else verb for verb, spec in COMMANDS.items()]

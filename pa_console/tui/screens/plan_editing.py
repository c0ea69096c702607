"""The editors of a plan: a form with a row for each action, and JSON; edits are checked at once.

Both keep their text in `draft` when the operator leaves them.
"""

import asyncio
import json
from collections.abc import Awaitable, Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, cast

from pydantic import ValidationError
from rapidfuzz import fuzz, process
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.content import Content
from textual.screen import ModalScreen
from textual.suggester import SuggestFromList
from textual.widgets import Button, Input, Static, TextArea

from pa_console.mission.examine import Examination
from pa_console.schema.command import COMMANDS, Verb
from pa_console.schema.plan import Plan
from pa_console.schema.world import World
from pa_console.tui.plan_preview import PlanPreview
from pa_console.tui.status_words import BAD, GOOD, KIND_WORDS, QUIET, WARN
from pa_console.tui.widgets.fields import LineField, TextField

CHECK_AFTER_S = 0.3
"""The pause in editing after which the plan is rehearsed and checked, in seconds."""
LIKE = 60.0
"""The minimum similarity of a name that is suggested, out of 100."""

OTHER = "other"
"""The result that opens the other editor."""

Examine = Callable[[Plan], Awaitable[Examination]]
"""A function that checks and rehearses a plan; it decides nothing."""


def nearest(text: str, options: Sequence[str]) -> str:
    """Return the option most similar to a text; '' if none is similar enough."""
    match = process.extractOne(
        text, options, scorer=fuzz.WRatio, processor=str.lower, score_cutoff=LIKE
    )
    return match[0] if match is not None else ""


def _unknown(text: str, problem: str, options: Sequence[str]) -> str:
    near = nearest(text, options)
    hint = f"did you mean {near}? ↓ uses it" if near else f"known: {', '.join(options[:6])}"
    return f"{problem}: {hint}"


def plan_json(plan: Plan) -> str:
    """Return a plan as JSON for editing, with one action per line."""
    return _written(plan.reason, [action.model_dump() for action in plan.actions])


def _written(reason: str, given: Iterable[Mapping[str, object]]) -> str:
    actions = ",\n".join(f"    {json.dumps(action)}" for action in given)
    listed = f"[\n{actions}\n  ]" if actions else "[]"
    return f'{{\n  "reason": {json.dumps(reason)},\n  "actions": {listed}\n}}'


def read_plan(text: str) -> Plan | str:
    """Return the plan in `text`, or a message with its first fault and the place of the fault."""
    try:
        return Plan.model_validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(str(part) for part in first["loc"])
        return f"{place}: {first['msg']}" if place else first["msg"]


@dataclass(frozen=True)
class FormRow:
    """One action as it is typed; it may be invalid."""

    agent: str = ""
    verb: str = ""
    place: str = ""
    after: str = ""
    stay_s: float = 0.0

    @property
    def action(self) -> dict[str, object]:
        """The action as a JSON object."""
        fields: dict[str, object] = {
            "agent": self.agent,
            "command": f"{self.verb} {self.place}".strip(),
        }
        numbers = self.after.replace(",", " ").split()
        if numbers:
            fields["after"] = [int(word) if word.isdecimal() else word for word in numbers]
        return fields | ({"stay_s": self.stay_s} if self.stay_s else {})

    def fault(self, world: World) -> str:
        """Return the fault of the row, regardless of other rows; '' if there is none."""
        if self.agent not in world.assets:
            return _unknown(self.agent, f"no asset “{self.agent}”", tuple(world.assets))
        spec = COMMANDS.get(cast(Verb, self.verb))
        kind = world.assets[self.agent].kind
        able = tuple(verb for verb, command in COMMANDS.items() if kind in command.kinds)
        if spec is None:
            return _unknown(self.verb, f"no command “{self.verb}”", able)
        if kind not in spec.kinds:
            return f"a {KIND_WORDS[kind]} cannot {self.verb}; it can {', '.join(able)}"
        if not spec.takes_frame:
            return f"{self.verb} takes no place" if self.place else ""
        if self.place not in world.frames:
            return _unknown(self.place, f"no place “{self.place}”", tuple(world.frames))
        if not all(word.isdecimal() for word in self.after.replace(",", " ").split()):
            return "after: the numbers of other rows, such as 1 or 1, 2"
        return ""


def rows_of(draft: str) -> tuple[str, list[FormRow]]:
    """Return the reason and the rows of a draft; raise ValueError if it cannot be shown in rows."""
    try:
        read: Any = json.loads(draft)
        rows = [_row_of(action) for action in read["actions"]]
        return str(read["reason"]), rows
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError("the draft cannot be shown in rows") from error


def _row_of(action: Mapping[str, Any]) -> FormRow:
    verb, _, place = str(action["command"]).partition(" ")
    after = ", ".join(str(number) for number in action.get("after", ()))
    return FormRow(str(action["agent"]), verb, place, after, float(action.get("stay_s", 0.0)))


class PickField(LineField):
    """A field for a name from a list: arrows go through it, Enter takes the most similar name."""

    BINDINGS = [
        Binding("down", "pick(1)", "Next name", show=False),
        Binding("up", "pick(-1)", "Name before", show=False),
    ]

    def __init__(self, value: str, placeholder: str, options: Sequence[str]) -> None:
        super().__init__(value, placeholder=placeholder)
        self.options = tuple(options)
        self.suggester = SuggestFromList(self.options, case_sensitive=False)

    def action_pick(self, step: int) -> None:
        """Go to the next name; from a text that is not a name, go to the most similar name."""
        if self.value in self.options:
            at = self.options.index(self.value) + step
            self.value = self.options[at % len(self.options)]
        elif self.options:
            self.value = nearest(self.value, self.options) or self.options[0]
        self.cursor_position = len(self.value)

    def settle(self) -> None:
        """Replace the typed text with the most similar name."""
        if self.value and self.value not in self.options:
            self.value = nearest(self.value, self.options) or self.value


class ActionRow(Vertical):
    """The fields of one action, with the findings of the checks below them."""

    def __init__(self, row: FormRow, world: World) -> None:
        super().__init__()
        self._stay_s = row.stay_s
        self.agent = PickField(row.agent, "asset", tuple(world.assets))
        self.verb = PickField(row.verb, "command", tuple(COMMANDS))
        self.place = PickField(row.place, "place", tuple(world.frames))
        self.after = LineField(row.after, placeholder="after")
        self._number, self._said = Static("", classes="-number"), Static("", classes="-said")

    def compose(self) -> ComposeResult:
        """Yield the fields in one line, and the line for the findings."""
        with Horizontal():
            yield from (self._number, self.agent, self.verb, self.place, self.after)
        yield self._said

    @property
    def row(self) -> FormRow:
        """The action as it is typed now."""
        agent, verb, place, after = (
            field.value.strip() for field in (self.agent, self.verb, self.place, self.after)
        )
        return FormRow(agent, verb, place, after, self._stay_s)

    def tell(self, number: int, findings: str, style: str) -> None:
        """Show the row's number and its findings."""
        self._number.update(Content(f"{number}"))
        self._said.update(Content.styled(findings, style))


class PlanForm(ModalScreen["Plan | str | None"]):
    """A plan as a form; it returns the changed plan, OTHER for its JSON, or None."""

    BINDINGS = [
        Binding("escape", "leave", "Back, keep the draft"),
        Binding("ctrl+s,f10", "send", "Submit for checking", priority=True),
        Binding("ctrl+n", "add", "Add a row", priority=True),
        Binding("ctrl+d", "remove", "Remove the row", priority=True),
        Binding("ctrl+r", "revert", "The plan as it was proposed", priority=True),
        Binding("f4", "json", "As JSON", priority=True),
    ]

    def __init__(self, world: World, proposed: str, draft: str, examine: Examine) -> None:
        """Begin with `draft`; raise ValueError if it cannot be shown in rows."""
        super().__init__()
        self._world, self._proposed, self.draft, self._examine = world, proposed, draft, examine
        self._reason, self._first = rows_of(draft)

    def compose(self) -> ComposeResult:
        """Yield the rows, the verdict on all of them, and the buttons."""
        with Vertical(id="plan-form"):
            yield VerticalScroll(*self._made(self._first), id="plan-rows", can_focus=False)
            yield Static(id="plan-verdict", markup=False)
            with Horizontal(id="plan-buttons"):
                yield Button("Back (Esc)", id="leave", compact=True)
                yield Button("Add (^N)", id="add", compact=True)
                yield Button("Remove (^D)", id="remove", compact=True)
                yield Button("JSON (F4)", id="json", compact=True)
                yield Button("Send (^S)", id="send", variant="primary", compact=True)

    def _made(self, rows: Sequence[FormRow]) -> list[ActionRow]:
        return [ActionRow(row, self._world) for row in rows]

    def on_mount(self) -> None:
        """Focus the first row."""
        form = self.query_one("#plan-form")
        form.border_title = "Modify the plan"
        form.border_subtitle = "↑ ↓ pick a name   Enter takes the nearest   ^R plan as proposed"
        if rows := self._rows:
            rows[0].agent.focus()
        self._check()

    @property
    def _rows(self) -> list[ActionRow]:
        return list(self.query(ActionRow))

    @on(Input.Changed)
    def _changed(self, event: Input.Changed) -> None:
        event.stop()
        self._check()

    @on(Input.Submitted)
    def _entered(self, event: Input.Submitted) -> None:
        """Take the most similar name, and focus the next field."""
        event.stop()
        if isinstance(event.input, PickField):
            event.input.settle()
        self.focus_next()

    def _check(self) -> Plan | None:
        """Show errors at once; if there are none, examine the plan at the next pause."""
        rows = self._rows
        self.draft = _written(self._reason, [line.row.action for line in rows])
        faults = [line.row.fault(self._world) for line in rows]
        read = "see the rows" if any(faults) else read_plan(self.draft)
        plan = read if isinstance(read, Plan) else None
        for number, (line, fault) in enumerate(zip(rows, faults, strict=True), start=1):
            line.tell(number, f"✘ {fault}" if fault else "…", BAD if fault else QUIET)
        self._tell(*(("checking …", QUIET) if plan is not None else (f"✘ {read}", BAD)))
        self.query_one("#send", Button).disabled = plan is None
        if plan is not None:
            look = partial(self._look, plan)
            self.run_worker(look, group="check", exclusive=True, exit_on_error=False)
        else:
            self.workers.cancel_group(self, "check")
        return plan

    def _tell(self, verdict: str, style: str) -> None:
        self.query_one("#plan-verdict", Static).update(Content.styled(verdict, style))

    async def _look(self, plan: Plan) -> None:
        """Rehearse and check the plan, and show the result in each row."""
        await asyncio.sleep(CHECK_AFTER_S)
        examination = await self._examine(plan)
        broken = [finding for finding in examination.findings if finding.broken]
        preview = (
            PlanPreview(self._world, plan, examination.rehearsal)
            if examination.rehearsal is not None
            else None
        )
        for number, each in enumerate(self._rows, start=1):
            row = each.row
            mine = [f for f in broken if row.agent in f.message]
            if mine:
                findings = "; ".join(f"{finding.rule_id}: {finding.message}" for finding in mine)
                bad = any(finding.blocking for finding in mine)
                each.tell(number, f"{'✘' if bad else '△'} {findings}", BAD if bad else WARN)
            else:
                each.tell(number, f"✔ {'; '.join(_outlook(row, preview))}", GOOD)
        blocking = any(finding.blocking for finding in broken)
        others = [f"{finding.rule_id}: {finding.message}" for finding in broken]
        if broken:
            mark = "✘" if blocking else "△"
            self._tell(f"{mark} {'; '.join(others)}", BAD if blocking else WARN)
        else:
            self._tell("✔ no rule is broken", GOOD)

    def action_send(self) -> None:
        """Return the plan if it is valid."""
        if (plan := self._check()) is not None:
            self.dismiss(plan)

    def action_leave(self) -> None:
        """Leave the form and keep the draft."""
        self._check()
        self.dismiss(None)

    def action_json(self) -> None:
        """Switch to the plan as JSON."""
        self._check()
        self.dismiss(OTHER)

    async def action_add(self) -> None:
        """Add a row at the end."""
        [row] = self._made([FormRow()])
        await self.query_one("#plan-rows").mount(row)
        row.agent.focus()
        self._check()

    async def action_remove(self) -> None:
        """Remove the row that has the focus, or else the last row."""
        rows = self._rows
        gone = next((row for row in rows if self.focused in row.walk_children()), None)
        if gone is None and rows:
            gone = rows[-1]
        if gone is not None:
            await gone.remove()
        if left := self._rows:
            left[-1].agent.focus()
        self._check()

    async def action_revert(self) -> None:
        """Restore the proposed plan."""
        self._reason, rows = rows_of(self._proposed)
        listed = self.query_one("#plan-rows")
        await listed.remove_children()
        await listed.mount_all(self._made(rows))
        self._check()

    async def on_button_pressed(self, event: Button.Pressed) -> None:
        """Carry out the button's action."""
        event.stop()
        await self.run_action(event.button.id or "")


def _outlook(row: FormRow, preview: PlanPreview | None) -> Iterator[str]:
    """Yield the arrival time of an asset and its remaining charge."""
    if preview is None:
        yield "it can be carried out"
        return
    line = preview.rehearsal.timeline.assets.get(row.agent)
    arrival_s = preview.arrival_s(row.agent, row.place)
    if row.place and arrival_s is not None:
        yield f"there after {arrival_s:.0f} s"
    if line is not None:
        yield f"battery {line.least_battery_pct:.0f} % left"


class PlanField(TextField):
    """A field for the text of a plan; one key selects the whole text."""

    BINDINGS = [Binding("ctrl+a", "select_all", "Select all", show=False)]


class PlanEditor(ModalScreen["Plan | str | None"]):
    """A plan as JSON; the editor returns the changed plan, OTHER for the form, or None."""

    BINDINGS = [
        Binding("escape", "dismiss", "Back, keep the draft"),
        Binding("ctrl+s,f10", "send", "Submit for checking"),
        Binding("ctrl+r", "revert", "The plan as it was proposed"),
        Binding("f4", "form", "As a form"),
    ]

    def __init__(self, proposed: str, draft: str) -> None:
        """Begin with `draft`; `proposed` is the plan that can be restored at any time."""
        super().__init__()
        self._proposed, self.draft = proposed, draft

    def compose(self) -> ComposeResult:
        """Yield the editor, the verdict on its text, and the buttons."""
        with Vertical(id="editor"):
            yield Static("The changed plan goes through all safeguards again.", id="editor-note")
            yield PlanField(self.draft, id="editor-text", tab_behavior="focus", compact=True)
            yield Static(id="editor-error", markup=False)
            usage = (f"{verb}{' FRAME' * spec.takes_frame}" for verb, spec in COMMANDS.items())
            yield Static(f"commands: {', '.join(usage)}", id="editor-help", markup=False)
            with Horizontal(id="editor-buttons"):
                yield Button("Back (Esc)", id="leave", compact=True)
                yield Button("Send (^S)", id="send", variant="primary", compact=True)

    def on_mount(self) -> None:
        """Focus the text."""
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
            self.dismiss(OTHER)

    def action_revert(self) -> None:
        """Restore the proposed plan; undo brings the typed text back."""
        area = self.query_one(TextArea)
        area.replace(self._proposed, area.document.start, area.document.end)

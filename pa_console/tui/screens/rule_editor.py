"""The rule editor: a rule is checked and tried while it is typed, and saved as a whole."""

import asyncio
from dataclasses import dataclass

from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, VerticalScroll
from textual.content import Content
from textual.screen import Screen
from textual.timer import Timer
from textual.widgets import Static, TextArea

from pa_console.evaluation.rule_trials import Trial, try_rule
from pa_console.policy.authoring.rule_draft import RuleDraft, check_draft
from pa_console.policy.authoring.rule_save import OpenRule, RulesChangedError, save_rule
from pa_console.policy.rule_seal import sign_rules
from pa_console.policy.rulebook import read_rule_set
from pa_console.schema.document import DocumentError
from pa_console.signing import load_signer
from pa_console.tui.rows import row
from pa_console.tui.screens.dialogs import Confirm
from pa_console.tui.screens.rule_rows import Workbench, draft_line, draft_rows
from pa_console.tui.status_words import NOTE, QUIET
from pa_console.tui.terminal import edit_outside, editor_command
from pa_console.tui.widgets.bars import KeyFooter
from pa_console.tui.widgets.fields import TextField
from pa_console.tui.widgets.row_views import TextRows

SETTLE_S = 0.25
"""The pause in typing before the rule is checked, in wall seconds."""


@dataclass(frozen=True)
class CheckedDraft:
    """A draft with its findings on the plans of the session."""

    draft: RuleDraft
    trials: tuple[Trial, ...]


class RuleEditor(Screen[str]):
    """An editor that returns the id of the saved rule; unsaved text is kept as a draft."""

    BINDINGS = [
        Binding("escape", "leave", "Back"),
        Binding("ctrl+s", "save", "Save"),
        Binding("ctrl+o", "outside", "$EDITOR"),
        Binding("ctrl+g", "to_problem", "To the problem"),
        Binding("ctrl+r", "revert", "Discard changes"),
    ]

    HORIZONTAL_BREAKPOINTS = [(0, "-narrow"), (100, "-wide")]

    def __init__(self, bench: Workbench, opened: OpenRule) -> None:
        """Continue the draft of the rule, if there is one."""
        super().__init__()
        self._bench = bench
        self._opened, self._begun = bench.drafts.get(opened.id, (opened, opened.text))
        self._timer: Timer | None = None
        self.checked: CheckedDraft | None = None
        """The result for the current text; None until it is known."""

    def compose(self) -> ComposeResult:
        """Yield the title, the text, the results, the status and the keys."""
        yield Static(id="rule-title", markup=False)
        with Horizontal(id="rule-body"):
            yield TextField(
                self._begun, id="rule-text", tab_behavior="focus", compact=True,
                show_line_numbers=True,
            )  # fmt: skip
            with VerticalScroll(id="rule-results"):
                yield TextRows(id="rule-sheet")
        yield Static(id="rule-status", markup=False)
        yield KeyFooter()

    def on_mount(self) -> None:
        """Focus the text."""
        area = self.query_one(TextArea)
        area.cursor_blink = False
        area.focus()
        self._changed()

    def on_unmount(self) -> None:
        """Write the drafts to disk, even if the latest text was not checked."""
        self._bench.drafts.keep()

    @property
    def text(self) -> str:
        """The rule as it is typed."""
        return self.query_one(TextArea).text

    def on_text_area_changed(self) -> None:
        """Keep the draft, and check it at the next pause in typing."""
        self._changed()

    def _changed(self) -> None:
        self._bench.drafts.note(self._opened, self.text)
        self._title()
        self.checked = None
        waiting = Content.styled("… checking", QUIET)
        self.query_one("#rule-status", Static).update(waiting)
        if self._timer is not None:
            self._timer.stop()
        self._timer = self.set_timer(SETTLE_S, self._check)

    def _title(self) -> None:
        opened, seal = self._opened, self._bench.seal()
        changed = "  ✎ not saved" if opened.id in self._bench.drafts else ""
        place = f"  {opened.path}" + (f":{opened.line}" if opened.line else "")
        self.query_one("#rule-title", Static).update(
            Content.assemble(
                (f"Rule {opened.id or '(new)'}", "bold $text-primary"),
                (changed, NOTE),
                (f"  {seal.words}", QUIET),
                (place, QUIET),
            )
        )

    def _check(self) -> None:
        self._bench.drafts.keep()
        self.run_worker(self._examine(), group="check", exclusive=True)

    async def _examine(self) -> CheckedDraft:
        """Check the text in a thread, and show the result unless the text has changed."""
        text, opened, cases = self.text, self._opened, self._bench.cases.cases()

        def examine() -> CheckedDraft:
            draft = check_draft(text, opened.taken)
            if draft.entry is None:
                return CheckedDraft(draft, ())
            return CheckedDraft(draft, try_rule(draft.entry, cases, self._bench.world, opened.id))

        checked = await asyncio.to_thread(examine)
        if text == self.text:
            self.checked = checked
            self.query_one("#rule-status", Static).update(
                Content.assemble(draft_line(checked.draft))
            )
            rows = tuple(draft_rows(checked.draft, checked.trials))
            rows = rows or (row("", ("examples and plans are tried once it compiles", QUIET)),)
            self.query_one("#rule-sheet", TextRows).show(rows)
        return checked

    def action_to_problem(self) -> None:
        """Move the cursor to the problem."""
        problem = self.checked.draft.problem if self.checked is not None else None
        if problem is not None and problem.line:
            area = self.query_one(TextArea)
            area.move_cursor((problem.line - 1, max(problem.column - 1, 0)), center=True)
            area.focus()

    def action_save(self) -> None:
        """Save the rule, after confirmation if there is a warning."""
        self.run_worker(self._save(), group="save", exclusive=True)

    async def _save(self) -> None:
        checked = await self._examine()
        draft = checked.draft
        if draft.problem is not None:
            self._failed(str(draft.problem))
            self.action_to_problem()
            return
        doubts = [f"{len(draft.wrong)} of its examples are wrong."] if draft.wrong else []
        seal = self._bench.seal()
        if seal.standing in ("known key", "unknown key"):
            doubts.append(
                f"The set is {seal.words}. Saving makes it ALTERED: the old set stays in force "
                f"until you sign the file (pa-console rules sign {self._opened.path}), unless the "
                "console was started with --unsigned."
            )
        if doubts and not await self._asked("\n".join(doubts), "Save"):
            return
        if await self._write(draft.text):
            await self._sign()
            await self._bench.saved()
            self._title()

    async def _write(self, text: str, *, anyway: bool = False) -> bool:
        """Save `text`, and return whether it was saved; ask first if the file has changed."""
        before = self._opened
        try:
            saved = await asyncio.to_thread(save_rule, before, text, anyway=anyway)
        except RulesChangedError as error:
            lost = "The other changes to this rule are then lost. " if error.same_rule else ""
            question = f"{error}.\n{lost}Put this rule alone into the file as it is now?"
            return await self._asked(question, "Save") and await self._write(text, anyway=True)
        except OSError as error:
            self._failed(f"{error.filename or before.path}: {error.strerror or error}")
            return False
        except (DocumentError, ValueError) as error:
            self._failed(str(error))
            return False
        self._bench.drafts.pop(before.id, None)
        self._opened = saved
        if self.text == text != saved.text:
            self.query_one(TextArea).load_text(saved.text)
        self._changed()
        self._bench.drafts.keep()
        self.notify(f"{saved.id} is in {saved.path}", title="Saved", markup=False)
        return True

    async def _sign(self) -> None:
        """If this machine's own key signed the rule set, offer to sign it again."""
        path = self._opened.path
        question = (
            "This machine's key signed the rule set, but the set has changed since. "
            "Sign it as it is now? Otherwise it counts as ALTERED and is refused."
        )
        if self._bench.seal().standing != "own key" or not await self._asked(question, "Sign"):
            return
        try:
            sign_rules(path, read_rule_set(path)[1], load_signer())
        except (DocumentError, ValueError, OSError) as error:
            self._failed(f"not signed: {error}")

    async def _asked(self, question: str, yes: str) -> bool:
        return bool(await self.app.push_screen_wait(Confirm(question, yes=yes, no="Back")))

    def _failed(self, problem: str) -> None:
        message = f"{problem}. The draft is kept."
        self.notify(message, title="Not saved", severity="error", markup=False)

    def action_outside(self) -> None:
        """Edit the rule in the user's own editor."""
        self.run_worker(self._outside(), group="outside", exclusive=True)

    async def _outside(self) -> None:
        question = (
            f"{self._bench.busy()} is active. While your editor has the terminal, you can "
            "neither see nor stop it."
        )
        if self._bench.busy() and not await self._asked(question, "Edit"):
            return
        try:
            text = await edit_outside(self, editor_command(), self.text)
        except ValueError as error:
            self.notify(str(error), title="$EDITOR", severity="error", markup=False)
        else:
            self.query_one(TextArea).text = text

    def action_revert(self) -> None:
        """Restore the text of the file, after confirmation."""
        self.run_worker(self._revert(), group="revert", exclusive=True)

    async def _revert(self) -> None:
        if self.text != self._opened.text and await self._asked("Discard the changes?", "Discard"):
            self.query_one(TextArea).text = self._opened.text

    def action_leave(self) -> None:
        """Go back; the draft is kept."""
        self.dismiss(self._opened.id)

"""The policy browser: every rule, its enforcement and its use; it opens the rule editor."""

import asyncio
from collections.abc import Callable, Coroutine, Sequence
from pathlib import Path

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, VerticalScroll
from textual.content import Content
from textual.screen import Screen
from textual.widgets import Input, OptionList, Select, Static
from textual.widgets.option_list import Option

from pa_console.policy.authoring import rule_save
from pa_console.policy.authoring.rule_save import OpenRule, RulesChangedError
from pa_console.policy.retriever import Retriever
from pa_console.schema.document import DocumentError
from pa_console.schema.rule import PRIORITIES, Rule, RuleHit, approvals_in_words
from pa_console.tui.rows import row
from pa_console.tui.screens.dialogs import Confirm
from pa_console.tui.screens.rule_editor import RuleEditor
from pa_console.tui.screens.rule_rows import (
    Workbench,
    rule_line,
    rule_rows,
    standing_style,
    use_rows,
)
from pa_console.tui.status_words import NOTE, QUIET
from pa_console.tui.surroundings import ShownRules
from pa_console.tui.widgets.bars import KeyFooter
from pa_console.tui.widgets.fields import LineField
from pa_console.tui.widgets.row_views import TextRows
from pa_console.views.rule_trail import uses_of

_DOMAINS = (("ROE  rules of engagement", "ROE"), ("WF  workflow", "WF"), ("CAP  capability", "CAP"))
_MODES = (("checked by code", "checked"), ("judged only", "judged"))


class PolicyScreen(Screen[str]):
    """The list of rules on the left, one whole rule on the right; typing a text scores every rule.

    The result is the id of the mission to show, empty for none.
    """

    BINDINGS = [
        Binding("escape,f6", "dismiss", "Back"),
        Binding("slash", "search", "Search"),
        Binding("e", "edit", "Edit"),
        Binding("n", "new", "New"),
        Binding("delete", "remove", "Remove"),
        Binding("m", "mission", "To its mission"),
        Binding("a", "accept", "Accept the file", show=False),
    ]

    HORIZONTAL_BREAKPOINTS = [(0, "-narrow"), (100, "-wide")]

    def __init__(self, rulebook: ShownRules, retriever: Retriever, bench: Workbench) -> None:
        super().__init__()
        self._rulebook, self._retriever, self._bench = rulebook, retriever, bench
        self._saved = ""
        self._hits: dict[str, RuleHit] = {}
        self._wanted: dict[str, str | None] = dict.fromkeys(
            ("policy-domain", "policy-priority", "policy-mode")
        )

    def compose(self) -> ComposeResult:
        """Yield the search line, the filters, the list and the detail."""
        yield Static("Policies", id="policy-title", markup=False)
        with Horizontal(id="policy-filters"):
            yield LineField(id="policy-search", placeholder="Score the rules against a text")
            yield Select(_DOMAINS, prompt="all domains", compact=True, id="policy-domain")
            yield Select(
                [(name, name) for name in PRIORITIES],
                prompt="all priorities",
                compact=True,
                id="policy-priority",
            )
            yield Select(_MODES, prompt="checked and judged", compact=True, id="policy-mode")
        with Horizontal(id="policy-body"):
            yield OptionList(id="policy-list", markup=False)
            with VerticalScroll(id="policy-detail"):
                yield TextRows(id="policy-sheet")
        yield KeyFooter()

    def on_mount(self) -> None:
        """Show all rules, and focus the search field."""
        self._list()
        self.query_one("#policy-search").focus()

    def use(self, rulebook: ShownRules, retriever: Retriever) -> None:
        """Show another rule set, which is in force now; the pointer stays on its rule."""
        self._rulebook, self._retriever = rulebook, retriever
        text = self.query_one("#policy-search", Input).value.strip()
        self._hits = {hit.rule_id: hit for hit in retriever.score_all(text)} if text else {}
        self._list(self._saved or self._selected)
        self._saved = ""

    @property
    def _selected(self) -> str:
        """The id of the rule at the pointer; empty if no rule is shown."""
        option = self.query_one("#policy-list", OptionList).highlighted_option
        return option.id or "" if option is not None else ""

    @on(Input.Changed, "#policy-search")
    def _search(self, event: Input.Changed) -> None:
        text = event.value.strip()
        hits: Sequence[RuleHit] = self._retriever.score_all(text) if text else ()
        self._hits = {hit.rule_id: hit for hit in hits}
        self._list()

    @on(Input.Submitted, "#policy-search")
    def _to_list(self) -> None:
        self.query_one("#policy-list").focus()

    @on(Select.Changed)
    def _filter(self, event: Select.Changed) -> None:
        value: object = event.value
        self._wanted[event.select.id or ""] = None if value is Select.NULL else str(value)
        self._list()

    def shown(self) -> list[Rule]:
        """Return the rules that pass the filters; during a search, the best score comes first."""
        rules = [
            rule
            for rule in self._rulebook.rules
            if self._wanted["policy-domain"] in (None, rule.domain)
            and self._wanted["policy-priority"] in (None, rule.priority)
            and self._wanted["policy-mode"] in (None, "checked" if rule.decidable else "judged")
        ]
        if self._hits:
            rules.sort(key=lambda rule: -self._score(rule))
        return rules

    def _score(self, rule: Rule) -> float:
        hit = self._hits.get(rule.id)
        return hit.score if hit else 0.0

    def _list(self, at: str = "") -> None:
        rules = self.shown()
        listing = self.query_one("#policy-list", OptionList)
        listing.clear_options()
        listing.add_options(Option(self._line(rule), id=rule.id) for rule in rules)
        if rules:
            listing.highlighted = next((n for n, rule in enumerate(rules) if rule.id == at), 0)
        else:
            self.query_one("#policy-sheet", TextRows).show(
                (row("", "No rules match the filters."),)
            )
        rulebook, asked = self._rulebook, approvals_in_words(self._rulebook.approvals)
        count = sum(rule.decidable for rule in rulebook.rules)
        self.query_one("#policy-title", Static).update(
            Content.assemble(
                ("Policies  ", "bold $text-primary"),
                f"{rulebook.name} {rulebook.seal.title} ",
                (rulebook.seal.words, standing_style(rulebook.seal)),
                *((f"  ▲ {warning}", "bold $text-error") for warning in rulebook.seal.warnings),
                (f"  people: {asked}" if asked else "", NOTE),
                (f"  {len(rules)} of {len(rulebook.rules)}, {count} checked by code", QUIET),
            )
        )

    def _line(self, rule: Rule) -> Content:
        score = self._score(rule) if self._hits else None
        return rule_line(rule, score, draft=rule.id in self._bench.drafts)

    @on(OptionList.OptionHighlighted)
    def _detail(self, event: OptionList.OptionHighlighted) -> None:
        self.show_detail(event.option.id or "")
        self.query_one("#policy-detail", VerticalScroll).scroll_home(animate=False)

    def show_detail(self, rule_id: str = "") -> None:
        """Show a rule, by default the one at the pointer, and its use in the session so far."""
        name = rule_id or self._selected
        for rule in (rule for rule in self._rulebook.rules if rule.id == name):
            uses = uses_of(name, self._bench.missions())
            rows = (*rule_rows(rule, self._hits.get(name)), *use_rows(uses))
            self.query_one("#policy-sheet", TextRows).show(rows)

    @on(OptionList.OptionSelected, "#policy-list")
    def action_edit(self) -> None:
        """Edit the rule at the pointer, or continue its draft."""
        name = self._selected
        if name:
            self._begin(lambda path: self._edit(lambda: rule_save.open_rule(path, name)))

    def action_new(self) -> None:
        """Write a new rule in the domain of the rule at the pointer."""
        domain = self._selected.partition("-")[0] or "ROE"
        self._begin(lambda path: self._edit(lambda: rule_save.new_rule(path, domain)))

    def action_remove(self) -> None:
        """Remove the rule at the pointer, after confirmation."""
        name = self._selected
        if name:
            self._begin(lambda path: self._remove(path, name))

    def action_mission(self) -> None:
        """Go to the trace of the last mission that used the rule at the pointer."""
        uses = uses_of(self._selected, self._bench.missions())
        if uses:
            self.dismiss(uses[-1].mission)
        else:
            self._refused("no mission of this session used this rule")

    def action_accept(self) -> None:
        """Put the refused rules of the file in force, after confirmation."""
        if self._bench.offered():
            self.run_worker(self._accept(), group="edit", exclusive=True)
        else:
            self._refused("no changed rules wait to be accepted")

    async def _accept(self) -> None:
        question = (
            f"The rules in {self._bench.path} were refused: {self._bench.offered()}.\n"
            "Put them in force anyway? The screen, the log and every report will say so."
        )
        if not await self.app.push_screen_wait(Confirm(question, yes="Accept", no="Back")):
            return
        try:
            await self._bench.accept()
        except ValueError as error:
            self._refused(str(error))

    def _begin(self, work: Callable[[Path], Coroutine[None, None, None]]) -> None:
        """Begin a change of the rule file, unless it may not be changed here."""
        path = self._bench.path
        if path is None or self._bench.closed:
            self._refused(self._bench.closed)
        else:
            self.run_worker(work(path), group="edit", exclusive=True)

    async def _edit(self, take: Callable[[], OpenRule]) -> None:
        try:
            opened = await asyncio.to_thread(take)
        except DocumentError as error:
            self._refused(str(error))
            return
        shown = await self.app.push_screen_wait(RuleEditor(self._bench, opened))
        self._saved = shown if shown not in {rule.id for rule in self._rulebook.rules} else ""
        self._list(shown or self._selected)
        self.query_one("#policy-list").focus()

    async def _remove(self, path: Path, name: str) -> None:
        question = f"Remove {name} from {path}?\nMissions that have begun still follow it."
        try:
            opened = await asyncio.to_thread(rule_save.open_rule, path, name)
            if not await self.app.push_screen_wait(Confirm(question, yes="Remove", no="Keep")):
                return
            try:
                await asyncio.to_thread(rule_save.remove_rule, opened)
            except RulesChangedError as error:
                question = f"{error}.\nRemove {name} from the file as it is now?"
                if await self.app.push_screen_wait(Confirm(question, yes="Remove", no="Keep")):
                    await asyncio.to_thread(rule_save.remove_rule, opened, anyway=True)
        except (DocumentError, ValueError, OSError) as error:
            self._refused(str(error))
        else:
            await self._bench.saved()

    def _refused(self, problem: str) -> None:
        self.notify(problem, title="Rules", severity="error", markup=False)

    def action_search(self) -> None:
        """Focus the search field."""
        self.query_one("#policy-search").focus()

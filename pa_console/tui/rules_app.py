"""The half of the app that knows which rules are in force: the browser, the workbench, changes."""

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from pa_console.schema.events import event as ev
from pa_console.schema.rule import Rule, RulesSeal
from pa_console.tui.commanding_app import CommandingApp
from pa_console.tui.kept_input import Drafts
from pa_console.tui.protocols import RuleScorer, ShownRules
from pa_console.tui.rule_rows import Workbench
from pa_console.tui.session_app import SessionApp

if TYPE_CHECKING:
    from pa_console.tui.screens.policies import PolicyScreen

_USES = frozenset(("rules_retrieved", "plan_checked", "workflow_moved"))
_WATCHED = _USES | {"telemetry", "rules_replaced", "noticed"}


class InForce(NamedTuple):
    """A rule set as the console sees it."""

    name: str
    seal: RulesSeal
    rules: tuple[Rule, ...]


class RulesApp(CommandingApp):
    """Follows every change of the rule set, and lends the browser what it needs to edit it."""

    rulebook: ShownRules
    retriever: RuleScorer
    bench: Workbench
    rule_texts: dict[str, Rule]
    """Every rule that was in force in this session, as it is in force now, by id."""

    def open_workbench(self, rules_file: Path | None, drafts: Path | None) -> None:
        """Begin with the rules of `rules_file`; without it, or read-only, none can be edited.

        `drafts` is the folder of what was typed and not saved, None for the user's own.
        """
        self.rule_texts = {rule.id: rule for rule in self.rulebook.rules}
        self._browser: PolicyScreen | None = None
        closed = "the rules are not open for editing here"
        if rules_file is not None and self.readonly:
            closed = "the console is read-only"
        elif rules_file is not None:
            closed = ""
        self.bench = Workbench(
            self.world,
            rules_file,
            closed,
            seal=lambda: self.rulebook.seal,
            missions=lambda: tuple(self.shown_state.missions.values()),
            busy=lambda: self.state.active or "",
            saved=self._reload,
            offered=lambda: self.station.rules_offered if self.station is not None else "",
            accept=self._accept,
            drafts=Drafts(None if closed else rules_file, drafts),
        )

    async def _reload(self) -> None:
        if self.station is not None:
            await self.station.reload_rules()

    async def _accept(self) -> None:
        if self.station is not None:
            await self.station.accept_rules()

    def on_session_app_received(self, message: SessionApp.Received) -> None:
        """Note what concerns the rules once the event is folded."""
        if message.event.data.kind in _WATCHED:
            self.call_later(self._note, message.event)

    def _note(self, event: ev.Event) -> None:
        self.bench.cases.see(event, self.state)
        if event.data.kind in _USES and (browser := self._shown_browser):
            browser.show_detail()
        match event.data:
            case ev.RulesReplaced(rules=name, rules_seal=seal, rule_set=rule_set):
                self.rule_texts.update({rule.id: rule for rule in rule_set.rules})
                self._use(InForce(name, seal, rule_set.rules))
            case ev.Noticed(subject="rules", level=level, text=text):
                self.tell(text, "Rules", bad=level == "alarm")
            case _:
                pass

    def _use(self, taken: InForce) -> None:
        """Show other rules, which the station has indexed."""
        self.rulebook = taken
        if self.station is not None:
            self.retriever = self.station.retriever
        if browser := self._shown_browser:
            browser.use(self.rulebook, self.retriever)

    @property
    def _shown_browser(self) -> "PolicyScreen | None":
        return self._browser if self._browser in self.screen_stack else None

    def action_policies(self) -> None:
        """Show the policy browser."""
        from pa_console.tui.screens.policies import PolicyScreen  # noqa: PLC0415

        def chosen(mission: str | None) -> None:
            if mission and self.shown is not None:
                self.shown.show_mission(self.shown_state, mission)

        self._browser = PolicyScreen(self.rulebook, self.retriever, self.bench)
        self.push_screen(self._browser, chosen)

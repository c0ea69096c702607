"""The controller of the rules in force: policy browser, parts for editing, and rule changes."""

from pathlib import Path
from typing import TYPE_CHECKING

from pa_console.policy.retriever import Retriever
from pa_console.schema.events import event as ev
from pa_console.tui.controllers.console_session import ConsoleSession
from pa_console.tui.kept_input import Drafts
from pa_console.tui.screens.rule_rows import Workbench
from pa_console.tui.surroundings import InForce, ShownRules

if TYPE_CHECKING:
    from pa_console.tui.screens.policies import PolicyScreen

_USES = frozenset(("rules_retrieved", "plan_checked", "workflow_moved"))
_WATCHED = _USES | {"telemetry", "rules_replaced", "noticed"}


class RulesController:
    """The current rule set, and the parts with which the policy browser edits it."""

    def __init__(
        self,
        session: ConsoleSession,
        rulebook: ShownRules,
        retriever: Retriever,
        rules_file: Path | None,
        drafts: Path | None,
    ) -> None:
        """Begin with the rules of `rules_file`; without it, or read-only, they cannot be edited.

        `drafts` is the folder of unsaved drafts, None for the user's own.
        """
        self._session = session
        self.rulebook: ShownRules = rulebook
        self.retriever = retriever
        self.texts = {rule.id: rule for rule in rulebook.rules}
        """Every rule that was in force in this session, in its latest version, by id."""
        self._browser: PolicyScreen | None = None
        closed = "the rules are not open for editing here"
        if rules_file is not None and session.readonly:
            closed = "the console is read-only"
        elif rules_file is not None:
            closed = ""
        self.bench = Workbench(
            session.world,
            rules_file,
            closed,
            seal=lambda: self.rulebook.seal,
            missions=lambda: tuple(session.shown_state.missions.values()),
            busy=lambda: session.state.active or "",
            saved=self._reload,
            offered=lambda: session.station.rules_offered if session.station is not None else "",
            accept=self._accept,
            drafts=Drafts(None if closed else rules_file, drafts),
        )

    async def _reload(self) -> None:
        if self._session.station is not None:
            await self._session.station.reload_rules()

    async def _accept(self) -> None:
        if self._session.station is not None:
            await self._session.station.accept_rules()

    def take(self, event: ev.Event) -> None:
        """Update the rules and their trials from an event that is already in the session state."""
        if event.data.kind not in _WATCHED:
            return
        self.bench.cases.see(event, self._session.state)
        if event.data.kind in _USES and (browser := self._shown_browser):
            browser.show_detail()
        match event.data:
            case ev.RulesReplaced(rules=name, rules_seal=seal, rule_set=rule_set):
                self.texts.update({rule.id: rule for rule in rule_set.rules})
                self._use(InForce(name, seal, rule_set.rules, rule_set.approvals))
            case ev.Noticed(subject="rules", level=level, text=text):
                self._session.tell(text, "Rules", bad=level == "alarm")
            case _:
                pass

    def _use(self, taken: InForce) -> None:
        """Show a new rule set, which the station has already indexed."""
        self.rulebook = taken
        if self._session.station is not None:
            self.retriever = self._session.station.retriever
        if browser := self._shown_browser:
            browser.use(self.rulebook, self.retriever)

    @property
    def _shown_browser(self) -> "PolicyScreen | None":
        return self._browser if self._browser in self._session.app.screen_stack else None

    def browse(self) -> None:
        """Show the policy browser."""
        from pa_console.tui.screens.policies import PolicyScreen  # noqa: PLC0415

        def chosen(mission: str | None) -> None:
            if mission and self._session.shown is not None:
                self._session.shown.show_mission(self._session.shown_state, mission)

        self._browser = PolicyScreen(self.rulebook, self.retriever, self.bench)
        self._session.app.push_screen(self._browser, chosen)

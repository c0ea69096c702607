"""A session for agents, which read it, ask, examine plans, propose missions, and stop.

The owner of the station passes every event to `take`. Nothing here approves, overrides, releases,
edits rules or signs, so an agent cannot do any of these.
"""

from collections.abc import Callable, Sequence

from pydantic import BaseModel, ValidationError

from pa_console.language.references.conversation import Unclear
from pa_console.schema.command import COMMANDS
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Finding
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import Timeline
from pa_console.schema.rule import Rule
from pa_console.schema.telemetry import AssetTelemetry
from pa_console.session.mission_trace import MissionTrace
from pa_console.session.state import SessionState
from pa_console.station.answers.answering import NO_QUESTION
from pa_console.station.station import ControlStation
from pa_console.views.session_views import (
    MissionDetail,
    MissionView,
    StateView,
    mission_detail,
    mission_view,
    state_view,
)

MOST_FOUND = 10
"""The most rules that a search returns."""
Changed = Callable[[str], None]
"""A function that receives the address of each resource that has changed."""
PICTURE, RULES, MISSIONS = "pa://picture", "pa://rules", "pa://missions/"


class AssetView(BaseModel):
    """One asset: its latest report, and the commands that it can carry out."""

    report: AssetTelemetry
    commands: tuple[str, ...]


class ExaminedPlan(BaseModel):
    """The findings on a plan in the present picture, and the result of its rehearsal.

    Nothing was queued. The plan of a mission is examined again before anybody may approve it.
    """

    blocked: bool
    findings: tuple[Finding, ...]
    rehearsal: Timeline | None = None


class FoundRules(BaseModel):
    """The rules in force, ordered by how well they fit the search."""

    rules: tuple[Rule, ...]


class AgentsSession:
    """The session state that the agents of one station share, and the functions open to them."""

    def __init__(self, station: ControlStation) -> None:
        self._station, self.state = station, SessionState()
        self.changed: Changed = lambda _address: None
        self._events = 0

    def take(self, event: ev.Event) -> None:
        """Process one event of the session, which the log has."""
        self.state.apply(event)
        self._events += not event.data.transient
        if isinstance(event.data, ev.TelemetryReceived):
            self.changed(PICTURE)
        elif isinstance(event.data, ev.RulesReplaced):
            self.changed(RULES)
        elif event.mission is not None and not event.data.transient:
            self.changed(MISSIONS + event.mission)

    def picture(self) -> StateView:
        """Return the present state of the session: picture, alarms, queue, stop."""
        return state_view(self.state, self._events)

    def describe_asset(self, name: str) -> AssetView:
        """Return an asset's report and commands; raises ValueError for an unknown name."""
        picture = self.state.picture
        assets = picture.assets if picture is not None else {}
        if name not in assets:
            raise ValueError(f"there is no asset {name!r}; known: {', '.join(assets) or 'none'}")
        report = assets[name]
        may = tuple(verb for verb, spec in COMMANDS.items() if report.kind in spec.kinds)
        return AssetView(report=report, commands=may)

    def rules(self, search: str = "", rule_id: str = "") -> FoundRules:
        """Return the rules in force: one by its id, those that match a text, or all.

        Raises ValueError for an unknown id.
        """
        book = self._station.rulebook
        if rule_id:
            matches = tuple(rule for rule in book.rules if rule.id == rule_id)
            if not matches:
                ids = ", ".join(rule.id for rule in book.rules)
                raise ValueError(f"there is no rule {rule_id!r}; known: {ids}")
            return FoundRules(rules=matches)
        if not search.strip():
            return FoundRules(rules=book.rules)
        hits = self._station.retriever.retrieve(search, MOST_FOUND)
        best = sorted(hits, key=lambda hit: -hit.score)[:MOST_FOUND]
        return FoundRules(rules=tuple(book.get(hit.rule_id) for hit in best))

    async def ask(self, text: str) -> ev.QuestionAnswered:
        """Answer a question from the record; raises ValueError for any other text."""
        question = self._station.question_in(text)
        if question is None:
            raise ValueError(NO_QUESTION)
        return await self._station.answer(question)

    async def examine(
        self, actions: Sequence[Action], purpose: str, *, rehearsed: bool
    ) -> ExaminedPlan:
        """Check a plan in the present picture; with `rehearsed`, return its rehearsal as well."""
        examination = await self._station.examine(_plan("", actions), purpose)
        shown = (
            examination.rehearsal.timeline
            if rehearsed and examination.rehearsal is not None
            else None
        )
        return ExaminedPlan(
            blocked=examination.blocked, findings=examination.findings, rehearsal=shown
        )

    def unclear(self, text: str) -> Unclear | None:
        """Return the unclear part of a text and its answers; None if the text is clear."""
        return self._station.proposals.unclear(text)

    def propose(
        self, agent: str, text: str, actions: Sequence[Action] = (), reason: str = ""
    ) -> MissionView:
        """Queue a mission that an agent proposes; raises ValueError if it is not accepted."""
        plan = _plan(reason, actions) if actions else None
        return mission_view(self._trace(self._station.proposals.propose(agent, text, plan)))

    def status(self, mission_id: str) -> MissionDetail:
        """Return a mission with its plans, findings, decisions and outcome.

        Raises ValueError for an unknown id.
        """
        trace = self.state.missions.get(mission_id)
        if trace is None:
            recent = ", ".join(list(self.state.missions)[-8:]) or "none"
            raise ValueError(f"there is no mission {mission_id!r}; the latest: {recent}")
        return mission_detail(trace)

    def withdraw(self, agent: str, mission_id: str) -> None:
        """Withdraw an agent's own proposal; raises ValueError for any other mission."""
        self._station.proposals.withdraw(agent, mission_id)

    def stop(self, agent: str) -> None:
        """Stop all assets; an agent cannot release the stop."""
        self._station.stop_all(f"agent {agent}")

    def _trace(self, mission: Mission) -> MissionTrace:
        return self.state.missions.get(mission.id) or MissionTrace(mission)


def _plan(reason: str, actions: Sequence[Action]) -> Plan:
    """Return the plan of these actions; raises ValueError with one line if it is invalid."""
    try:
        return Plan(reason=reason, actions=tuple(actions))
    except ValidationError as error:
        raise ValueError(error.errors()[0]["msg"].removeprefix("Value error, ")) from None

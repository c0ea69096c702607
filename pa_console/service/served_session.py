"""A session as its clients use it: read, given missions, decided about and stopped.

Whoever owns the station gives every event to `take`; commands go to the station, which checks, logs
and gates them as it does those of the console.
"""

import asyncio
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

from pydantic import ValidationError

from pa_console.orchestrator.planning.approval import inadmissible
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision, Mission
from pa_console.schema.plan import Plan
from pa_console.service.event_feed import EventFeed
from pa_console.service.problems import ProblemError
from pa_console.service.tokens import Bearer
from pa_console.service.views import DecisionBody, DecisionView, plan_of, shown_sha256
from pa_console.session.state.fold import SessionState
from pa_console.session.state.mission_trace import MissionTrace

ANSWERED_S = 10.0
"""So long a decision waits to hear whether it was accepted."""
SEE_PLANS = "read /v1/plans and decide about what waits there now"


class Commanded(Protocol):
    """A station, as far as clients command it."""

    @property
    def rulebook(self) -> Rulebook:
        """The rules in force."""
        ...

    @property
    def stopped(self) -> bool:
        """Whether everything is stopped."""
        ...

    @property
    def worked_on(self) -> str:
        """The id of the mission that is being worked on, '' for none."""
        ...

    def submit(self, text: str) -> Mission:
        """Queue a mission; raises ValueError when it cannot be taken."""
        ...

    def decide(self, decision: Decision) -> None:
        """Answer the plan that waits; raises ValueError when none does."""
        ...

    def cancel(self) -> None:
        """Cancel the mission that is worked on; raises ValueError when none is."""
        ...

    def withdraw(self, mission_id: str) -> None:
        """Take a waiting mission out of the queue; raises ValueError when it does not wait."""
        ...

    def stop_all(self, by: str) -> None:
        """Make every asset hold until `release`."""
        ...

    def release(self, by: str) -> None:
        """Release the stop; raises ValueError when nothing is stopped."""
        ...


class ServedSession:
    """What the clients of one station share: its state, its events, and its commands."""

    def __init__(
        self,
        station: Commanded,
        state: SessionState,
        log: Callable[[], Path | None],
        *,
        told: int = 0,
        signer: str = "",
    ) -> None:
        """`state` is folded by its owner; the `log` of the session has `told` events so far.

        `signer` is the person whose key signs approvals at this station, '' where a site has no
        keys: nobody else is made to have approved anything.
        """
        self.station, self._signer = station, signer
        self.state = state
        self.feed = EventFeed(log, told)
        self._asked: dict[str, asyncio.Future[ev.DecisionMade]] = {}

    def take(self, event: ev.Event) -> None:
        """Take in one event of the session, which the state has."""
        self.feed.put(event)
        if isinstance(event.data, ev.DecisionMade):
            waits = self._asked.pop(event.data.decision.request_id, None)
            if waits is not None and not waits.done():
                waits.set_result(event.data)

    def end(self) -> None:
        """Let every client know that the session is over."""
        self.feed.end()
        for waits in self._asked.values():
            waits.cancel()

    @property
    def waiting(self) -> tuple[MissionTrace, ev.ApprovalRequested] | None:
        """The plan that waits for a decision, and its mission."""
        trace = self.state.current
        return (trace, trace.approval) if trace is not None and trace.approval else None

    def mission(self, name: str) -> MissionTrace:
        """Return the mission with the id `name`; raises ProblemError for none."""
        found = self.state.missions.get(name)
        if found is None:
            raise ProblemError(
                404, "no-such-mission", f"there is no mission {name!r}", field="id",
                remedy="GET /v1/missions lists them",
            )  # fmt: skip
        return found

    def submit(self, text: str) -> MissionTrace:
        """Queue a mission and return it as it stands then."""
        with _refused("mission-not-taken", "text"):
            mission = self.station.submit(text)
        return self.state.missions.get(mission.id) or MissionTrace(mission)

    async def decide(self, bearer: Bearer, body: DecisionBody) -> DecisionView:
        """Decide in the bearer's name about the plan that was shown, and no other."""
        request = self._shown(body)
        if body.kind == "approve" and self._signer and bearer.person != self._signer:
            raise ProblemError(
                403, "not-the-signer",
                f"approvals are signed here with the key of {self._signer}, not of {bearer.person}",
                remedy=f"let {self._signer} approve, or approve at your own station",
            )  # fmt: skip
        decision = Decision(
            kind=body.kind,
            request_id=request.request_id,
            by=bearer.person,
            reason=body.reason,
            override_judge=body.override_judge,
            acknowledged=body.acknowledged,
            plan=_plan(body),
            asked=body.asked,
        )
        if problem := inadmissible(request, decision):
            raise ProblemError(409, "not-admissible", problem, field="kind")
        waits = asyncio.get_running_loop().create_future()
        with _refused("decision-not-taken", "request_id"):
            self.station.decide(decision)
        self._asked[request.request_id] = waits
        await asyncio.wait((waits,), timeout=ANSWERED_S)
        self._asked.pop(request.request_id, None)
        if not waits.done() or waits.cancelled():
            detail = "the decision was given, and nothing was heard of it; see /v1/events"
            return DecisionView(accepted=False, detail=detail, by=bearer.person)
        made = waits.result()
        return DecisionView(accepted=made.accepted, detail=made.detail, by=made.decision.by)

    def cancel(self, name: str) -> None:
        """Cancel the mission with the id `name`, or take it out of the queue."""
        self.mission(name)
        with _refused("not-cancelled", "id"):
            if self.station.worked_on == name:
                self.station.cancel()
            else:
                self.station.withdraw(name)

    def stop_all(self, bearer: Bearer) -> None:
        """Make every asset hold, in the bearer's name."""
        with _refused("not-stopped", ""):
            self.station.stop_all(bearer.person)

    def release(self, bearer: Bearer) -> None:
        """Release the stop, in the bearer's name."""
        with _refused("not-released", ""):
            self.station.release(bearer.person)

    def _shown(self, body: DecisionBody) -> ev.ApprovalRequested:
        """Return the request that waits, if it is the one that was shown."""
        waiting = self.waiting
        if waiting is None:
            raise ProblemError(409, "no-plan-waits", "no plan waits for a decision",
                               field="request_id", remedy=SEE_PLANS)  # fmt: skip
        request = waiting[1]
        if request.request_id != body.request_id:
            raise ProblemError(
                409, "stale-plan",
                f"the plan {body.request_id!r} does not wait any more; {request.request_id!r} does",
                field="request_id", remedy=SEE_PLANS,
            )  # fmt: skip
        if shown_sha256(request) != body.shown_sha256:
            raise ProblemError(
                409, "not-what-was-shown", "the plan that waits is not the one with that SHA-256",
                field="shown_sha256", remedy=SEE_PLANS,
            )  # fmt: skip
        return request


def _plan(body: DecisionBody) -> Plan | None:
    if body.kind != "modify":
        return None
    if body.actions is None:
        raise ProblemError(
            422, "not-valid", "modify needs the whole plan", field="actions",
            remedy='for example [{"agent": "Drone_T04", "command": "move_to EastGate"}]',
        )  # fmt: skip
    try:
        return plan_of(body.actions, body.reason)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise ProblemError(
            422, "not-valid", first["msg"].removeprefix("Value error, "), field="actions",
            remedy="the page on missions lists the commands",
        ) from error  # fmt: skip


@contextmanager
def _refused(kind: str, field: str) -> Generator[None]:
    """Word what the station refuses as a problem of the request."""
    try:
        yield
    except ValueError as error:
        raise ProblemError(409, kind, str(error), field=field) from error

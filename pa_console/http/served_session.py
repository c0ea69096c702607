"""A session as its clients use it: read, given missions, decided about and stopped.

The owner of the station gives every event to `take`; commands go to the station, which checks, logs
and gates them as it does those of the console. A second person signs the plan that waits with an
own key that this machine never sees.
"""

import asyncio
from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

from pydantic import ValidationError

from pa_console.fleets.authorization import RefusedError, UnsignedApproval
from pa_console.fleets.fleet import Countersigned
from pa_console.fleets.station_authority import StationAuthority
from pa_console.http.event_feed import EventFeed
from pa_console.http.guard import ProblemError
from pa_console.http.tokens import Bearer
from pa_console.http.views import (
    DecisionBody,
    DecisionView,
    SignatureBody,
    ToSignView,
    plan_of,
    shown_sha256,
    to_sign_view,
)
from pa_console.language.questions import Question
from pa_console.mission.approval import inadmissible
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.events import event as ev
from pa_console.schema.events.event import ApprovalRequested, DecisionMade
from pa_console.schema.mission import ELSEWHERE, Decision, Mission
from pa_console.schema.plan import Plan
from pa_console.session.mission_trace import MissionTrace
from pa_console.session.state import SessionState
from pa_console.station.answering import IS_QUESTION, NO_QUESTION


class Countersigning:
    """Prepares what a second person signs of a plan, and takes that signature in."""

    def __init__(self, authority: StationAuthority | None) -> None:
        """`authority` has the keys of the station, None where its site has none."""
        self._authority = authority

    def to_sign(self, request: ApprovalRequested, rules: Rulebook, person: str) -> UnsignedApproval:
        """Return what `person` is to sign of `request`; raises ProblemError for nothing."""
        authority = self._keys_for(request)
        try:
            authority.trust.approver(person)
        except RefusedError as refused:
            raise _may_not_sign(403, "may-not-sign", str(refused), "person") from refused
        return authority.to_sign(request, rules, person)

    def take(
        self,
        request: ApprovalRequested,
        rules: Rulebook,
        given: Countersigned,
        made: Iterable[DecisionMade],
    ) -> None:
        """Take in what a person has `given` for `request`; raises ProblemError if it is no more.

        `made` are the decisions of its mission so far.
        """
        authority, person = self._keys_for(request), given.person
        if why := authority.objection_to_signature(request, rules, person, given.signature):
            raise _may_not_sign(403, "signature-refused", why, "signed")
        if person == authority.person:
            raise ProblemError(
                409, "decides-here", f"{person} sits at this station and decides there",
                field="person", remedy="POST /v1/decisions",
            )  # fmt: skip
        before = _signatures(request, made)
        both = Decision(kind="approve", signatures={**before, person: given.signature})
        if person in before or person not in authority.valid(request, both, rules):
            raise ProblemError(
                409, "signed-already", f"this plan has the signature with the key of {person}",
                field="person", remedy="let somebody else sign",
            )  # fmt: skip

    def _keys_for(self, request: ApprovalRequested) -> StationAuthority:
        """Return the keys of the station if `request` is for others to sign, too."""
        if self._authority is None:
            raise ProblemError(
                409, "no-keys", "this site has no keys, so nobody can be the second person",
                remedy="pa-console keys make",
            )  # fmt: skip
        if request.blocked_by:
            raise ProblemError(409, "not-admissible", "; ".join(request.blocked_by))
        if not request.approvals:
            raise ProblemError(
                409, "one-is-enough", f"one person is enough, who is {self._authority.person}",
                remedy="POST /v1/decisions",
            )  # fmt: skip
        return self._authority


def _signatures(request: ApprovalRequested, made: Iterable[DecisionMade]) -> dict[str, str]:
    """Return what has been signed of `request` so far, by name."""
    now = [each.decision for each in made if each.attempt == request.attempt]
    return {name: text for decision in now for name, text in decision.signatures.items()}


def _may_not_sign(status: int, kind: str, why: str, field: str) -> ProblemError:
    return ProblemError(status, kind, why, field=field, remedy="pa-console keys list says who may")


ANSWERED_S = 10.0
"""The longest wait for the result of a decision, seconds."""
SEE_PLANS = "read /v1/plans and decide about what waits there now"


class Commanded(Protocol):
    """A station, as far as clients command it."""

    @property
    def rulebook(self) -> Rulebook:
        """The rules in force."""
        ...

    @property
    def stopped(self) -> bool:
        """True while everything is stopped."""
        ...

    @property
    def worked_on(self) -> str:
        """The id of the mission that is being worked on, '' for none."""
        ...

    def submit(self, text: str) -> Mission:
        """Queue a mission; raises ValueError when it cannot be taken."""
        ...

    def question_in(self, text: str) -> Question | None:
        """Return the question about the record in `text`; None for any other text."""
        ...

    async def answer(self, question: Question) -> ev.QuestionAnswered:
        """Answer a question; nothing is decided by that, and nobody moves."""
        ...

    def decide(self, decision: Decision) -> None:
        """Answer the plan that waits; raises ValueError when none does."""
        ...

    def countersign(self, signed: Countersigned) -> None:
        """Take in what a second person has signed; raises ValueError when that cannot be."""
        ...

    def acknowledge(self, alarm_id: str, by: str) -> None:
        """Note that an alarm was seen; raises ValueError when it is not open."""
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
        authority: StationAuthority | None = None,
    ) -> None:
        """`state` is folded by its owner; the `log` of the session has `told` events so far.

        `authority` has the keys with which this station and the person at it sign, None where a
        site has none: nobody else is made to have approved anything.
        """
        self.station, self._countersigning = station, Countersigning(authority)
        self._authority = authority
        self.state = state
        self.feed = EventFeed(log, told)
        self._asked: dict[tuple[str, str], asyncio.Future[ev.DecisionMade]] = {}
        """The clients waiting for a decision, by its request and person."""
        self._answering = asyncio.Lock()

    def take(self, event: ev.Event) -> None:
        """Take in one event of the session, which the state has."""
        self.feed.put(event)
        if isinstance(event.data, ev.DecisionMade):
            decision = event.data.decision
            last = decision.by.rpartition(", ")[2]
            waits = self._asked.pop((decision.request_id, last), None)
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

    async def answer(self, text: str) -> ev.QuestionAnswered:
        """Answer a question, one at a time; raises ProblemError for a text that is none."""
        question = self.station.question_in(text)
        if question is None:
            raise ProblemError(
                422, "not-a-question", NO_QUESTION, field="text",
                remedy="ask one of these; a mission goes to POST /v1/missions",
            )  # fmt: skip
        async with self._answering:
            return await self.station.answer(question)

    def submit(self, text: str) -> MissionTrace:
        """Queue a mission and return it as it stands then; a question is none."""
        if self.station.question_in(text) is not None:
            raise ProblemError(409, "mission-not-taken", IS_QUESTION, field="text",
                               remedy="POST /v1/questions answers it")  # fmt: skip
        with _refused("mission-not-taken", "text"):
            mission = self.station.submit(text)
        return self.state.missions.get(mission.id) or MissionTrace(mission)

    async def decide(self, bearer: Bearer, body: DecisionBody) -> DecisionView:
        """Decide in the bearer's name about the plan that was shown, and no other."""
        request = self._shown(body)
        signer = self._authority.person if self._authority is not None else ""
        if body.kind == "approve" and signer and bearer.person != signer:
            raise ProblemError(
                403, "not-the-signer",
                f"approvals are signed here with the key of {signer}, not of {bearer.person}",
                remedy=f"let {signer} approve, or sign with your own key where a plan takes two: "
                "POST /v1/plans/ID/signatures",
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
        with _refused("decision-not-taken", "request_id"):
            self.station.decide(decision)
        return await self._heard_of(request, bearer.person)

    def to_sign(self, request_id: str, person: str) -> ToSignView:
        """Return what `person` is to sign of the plan that waits as `request_id`."""
        _, request = self._waits(request_id)
        unsigned = self._countersigning.to_sign(request, self.station.rulebook, person)
        name = self._authority.name if self._authority is not None else ""
        return to_sign_view(name, request, unsigned)

    async def countersign(self, request_id: str, body: SignatureBody) -> DecisionView:
        """Take in what a second person has signed of the plan that waits as `request_id`.

        Whoever brings it, it counts for the person whose key has made it.
        """
        trace, request = self._waits(request_id)
        given = Countersigned(request.request_id, body.person, body.signed)
        self._countersigning.take(request, self.station.rulebook, given, trace.decisions)
        with _refused("signature-not-taken", "signed"):
            self.station.countersign(given)
        return await self._heard_of(request, f"{body.person} {ELSEWHERE}")

    async def _heard_of(self, request: ev.ApprovalRequested, by: str) -> DecisionView:
        """Wait until the session emits the result of the decision that was given just now."""
        waits = asyncio.get_running_loop().create_future()
        asked = request.request_id, by
        self._asked[asked] = waits
        await asyncio.wait((waits,), timeout=ANSWERED_S)
        self._asked.pop(asked, None)
        if not waits.done() or waits.cancelled():
            detail = "the decision was given, and nothing was heard of it; see /v1/events"
            return DecisionView(accepted=False, detail=detail, by=by)
        made = waits.result()
        return DecisionView(accepted=made.accepted, detail=made.detail, by=made.decision.by)

    def acknowledge(self, bearer: Bearer, alarm_id: str) -> None:
        """Note that the bearer has seen an open alarm."""
        if all(item.alarm.id != alarm_id for item in self.state.alarms):
            known = ", ".join(item.alarm.id for item in self.state.alarms) or "none"
            raise ProblemError(
                404, "no-such-alarm", f"no alarm {alarm_id!r} is open; open: {known}", field="id",
                remedy="GET /v1/state lists them",
            )  # fmt: skip
        with _refused("not-acknowledged", "id"):
            self.station.acknowledge(alarm_id, bearer.person)

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
        """Return the waiting request, if it is the one that was shown."""
        _, request = self._waits(body.request_id)
        if shown_sha256(request) != body.shown_sha256:
            raise ProblemError(
                409, "not-what-was-shown", "the plan that waits is not the one with that SHA-256",
                field="shown_sha256", remedy=SEE_PLANS,
            )  # fmt: skip
        return request

    def _waits(self, request_id: str) -> tuple[MissionTrace, ev.ApprovalRequested]:
        """Return the request that waits, and its mission, if it is the one of that id."""
        waiting = self.waiting
        if waiting is None:
            raise ProblemError(409, "no-plan-waits", "no plan waits for a decision",
                               field="request_id", remedy=SEE_PLANS)  # fmt: skip
        if (there := waiting[1].request_id) != request_id:
            raise ProblemError(
                409, "stale-plan",
                f"the plan {request_id!r} does not wait any more; {there!r} does",
                field="request_id", remedy=SEE_PLANS,
            )  # fmt: skip
        return waiting


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

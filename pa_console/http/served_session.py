"""A session for its clients, who read and follow it, give missions, decide and stop.

The owner of the station passes every event to `take`. Commands go to the station, which checks,
logs and gates them like those of the console. A second person signs the waiting plan with a key
that this machine never receives.
"""

import asyncio
from collections import deque
from collections.abc import AsyncGenerator, Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from itertools import chain, islice
from pathlib import Path
from typing import NamedTuple

from pydantic import ValidationError

from pa_console.fleets.authorization import RefusedError
from pa_console.fleets.fleet import PlanCountersignature
from pa_console.fleets.station_authority import StationAuthority
from pa_console.http.bodies import (
    DecisionBody,
    DecisionView,
    SignatureBody,
    ToSignView,
    plan_of,
    to_sign_view,
)
from pa_console.http.guard import ProblemError
from pa_console.http.tokens import Bearer
from pa_console.language.orders.order_changes import Change
from pa_console.mission.approval import inadmissible
from pa_console.schema.events import event as ev
from pa_console.schema.events.event import Event
from pa_console.schema.mission import ELSEWHERE, Decision
from pa_console.schema.plan import Plan
from pa_console.session.log.chain import read_log
from pa_console.session.mission_trace import MissionTrace
from pa_console.session.state import SessionState
from pa_console.session.stills import read_still
from pa_console.station.answers.answering import IS_QUESTION, NO_QUESTION
from pa_console.station.station import ControlStation
from pa_console.views.session_views import shown_sha256

KEPT = 1000
"""The number of recent events kept in memory; older ones are read from the log."""
PIECE = 200
"""The number of events read from the log at a time; events not written yet are in memory."""
SILENT_S = 15.0
"""The silence after which a reader gets a sign of life from the session, in seconds."""
ANSWERED_S = 10.0
"""The longest wait for the result of a decision, in seconds."""
SEE_PLANS = "read /v1/plans and decide on the plan that waits now"


class NumberedEvent(NamedTuple):
    """An event with its number among the logged ones, from 1."""

    number: int
    event: Event


class EventFeed:
    """The logged events of a session, added with `put`, for the readers that `follow`.

    Transient events are left out. A slow reader delays nothing: it continues from the log.
    """

    def __init__(self, log: Callable[[], Path | None], number: int = 0) -> None:
        """Continue after `number` events; `log` returns the path of their log, if any."""
        self._log, self.number = log, number
        self._last: deque[Event] = deque(maxlen=KEPT)
        self._changed = asyncio.Event()
        self._ended = False

    def put(self, event: Event) -> None:
        """Add an event that the log has; a transient one is ignored."""
        if event.data.transient:
            return
        self.number += 1
        self._last.append(event)
        self._wake()

    def end(self) -> None:
        """End every reader after it has read all events."""
        self._ended = True
        self._wake()

    async def follow(self, after: int) -> AsyncGenerator[NumberedEvent | None]:
        """Yield every event after the number `after`, and None if SILENT_S passes without one.

        Raises LogError if the log, which has the older events, cannot be read.
        """
        number = min(after, self.number)
        while True:
            gone = self.number - len(self._last)
            if number < gone:
                async for item in self._from_log(number, gone):
                    yield item
                number = gone
                continue
            for event in list(islice(self._last, number - gone, None)):
                number += 1
                yield NumberedEvent(number, event)
            if number < self.number:
                continue
            if self._ended:
                return
            try:
                await asyncio.wait_for(self._changed.wait(), SILENT_S)
            except TimeoutError:
                yield None

    def _wake(self) -> None:
        self._changed.set()
        self._changed = asyncio.Event()

    async def _from_log(self, after: int, until: int) -> AsyncGenerator[NumberedEvent]:
        """Yield the logged events after the number `after`, up to and including `until`."""
        path = self._log()
        if path is None:
            return
        records = enumerate(read_log(path), start=1)
        wanted = (NumberedEvent(number, event) for number, event in records if number > after)
        while piece := await asyncio.to_thread(_some, wanted):
            for item in piece:
                if item.number > until:
                    return
                yield item


def _some(items: Iterator[NumberedEvent]) -> list[NumberedEvent]:
    return list(islice(items, PIECE))


def _may_not_sign(kind: str, why: str, field: str) -> ProblemError:
    return ProblemError(403, kind, why, field=field, remedy="pa-console keys list says who may")


class ServedSession:
    """The state, the events and the commands that the clients of one station share."""

    def __init__(
        self,
        station: ControlStation,
        state: SessionState,
        log: Callable[[], Path | None],
        *,
        told: int = 0,
        authority: StationAuthority | None = None,
    ) -> None:
        """Use `state`, which its owner updates; the session's `log` has `told` events so far.

        `authority` has the keys of this station and of the person at it, None for a site without
        keys. No approval is signed in the name of anybody else.
        """
        self.station, self._authority = station, authority
        self.state = state
        self.feed, self._log = EventFeed(log, told), log
        self._asked: dict[tuple[str, str], asyncio.Future[ev.DecisionMade]] = {}
        """The clients that wait for the result of a decision, by its request and person."""
        self._answering = asyncio.Lock()

    def take(self, event: ev.Event) -> None:
        """Process one event of the session, which the state already has."""
        self.feed.put(event)
        if isinstance(event.data, ev.DecisionMade):
            decision = event.data.decision
            last = decision.by.rpartition(", ")[2]
            waits = self._asked.pop((decision.request_id, last), None)
            if waits is not None and not waits.done():
                waits.set_result(event.data)

    def end(self) -> None:
        """End the event streams and the waits of all clients, because the session is over."""
        self.feed.end()
        for waits in self._asked.values():
            waits.cancel()

    @property
    def waiting(self) -> tuple[MissionTrace, ev.ApprovalRequested] | None:
        """The mission and the request of the plan that waits for a decision; None if none waits."""
        trace = self.state.current
        return (trace, trace.approval) if trace is not None and trace.approval else None

    def mission(self, name: str) -> MissionTrace:
        """Return the mission with the id `name`; raises ProblemError if there is none."""
        trace = self.state.missions.get(name)
        if trace is None:
            raise ProblemError(
                404, "no-such-mission", f"there is no mission {name!r}", field="id",
                remedy="GET /v1/missions lists them",
            )  # fmt: skip
        return trace

    async def answer(self, text: str) -> ev.QuestionAnswered:
        """Answer a question, one at a time; raises ProblemError for any other text."""
        question = self.station.question_in(text)
        if question is None:
            raise ProblemError(
                422, "not-a-question", NO_QUESTION, field="text",
                remedy="ask one of these; a mission goes to POST /v1/missions",
            )  # fmt: skip
        async with self._answering:
            return await self.station.answer(question)

    async def still_of(self, track: str) -> ev.CameraStill:
        """Take a still of a track; raises ProblemError if that is not possible."""
        picture = self.state.picture
        if picture is None or track not in picture.tracks:
            raise ProblemError(404, "no-such-track", f"there is no track {track!r}", field="id",
                               remedy="GET /v1/state lists them")  # fmt: skip
        still = await self.station.still_of(track)
        if still is None or still.problem:
            why = "no camera has it in view" if still is None else still.problem
            raise ProblemError(409, "no-picture", why, field="id")
        return still

    def file_of(self, still: ev.CameraStill) -> bytes:
        """Return the file of a still that was shown; raises ProblemError if it is not kept."""
        content = read_still(self._log(), still)
        if content is None:
            raise ProblemError(404, "no-such-picture", "no such still is kept beside the log",
                               remedy="GET /v1/tracks/ID/still takes one")  # fmt: skip
        return content

    def still(self, sha256: str) -> ev.CameraStill:
        """Return the still with this SHA-256 that was shown lately, or with a plan.

        Raises ProblemError if there is none.
        """
        shown = (still for trace in self.state.missions.values() for still in trace.stills.values())
        for still in chain(self.state.stills.values(), shown):
            if still.sha256 == sha256:
                return still
        raise ProblemError(404, "no-such-picture", "no such still was shown in this session",
                           field="sha256", remedy="GET /v1/tracks/ID/still takes one")  # fmt: skip

    def submit(self, text: str) -> MissionTrace:
        """Queue a mission and return its trace; raises ProblemError if it is not accepted."""
        if self.station.question_in(text) is not None:
            raise ProblemError(409, "mission-not-taken", IS_QUESTION, field="text",
                               remedy="POST /v1/questions answers it")  # fmt: skip
        with _refused("mission-not-taken", "text"):
            mission = self.station.submit(text)
        return self.state.missions.get(mission.id) or MissionTrace(mission)

    async def decide(self, bearer: Bearer, body: DecisionBody) -> DecisionView:
        """Decide in the bearer's name on the plan that was shown, and on no other."""
        request = self._shown(body)
        signer = self._authority.person if self._authority is not None else ""
        if body.kind == "approve" and signer and bearer.person != signer:
            raise ProblemError(
                403, "not-the-signer",
                f"approvals are signed here with the key of {signer}, not of {bearer.person}",
                remedy=f"let {signer} approve, or sign with your own key if a plan needs two: "
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
        """Return the text that `person` signs for the waiting plan of `request_id`."""
        _, request = self._waits(request_id)
        authority = self._keys_for(request)
        try:
            authority.trust.approver(person)
        except RefusedError as refused:
            raise _may_not_sign("may-not-sign", str(refused), "person") from refused
        unsigned = authority.to_sign(request, self.station.rulebook, person)
        return to_sign_view(authority.name, request, unsigned)

    async def countersign(self, request_id: str, body: SignatureBody) -> DecisionView:
        """Accept a second person's signature on the waiting plan of `request_id`.

        It counts for the person whose key made it, no matter who submits it.
        """
        trace, request = self._waits(request_id)
        given = PlanCountersignature(request.request_id, body.person, body.signed)
        self._check_signature(request, given, trace.decisions)
        with _refused("signature-not-taken", "signed"):
            self.station.countersign(given)
        return await self._heard_of(request, f"{body.person} {ELSEWHERE}")

    def _check_signature(
        self,
        request: ev.ApprovalRequested,
        given: PlanCountersignature,
        made: Iterable[ev.DecisionMade],
    ) -> None:
        """Raise ProblemError unless the signature `given` counts for `request`.

        `made` are the decisions of its mission so far.
        """
        authority, person, rules = self._keys_for(request), given.person, self.station.rulebook
        if why := authority.objection_to_signature(request, rules, person, given.signature):
            raise _may_not_sign("signature-refused", why, "signed")
        if person == authority.person:
            raise ProblemError(
                409, "decides-here", f"{person} sits at this station and decides there",
                field="person", remedy="POST /v1/decisions",
            )  # fmt: skip
        decided = (each.decision for each in made if each.attempt == request.attempt)
        before = {name: text for given in decided for name, text in given.signatures.items()}
        both = Decision(kind="approve", signatures={**before, person: given.signature})
        if person in before or person not in authority.valid(request, both, rules):
            raise ProblemError(
                409, "signed-already", f"this plan is already signed with the key of {person}",
                field="person", remedy="let another person sign",
            )  # fmt: skip

    def _keys_for(self, request: ev.ApprovalRequested) -> StationAuthority:
        """Return the station's keys; raises ProblemError unless `request` needs a second person."""
        if self._authority is None:
            raise ProblemError(
                409, "no-keys", "this site has no keys, so no second person can sign",
                remedy="pa-console keys make",
            )  # fmt: skip
        if request.blocked_by:
            raise ProblemError(409, "not-admissible", "; ".join(request.blocked_by))
        if not request.approvals:
            raise ProblemError(
                409, "one-is-enough", f"the approval of {self._authority.person} is enough",
                remedy="POST /v1/decisions",
            )  # fmt: skip
        return self._authority

    async def _heard_of(self, request: ev.ApprovalRequested, by: str) -> DecisionView:
        """Wait until the session emits the result of the decision just made."""
        waits = asyncio.get_running_loop().create_future()
        asked = request.request_id, by
        self._asked[asked] = waits
        await asyncio.wait((waits,), timeout=ANSWERED_S)
        self._asked.pop(asked, None)
        if not waits.done() or waits.cancelled():
            detail = "the decision was sent, but has no result yet; see /v1/events"
            return DecisionView(accepted=False, detail=detail, by=by)
        made = waits.result()
        return DecisionView(accepted=made.accepted, detail=made.detail, by=made.decision.by)

    def acknowledge(self, bearer: Bearer, alarm_id: str) -> None:
        """Record that the bearer has seen an open alarm."""
        if all(item.alarm.id != alarm_id for item in self.state.alarms):
            alarms = ", ".join(item.alarm.id for item in self.state.alarms) or "none"
            raise ProblemError(
                404, "no-such-alarm", f"no alarm {alarm_id!r} is open; open: {alarms}", field="id",
                remedy="GET /v1/state lists them",
            )  # fmt: skip
        with _refused("not-acknowledged", "id"):
            self.station.acknowledge(alarm_id, bearer.person)

    def change_standing(self, bearer: Bearer, name: str, change: Change) -> None:
        """Change a standing order in force in the bearer's name."""
        standing = self.state.standing.get(name)
        if standing is None or not standing.in_force:
            raise ProblemError(
                404, "no-such-order", f"no standing order {name!r} is in force", field="id",
                remedy="GET /v1/state lists them",
            )  # fmt: skip
        with _refused("not-changed", "change"):
            self.station.change_standing(name, change, bearer.person)

    def change_manual(self, bearer: Bearer, asset: str, *, take: bool) -> None:
        """Take manual control of an asset, or give it back, in the bearer's name."""
        if asset not in self.station.world.assets:
            raise ProblemError(
                404, "no-such-asset", f"there is no asset {asset!r}", field="id",
                remedy=f"known: {', '.join(self.station.world.assets)}",
            )  # fmt: skip
        manual = self.station.manual
        with _refused("not-changed", "id"):
            (manual.take if take else manual.end)(asset, bearer.person)

    def cancel(self, name: str) -> None:
        """Cancel the mission with the id `name`, or remove it from the queue."""
        self.mission(name)
        with _refused("not-cancelled", "id"):
            if self.station.worked_on == name:
                self.station.cancel()
            else:
                self.station.withdraw(name)

    def stop_all(self, bearer: Bearer) -> None:
        """Stop all assets in the bearer's name."""
        with _refused("not-stopped", ""):
            self.station.stop_all(bearer.person)

    def release(self, bearer: Bearer) -> None:
        """Release the stop, in the bearer's name."""
        with _refused("not-released", ""):
            self.station.release(bearer.person)

    def _shown(self, body: DecisionBody) -> ev.ApprovalRequested:
        """Return the waiting request; raises ProblemError unless its plan was shown."""
        _, request = self._waits(body.request_id)
        if shown_sha256(request) != body.shown_sha256:
            raise ProblemError(
                409, "not-what-was-shown", "the plan that waits is not the one with that SHA-256",
                field="shown_sha256", remedy=SEE_PLANS,
            )  # fmt: skip
        return request

    def _waits(self, request_id: str) -> tuple[MissionTrace, ev.ApprovalRequested]:
        """Return the waiting request and its mission; raises ProblemError if it has another id."""
        waiting = self.waiting
        if waiting is None:
            raise ProblemError(409, "no-plan-waits", "no plan is waiting for a decision",
                               field="request_id", remedy=SEE_PLANS)  # fmt: skip
        if (there := waiting[1].request_id) != request_id:
            raise ProblemError(
                409, "stale-plan",
                f"the plan {request_id!r} no longer waits; {there!r} does",
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
            remedy="the manual page on missions lists the commands",
        ) from error  # fmt: skip


@contextmanager
def _refused(kind: str, field: str) -> Generator[None]:
    """Turn a refusal of the station into a problem of the request."""
    try:
        yield
    except ValueError as error:
        raise ProblemError(409, kind, str(error), field=field) from error

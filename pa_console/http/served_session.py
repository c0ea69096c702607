"""A session as its clients use it: read, followed, given missions, decided about and stopped.

The owner of the station gives every event to `take`; commands go to the station, which checks, logs
and gates them as it does those of the console. A second person signs the plan that waits with an
own key that this machine never sees.
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
"""The number of events read from the log at a time: unwritten ones are in memory."""
SILENT_S = 15.0
"""The silence after which a reader gets a sign of life of the session, seconds."""


class NumberedEvent(NamedTuple):
    """An event with its number among the logged ones, from 1."""

    number: int
    event: Event


class EventFeed:
    """Keeps the events given to `put` for the readers that `follow`.

    It holds the events of the log, without transient ones. A slow reader delays nothing: it
    continues from the log.
    """

    def __init__(self, log: Callable[[], Path | None], number: int = 0) -> None:
        """`log` is where the session's log is, None for none; it has `number` events so far."""
        self._log, self.number = log, number
        self._last: deque[Event] = deque(maxlen=KEPT)
        self._changed = asyncio.Event()
        self._ended = False

    def put(self, event: Event) -> None:
        """Take one more event, which the log has."""
        if event.data.transient:
            return
        self.number += 1
        self._last.append(event)
        self._wake()

    def end(self) -> None:
        """Let every reader end that has read all."""
        self._ended = True
        self._wake()

    async def follow(self, after: int) -> AsyncGenerator[NumberedEvent | None]:
        """Yield every event after the one with the number `after`, and None while none comes.

        Raises LogError when the log, which is read for what is older, cannot be.
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
        """Yield what the log has between two numbers, the latter included."""
        path = self._log()
        if path is None:
            return
        told = enumerate(read_log(path), start=1)
        wanted = (NumberedEvent(number, event) for number, event in told if number > after)
        while piece := await asyncio.to_thread(_some, wanted):
            for item in piece:
                if item.number > until:
                    return
                yield item


def _some(items: Iterator[NumberedEvent]) -> list[NumberedEvent]:
    return list(islice(items, PIECE))


def _may_not_sign(kind: str, why: str, field: str) -> ProblemError:
    return ProblemError(403, kind, why, field=field, remedy="pa-console keys list says who may")


ANSWERED_S = 10.0
"""The longest wait for the result of a decision, seconds."""
SEE_PLANS = "read /v1/plans and decide about what waits there now"


class ServedSession:
    """The parts that the clients of one station share: its state, its events, and its commands."""

    def __init__(
        self,
        station: ControlStation,
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
        self.station, self._authority = station, authority
        self.state = state
        self.feed, self._log = EventFeed(log, told), log
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

    async def still_of(self, track: str) -> ev.CameraStill:
        """Take the picture of a track; raises ProblemError where there is none."""
        picture = self.state.picture
        if picture is None or track not in picture.tracks:
            raise ProblemError(404, "no-such-track", f"there is no track {track!r}", field="id",
                               remedy="GET /v1/state lists them")  # fmt: skip
        still = await self.station.still_of(track)
        if still is None or still.problem:
            why = "no camera has it in sight" if still is None else still.problem
            raise ProblemError(409, "no-picture", why, field="id")
        return still

    def file_of(self, still: ev.CameraStill) -> bytes:
        """Return the file of a picture that was shown; raises ProblemError where it is none."""
        content = read_still(self._log(), still)
        if content is None:
            raise ProblemError(404, "no-such-picture", "no such picture is kept beside the log",
                               remedy="GET /v1/tracks/ID/still takes one")  # fmt: skip
        return content

    def still(self, sha256: str) -> ev.CameraStill:
        """Return the picture with this SHA-256 that was shown lately, or with a plan."""
        shown = (still for trace in self.state.missions.values() for still in trace.stills.values())
        for still in chain(self.state.stills.values(), shown):
            if still.sha256 == sha256:
                return still
        raise ProblemError(404, "no-such-picture", "no such picture was shown in this session",
                           field="sha256", remedy="GET /v1/tracks/ID/still takes one")  # fmt: skip

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
        authority = self._keys_for(request)
        try:
            authority.trust.approver(person)
        except RefusedError as refused:
            raise _may_not_sign("may-not-sign", str(refused), "person") from refused
        unsigned = authority.to_sign(request, self.station.rulebook, person)
        return to_sign_view(authority.name, request, unsigned)

    async def countersign(self, request_id: str, body: SignatureBody) -> DecisionView:
        """Take in what a second person has signed of the plan that waits as `request_id`.

        Whoever brings it, it counts for the person whose key has made it.
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
        """Raise ProblemError unless what a person has `given` counts for `request`.

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
                409, "signed-already", f"this plan has the signature with the key of {person}",
                field="person", remedy="let somebody else sign",
            )  # fmt: skip

    def _keys_for(self, request: ev.ApprovalRequested) -> StationAuthority:
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

    def change_standing(self, bearer: Bearer, name: str, change: Change) -> None:
        """Change a standing order that is in force, in the bearer's name."""
        found = self.state.standing.get(name)
        if found is None or not found.in_force:
            raise ProblemError(
                404, "no-such-order", f"no standing order {name!r} is in force", field="id",
                remedy="GET /v1/state lists them",
            )  # fmt: skip
        with _refused("not-changed", "change"):
            self.station.change_standing(name, change, bearer.person)

    def change_manual(self, bearer: Bearer, asset: str, *, take: bool) -> None:
        """Take manual control of an asset in the bearer's name, or give it back."""
        if asset not in self.station.world.assets:
            raise ProblemError(
                404, "no-such-asset", f"there is no asset {asset!r}", field="id",
                remedy=f"known: {', '.join(self.station.world.assets)}",
            )  # fmt: skip
        manual = self.station.manual
        with _refused("not-changed", "id"):
            (manual.take if take else manual.end)(asset, bearer.person)

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
        """Return the waiting request, if that request was shown."""
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

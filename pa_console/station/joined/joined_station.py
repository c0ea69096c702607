"""A console that has joined another station's session, and at which a second person can sign.

The only command of the console is a stop, which the other station carries out. A signature is sent
to the station of the session, which counts it, and from there to the vehicle, which verifies it
again. Questions are answered here, with this console's copy of world and rules. After a commander
takes command here, this station's own session begins.
"""

import asyncio
import time
from collections import deque
from collections.abc import AsyncGenerator, Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from time import monotonic
from typing import NoReturn

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from pa_console.fleets.authorization import RefusedError, sign_approval
from pa_console.fleets.reports import Notices
from pa_console.fleets.simulated import ShownPicture
from pa_console.fleets.station_authority import StationAuthority, approval_of
from pa_console.fleets.vda5050.additions import Countersignature, StopAsked
from pa_console.fleets.vda5050.vehicle import EXPIRY_S
from pa_console.language.questions import Question
from pa_console.language.references.scene import ReferenceScene
from pa_console.mission.approval import inadmissible
from pa_console.mission.examine import Examination
from pa_console.mission.stop import CONFIRM_S
from pa_console.policy.retriever import Retriever
from pa_console.policy.rulebook import Rulebook, with_core
from pa_console.schema.evaluation import Variant
from pa_console.schema.events import event as ev
from pa_console.schema.events.event import CommandTaken, Event, SessionStarted
from pa_console.schema.events.intake import AnswerLine, QuestionAnswered, QuestionTopic
from pa_console.schema.mission import Decision, Mission
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import RehearsedReading
from pa_console.schema.world import World
from pa_console.session.state import SessionState
from pa_console.station.answers.alternatives import (
    Alternative,
    rehearse_other_ways,
    rehearse_reading,
)
from pa_console.station.answers.answering import answer
from pa_console.station.assembly import has_rules_of
from pa_console.station.earlier.unclosed_session import LeftMissions
from pa_console.station.intake import read_text
from pa_console.station.joined.shared_log import LOOK_S, SharedLog

REHEARSED: frozenset[QuestionTopic] = frozenset({"other_asset", "alternatives"})
"""The topics of questions that need new checks and rehearsals, not only the record."""

OTHER_RULES = "the rules in force at the station differ from those of this console"


NO_PICTURE = "no picture has been received from the station yet"


SILENT_S = 5.0
STOP_AGAIN_S = 0.5
"""The interval at which a stop is requested until it appears in the station's log, in seconds."""

SUBJECT = "joined"
OwnStation = Callable[[], StationAuthority]
"""A function that returns the keys of this machine's station; it may raise ValueError."""


@dataclass(frozen=True)
class Signatory:
    """The person at a joined console, with the key for signing."""

    name: str
    key: Ed25519PrivateKey


class JoinedStation:
    """A joined session; the console that shows it uses this class in place of ControlStation.

    A second person can sign here. Questions are answered with a copy of the session's world and
    rules.
    """

    rate = 1.0

    def __init__(
        self,
        log: SharedLog,
        before: Sequence[ev.Event],
        signatory: Signatory,
        world: World,
        rules: Rulebook,
    ) -> None:
        """Start with the events `before`; `world` and `rules` are those of the session."""
        self._log, self._before, self._rules = log, before, rules
        self.fleet, self.variant = ShownPicture(world), Variant()
        self.rulebook, self.retriever = with_core(rules), Retriever(rules.rules)
        self._signatory, self._state = signatory, SessionState()
        self._news, self._pointer = _ConnectionNews(log), ""
        self._answered = deque[ev.Event]()
        """The answers given here, which are only shown here and not logged."""
        self._closing = False
        self._stop_asked: _StopAsked | None = None
        for event in before:
            self._state.apply(event)

    @property
    def station(self) -> str:
        """The name of the station that runs the session."""
        return self._log.stream.station

    @property
    def signer(self) -> str:
        """The name of the person at this console; '' if the person may not sign."""
        try:
            self._log.trust.approver(self._signatory.name)
        except RefusedError:
            return ""
        return self._signatory.name

    @property
    def started(self) -> ev.SessionStarted | None:
        """The first event of the session."""
        return self._state.started

    def take_before(self) -> list[ev.Event]:
        """Return the events before this console joined; `run` then yields only later events."""
        before, self._before = self._before, ()
        return _without_old_pictures(before)

    async def run(self) -> AsyncGenerator[ev.Event]:
        """Yield the events of the session, notices about the connection, and answers given here.

        The iteration ends with the session, or after `close`. The caller closes the connection.
        """
        for event in self.take_before():
            yield event
        while not self._closing:
            events = _without_old_pictures(self._log.take())
            for event in events:
                self._state.apply(event)
                yield event
            for notice in (*self._news.take(heard=bool(events)), *self._follow_stop()):
                yield ev.Event(t=datetime.now(UTC), tick=self._state.tick, data=notice)
            while self._answered:
                yield self._answered.popleft()
            if self._state.ended:
                return
            await asyncio.sleep(LOOK_S)

    def decide(self, decision: Decision) -> None:
        """Sign the plan that waits for a second person, and send the signature to its station.

        Raises ValueError if the decision is not such an approval, or cannot be signed or sent.
        """
        log, name, started = self._log, self._signatory.name, self._state.started
        request = self._to_sign(decision)
        seal = started.rules_seal if started is not None else None
        approval = approval_of(
            request,
            person=name,
            station=log.trust.roster.stations[self.station],
            session=log.stream.session,
            rules=seal.content_sha256 if seal is not None else "",
        )
        message = Countersignature(
            **log.header(Countersignature),
            session=log.stream.session,
            request_id=request.request_id,
            person=name,
            approval=sign_approval(self._signatory.key, approval, time.time()),
        )
        if not log.publish(message, round(EXPIRY_S)):
            raise ValueError(f"nothing reaches the broker: {log.link.problem}")

    def _to_sign(self, decision: Decision) -> ev.ApprovalRequested:
        """Return the request that `decision` approves; raises ValueError if it cannot be signed."""
        trace = self._state.current
        request = trace.approval if trace is not None else None
        if decision.kind != "approve":
            raise ValueError(f"{self.station} decides; here a plan can only be countersigned")
        if request is None:
            raise ValueError("no plan waits for a signature")
        if not request.approvals:
            raise ValueError(f"this plan needs one person only, who is at {self.station}")
        if problem := inadmissible(request, decision):
            raise ValueError(problem)
        if self.station not in self._log.trust.roster.stations:
            raise ValueError(f"{self.station} is no longer a station of this site")
        try:
            self._log.trust.approver(self._signatory.name)
        except RefusedError as refused:
            raise ValueError(str(refused)) from refused
        return request

    def stop_all(self) -> None:
        """Request a stop of all assets from the station until its log contains the stop.

        Raises ValueError if the request cannot be sent.
        """
        self._ask_to_stop()
        now_s = monotonic()
        self._stop_asked = _StopAsked(now_s, now_s)

    def _ask_to_stop(self) -> None:
        log = self._log
        request = StopAsked(
            **log.header(StopAsked), session=log.stream.session, person=self._signatory.name
        )
        if not log.publish(request, round(EXPIRY_S)):
            raise ValueError(f"nothing reaches the broker: {log.link.problem}")

    def _follow_stop(self) -> Iterator[ev.Noticed]:
        """Repeat a stop request that is not logged yet; yield a notice if this takes long."""
        request, now_s = self._stop_asked, monotonic()
        if request is None:
            return
        if self._state.stop is not None:
            self._stop_asked = None
            if request.late:
                yield ev.Noticed(level="info", subject="stop", text=f"{self.station} has stopped")
            return
        if now_s - request.sent_s >= STOP_AGAIN_S:
            request.sent_s = now_s
            with suppress(ValueError):  # the connection is reported as broken anyway
                self._ask_to_stop()
        if not request.late and now_s - request.pressed_s > CONFIRM_S:
            request.late = True
            text = f"STOP not confirmed by {self.station}: the request is repeated"
            yield ev.Noticed(level="alarm", subject="stop", text=text)

    async def close(self, reason: str = "") -> None:  # noqa: ARG002 - the session continues
        """Leave the session, which continues without this console."""
        self._closing = True

    async def look_at(self, mission: Mission, words: str) -> RehearsedReading | None:
        """Return a plan for another reading of a mission, rehearsed here; None if not possible."""
        self.fleet.show(self._state.picture)
        return None if self._unfit() else await rehearse_reading(self, mission, words)

    async def examine(self, _plan: Plan, _text: str = "") -> Examination:
        """Raise ValueError, because a plan is changed only at the station that decides on it."""
        raise ValueError("a plan is changed at the station that decides on it")

    async def foresee(self, _text: str) -> str:
        """Return '', because this console has no models."""
        return ""

    async def other_ways(
        self, mission: Mission, words: str, but: Plan
    ) -> AsyncGenerator[RehearsedReading]:
        """Yield plans other than `but` for the same reading of a mission, rehearsed here."""
        self.fleet.show(self._state.picture)
        if not self._unfit():
            async for rehearsed in rehearse_other_ways(self, mission, words, but):
                yield rehearsed

    def _unfit(self) -> str:
        """Return why a rehearsal here could differ from one at the station; '' if it could not."""
        if self._state.picture is None:
            return NO_PICTURE
        if self.started is None or not has_rules_of(self.started, self._rules):
            return OTHER_RULES
        return ""

    def question_in(self, text: str) -> Question | None:
        """Return the question about the session in `text`, for `answer`; None for any other text.

        While there is no picture, the result is always None, because words cannot refer to it.
        """
        picture = self._state.picture
        if picture is None:
            return None
        scene = ReferenceScene(self.fleet.world, picture, pointer=self._pointer)
        return read_text(text, scene, self._rules).question

    async def answer(
        self, question: Question, show: Callable[[Alternative], object] = lambda _: None
    ) -> ev.QuestionAnswered:
        """Answer a question from the received part of the session and the local copy of its site.

        The question is not sent to the session's station. If only that station can answer it, the
        answer refers the operator to that station.
        """
        state = self._state
        self.fleet.show(state.picture)
        if question.topic in REHEARSED and (why := self._unfit()):
            text = f"{why}, so it cannot be rehearsed here; ask it at {self.station}"
            current = state.current
            mission = current.mission.id if current is not None else ""
            answered = QuestionAnswered(
                question=question.text,
                topic=question.topic,
                subjects=question.subjects,
                lines=(AnswerLine(about="not here", said=text),),
            )
        else:
            given = await answer(self, question, state, show)
            answered, mission = given.event, given.mission
        now, tick = datetime.now(UTC), state.tick
        self._answered.append(ev.Event(t=now, tick=tick, mission=mission or None, data=answered))
        return answered

    @property
    def ground(self) -> None:
        """The ground map: None, because robots send it only to the station that commands them."""

    async def still_of(self, _track: str) -> ev.CameraStill | None:
        """Return None, because only the station of the session takes and stores stills."""
        return None

    def read_live(self, show: Callable[[str, str], None] | None) -> None:
        """Do nothing, because orders are given at the station itself."""

    def typing(self, text: str) -> None:
        """Do nothing, because orders are given at the station itself."""

    def point(self, name: str) -> None:
        """Record the name marked on the screen, or ''; *this one* in a question means that name."""
        self._pointer = name

    def command_question(self, epoch: int, own: str) -> str:
        """Return the question with which the operator confirms that station `own` takes command.

        It states the consequences; `epoch` is the new epoch.
        """
        station, left = self.station, LeftMissions.of(self._state)
        moved = ", ".join(trace.mission.id for trace in left.under_way)
        waits = ", ".join(mission.id for mission in left.again)
        under_way = (
            f"Under way at {station}: {moved}. Vehicles finish the commands that they have begun, "
            "and refuse later ones.\n"
        ) * bool(moved)
        under_way += (
            f"No asset has moved yet for {waits}: queued again here, for approval here.\n"
        ) * bool(waits)
        return (
            f"Put {own} in command in place of {station}? The epoch rises to {epoch}.\n"
            f"From then on, vehicles refuse commands from {station}, and its screen says so.\n"
            f"{under_way}"
            f"This console closes and opens again as that of {own}, with its own session and log.\n"
            f"The log begins with the last record of {station} that was received here. "
            f"{station} commands until everything is ready."
        )

    def left_missions(self, last: Sequence[ev.Event]) -> LeftMissions:
        """Apply the session's `last` events, which are not shown, and return its open missions."""
        for event in last:
            self._state.apply(event)
        return LeftMissions.of(self._state)

    def _refuse(self, *_: object, **__: object) -> NoReturn:
        raise ValueError(f"this is the session of {self.station}, which is in command")

    async def _refuse_rules(self) -> NoReturn:
        self._refuse()

    # Only the station of the session has these methods; here, each raises ValueError.
    submit = cancel = release = acknowledge = move = defer = withdraw = inject = _refuse
    change_standing = mute_agent = let_next_go_first = _refuse
    reload_rules = accept_rules = _refuse_rules
    rules_offered = ""


@dataclass
class _StopAsked:
    """A stop that was requested here and is not yet in the station's log.

    Times are in seconds of this machine's clock.
    """

    pressed_s: float
    sent_s: float
    late: bool = False


class _ConnectionNews:
    """Notices about the connection and the station in command, one for each change."""

    def __init__(self, log: SharedLog) -> None:
        self._log, self._notices = log, Notices()
        self._problem, self._takeover = "", log.trust.takeover
        self._heard_at = monotonic()
        self._silent = self._lacks = False

    def take(self, *, heard: bool) -> Sequence[ev.IncidentHappened | ev.Noticed]:
        """Return the new notices; `heard` is True if records have just arrived."""
        log, station, now_s = self._log, self._log.stream.station, monotonic()
        if (problem := log.link.problem) != self._problem:
            self._problem = problem
            if problem:
                self._say("alarm", f"no connection to the broker: {problem}")
            else:
                self._say("info", "connected to the broker again")
        self._heard_at = now_s if heard else self._heard_at
        if (silent := now_s - self._heard_at > SILENT_S) != self._silent:
            self._silent = silent
            if silent:
                self._say("alarm", f"nothing received from {station} for {SILENT_S:.0f} s")
            else:
                self._say("info", f"records from {station} arrive again")
        if (lacks := log.stream.missing > 0) != self._lacks:
            self._lacks = lacks
            if lacks:
                self._say("warning", f"{log.stream.missing} records are missing and are requested")
            else:
                self._say("info", "no records are missing any more")
        if log.problem:
            self._say("warning", f"rejected: {log.problem}")
            log.problem = ""
        if (takeover := log.trust.takeover) != self._takeover:
            self._takeover = takeover
            in_command = log.trust.roster.station_of(log.trust.takeover.station)
            more = "" if in_command == station else f"; {station} no longer commands any asset"
            self._say("alarm", f"{log.trust.in_command}{more}")
        return self._notices.take()

    def _say(self, level: ev.Level, text: str) -> None:
        self._notices.say(level, SUBJECT, text, monotonic())


def _without_old_pictures(events: Sequence[ev.Event]) -> list[ev.Event]:
    """Return `events` with only the last of their pictures, because earlier ones are not shown."""
    pictures = [n for n, event in enumerate(events) if event.data.kind == "telemetry"]
    old = frozenset(pictures[:-1])
    return [event for number, event in enumerate(events) if number not in old]


class Succession:
    """A takeover of command from the joined session's station by the person at this console.

    All steps that can fail come before `take`. After `take`, vehicles accept no commands from the
    other station, and none from this station until its session begins.
    """

    def __init__(self, log: SharedLog, signatory: Signatory, own: OwnStation) -> None:
        self._log, self._signatory, self._own = log, signatory, own
        self.authority: StationAuthority | None = None
        """The keys with which this station commands; None before `prepare` succeeds."""
        self.taken: CommandTaken | None = None
        """The event of the takeover; None before the takeover."""
        self.last: tuple[Event, ...] = ()
        """The events of the other session after the last one shown here, up to the takeover."""

    @property
    def possible(self) -> bool:
        """True if the person at this console is a commander; only commanders may take command."""
        try:
            return self._log.trust.person(self._signatory.name).role == "commander"
        except RefusedError:
            return False

    def prepare(self, started: SessionStarted | None) -> StationAuthority:
        """Return the keys of this station, which may then take command with the session's rules.

        Raises ValueError with the reason if command cannot be taken from here.
        """
        log, name = self._log, self._signatory.name
        if not self.possible:
            raise ValueError(f"only a commander can take command, and {name} is not a commander")
        if problem := log.link.problem:
            raise ValueError(f"no connection to the broker: {problem}")
        authority = self._own()
        if not authority.refusal:
            raise ValueError(
                f"{authority.name} is in command already; leave, and use 'console --fleet'"
            )
        if not authority.name:
            raise ValueError("this station is not in the roster: the site's owner must enrol it")
        if started is not None and started.rules_seal is not None:
            sha256 = started.rules_seal.content_sha256
            if sha256 not in authority.trust.roster.rules:
                raise ValueError(f"vehicles refuse commands under the rules {started.rules!r}")
        self.authority = authority
        return authority

    def take(self, publish: Callable[[], object]) -> CommandTaken:
        """Take command, announce it with `publish`, and return the first event for the new log.

        If command cannot be taken, nothing changes and ValueError is raised.
        """
        authority, stream = self.authority, self._log.stream
        if authority is None:
            raise ValueError("nothing was prepared")
        authority.take_command(self._signatory.name, self._signatory.key)
        publish()
        self.last = tuple(self._log.take())
        self.taken = CommandTaken(
            station=stream.station,
            session=stream.session,
            records=stream.wanted - 1,
            head=stream.head,
            epoch=authority.trust.takeover.epoch,
            by=self._signatory.name,
        )
        return self.taken

"""The open parts of an earlier session whose console was killed or relieved of command.

A session that was not closed continues here. Its log has everything that determines the world:
seed, scenario, incidents and commands. The fleet is simulated again from the beginning to the last
record, and its picture must then equal the one in the log.

For a relieved station's session, a mission that has not moved any asset is queued again with its
original text. It is planned with present reports and needs approval like any mission. A mission
that has sent a command is only reported, because its plan was approved for another station. The
picture raises alarms and their missions again. Standing orders do not continue, because they were
approved at that station only.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.policy.moments import Pursuits, moment
from pa_console.policy.rule_variables import Sightings
from pa_console.schema.command import DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.incident import Scenario
from pa_console.schema.mission import Mission, QueueEntry
from pa_console.schema.rehearsal import OrderMoment
from pa_console.schema.world import World
from pa_console.session.log.chain import TORN, LogError, read_log
from pa_console.session.mission_trace import MissionTrace
from pa_console.session.past_sessions import is_held, newest_logs, summarise
from pa_console.session.state import SessionState, begun_missions, waiting_entries
from pa_console.session.wording import order_in_words
from pa_console.station.alarms.alarm_book import AlarmBook

OTHERWISE = "its world did not come out again as the log tells of it"
LOOKED_AT = 30
"""The number of logs, the newest first, that are searched for the last session of a world."""


@dataclass(frozen=True)
class LeftMissions:
    """The missions and orders that a relieved station's session left open.

    `manual` are the assets under manual control, which remain so, each with the person who took it.
    `again` are the missions that have not moved any asset, the one that was being planned first;
    `under_way` are those that have. `standing` are the ids of the standing orders in force there.
    `awaiting` are the ended missions that await assets under manual control. `stopped` is True if
    all assets were stopped.
    """

    manual: tuple[tuple[str, str], ...] = ()
    again: tuple[Mission, ...] = ()
    under_way: tuple[MissionTrace, ...] = ()
    standing: tuple[str, ...] = ()
    awaiting: tuple[tuple[Mission, tuple[str, ...]], ...] = ()
    stopped: bool = False

    @classmethod
    def of(cls, state: SessionState) -> "LeftMissions":
        """Return the missions and orders left open in `state`; none if the session has ended."""
        if state.ended:
            return cls()
        begun = begun_missions(state)
        again = [trace.mission for trace in begun if not trace.commands]
        again += [entry.mission for entry in waiting_entries(state)]
        return cls(
            manual=tuple((name, control.by) for name, control in state.manual.items()),
            again=tuple(mission for mission in again if mission.source == "operator"),
            under_way=tuple(trace for trace in begun if trace.commands),
            standing=tuple(name for name, trace in state.standing.items() if trace.in_force),
            awaiting=tuple(
                (trace.mission, state.awaiting[trace.mission.id]) for trace in _awaiting(state)
            ),
            stopped=state.stop is not None,
        )

    def notices(self, station: str) -> Iterator[str]:
        """Yield notices about these for the operator; `station` is the relieved station."""
        for trace in self.under_way:
            orders = "; ".join(
                f"{sent.command.agent} {order_in_words(sent.command)}"
                for sent in trace.commands.values()
            )
            yield (
                f"{station} had {trace.mission.id} “{trace.mission.said}” under way ({orders}): "
                "vehicles end what they have begun, and nobody verifies it"
            )
        for mission, assets in self.awaiting:
            yield (
                f"{mission.id} “{mission.said}” of {station} awaits {', '.join(assets)}: give it "
                "again here if it is still wanted"
            )
        if self.standing:
            yield (
                f"no standing order of {station} is in force here ({', '.join(self.standing)}): "
                "approve them anew"
            )
        if self.stopped:
            yield f"{station} had stopped every asset: all stay stopped until you release them"


def _awaiting(state: SessionState) -> Iterator[MissionTrace]:
    """Yield the missions that await an asset under manual control."""
    return (state.missions[name] for name in state.awaiting if name in state.missions)


class NotResumableError(ValueError):
    """An error for a session that cannot be resumed; the text is the reason."""


@dataclass(frozen=True)
class UnclosedSession:
    """The last session of a world, read from its log, if the console ended without closing it."""

    log: Path
    state: SessionState

    @property
    def started(self) -> ev.SessionStarted:
        """The first event of the session, with the rules that were in force last."""
        assert self.state.started is not None
        return self.state.started

    @property
    def waiting(self) -> tuple[QueueEntry, ...]:
        """The missions that waited and had not begun, except those of standing orders."""
        return tuple(entry for entry in waiting_entries(self.state) if not entry.mission.standing)

    @property
    def started_by_standing(self) -> tuple[str, ...]:
        """The ids of the waiting missions that standing orders had started."""
        return tuple(
            entry.mission.id for entry in waiting_entries(self.state) if entry.mission.standing
        )

    @property
    def manual(self) -> Iterator[tuple[str, str]]:
        """The assets under manual control, each with the person who took it."""
        return ((name, control.by) for name, control in self.state.manual.items())

    @property
    def awaiting(self) -> Iterator[tuple[Mission, tuple[str, ...]]]:
        """The missions that await assets under manual control, each with these assets."""
        for trace in _awaiting(self.state):
            yield trace.mission, self.state.awaiting[trace.mission.id]

    @property
    def interrupted(self) -> tuple[MissionTrace, ...]:
        """The missions that had begun and had not ended."""
        return begun_missions(self.state)

    @property
    def unfinished(self) -> bool:
        """True if a mission, an alarm or a stop was open, or an asset under manual control."""
        state = self.state
        open_ = self.interrupted or self.waiting or state.alarms or state.stop
        return bool(open_ or state.manual or state.awaiting)


@dataclass(frozen=True)
class ResumedSession:
    """A session restored to its last record, with its world and its picture.

    `stops` counts the stops so far, and one more that a killed console may have sent before it was
    logged: a stop does not wait for the disk, and a vehicle ignores a command id that it has
    already received. Standing orders do not continue.
    """

    before: UnclosedSession
    fleet: SimulatedFleet
    alarms: AlarmBook
    sightings: Sightings
    pursuits: Pursuits
    stops: int


class PursuitHistory:
    """The pursuits in a session's log: assets that were sent after tracks (ROE-14).

    An order lasts until its mission ends, as in the monitor of a running mission. An order that was
    reported as done is not a pursuit.
    """

    def __init__(self, world: World) -> None:
        self.pursuits, self._world = Pursuits(), world
        self._orders: dict[str, dict[str, tuple[str, OrderMoment]]] = {}
        """The latest command of each agent and its id, by mission."""

    def take(self, event: ev.Event) -> None:
        """Process the next event of the log."""
        match event.data:
            case ev.CommandSent(command=command) if event.mission is not None:
                order = OrderMoment(
                    agent=command.agent,
                    kind=self._world.assets[command.agent].kind,
                    verb=command.verb,
                    target=command.target,
                )
                self._orders.setdefault(event.mission, {})[command.agent] = (
                    command.command_id,
                    order,
                )
            case ev.CommandReplied(reply=reply) if reply.status == "done":
                for orders in self._orders.values():
                    name, order = orders.get(reply.agent, ("", None))
                    if order is not None and name == reply.command_id:
                        orders[reply.agent] = name, order.model_copy(update={"done": True})
            case ev.MissionFinished() if event.mission is not None:
                self._orders.pop(event.mission, None)
            case ev.TelemetryReceived(picture=picture) if self._orders:
                orders = [order for latest in self._orders.values() for _, order in latest.values()]
                self.pursuits.look(moment(picture, self._world, orders))
            case _:
                pass


def find_unclosed(folder: Path, world_sha256: str) -> UnclosedSession | None:
    """Return the last session of the world with a log in `folder`, if it was never closed.

    The result is None if the session was closed or continues in another console. Logs that cannot
    be read are skipped.
    """
    for log in newest_logs(folder)[:LOOKED_AT]:
        try:
            summary = summarise(log)
            if summary.world_sha256 != world_sha256 or summary.readonly:
                continue
            if summary.ending == "closed" or is_held(log):
                return None
            state = SessionState()
            for event in _events(log):
                state.apply(event)
        except (LogError, OSError):
            continue
        return UnclosedSession(log, state)
    return None


def _events(log: Path) -> Iterator[ev.Event]:
    """Yield the events of a log, without an incomplete last line; raises LogError."""
    try:
        yield from read_log(log)
    except LogError as error:
        if error.problem != TORN:
            raise


def resume(session: UnclosedSession, world: World, scenario: Scenario | None) -> ResumedSession:
    """Restore `session` in its own `world` and `scenario`.

    Raises NotResumableError if the simulated world differs from the log, LogError if the log cannot
    be read.
    """
    fleet = SimulatedFleet.start(world, session.started.seed, scenario)
    alarms, sightings, history = AlarmBook(world), Sightings(world), PursuitHistory(world)
    sent: dict[str, DeviceCommand] = {}
    stops, first = 0, False
    taken = frozenset[str]()
    for event in _events(session.log):
        while fleet.tick < event.tick:
            fleet.step()
        history.take(event)
        match event.data:
            case ev.SessionStarted():
                first = True
            case ev.SessionResumed():
                first, stops = True, stops + 1
            case ev.IncidentHappened(source="operator", incident=incident):
                fleet.inject(incident)
            case ev.CommandSent(command=command):
                sent[command.command_id] = command
                fleet.send(command)
            case ev.CommandResent(command_id=name) if name in sent:
                fleet.send(sent[name])
            case ev.ManualControlTaken(asset=asset):
                fleet.mark_manual(taken := taken | {asset})
            case ev.ManualControlEnded(asset=asset):
                fleet.mark_manual(taken := taken - {asset})
            case ev.AllStopped():
                stops += 1
            case ev.TelemetryReceived(picture=picture):
                if fleet.picture() != picture:
                    raise NotResumableError(OTHERWISE)
                sightings.look(picture)
                if not first:
                    alarms.look(picture)
                first = False
            case ev.AlarmAcknowledged(alarm_id=name) if name in {a.id for a in alarms.open}:
                alarms.acknowledge(name, "operator")
            case _:
                pass
    return ResumedSession(session, fleet, alarms, sightings, history.pursuits, stops + 1)

"""The open parts of an earlier session whose console was killed or relieved of command.

If a session was not closed, it continues here. Its log has all that determines the simulated world:
seed, scenario, incidents and commands. The fleet is simulated again from the beginning to the last
record, and its picture must then equal the picture in the log.

If a station was relieved, its missions that have not moved any asset are queued again with their
original texts. They are planned with current reports and need approval like any mission. A mission
that has sent a command is only reported, because its plan was approved for the other station.
Alarms are raised again from the picture, and so are their missions. Standing orders do not
continue, because they were approved only at the other station.
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

OTHERWISE = "the world simulated again from the log differs from the log"
LOOKED_AT = 30
"""The number of newest logs that are searched for the last session of a world."""


@dataclass(frozen=True)
class LeftMissions:
    """The missions and orders that a relieved station's session left open.

    `manual` has the assets that are under manual control and remain so, each with the person who
    took it. `again` has the missions that have sent no commands, the active mission first, and
    `under_way` has those that have. `standing` has the ids of the standing orders in force there.
    `awaiting` has the ended missions that await assets under manual control, with these assets.
    `stopped` is True if all assets were stopped.
    """

    manual: tuple[tuple[str, str], ...] = ()
    again: tuple[Mission, ...] = ()
    under_way: tuple[MissionTrace, ...] = ()
    standing: tuple[str, ...] = ()
    awaiting: tuple[tuple[Mission, tuple[str, ...]], ...] = ()
    stopped: bool = False

    @classmethod
    def of(cls, state: SessionState) -> "LeftMissions":
        """Return the missions and orders that are open in `state`; none if the session ended."""
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
        """Yield notices about the open missions and orders of the relieved station `station`."""
        for trace in self.under_way:
            orders = "; ".join(
                f"{sent.command.agent} {order_in_words(sent.command)}"
                for sent in trace.commands.values()
            )
            yield (
                f"{station} had {trace.mission.id} “{trace.mission.said}” under way ({orders}): "
                "vehicles finish the commands that they have begun, without verification"
            )
        for mission, assets in self.awaiting:
            yield (
                f"{mission.id} “{mission.said}” of {station} awaits {', '.join(assets)}: give it "
                "again here if it is still needed"
            )
        if self.standing:
            yield (
                f"the standing orders of {station} are not in force here "
                f"({', '.join(self.standing)}): give and approve them again"
            )
        if self.stopped:
            yield f"{station} had stopped every asset: all stay stopped until you release them"


def _awaiting(state: SessionState) -> Iterator[MissionTrace]:
    """Yield the missions that await an asset under manual control."""
    return (state.missions[name] for name in state.awaiting if name in state.missions)


class NotResumableError(ValueError):
    """The error for a session that cannot be resumed; the text is the reason."""


@dataclass(frozen=True)
class UnclosedSession:
    """The last session of a world, read from its log, which the console did not close."""

    log: Path
    state: SessionState

    @property
    def started(self) -> ev.SessionStarted:
        """The first event of the session, but with the rules that were in force last."""
        assert self.state.started is not None
        return self.state.started

    @property
    def waiting(self) -> tuple[QueueEntry, ...]:
        """The missions that waited in the queue, except those of standing orders."""
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
        """The missions that had begun but not ended."""
        return begun_missions(self.state)

    @property
    def unfinished(self) -> bool:
        """True if a mission or an alarm was open, a stop in force, or an asset taken manually."""
        state = self.state
        open_ = self.interrupted or self.waiting or state.alarms or state.stop
        return bool(open_ or state.manual or state.awaiting)


@dataclass(frozen=True)
class ResumedSession:
    """A session restored to its last record, with its world and its picture.

    `stops` is the number of stops so far, plus one that a killed console may have sent before it
    was logged, because a stop does not wait for the disk. The number keeps command ids unique,
    because a vehicle ignores an id that it has already received. Standing orders do not continue.
    """

    before: UnclosedSession
    fleet: SimulatedFleet
    alarms: AlarmBook
    sightings: Sightings
    pursuits: Pursuits
    stops: int


class PursuitHistory:
    """The pursuits in a session's log: assets that were sent after tracks (ROE-14).

    An order counts until its mission ends, as in the monitor of a running mission. It is not a
    pursuit once it was reported as done.
    """

    def __init__(self, world: World) -> None:
        self.pursuits, self._world = Pursuits(), world
        self._orders: dict[str, dict[str, tuple[str, OrderMoment]]] = {}
        """By mission, the latest command of each agent with the command's id."""

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
    """Return the last session of the world among the logs in `folder`, if it was never closed.

    The result is None if the session was closed, or if another console is running it. Logs that
    cannot be read are skipped.
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

    Raises NotResumableError if the simulated world differs from the log, and LogError if the log
    cannot be read.
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

"""The fleet of robots on several links and, optionally, on a message bus.

The fleet has one picture and one clock, the station's. It sends a command to the link of its asset.
Everything that a link reports is checked first, and no fault of a link ends the session.
"""

import secrets
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from math import isfinite
from time import monotonic
from typing import TYPE_CHECKING

from pydantic import ValidationError

from pa_console.fleets.fleet import Received, RelaysImages
from pa_console.fleets.link import (
    DeviceAnswer,
    GroundMap,
    Link,
    LinkNews,
    LinkNotice,
    NotReady,
)
from pa_console.fleets.reported_fleet import ReportedFleet
from pa_console.fleets.reported_picture import ReportedPicture
from pa_console.fleets.reports import AssetReport, SensorReport
from pa_console.fleets.simulated import Authorize, Verify
from pa_console.fleets.snapshot import SnapshotError
from pa_console.schema.command import COMMANDS, FINAL_REPLIES, CommandReply, DeviceCommand
from pa_console.schema.telemetry import AssetTelemetry
from pa_console.schema.world import Background, World
from pa_console.sim import picture as station_side
from pa_console.sim.worlds.terrain import Terrain

if TYPE_CHECKING:
    from pa_console.fleets.vda5050.mqtt_fleet import MqttFleet

MOST_SENT = 4096
"""The largest number of commands whose answers are tracked; the oldest are dropped first."""

MOST_NEWS = 20_000
"""The largest number of reports and answers from one link in one step; the rest is dropped."""

MOST_DETAIL = 500
"""The longest detail of an answer, in characters."""

POLL_S = 0.05
"""The longest wait for one link before the others are checked, in seconds."""


@dataclass
class _SentCommand:
    """A command of the station, and the last answer of its asset."""

    command: DeviceCommand
    reply: CommandReply | None = None

    @property
    def ended(self) -> bool:
        """True once the asset has carried out, failed or refused the command."""
        return self.reply is not None and self.reply.status in FINAL_REPLIES


class LinkedFleet(ReportedFleet):
    """The fleet of the assets of `world` on `links` and, if given, on `bus`.

    After `use`, each command to a link is verified here in place of its asset, so that only
    commands that people have approved are sent.
    """

    def __init__(
        self,
        world: World,
        links: Sequence[Link],
        bus: "MqttFleet | None" = None,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        """Read the assets' time from `now`; raises ValueError if an asset is on two links."""
        self._links, self._bus, self._now = tuple(links), bus, now
        self._began = self._read_at = now()
        self._link_of = _links_of_assets(self._links, world)
        super().__init__(bus.reported if bus is not None else ReportedPicture(world))
        self._reported.links = {name: link.name for name, link in self._link_of.items()}
        if bus is not None:
            bus.reserve(dict(self._reported.links))
            self._note_bus(bus)
        self._period = station_side.period_ticks(world)
        self._session = secrets.token_hex(8)
        """The prefix of every command id on a link, which keeps ids unique across sessions."""
        self._sent: OrderedDict[str, _SentCommand] = OrderedDict()
        self.background: Background | None = None
        """The newest map that robots have made of the ground."""
        self._down: set[str] = set()
        self._manual: set[str] = set()
        self._authorize: Authorize | None = None
        self._verify: Verify = lambda _token, _command: ""
        self._take_news()
        self._show()

    def use(self, authorize: Authorize, verify: Verify) -> None:
        """Verify every command to a link from now on, with the token that `authorize` returns."""
        self._authorize, self._verify = authorize, verify

    @property
    def links(self) -> tuple[Link, ...]:
        """The links, without the bus."""
        return self._links

    def image_on(self, topic: str) -> bytes:
        """Return the next image on `topic`, over the first link that relays images.

        Raises SnapshotError if there is no such link or no valid image.
        """
        link = next((link for link in self._links if isinstance(link, RelaysImages)), None)
        if link is None:
            raise SnapshotError("needs a link to ROS 2: --fleet ros2:FILE")
        return link.image_on(topic)

    def mark_manual(self, assets: frozenset[str]) -> None:
        """Show `assets`, and no others, as under manual control from this station, at once."""
        if self._bus is not None:  # the bus makes the picture of all assets
            self._bus.mark_manual(assets)
        else:
            super().mark_manual(assets)

    def wait_for_reports(self, seconds: float) -> None:
        """Wait for a report from every asset on a connected link, for `seconds` at most."""
        until = monotonic() + seconds
        while (left_s := until - monotonic()) > 0.0:
            assets = self.picture().assets
            silent = [
                link
                for link in self._links
                if not self._problem_of(link)
                and any(assets[name].comms == "lost" for name in self._assets_on(link))
            ]
            if not silent:
                return
            silent[0].wait(min(left_s, POLL_S))
            self._take_news()
            self._show()

    def send(self, command: DeviceCommand) -> None:
        """Send `command` to the link of its asset now; a hold is sent even without a connection.

        A command that has ended is not sent again; its answer is repeated. A hold is always sent.
        """
        link = self._link_of.get(command.agent)
        if link is not None:
            if command.verb == "hold" or self._may_go(command, link):
                self._transmit(command, link)
        elif self._bus is not None:
            self._bus.send(command)
        else:
            text = "is not on any link: nothing can be sent to it"
            self._say("alarm", command.agent, text, "absent")

    def _may_go(self, command: DeviceCommand, link: Link) -> bool:
        """Return whether `command` may be sent now; if not, a reply or a notice has the reason."""
        sent = self._sent.get(command.command_id)
        if sent is not None and sent.command != command:
            self._refuse(command, "its id was used for another command before")
            return False
        if sent is not None and sent.reply is not None and sent.ended:
            self._replies.append(sent.reply.model_copy(update={"tick": self._tick}))
            return False
        if problem := self._problem_of(link):
            text = f"{command.verb} is not sent: no connection over {link.name}: {problem}"
            self._say("alarm", command.agent, text, "unsent")
            return False
        # This check is last, and only for a new command, because it uses up the command's token.
        if sent is None and (why := self._refusal(command)):
            self._sent[command.command_id] = _SentCommand(command)
            self._refuse(command, why)
            return False
        return command.agent not in self._manual

    def _refusal(self, command: DeviceCommand) -> str:
        """Return why a new `command` may not be sent; '' if it may, which uses up its token."""
        if command.agent in self._manual:
            return "it is under manual control"
        token = self._authorize(command) if self._authorize is not None else None
        return self._verify(token, command)

    def _transmit(self, command: DeviceCommand, link: Link) -> None:
        """Send `command` over its link; if it was sent before, a new answer is expected."""
        self._sent[command.command_id] = _SentCommand(command)
        self._sent.move_to_end(command.command_id)
        while len(self._sent) > MOST_SENT:
            self._sent.popitem(last=False)
        on_wire = command.model_copy(update={"command_id": f"{self._session}.{command.command_id}"})
        try:
            link.send(on_wire)
        except Exception as error:  # a link must not raise; if it does, the session continues
            self._fault(link, f"cannot send {command.verb} to {command.agent}", error)

    def step(self) -> Received:
        """Advance the clock by `world.dt_s`; return everything received since the last step."""
        self._tick += 1
        self._take_news()
        if self._bus is not None:  # the bus updates the picture as well
            received = self._bus.step()
            self._note_bus(self._bus)
        else:
            received = Received()
            if self._tick % self._period == 0:
                self._show()
        replies, self._replies = tuple(self._replies), []
        return Received(
            (*replies, *received.replies),
            (*self._notices.take(), *received.told),
            received.countersigned,
            received.stop_asked,
        )

    def close(self) -> None:
        """Close all links and the bus; the robots then follow their own rules for a lost link."""
        for link in self._links:
            try:
                link.close()
            except Exception as error:
                self._fault(link, "cannot be closed", error)
        if self._bus is not None:
            self._bus.close()

    def _note_bus(self, bus: "MqttFleet") -> None:
        """Show the bus as the link of each asset that has joined it."""
        for name in bus.joined - self._reported.links.keys():
            self._reported.links[name] = bus.name

    def _take_news(self) -> None:
        """Process the news of every link, and report lost and restored connections."""
        # The clock is read once for the lag and for the age of every report. With two readings, a
        # delay in between would make a moving asset appear farther away than it can have come.
        self._read_at = self._now()
        passed_s = (self._read_at - self._began).total_seconds()
        self._reported.advance(self._tick, passed_s - self.time_s)
        for link in self._links:
            self._note_problem(link)
            for news in self._news_of(link):
                try:
                    self._take(link, news)
                except Exception as error:  # a bad report must not end the session
                    self._fault(link, f"{type(news).__name__} is set aside", error)

    def _news_of(self, link: Link) -> Sequence[LinkNews]:
        try:
            news = list(link.take())
        except Exception as error:
            self._fault(link, "its news cannot be processed", error)
            return ()
        if len(news) > MOST_NEWS:
            text = f"{len(news) - MOST_NEWS} messages came too fast and were set aside"
            self._say("alarm", link.name, text, "flood")
        return news[:MOST_NEWS]

    def _note_problem(self, link: Link) -> None:
        """Report a lost or restored connection; after a loss, mark its assets as not reporting."""
        problem = self._problem_of(link)
        if bool(problem) == (link.name in self._down):
            return
        if problem:
            self._down.add(link.name)
            self._say("alarm", link.name, f"no connection: {problem}", "down")
            for name in self._assets_on(link):
                self._reported.break_link(name)
        else:
            self._down.remove(link.name)
            self._say("info", link.name, "connected again", "up")

    def _take(self, link: Link, news: LinkNews) -> None:
        match news:
            case LinkNotice(level, subject, text):
                self._say(level, subject, text)
            case DeviceAnswer():
                self._take_answer(link, news)
            case NotReady(agent, why):
                if self._is_on(link, agent):
                    self._reported.note_readiness(agent, why[:MOST_DETAIL])
            case GroundMap(background):
                self.background = background
            case AssetReport():
                if self._is_on(link, news.agent) and link.name not in self._down:
                    self._take_report(link, news)
            case SensorReport():
                if news.sensor in self.world.cameras or self._is_on(link, news.sensor):
                    self._take_sensor(self._stamp(news.sensor, news.sent), news)

    def _is_on(self, link: Link, name: str) -> bool:
        """Return whether `name` is an asset of `link`; if not, report its news as set aside."""
        if self._link_of.get(name) is link:
            return True
        text = f"reports over {link.name}, to which it does not belong: set aside"
        self._say("warning", name, text, "stranger")
        return False

    def _take_answer(self, link: Link, answer: DeviceAnswer) -> None:
        """Queue `answer` for the next step, if it is for an unfinished command to the same asset.

        An answer to an unknown command is reported and set aside.
        """
        sent = self._sent_as(answer.command_id)
        is_its = sent is not None and sent.command.agent == answer.agent
        if sent is None or not is_its or self._link_of.get(answer.agent) is not link:
            text = "answers a command that was not sent to it in this session: set aside"
            self._say("warning", answer.agent, text, "unknown command")
        elif not sent.ended:
            sent.reply = self._reply(sent.command, answer.status, answer.detail[:MOST_DETAIL])

    def _take_report(self, link: Link, report: AssetReport) -> None:
        name = report.agent
        stamp = self._stamp(name, report.sent)
        if stamp is None or not self._belief.is_latest(name, report.sent):
            return
        try:
            telemetry = self._telemetry(report, self._reported.terrain, max(stamp, 0))
        except (ValidationError, TypeError, ValueError) as error:
            self._fault(link, f"the report of {name} is set aside", error)
            return
        (self._manual.add if report.manual else self._manual.discard)(name)
        self._reported.report(name, stamp, telemetry)

    def _stamp(self, name: str, sent: datetime) -> int | None:
        """Return the tick at which a report was sent; None if its time is not plausible."""
        stamp = self._belief.tick_of(sent, self._now(), self._read_at, self._tick)
        if stamp is None:
            self._belief.ahead(name)
        return stamp

    def _telemetry(self, report: AssetReport, terrain: Terrain, tick: int) -> AssetTelemetry:
        """Return `report` as telemetry of `tick`; raises ValueError for impossible values."""
        world, (x, y) = terrain.world, report.position
        if not (isfinite(x) and isfinite(y)):
            raise ValueError(f"its position ({x}, {y}) is not a place")
        battery = world.low_battery_pct if report.battery_pct is None else report.battery_pct
        at = terrain.frame_at(x, y)
        sent = self._sent_as(report.command_id or "")
        command = sent.command if sent is not None else None
        post = at
        if report.task == "returning":
            post = world.base
        elif command is not None and COMMANDS[command.verb].takes_frame:
            post = command.target
        elif report.route:
            post = terrain.frame_at(*report.route[-1])
        return AssetTelemetry(
            id=report.agent,
            kind=world.assets[report.agent].kind,
            at=at,
            post=post,
            position=(x, y),
            heading_deg=report.heading_deg,
            speed_mps=report.speed_mps,
            status=report.status,
            task=report.task,
            battery_pct=battery,
            battery_known=report.battery_pct is not None,
            low_battery=report.battery_pct is None or battery < world.low_battery_pct,
            comms="ok",
            available=report.status != "failed" and battery > 0.0 and not report.manual,
            route=tuple(report.route),
            command_id=command.command_id if command is not None else None,
            stamp_s=terrain.seconds(tick),
            manual=report.manual,
        )

    def _sent_as(self, on_wire: str) -> _SentCommand | None:
        """Return the command of this session with the given id on a link; None if there is none."""
        session, _, own_id = on_wire.partition(".")
        return self._sent.get(own_id) if session == self._session else None

    def _refuse(self, command: DeviceCommand, why: str) -> None:
        """Refuse `command` in place of its asset."""
        sent = self._sent.get(command.command_id)
        reply = self._reply(command, "refused", why[:MOST_DETAIL])
        if sent is not None and sent.command == command:
            sent.reply = reply

    def _assets_on(self, link: Link) -> Iterator[str]:
        return (name for name, other in self._link_of.items() if other is link)

    def _problem_of(self, link: Link) -> str:
        try:
            return link.problem
        except Exception as error:
            return f"{type(error).__name__}: {error}"

    def _fault(self, link: Link, problem: str, error: Exception) -> None:
        text = f"{problem}: {type(error).__name__}: {error}"
        self._say("alarm", link.name, text, f"fault {problem}")


def _links_of_assets(links: Sequence[Link], world: World) -> dict[str, Link]:
    """Return the link of each asset.

    Raises ValueError if a link is given twice, if an asset is on two links, or if an asset is
    missing from the world.
    """
    link_of: dict[str, Link] = {}
    names = [link.name for link in links]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise ValueError(f"{twice} is given twice: give each link once")
    for link in links:
        for name in sorted(link.agents):
            if name not in world.assets:
                raise ValueError(
                    f"{link.name} drives {name}, which is not an asset of this world: "
                    "add it to the world file, or take it off the link"
                )
            if (other := link_of.setdefault(name, link)) is not link:
                raise ValueError(
                    f"{name} is on two links, {other.name} and {link.name}: take it off one of them"
                )
    return link_of

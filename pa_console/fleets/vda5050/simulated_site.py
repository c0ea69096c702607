"""The simulated site: a checkpoint whose assets and cameras are clients on the bus.

Each asset is a VDA 5050 vehicle. The simulated radio connects the asset with its gateway, which is
its client on the bus.
"""

import asyncio
import math
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from time import perf_counter

from pydantic import TypeAdapter, ValidationError

from pa_console.fleets.vda5050.additions import (
    SIGNED,
    SITE,
    TRUST,
    ClockDone,
    ClockMessage,
    Detections,
    IncidentDone,
    IncidentMessage,
    ScenarioNews,
    SeenContact,
    SeenRobot,
    SignedMessage,
    SiteDescription,
)
from pa_console.fleets.vda5050.broker import (
    BrokerAddress,
    Credentials,
    IncomingMessage,
    require_client,
    say_nothing,
)
from pa_console.fleets.vda5050.gateway import Gateway, OnBus, Speaker
from pa_console.fleets.vda5050.vehicle import Verify, anybody
from pa_console.fleets.vda5050.wire import Header, Numbers, Topic, UnreadableError, in_milliseconds
from pa_console.schema.events.event import IncidentHappened, Noticed
from pa_console.schema.incident import Incident
from pa_console.schema.telemetry import AssetTelemetry, Weather
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.sensing_state import Detection

MOST_STEPS_AT_ONCE = 20
"""The largest number of delayed steps that are made up for at once."""

OVERTAKEN_S = 1.0
"""The longest wait of a step for messages that the station sent before it, in seconds."""

UP_S = 10.0
"""The longest wait for the connection of a client, in seconds."""

_INCIDENT: TypeAdapter[Incident] = TypeAdapter(Incident)


@dataclass(frozen=True)
class SiteOptions:
    """The options of a site.

    Its clock runs at `rate` site seconds per real second or, if `paced`, at the station's steps.
    """

    world_sha256: str
    scenario: str = ""
    paced: bool = False
    rate: float = 1.0
    verify: Verify = anybody
    take: Callable[[str], object] = lambda _message: None
    """A function that accepts every signed roster, revocation and takeover from the bus."""
    credentials: Callable[[str], Credentials | None] = lambda _name: None
    """A function that returns the credentials for a client name."""


class SimulatedSite:
    """A simulated `checkpoint` on the bus at `address`."""

    def __init__(
        self, checkpoint: Checkpoint, address: BrokerAddress, options: SiteOptions
    ) -> None:
        """Prepare the clients; raises ValueError if the library for them is not installed."""
        require_client()
        self.checkpoint, self._options = checkpoint, options
        self._world = checkpoint.world
        self._numbers, self._epoch = Numbers(), in_milliseconds(datetime.now(UTC))
        self._step_time = timedelta(seconds=self._world.dt_s / options.rate)
        """The real time between two steps of a site that is not paced."""
        self._due: datetime | None = None
        """The time at which the current step was due; None between steps."""
        self._news = asyncio.Event()
        self._asked: list[Header] = []
        self._weather: Weather = checkpoint.picture().weather

        bus = OnBus(address, self._numbers, self.now, options.credentials)
        self.robots = {
            name: Gateway(name, bus, self._world, checkpoint.send, options.verify)
            for name in self._world.assets
        }
        self._cameras = {name: Speaker(name, bus) for name in self._world.cameras}
        self._site = _SiteSpeaker(bus, self._describe, self._ask, self._hear_signed)

    def now(self) -> datetime:
        """Return the time at the site (UTC)."""
        return self._time_of(self.checkpoint.tick)

    async def run(self) -> None:
        """Run the site until cancelled; raises ValueError if a client cannot connect."""
        asyncio.get_running_loop().set_exception_handler(say_nothing)
        speakers: list[Speaker] = [*self.robots.values(), *self._cameras.values()]
        running = [asyncio.create_task(speaker.client.run()) for speaker in speakers]
        try:
            await self._all_up(speakers)
            for name, telemetry in self.checkpoint.picture().assets.items():
                self._tell_at_once(name, telemetry)
            speakers.append(self._site)
            running.append(asyncio.create_task(self._site.client.run()))
            await self._all_up((self._site,))
            running.append(asyncio.create_task(self._serve()))
            done, _ = await asyncio.wait(running, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            for speaker in speakers:
                await speaker.leave()
            for task in running:
                task.cancel()
            await asyncio.gather(*running, return_exceptions=True)

    async def _all_up(self, speakers: Iterable[Speaker]) -> None:
        for speaker in speakers:
            until = perf_counter() + UP_S
            while not speaker.client.connected:
                if perf_counter() > until:
                    name = speaker.identity.serial_number
                    raise ValueError(
                        f"no broker lets {name} in at {speaker.client.address}: "
                        f"{speaker.client.problem}"
                    )
                await asyncio.sleep(0.02)

    async def _serve(self) -> None:
        """Answer the station's messages, and advance the world if the site is not paced."""
        made = utc_now()
        pause_s = min(self._step_time.total_seconds(), self._world.dt_s)
        while True:
            if self._options.paced:
                await self._news.wait()
            else:
                await asyncio.sleep(pause_s)
            self._news.clear()
            asked, self._asked = self._asked, []
            for message in asked:
                await self._answer(message)
            if not self._options.paced:
                made = self._catch_up(made)

    def _catch_up(self, made: datetime) -> datetime:
        """Make the steps that are due; return the time at which the last one was due.

        `made` is the time at which the previous step was due. Delayed steps, of which a busy
        machine makes several at once, get the times at which they were due. Otherwise, an asset
        would appear to move farther than it can in that time. Steps beyond MOST_STEPS_AT_ONCE are
        skipped, as if the site had been stopped for that time.
        """
        now = utc_now()
        made = max(min(made, now), now - (MOST_STEPS_AT_ONCE + 1) * self._step_time)
        while made + self._step_time <= now:
            made = self._due = made + self._step_time
            self._step()
        self._due = None
        return made

    async def _answer(self, message: Header) -> None:
        match message:
            case ClockMessage() if self._options.paced:
                await self._none_overtaken(message.after)
                while self.checkpoint.tick < message.tick:
                    self._step()
                after = self._numbers.fresh()
                header = self._site.header(ClockDone.TOPIC)
                done = ClockDone(**header, tick=self.checkpoint.tick, after=after)
                self._site.say(done, qos=1)
            case IncidentMessage():
                problem = self._inject(message.incident)
                header = self._site.header(IncidentDone.TOPIC)
                done = IncidentDone(
                    **header, number=message.number, problem=problem, after=self._numbers.fresh()
                )
                self._site.say(done, qos=1)
            case _:
                pass

    async def _none_overtaken(self, after: dict[str, int]) -> None:
        """Wait until the messages in `after` have arrived, for OVERTAKEN_S at most."""
        until = perf_counter() + OVERTAKEN_S
        while not self._numbers.has_seen(after) and perf_counter() < until:
            await asyncio.sleep(0.0005)

    def _step(self) -> None:
        """Advance the world by one step, and publish the reports that reached the gateways."""
        replies = self.checkpoint.step()
        if self.checkpoint.arrived.wired is not None:
            self._look(self.checkpoint.arrived.wired)
        for reply in replies:
            if (robot := self.robots.get(reply.agent)) is not None:
                robot.hear(reply)
        for report in self.checkpoint.arrived.reports:
            sent = self._time_of(report.stamp)
            self._see(report.agent, sent, report.detections)
            self.robots[report.agent].report(report.telemetry.telemetry(), sent)
        for incident in self.checkpoint.take_incidents():
            self._tell(IncidentHappened(incident=incident, source="scenario"))
        for text in self.checkpoint.take_skipped():
            self._tell(Noticed(level="warning", subject="scenario", text=text))
        weather = self.checkpoint.picture().weather
        if weather != self._weather:
            self._weather = weather
            self._describe()

    def _look(self, wired: Mapping[str, tuple[Detection, ...]]) -> None:
        """Publish the detections of every camera."""
        cameras = self.checkpoint.picture().cameras
        for name, speaker in self._cameras.items():
            works = cameras[name].works
            spec = self._world.cameras[name]
            speaker.say(
                Detections(
                    **speaker.header(Detections.TOPIC),
                    works=works,
                    contacts=self._contacts(wired.get(name, ())),
                    team=self._team(spec.at, spec.sensor_range_m) if works else (),
                )
            )

    def _see(self, name: str, sent: datetime, detections: tuple[Detection, ...]) -> None:
        """Publish the detections of an asset at the time `sent`."""
        kind = self._world.assets[name].kind
        robot = self.robots[name]
        if not robot.client.connected or (not detections and kind != "uav"):
            return
        sees = self._world.platforms[kind].sensor_range_m / 2
        team = (
            self._team(self.checkpoint.truth().assets[name].position, sees) if kind == "uav" else ()
        )
        header = robot.header(Detections.TOPIC, sent)
        robot.say(Detections(**header, contacts=self._contacts(detections), team=team))

    def _team(self, at: tuple[float, float], within_m: float) -> tuple[SeenRobot, ...]:
        """Return the assets that a sensor at `at` recognises, which are those within `within_m`."""
        return tuple(
            SeenRobot(name=name, x=asset.position[0], y=asset.position[1])
            for name, asset in self.checkpoint.truth().assets.items()
            if math.dist(at, asset.position) <= within_m
        )

    def _contacts(self, detections: Iterable[Detection]) -> tuple[SeenContact, ...]:
        return tuple(
            SeenContact(
                signature=detection.contact,
                kind=detection.kind,
                x=detection.position[0] if detection.position is not None else None,
                y=detection.position[1] if detection.position is not None else None,
                sigma_m=detection.sigma_m,
                identity=detection.identity,
                opinion=detection.opinion,
                noncombatants=detection.noncombatants,
                emergency=detection.emergency,
                warned_s=None
                if detection.warned_tick is None
                else (self.checkpoint.tick - detection.warned_tick) * self._world.dt_s,
            )
            for detection in detections
        )

    def _inject(self, text: str) -> str:
        """Make an incident happen; return the reason if it cannot, else ""."""
        try:
            incident = _INCIDENT.validate_json(text)
            self.checkpoint.inject(incident)
        except ValidationError:
            return "the site does not know such an incident"
        except ValueError as error:
            return str(error)
        if self.checkpoint.tick == 0:
            for name, telemetry in self.checkpoint.picture().assets.items():
                self._tell_at_once(name, telemetry)
        return ""

    def _tell_at_once(self, name: str, telemetry: AssetTelemetry) -> None:
        """Publish the initial state of an asset, before the first step."""
        robot = self.robots[name]
        if telemetry.comms == "lost":
            robot.cut()
        else:
            robot.report(telemetry, self.now())

    def _tell(self, event: IncidentHappened | Noticed) -> None:
        header = self._site.header(ScenarioNews.TOPIC)
        self._site.say(ScenarioNews(**header, event=event.model_dump_json()), qos=1)

    def _describe(self) -> None:
        self._site.say(
            SiteDescription(
                **self._site.header(SiteDescription.TOPIC),
                world=self._world.name,
                world_sha256=self._options.world_sha256,
                seed=self.checkpoint.seed,
                scenario=self._options.scenario,
                paced=self._options.paced,
                rate=self._options.rate,
                tick=self.checkpoint.tick,
                weather=self._weather,
            ),
            qos=1,
            retain=True,
        )

    def _hear_signed(self, received: IncomingMessage) -> None:
        """Pass a signed message to the vehicles; one that is not valid is ignored."""
        with suppress(UnreadableError):
            self._options.take(SignedMessage.read(received.payload).message)

    def _ask(self, message: Header) -> None:
        self._asked.append(message)
        self._news.set()

    def _time_of(self, tick: int) -> datetime:
        """Return the time of a tick.

        At a paced site, it is counted from the start. Otherwise, it is counted back from the time
        at which the current step was due, so that the real time between steps does not matter.
        """
        if self._options.paced:
            return self._epoch + timedelta(seconds=tick * self._world.dt_s)
        return (self._due or utc_now()) - (self.checkpoint.tick - tick) * self._step_time


def utc_now() -> datetime:
    """Return the time of this machine (UTC)."""
    return datetime.now(UTC)


class _SiteSpeaker(Speaker):
    """The client of the site itself, which receives a station's requests to the simulation.

    The same connection receives the signed messages, because the broker accepts only one connection
    with each certificate.
    """

    HEARS = (ClockMessage, IncidentMessage)

    def __init__(
        self,
        bus: OnBus,
        arrived: Callable[[], None],
        asked: Callable[[Header], None],
        signed: Callable[[IncomingMessage], None],
    ) -> None:
        super().__init__(SITE.serial_number, bus)
        self._arrived, self._asked, self._signed = arrived, asked, signed
        trust = [str(Topic(bus.address.site, TRUST, kind.TOPIC)) for kind in SIGNED]
        self.client.topics = (*self.client.topics, *trust)

    def _heard(self, received: IncomingMessage) -> None:
        topic = Topic.of(received.topic)
        if topic is None or topic.identity != TRUST:
            super()._heard(received)
        else:
            self._signed(received)

    def _take(self, message: Header) -> None:
        self._asked(message)

"""The fleet of a simulated site, with incidents and, if it is paced, the station's clock."""

from collections.abc import Callable
from datetime import datetime, timedelta
from time import monotonic
from typing import TYPE_CHECKING

from pa_console.fleets.vda5050 import additions
from pa_console.fleets.vda5050.additions import SITE
from pa_console.fleets.vda5050.broker import OutgoingMessage
from pa_console.fleets.vda5050.mqtt_fleet import MqttFleet
from pa_console.fleets.vda5050.station_link import JoinedBus
from pa_console.fleets.vda5050.wire import Header, Identity, Topic
from pa_console.schema.incident import Incident, PlaceAsset, unknown_name
from pa_console.schema.world import World

if TYPE_CHECKING:
    from pa_console.fleets.station_authority import StationAuthority

ANSWER_S = 3.0
"""The longest wait for an answer of the site, in seconds."""


class SiteFleet(MqttFleet):
    """The fleet of a simulated site; a paced site advances only with the station's steps."""

    def __init__(
        self,
        world: World,
        joined: JoinedBus,
        site: additions.SiteDescription,
        keys: "StationAuthority | None" = None,
    ) -> None:
        """Join the `site`; raises ValueError if a paced site does not answer."""
        self._site, self._site_tick = site, -1
        self._site_dt_s = world.dt_s
        self._epoch = site.timestamp - timedelta(seconds=site.tick * world.dt_s)
        self._began, self._moved = site.tick, False
        self._after: dict[str, int] = {}
        self._incidents, self._problems = 0, dict[int, str]()
        if site.paced:  # no limit: the station waits for every message of each of its steps
            joined.link.limit = None
        super().__init__(world, joined, keys)
        if site.paced:
            self._move_site(0)
            self._began = self._site_tick
            if self._site_tick < 0:
                self.close()
                raise ValueError("the site does not answer; is another station driving it?")
            self._wait(self._all_heard)
            self._show()

    @property
    def paced(self) -> bool:
        """True if the site waits for the station's steps."""
        return self._site.paced

    @property
    def seed(self) -> int:
        """The seed of the site's random numbers."""
        return self._site.seed

    def now(self) -> datetime:
        """Return the time on the robots' clock (UTC)."""
        if not self._site.paced:
            return super().now()
        ticks = max(self._site_tick, 0)
        return self._epoch + timedelta(seconds=ticks * self._site_dt_s)

    def inject(self, incident: Incident) -> None:
        """Apply `incident` at the site now.

        Raises ValueError for an unknown name (the message lists the known names), and if the site
        refuses the incident or does not answer.
        """
        _, problem = unknown_name(incident, self.world)
        if problem:
            raise ValueError(problem)
        self._incidents += 1
        number = self._incidents
        if self._site.paced and self._site_tick == 0:
            self._reported.begin(0)
        elif isinstance(incident, PlaceAsset):
            self._reported.carried(incident.asset)
        header = self._header(additions.SITE, additions.IncidentMessage.TOPIC)
        self._tell_site(
            additions.IncidentMessage(**header, number=number, incident=incident.model_dump_json())
        )
        self._wait(lambda: number in self._problems and self._numbers.has_seen(self._after))
        self._show()
        problem = self._problems.pop(number, "the site did not answer")
        if problem:
            raise ValueError(problem)

    def _receive(self) -> None:
        if self._site.paced:
            self._move_site(self._began + self._tick)
        super()._receive()

    def _move_site(self, tick: int) -> None:
        """Advance the site to `tick`, and process all messages that it sends until then."""
        header = self._header(additions.SITE, additions.ClockMessage.TOPIC)
        self._moved = False
        message = additions.ClockMessage(**header, tick=tick, after=self._numbers.fresh())
        self._tell_site(message)
        self._wait(lambda: self._moved and self._numbers.has_seen(self._after))

    def _wait(self, done: Callable[[], bool]) -> None:
        """Process messages until `done`, for ANSWER_S at most."""
        until = monotonic() + ANSWER_S
        while True:
            super()._receive()
            left_s = until - monotonic()
            if done() or left_s <= 0.0:
                return
            self._link.wait_news(left_s)

    def _all_heard(self) -> bool:
        online = (robot for robot in self._robots.values() if robot.connection == "ONLINE")
        return all(robot.state is not None for robot in online)

    def _tell_site(self, message: Header) -> None:
        topic = Topic(self._link.address.site, additions.SITE, message.TOPIC)
        self._link.publish(OutgoingMessage(str(topic), message.write(), qos=1))

    def _take_more(self, identity: Identity, message: Header) -> None:
        if identity != additions.SITE:
            super()._take_more(identity, message)
            return
        match message:
            case additions.ClockDone():
                self._site_tick, self._moved = message.tick, True
                self._after = dict(message.after)
            case additions.IncidentDone():
                self._problems[message.number] = message.problem
                self._after = dict(message.after)
            case _:
                super()._take_more(identity, message)

    def _tick_of(self, sent: datetime, arrived: datetime) -> int | None:
        if not self._site.paced:
            return super()._tick_of(sent, arrived)
        ticks = round((sent - self._epoch).total_seconds() / self.world.dt_s) - self._began
        return ticks if ticks <= self._tick else None


def fleet_of(
    joined: JoinedBus, world: World, world_sha256: str, keys: "StationAuthority | None" = None
) -> MqttFleet:
    """Return the fleet of `world` on the bus that was joined.

    Raises ValueError, and leaves the bus, if a site there is not running or has another world.
    """
    site = joined.site
    if site is None:
        return MqttFleet(world, joined, keys)
    if SITE not in joined.online:
        joined.link.close()
        raise ValueError(f"the site of {site.world!r} at {joined.link.address} is not running now")
    if site.world_sha256 != world_sha256:
        joined.link.close()
        raise ValueError(
            f"the site on this bus has another world: {site.world!r}, whose file has the "
            f"SHA-256 {site.world_sha256[:12]}; ours has {world_sha256[:12]}; give its --world"
        )
    return SiteFleet(world, joined, site, keys)

"""A session and its site on a TAK map, drawn from events without delaying the session.

An old report never looks fresh. The `time` of an event is the time of the asset's report or of the
track's last detection; its `stale` is later by the `stale_s` of the world. A thing that becomes
silent is sent once more, already stale, and then not again until its next report.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from threading import Condition, Thread
from typing import Literal, Protocol, Self
from xml.etree.ElementTree import Element

from pydantic import TypeAdapter, ValidationError

from pa_console.schema.base import Name, Point
from pa_console.schema.events.event import Event, SessionEnded, TelemetryReceived
from pa_console.schema.telemetry import AssetTelemetry, Picture, Track
from pa_console.schema.world import PLAIN_KINDS, AssetKind, World
from pa_console.sim.worlds.geography import Geography
from pa_console.tak.cot_event import (
    AFFILIATIONS,
    UNKNOWN,
    CotEvent,
    CotPoint,
    How,
    deletion,
    element,
)

SHAPE, SPOT = "u-d-f", "b-m-p-s-m"
SPOT_ICONS = "COT_MAPPING_SPOTMAP"
"""The icon set of ATAK for points."""
WHITE, RED, CYAN = 0xFFFFFFFF, 0xFFFF0000, 0xFF00FFFF
FILLED = 0x40FFFFFF
"""A mask that reduces a colour to a quarter of its opacity, for fills."""
TRACK_FUNCTIONS = {"vehicle": "G-E-V", "person": "G-U"}
YELLOW = 0xFFFFFF00
DRAWN_S = 600.0
"""The validity of the ground on the map, in seconds; it is drawn again in half the time."""
DRAWING_S = 3.0
"""The longest wait at the end for a picture that is being drawn, in seconds."""


@dataclass(frozen=True)
class SiteOnMap:
    """A world, its place on the earth, and the names of its things on the map.

    Every uid begins with `name`. A `replay` differs from a live session in uid, callsign and `how`.
    """

    world: World
    geography: Geography
    name: str
    replay: bool = False

    def uid(self, *parts: str) -> str:
        """Return the uid of a thing of this site, which is always the same."""
        return ".".join(("pa-console-replay" if self.replay else "pa-console", self.name, *parts))

    def callsign(self, name: str) -> str:
        """Return the label of a thing."""
        return f"REPLAY {name}" if self.replay else name

    @property
    def how(self) -> How:
        """The source of the positions."""
        return "m-s" if self.replay else "m-g"

    def point(self, at: Point, ce: float = UNKNOWN, *, flies: bool = False) -> CotPoint:
        """Return `at` as a TAK point with error `ce`; if `flies`, its height is unknown."""
        latitude, longitude = self.geography.degrees(at)
        altitude = self.geography.altitude
        hae = UNKNOWN if flies or altitude is None else altitude
        return CotPoint(latitude, longitude, hae, ce)

    def shape(
        self,
        uid: str,
        callsign: str,
        points: Sequence[Point],
        colour: int,
        until: tuple[datetime, datetime],
        *,
        closed: bool = False,
        remarks: str = "",
    ) -> CotEvent:
        """Return a line, or a polygon if `closed`; `until` is (time, stale)."""
        way = [*points, points[0]] if closed else list(points)
        detail: list[Element] = []
        for latitude, longitude in map(self.geography.degrees, way):
            detail.append(element("link", {"point": f"{latitude:.8f},{longitude:.8f}"}))
        detail.append(element("strokeColor", {"value": signed(colour)}))
        detail.append(element("strokeWeight", {"value": "3.0"}))
        if closed:
            detail.append(element("fillColor", {"value": signed(colour & FILLED)}))
        detail.append(element("labels_on", {"value": "true"}))
        detail.append(element("contact", {"callsign": self.callsign(callsign)}))
        detail.append(element("remarks", {}, remarks))
        middle = (sum(x for x, _ in points) / len(points), sum(y for _, y in points) / len(points))
        at = self.point(middle if closed else points[0])
        return CotEvent(uid, SHAPE, *until, at, self.how, tuple(detail))

    def ground(self, now: datetime, stale: datetime) -> list[CotEvent]:
        """Return the perimeter, the zones and the frames."""
        until, world = (now, stale), self.world
        area = self.uid("perimeter")
        drawn = [self.shape(area, world.title, world.perimeter, CYAN, until, closed=True)]
        for name, zone in world.zones.items():
            uid, says = self.uid("zone", name), f"{zone.kind} zone"
            drawn.append(self.shape(uid, name, zone.polygon, RED, until, closed=True, remarks=says))
        for name, frame in world.frames.items():
            detail = (
                element("contact", {"callsign": self.callsign(name)}),
                element("color", {"argb": signed(WHITE)}),
                element("usericon", {"iconsetpath": f"{SPOT_ICONS}/{SPOT}/{signed(WHITE)}"}),
                element("remarks", {}, f"{frame.kind}, {frame.radius_m:g} m around this point"),
            )
            at = self.point(frame.at, frame.radius_m)
            drawn.append(CotEvent(self.uid("frame", name), SPOT, *until, at, self.how, detail))
        return drawn

    def ground_deleted(self, now: datetime) -> list[CotEvent]:
        """Return the events that remove the ground from the map."""
        return [deletion(event.uid, event.type, now) for event in self.ground(now, now)]


def site_name(text: str) -> str:
    """Return `text` as the name of a site; raise ValueError for an invalid one."""
    try:
        return TypeAdapter[str](Name).validate_python(text)
    except ValidationError:
        raise ValueError(f"--name {text}: letters, digits and _ after a letter") from None


def signed(argb: int) -> str:
    """Return a colour in ATAK's form: a signed number of 32 bits."""
    return str(argb - (1 << 32) if argb >= 1 << 31 else argb)


Affiliation = Literal["f", "n", "s", "u"]
ASSET_TYPES: dict[AssetKind, str] = {
    "uav": "a-f-A-M-H-Q",
    "ugv": "a-f-G-E-V-U",
    "robot": "a-f-G-E-V",
}
"""CoT types according to MIL-STD-2525: a rotary-wing UAV, a utility vehicle, a ground vehicle.

MIL-STD-2525 has no unmanned ground vehicle.
"""


def affiliation(track: Track) -> Affiliation:
    """Return the affiliation of a track from its identification and the sensors.

    Hostile (`h`) is never returned, because another user's map may show it as a target. The remarks
    of the track have its intent in words.
    """
    if track.intent == "hostile":
        return "s"
    if track.noncombatants or track.emergency:
        return "n"
    if track.identity == "authorized":
        return "f"
    if track.identity == "unauthorized":
        return "s"
    return "n" if track.intent == "benign" else "u"


def track_type(track: Track) -> str:
    """Return the CoT type of a track."""
    return f"a-{affiliation(track)}-{TRACK_FUNCTIONS[track.kind]}"


class PictureOnMap:
    """The state of the map: the things that are shown or stale on it."""

    def __init__(self, site: SiteOnMap, pace: float = 1.0) -> None:
        """Show `pace` seconds of the session in one second of the map."""
        self._site, self._pace = site, pace
        self._stale: set[str] = set()
        self._shown: dict[str, str] = {}
        """The type of every track and route on the map, by uid."""

    def events(self, picture: Picture, now: datetime) -> list[CotEvent]:
        """Return the events that update the map to `picture` at the time `now`."""
        result: list[CotEvent] = []
        seen: dict[str, str] = {}
        for asset in picture.assets.values():
            event, fresh = self._asset(asset, picture, now)
            result += self._once_stale(event, fresh=fresh)
            if asset.route and fresh:
                route = self._route(asset, event)
                seen[route.uid] = route.type
                result.append(route)
        for track in picture.tracks.values():
            event, fresh = self._track(track, picture, now)
            seen[event.uid] = event.type
            result += self._once_stale(event, fresh=fresh)
        gone = [deletion(uid, kind, now) for uid, kind in self._shown.items() if uid not in seen]
        self._stale -= {event.subject for event in gone}
        self._shown = seen
        return [*gone, *result]

    def deleted(self, now: datetime) -> list[CotEvent]:
        """Return the events that remove every track and route from the map."""
        gone = [deletion(uid, kind, now) for uid, kind in self._shown.items()]
        self._shown = {}
        return gone

    def _once_stale(self, event: CotEvent, *, fresh: bool) -> list[CotEvent]:
        """Return the event, or nothing if it is stale and was already sent as stale."""
        if fresh:
            self._stale.discard(event.uid)
            return [event]
        if event.uid in self._stale:
            return []
        self._stale.add(event.uid)
        return [event]

    def _times(
        self, stamp_s: float, picture: Picture, now: datetime, *, stale: bool
    ) -> tuple[datetime, datetime, bool]:
        """Return the time of a report, the end of its validity, and whether it is fresh."""
        age_s = max(picture.time_s - stamp_s, 0.0) / self._pace
        time = now - timedelta(seconds=age_s)
        until = time + timedelta(seconds=self._site.world.stale_s)
        fresh = until > now and not stale
        return time, until if fresh else min(until, now), fresh

    def _asset(
        self, asset: AssetTelemetry, picture: Picture, now: datetime
    ) -> tuple[CotEvent, bool]:
        silent = asset.stale or asset.comms == "lost"
        time, until, fresh = self._times(asset.stamp_s, picture, now, stale=silent)
        site = self._site
        course = site.geography.course(asset.heading_deg)
        battery = f"{asset.battery_pct:.0f}"
        detail = (
            element("contact", {"callsign": site.callsign(asset.id)}),
            element("status", {"battery": battery}),
            element("track", {"course": f"{course:.1f}", "speed": f"{asset.speed_mps:.2f}"}),
            element("remarks", {}, asset_words(asset, picture.time_s)),
        )
        at = site.point(asset.position, flies=asset.kind == "uav")
        uid, kind = site.uid(asset.id), ASSET_TYPES[asset.kind]
        return CotEvent(uid, kind, time, until, at, site.how, detail), fresh

    def _track(self, track: Track, picture: Picture, now: datetime) -> tuple[CotEvent, bool]:
        time, until, fresh = self._times(track.stamp_s, picture, now, stale=track.stale)
        site = self._site
        course = site.geography.course(track.heading_deg)
        detail = (
            element("contact", {"callsign": site.callsign(track.id)}),
            element("track", {"course": f"{course:.1f}", "speed": f"{track.speed_mps:.2f}"}),
            element("remarks", {}, track_words(track, picture.time_s)),
        )
        at = site.point(track.position, track.uncertainty_m or UNKNOWN)
        uid, kind = site.uid("track", track.id), track_type(track)
        return CotEvent(uid, kind, time, until, at, site.how, detail), fresh

    def _route(self, asset: AssetTelemetry, event: CotEvent) -> CotEvent:
        """Return the rest of an asset's route, which becomes stale together with the asset."""
        return self._site.shape(
            self._site.uid("route", asset.id),
            f"{asset.id} route",
            (asset.position, *asset.route),
            YELLOW,
            (event.time, event.stale),
            remarks=f"{asset.id}, {asset.task}{f' to {asset.post}' if asset.post else ''}",
        )


def asset_words(asset: AssetTelemetry, now_s: float) -> str:
    """Return an asset's task and its doubtful values in words."""
    words = [PLAIN_KINDS[asset.kind], asset.task]
    if asset.at:
        words.append(f"at {asset.at}")
    if asset.post and asset.post != asset.at:
        words.append(f"posted to {asset.post}")
    if asset.status != "ok":
        words.append(asset.status)
    if asset.manual:
        words.append("under manual control")
    if asset.low_battery:
        words.append("battery low")
    if asset.comms != "ok":
        words.append(f"link {asset.comms}")
    if asset.integrity == "suspect":
        words.append("its position is in doubt")
    if asset.stale or asset.comms == "lost":
        words.append(f"no report for {max(now_s - asset.stamp_s, 0.0):.0f} s")
    return ", ".join(words)


def track_words(track: Track, now_s: float) -> str:
    """Return the facts about a track in words, with their sources and age."""
    words = [f"{AFFILIATIONS[affiliation(track)]} {track.kind}", f"{track.status}, {track.gate}"]
    words.append(f"identity {track.identity}")
    if track.dispute:
        words.append(track.dispute)
    if track.intent != "unknown":
        by = f" by {', '.join(track.hostile_by)}" if track.hostile_by else ""
        words.append(f"intent {track.intent}{by}")
    if track.emergency:
        words.append("emergency vehicle")
    if track.noncombatants:
        words.append("noncombatants suspected")
    if track.warned:
        words.append("went on after a warning" if track.defiant else "warned")
    if track.seen_by:
        words.append(f"seen by {', '.join(track.seen_by)}")
    if track.stale:
        words.append(f"not detected for {max(now_s - track.stamp_s, 0.0):.0f} s")
    return ", ".join(words)


class Receiver(Protocol):
    """A sink of CoT events, such as a connection."""

    connections: int

    def send(self, events: Iterable[CotEvent]) -> None:
        """Accept `events`; return at once."""
        ...


class SessionOnMap:
    """The events for a receiver from a session's pictures, at most one picture in `every_s`.

    An event is never newer than this machine's clock, so that a station's fast clock cannot make a
    report look fresh.
    """

    def __init__(
        self,
        site: SiteOnMap,
        receiver: Receiver,
        every_s: float = 1.0,
        pace: float = 1.0,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        """Show `pace` seconds of the session in one second of the map."""
        self._site, self._receiver, self._now = site, receiver, now
        self._picture = PictureOnMap(site, pace)
        self._every = timedelta(seconds=min(every_s, site.world.stale_s / 2))
        self._last: datetime | None = None
        self._drawn: tuple[int, datetime] | None = None

    def take(self, event: Event) -> None:
        """Process one event of the session; only pictures and the end are shown."""
        match event.data:
            case TelemetryReceived(picture=picture):
                moment = min(event.t, self._now())
                # If the clock was set back, the difference is negative, and the picture is shown.
                if self._last is not None and timedelta() <= moment - self._last < self._every:
                    return
                self._last = moment
                self._receiver.send([*self._ground(moment), *self._picture.events(picture, moment)])
            case SessionEnded():
                self.end()
            case _:
                pass

    def end(self) -> None:
        """Remove tracks, routes and the ground from the map; assets become stale by themselves."""
        now = self._now()
        drawn = self._site.ground_deleted(now) if self._drawn is not None else []
        self._drawn = None
        self._receiver.send([*self._picture.deleted(now), *drawn])

    def _ground(self, now: datetime) -> list[CotEvent]:
        """Return the ground after each new connection, and again before it becomes stale."""
        connections = self._receiver.connections
        if self._drawn is not None:
            before, at = self._drawn
            if before == connections and now - at < timedelta(seconds=DRAWN_S / 2):
                return []
        self._drawn = connections, now
        return self._site.ground(now, now + timedelta(seconds=DRAWN_S))


class InBackground:
    """A thread that passes the pictures and the end of a session to `show` in its `with` block.

    If several pictures wait, only the newest is shown, so that the session never waits. An error of
    `show` ends the thread and is passed to `tell` in one line.
    """

    def __init__(self, show: Callable[[Event], object], tell: Callable[[str], object]) -> None:
        self._show, self._tell = show, tell
        self._picture: Event | None = None
        self._end: Event | None = None
        self._over = False
        self._news = Condition()
        self._thread = Thread(target=self._run, name="tak pictures", daemon=True)

    def take(self, event: Event) -> None:
        """Accept one event of the session; return at once."""
        match event.data:
            case TelemetryReceived():
                with self._news:
                    self._picture = event
                    self._news.notify()
            case SessionEnded():
                with self._news:
                    self._end = event
                    self._news.notify()
            case _:
                pass

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_error: object) -> None:
        with self._news:
            self._over = True
            self._news.notify()
        self._thread.join(DRAWING_S)

    def _run(self) -> None:
        try:
            while waiting := self._next():
                for event in waiting:
                    self._show(event)
        except Exception as error:  # an error on the map must not end the session
            self._tell(f"nothing more is shown: {type(error).__name__}: {error}")

    def _next(self) -> list[Event]:
        """Wait for events to show and return them; return none at the end."""
        with self._news:
            self._news.wait_for(lambda: self._picture or self._end or self._over)
            waiting = [event for event in (self._picture, self._end) if event is not None]
            self._picture = self._end = None
        return waiting

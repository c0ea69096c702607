"""The common base of fleets that rely on reports: picture, clock, notices and replies."""

from pa_console.fleets.reported_picture import ReportedPicture
from pa_console.fleets.reports import Belief, Notices, SensorReport
from pa_console.schema.command import CommandReply, DeviceCommand, ReplyStatus
from pa_console.schema.events.event import Level
from pa_console.schema.telemetry import Picture, Weather
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint


class ReportedFleet:
    """The picture, the clock, the notices and the replies of a fleet that relies on reports."""

    _replies: list[CommandReply]
    _tick: int
    _weather: Weather = "clear"

    def __init__(self, reported: ReportedPicture) -> None:
        self._reported, self._tick = reported, 0
        self._notices, self._replies = Notices(), []
        self._belief = Belief(reported.world.dt_s, self._say)

    @property
    def world(self) -> World:
        """The world of the fleet."""
        return self._reported.world

    @property
    def tick(self) -> int:
        """The number of steps since the session began."""
        return self._tick

    @property
    def time_s(self) -> float:
        """The seconds since the session began, on the station's clock."""
        return self._reported.terrain.seconds(self._tick)

    def picture(self) -> Picture:
        """Return the latest picture; a new one is built every `world.telemetry_period_s`."""
        return self._reported.picture()

    def forecast(self) -> Checkpoint:
        """Return a simulation from the picture and the world only."""
        return self._reported.forecast()

    def mark_manual(self, assets: frozenset[str]) -> None:
        """Show `assets`, and no others, as under manual control from this station, at once."""
        self._reported.mark_manual(assets)
        self._show()

    def _show(self) -> None:
        """Rebuild the picture, and report the senders of messages that had to be left out."""
        for name in dict.fromkeys(self._reported.show(self._weather)):
            text = "its reports cannot be shown in any picture and are set aside"
            self._say("alarm", name, text, "fault picture")

    def _take_sensor(self, stamp: int | None, seen: SensorReport, rate: float = 1.0) -> None:
        """Process detections of tick `stamp`, unless they are too old.

        Detections from before the session are ignored, because sensors repeat those that are still
        valid.
        """
        name = seen.sensor
        if stamp is not None and self._belief.is_recent(name, self._tick - stamp, rate):
            for aside in self._reported.detect(stamp, seen) if stamp >= 0 else ():
                self._say("alarm", aside.sensor, aside.text, aside.kind)

    def _reply(self, command: DeviceCommand, status: ReplyStatus, detail: str) -> CommandReply:
        """Return a reply to `command`; the next step returns it as well."""
        reply = CommandReply(
            command_id=command.command_id,
            agent=command.agent,
            status=status,
            tick=self._tick,
            detail=detail,
        )
        self._replies.append(reply)
        return reply

    def _say(self, level: Level, subject: str, text: str, kind: str = "") -> None:
        self._notices.say(level, subject, text, self.time_s, kind)

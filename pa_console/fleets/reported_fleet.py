"""The parts that fleets share which go by reports: one picture, one clock, notices, replies."""

from pa_console.fleets.reported_picture import ReportedPicture
from pa_console.fleets.reports import Belief, Notices, SensorReport
from pa_console.schema.command import CommandReply, DeviceCommand, ReplyStatus
from pa_console.schema.events.event import Level
from pa_console.schema.telemetry import Picture, Weather
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint


class ReportedFleet:
    """The picture, the clock, the notices and the replies of a fleet that goes by reports.

    `_tick` counts its steps; `now` is the clock of its robots.
    """

    _replies: list[CommandReply]
    _tick: int
    _weather: Weather = "clear"

    def __init__(self, known: ReportedPicture) -> None:
        self._known, self._tick = known, 0
        self._told, self._replies = Notices(), []
        self._belief = Belief(known.world.dt_s, self._say)

    @property
    def world(self) -> World:
        """The world of the fleet."""
        return self._known.world

    @property
    def tick(self) -> int:
        """Steps taken since the session began."""
        return self._tick

    @property
    def time_s(self) -> float:
        """Seconds on the station's clock since the session began."""
        return self._known.terrain.seconds(self._tick)

    def picture(self) -> Picture:
        """Return the picture as it was made last, every `world.telemetry_period_s`."""
        return self._known.picture()

    def forecast(self) -> Checkpoint:
        """Return a simulation of what the picture shows, built from it and the world alone."""
        return self._known.forecast()

    def mark_manual(self, assets: frozenset[str]) -> None:
        """Show `assets`, and no others, as taken under manual control at this station; at once."""
        self._known.mark_manual(assets)
        self._show()

    def _show(self) -> None:
        """Make the picture anew, and name those whose reports it had to be made without."""
        for name in dict.fromkeys(self._known.show(self._weather)):
            text = "what it reports cannot be shown in any picture and is set aside"
            self._say("alarm", name, text, "fault picture")

    def _take_sensor(self, stamp: int | None, seen: SensorReport, rate: float = 1.0) -> None:
        """Take in detections of tick `stamp`, unless they are too old.

        What sensors saw before the session began, they report again by now.
        """
        name = seen.sensor
        if stamp is not None and self._belief.is_recent(name, self._tick - stamp, rate):
            for aside in self._known.detect(stamp, seen) if stamp >= 0 else ():
                self._say("alarm", aside.sensor, aside.text, aside.kind)

    def _reply(self, command: DeviceCommand, status: ReplyStatus, detail: str) -> CommandReply:
        """Return an answer to `command`, which the next step passes on."""
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
        self._told.say(level, subject, text, self.time_s, kind)

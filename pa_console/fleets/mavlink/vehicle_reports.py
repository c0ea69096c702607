"""The processing of one vehicle's MAVLink messages: its state, its readiness, and notices."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from typing import Any

from pa_console.fleets.link import LinkNews, LinkNotice
from pa_console.fleets.mavlink import commands
from pa_console.fleets.mavlink.ardupilot import BATTERY
from pa_console.fleets.mavlink.commands import Autopilot, MavItem
from pa_console.fleets.mavlink.drone_state import PREARM, DroneState
from pa_console.fleets.mavlink.geofence import FenceWatch, fence_of
from pa_console.fleets.mavlink.vehicles_file import MavlinkVehicles
from pa_console.fleets.readiness import Readiness
from pa_console.schema.base import Point
from pa_console.schema.command import DeviceCommand
from pa_console.schema.events.event import Level
from pa_console.schema.world import AssetKind
from pa_console.sim.worlds.geography import Geography
from pa_console.sim.worlds.terrain import Terrain

CHECK_AGAIN_S = 5.0
"""The time between two requests for the reasons of a vehicle that does not arm, in seconds."""

REPEAT_TEXT_S = 30.0
"""The least time between two equal notices, in seconds."""

MOST_TEXTS = 512
"""The largest number of different notices in REPEAT_TEXT_S; further ones are dropped."""

COMPLETE_S = 5.0
"""The longest wait for the battery level and the landed state, in seconds; both are optional."""

NO_ESTIMATE = "it has no position estimate yet"


class ReportingVehicle(ABC):
    """The state of the asset `agent` from its messages; `tell` gets its notices and readiness."""

    def __init__(
        self,
        agent: str,
        autopilot: Autopilot,
        *,
        terrain: Terrain,
        geography: Geography,
        vehicles: MavlinkVehicles,
        tell: Callable[[LinkNews], None],
        now: Callable[[], float],
    ) -> None:
        """Take the time in seconds from `now`, a monotonic clock."""
        self.agent, self.heard = agent, True
        """`heard` is False while no heartbeats arrive."""
        self._terrain, self._geography = terrain, geography
        self._autopilot, self._tell, self._now = autopilot, tell, now
        self._kind = self._found_kind = vehicles.vehicles[agent].kind
        self.state = DroneState(geography, ground_bound=self._kind == "ugv")
        self.readiness, self._checks_s = Readiness(agent, tell), 0.0
        areas = fence_of(terrain.world, geography)
        self.fence = FenceWatch(areas, geography, autopilot, self._say, vehicles.fence_check_s)
        self._texts: dict[str, float] = {}
        """The times of recent notices, by their texts."""
        self._told_once: set[str] = set()
        self._first_s: float | None = None
        self._known_healthy = False

    @abstractmethod
    def _seen(self) -> None:
        """React to a new position."""

    @abstractmethod
    def _give_up(self, why: str) -> None:
        """End the current order, if there is one, as failed."""

    def fence_read(self, problem: str, items: Sequence[MavItem]) -> None:
        """Process the vehicle's geofence, or the reason why it could not be read."""
        self.fence.read(problem, items, self._now())

    def fence_uploaded(self, problem: str) -> None:
        """Process the result of the upload of a geofence."""
        self.fence.uploaded(problem, self._now())

    def home_at(self, latitude: float, longitude: float) -> None:
        """Process the home position, where the vehicle returns; warn if it is not at the base."""
        home = self._geography.near(latitude, longitude)
        if home is None:
            return
        self.state.home, world = home, self._terrain.world
        if self._terrain.frame_at(*home) != world.base:
            away = math.dist(home, world.frames[world.base].at)
            text = f"has its home {away:.0f} m from {world.base}, and returns there"
            self._say_now_and_then("warning", text)

    def positioned(self, message: Mapping[str, Any], arrived: datetime) -> None:
        """Process a GLOBAL_POSITION_INT, and react to a new position or a restart."""
        if self.state.clock.restarted(int(message["time_boot_ms"]) / 1e3):
            self._say("alarm", "has started again")
            self.fence.start_again()
            self.state.fix = None
            if self.state.may_arm:
                self.state.may_arm = False
            self._autopilot.ask_again()
            self._give_up("it has started again")
        state, before = self.state, self.state.fix
        if problem := state.positioned(message, arrived):
            self._say_now_and_then("alarm", f"{problem}: ignored")
        elif state.fix is not None and state.fix is not before and self._complete():
            self._seen()

    def is_a(self, kind: AssetKind) -> None:
        """Process the kind of vehicle in a heartbeat; report a kind that differs from the file."""
        if kind != self._found_kind:
            self._found_kind = kind
            if kind != self._kind:
                text = f"is a {kind} by its heartbeat and a {self._kind} in the file: no orders"
                self._say("alarm", text)

    def checked(self, may_arm: bool) -> None:
        """Record whether the vehicle's own checks allow arming."""
        self.state.may_arm = may_arm

    def lacks(self, messages: str) -> None:
        """Report the requested messages that do not arrive."""
        self._say_now_and_then("warning", f"does not send {messages}")

    def mode_changed(self, mode: str) -> None:
        """Process the flight mode, by mavsdk's name, which arrives with every heartbeat."""
        was_manual, self.state.mode, self.state.mode_s = self.state.manual, mode, self._now()
        self._look_for_pilot(was_manual)

    def heartbeat(self, base_mode: int, system_state: int) -> None:
        """Process the flags of a heartbeat."""
        was_manual, armed_flag, self.heard = self.state.manual, 128, True
        self.state.armed, self.state.beats = bool(base_mode & armed_flag), True
        self.state.system_state = system_state
        self._look_for_pilot(was_manual)

    def health(self, ok: bool) -> None:
        """Process the health of the sensors; in the first seconds, bad health is ignored.

        In this time, the autopilot has not yet reported on all sensors.
        """
        since_s = self._now() - self._first_s if self._first_s is not None else 0.0
        self._known_healthy |= ok
        self.state.healthy = ok or not (self._known_healthy or since_s > COMPLETE_S)

    def said(self, message: Mapping[str, Any]) -> None:
        """Process a STATUSTEXT; warnings are reported to the operator."""
        line, warning = self.state.said(message, self._now()), 4
        # The asset's card on the screen shows the reasons for not arming while they last.
        if line is not None and line.severity <= warning and not line.text.startswith(PREARM):
            level = "alarm" if line.severity < warning else "warning"
            self._say_now_and_then(level, f"says: {line.text}")

    def _defect(self) -> str:
        """Return why the vehicle accepts only a report and a hold; '' if this does not apply."""
        if self._found_kind != self._kind:
            return f"it is a {self._found_kind} by its heartbeat, and a {self._kind} in the file"
        if not self._complete():
            return "it has not reported everything yet: its position, its mode, whether it flies"
        return "it reports an emergency" if self.state.status == "failed" else ""

    def _why_grounded(self, command: DeviceCommand) -> str:
        """Return why the vehicle cannot start to move; '' if it can."""
        state = self.state
        goes_home = command.verb == "return_to_base" and not state.landed
        if self.fence.problem and not goes_home:
            return f"{self.fence.problem}: it may not start a flight"
        if state.parked and (why := state.prearm_problem(self._now())):
            return f"not ready: {why}"
        return ""

    def _note_readiness(self, now: float) -> None:
        """Update the reasons why the vehicle cannot start yet; ask the vehicle for its own."""
        state = self.state
        parts: list[str] = []
        if self.heard and state.parked:
            parts = [] if state.fix is not None else [NO_ESTIMATE]
            if problem := state.prearm_problem(now):
                parts.append(problem)
                if now - self._checks_s >= CHECK_AGAIN_S:
                    self._checks_s = now
                    self._autopilot.send(commands.CHECK_AGAIN, 0)
            if not parts and self.fence.pending:
                parts.append(self.fence.problem)
        self.readiness.note(parts)

    def _why_no_fence(self, at: Point) -> str:
        """Return why the geofence of a vehicle `at` a place may not be replaced; '' if it may."""
        if self.state.manual:
            return f"a pilot flies it ({self.state.mode})"
        if not self.state.landed and self._terrain.depth(at) < 0.0:
            return "it flies outside the perimeter"
        return ""

    def _look_for_pilot(self, was_manual: bool) -> None:
        """Report a change of manual control; end the order if a pilot has taken over."""
        if was_manual is self.state.manual:
            return
        if self.state.manual:
            self._say("warning", f"is flown by a pilot ({self.state.mode})")
            self._give_up(f"a pilot has taken over ({self.state.mode})")
        else:
            self._say("info", f"is no longer flown by a pilot ({self.state.mode})")

    def _with_words(self, problem: str, since_s: float) -> str:
        words = "; ".join(list(dict.fromkeys(self.state.reasons(since_s)))[:2])
        return f"{problem}: {words}" if words else problem

    def _say_now_and_then(self, level: Level, text: str) -> None:
        """Emit a notice, unless an equal one was emitted within REPEAT_TEXT_S."""
        now, texts = self._now(), self._texts
        for old in [old for old, at_s in texts.items() if now - at_s > REPEAT_TEXT_S]:
            del texts[old]
        if text not in texts and len(texts) < MOST_TEXTS:
            texts[text] = now
            self._say(level, text)

    def _complete(self) -> bool:
        """Return whether position, mode, landed state and battery level are known.

        The last two are not waited for after COMPLETE_S.
        """
        state, now = self.state, self._now()
        if state.fix is None or not state.mode_s or not state.beats:
            return False
        self._first_s = now if self._first_s is None else self._first_s
        if state.battery_pct is not None and state.on_ground is not None:
            return True
        if now - self._first_s < COMPLETE_S:
            return False
        if state.battery_pct is None:
            remedy = f": set {BATTERY}" if self._autopilot.kind == "ardupilot" else ""
            text = f"does not report its battery, which counts as low{remedy}"
            if text not in self._told_once:
                self._told_once.add(text)
                self._say("warning", text)
        return True

    def _say(self, level: Level, text: str) -> None:
        self._tell(LinkNotice(level, self.agent, text))

    def _at_base(self) -> bool:
        fix, world = self.state.fix, self._terrain.world
        return fix is not None and self._terrain.frame_at(*fix.at) == world.base

    def _words(self) -> str:
        """Return a short report of the vehicle: place, height, mode, battery and geofence."""
        fix, state = self.state.fix, self.state
        if fix is None:
            return "it has not reported its position"
        at = self._terrain.frame_at(*fix.at)
        battery = f"{state.battery_pct:.0f} %" if state.battery_pct is not None else "unknown"
        fence = self.fence.problem or "geofence as in the world"
        return (
            f"{f'at {at}' if at else 'between frames'}, {fix.altitude_m:.0f} m up, {state.mode}, "
            f"{'armed' if state.armed else 'disarmed'}, battery {battery}, {fence}"
        )

"""The connection to one vehicle through mavsdk.

The vehicle's messages are passed to its `Flight`, and the flight's requests are sent to it. mavsdk
calls back on its own threads. The callbacks only hand their work over with `post`.
"""

import json
import math
import struct
import time
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from functools import partial
from typing import Any, Protocol, cast

from mavsdk.autopilot import Autopilot as Family
from mavsdk.plugins.action import Action, ActionResult
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkDirectError, MavlinkMessage
from mavsdk.plugins.mission_raw import MissionItem, MissionRaw, MissionRawResult
from mavsdk.plugins.telemetry import LandedState, Telemetry
from mavsdk.system import System

from pa_console.fleets.mavlink import ardupilot
from pa_console.fleets.mavlink.commands import ACCEPTED, RESULTS, Cmd, Kind, MavCommand, MavItem
from pa_console.fleets.mavlink.flight import Flight
from pa_console.fleets.mavlink.messages import POSITION, RequestedMessages, needed_messages
from pa_console.schema.world import AssetKind

Post = Callable[[Callable[[], object]], None]
"""A function that passes work to the link's own thread."""

AUTOPILOT = 1
"""The component id of an autopilot; cameras and radios of the same vehicle are ignored."""

FENCE, MISSION = 1, 0
PX4_FENCE_ACTION, FENCE_ACTION, FENCE_TYPE = "GF_ACTION", "FENCE_ACTION", "FENCE_TYPE"
PX4_ACTS = (2, 3, 4, 5)
"""PX4's actions at the fence that take effect: hold, return, terminate, land (1 only warns)."""

PREARM_CHECK = 0x1000_0000
"""The bit of SYS_STATUS for the checks before arming."""

SENSORS = 0x0020_002F
"""The bits of SYS_STATUS for gyroscopes, accelerometers, magnetometer, barometer, GPS and position.

The last one is the estimate of the position.
"""

UNANSWERED = frozenset((ActionResult.TIMEOUT, ActionResult.BUSY, ActionResult.CONNECTION_ERROR))


class _Arguments(Protocol):
    def __call__(self, value: Any, _data: Any) -> None: ...


class MavsdkAutopilot:
    """A vehicle that mavsdk has found; after `listen`, a flight receives its messages."""

    def __init__(self, system: System, post: Post, asset_kind: AssetKind, rate_hz: float) -> None:
        """Prepare to request positions at `rate_hz`; `listen` starts the requests."""
        self._system, self._post = system, post
        self._stands = float(ardupilot.STANDS[asset_kind])
        needed = needed_messages(asset_kind, 1.0 / rate_hz)
        self.messages = RequestedMessages(needed, time.monotonic())
        self.parameters: dict[str, float] = {}
        """The values of the parameters that have been read."""
        self._unnamed = frozenset[str]()
        self._telemetry, self._action = Telemetry(system), Action(system)
        self._mission, self._direct = MissionRaw(system), MavlinkDirect(system)
        self.system_id: int = system.get_system_id()
        self._flight: Flight  # set by `listen`, before any subscription or request

    @property
    def kind(self) -> Kind:
        """The family of the autopilot, by its heartbeat."""
        family = self._system.autopilot_type()
        if family == Family.PX4:
            return "px4"
        return "ardupilot" if family == Family.ARDUPILOT else "other"

    @property
    def connected(self) -> bool:
        """True while heartbeats of the vehicle arrive."""
        return bool(self._system.is_connected())

    def listen(self, flight: Flight) -> None:
        """Pass the vehicle's messages to `flight`, and request all needed messages."""
        self._flight, telemetry = flight, self._telemetry
        self._subscribe("STATUSTEXT", flight.said)
        self._subscribe(
            "COMMAND_ACK", lambda m: flight.acknowledged(int(m["command"]), int(m["result"]))
        )
        self._subscribe("PARAM_VALUE", self._parameter)
        takes: dict[str, Callable[[dict[str, Any]], None]] = {
            "HEARTBEAT": self._heartbeat,
            "SYS_STATUS": self._checks,
        }
        for needed in self.messages.needed:
            if needed.name != POSITION:
                self._subscribe(needed.name, takes.get(needed.name))
        self._direct.subscribe_message(POSITION, self._positioned)
        telemetry.subscribe_flight_mode(self._posts(self._mode))
        telemetry.subscribe_battery(self._posts(self._battery))
        telemetry.subscribe_landed_state(self._posts(self._landed))
        telemetry.subscribe_health(self._posts(self._health))
        telemetry.subscribe_home(self._posts(self._home))
        self.step()

    def _subscribe(self, name: str, take: Callable[[dict[str, Any]], None] | None) -> None:
        def heard(received: Any, _data: Any) -> None:
            if received.component_id == AUTOPILOT:
                self._post(partial(self._heard, name, take, received.fields_json))

        self._direct.subscribe_message(name, heard)

    def _heard(
        self, name: str, take: Callable[[dict[str, Any]], None] | None, fields_json: str
    ) -> None:
        self.messages.heard(name, time.monotonic())
        if take is not None:
            take(cast("dict[str, Any]", json.loads(fields_json)))

    def _positioned(self, received: Any, _data: Any) -> None:
        if received.component_id == AUTOPILOT:
            take = partial(self._flight.positioned, arrived=datetime.now(UTC))
            self._post(partial(self._heard, POSITION, take, received.fields_json))

    def step(self) -> None:
        """Request the messages that do not arrive, and report the missing ones to the flight."""
        now_s = time.monotonic()
        for needed in self.messages.due(now_s):
            interval = (float(needed.number), needed.period_s * 1e6)
            self.send(MavCommand(Cmd.SET_MESSAGE_INTERVAL, interval), 0)
        missing = self.messages.missing(now_s)
        names = frozenset(needed.name for needed in missing)
        if self.connected and not names <= self._unnamed:
            lines = [f"{needed.name}: {needed.lacking}" for needed in missing]
            self._flight.lacks("; ".join(lines))
        self._unnamed = names

    def ask_again(self) -> None:
        """Request every message again, because the vehicle may have lost the earlier requests."""
        self.messages.ask_again(time.monotonic())
        self.step()

    def _posts(self, take: Callable[[Any], None]) -> _Arguments:
        def heard(value: Any, _data: Any) -> None:
            self._post(partial(take, value))

        return heard

    def _heartbeat(self, message: dict[str, Any]) -> None:
        self._flight.heartbeat(int(message["base_mode"]), int(message["system_status"]))
        if self.kind == "ardupilot":
            vehicle = int(message["type"])
            self._flight.is_a("ugv" if vehicle in ardupilot.ROVER_TYPES else "uav")
            self._flight.mode_changed(ardupilot.mode_name(vehicle, int(message["custom_mode"])))

    def _checks(self, message: dict[str, Any]) -> None:
        """Process the results of the vehicle's checks before arming and of its sensor checks."""
        enabled = int(message["onboard_control_sensors_enabled"])
        fails = enabled & ~int(message["onboard_control_sensors_health"])
        if enabled & PREARM_CHECK:
            self._flight.checked(not fails & PREARM_CHECK)
        if self.kind == "ardupilot":
            self._flight.health(not fails & SENSORS)

    def _mode(self, mode: Any) -> None:
        if self.kind != "ardupilot":
            self._flight.mode_changed(mode.name)

    def _battery(self, battery: Any) -> None:
        remaining = float(battery.remaining_percent)
        if 0.0 <= remaining <= 100.0 and battery.id == 0:
            self._flight.state.battery_pct = remaining

    def _landed(self, landed: Any) -> None:
        on_ground = {LandedState.ON_GROUND: True, LandedState.UNKNOWN: None}
        self._flight.state.on_ground = on_ground.get(landed, False)

    def _health(self, health: Any) -> None:
        if self.kind != "ardupilot":
            self._flight.health(
                bool(
                    health.is_gyrometer_calibration_ok
                    and health.is_accelerometer_calibration_ok
                    and health.is_magnetometer_calibration_ok
                    and health.is_global_position_ok
                )
            )

    def _home(self, home: Any) -> None:
        self._flight.home_at(float(home.latitude_deg), float(home.longitude_deg))

    def send(self, command: MavCommand, times: int) -> None:
        """Send a command once; `times` is the number of earlier attempts."""
        fields = self._addressed(command=int(command.command))
        most = 7 if command.place is None else 4
        params = (*command.params, *(0.0 for _ in range(most)))[:most]
        for number, value in enumerate(params, 1):
            fields[f"param{number}"] = None if math.isnan(value) else value  # mavsdk's form of NaN
        if command.place is None:
            name, fields["confirmation"] = "COMMAND_LONG", times
        else:
            name = "COMMAND_INT"
            x, y = (round(degrees * 1e7) for degrees in command.place)
            fields |= {"frame": command.frame, "current": 0, "autocontinue": 0}
            fields |= {"x": x, "y": y, "z": command.altitude_m}
        self._send(name, fields)

    def _send(self, name: str, fields: dict[str, Any]) -> None:
        try:
            self._direct.send_message(self._message(name, fields))
        except MavlinkDirectError:
            return  # the flight repeats the command, and finally reports that it was not answered

    def _message(self, name: str, fields: dict[str, Any]) -> MavlinkMessage:
        return MavlinkMessage(name, 0, 0, self.system_id, AUTOPILOT, json.dumps(fields))

    def hold(self) -> None:
        """Change to the mode that keeps the place; mavsdk repeats the request until answered."""
        if self.kind == "ardupilot":
            fields = self._addressed(command=int(Cmd.SET_MODE), param1=1.0, param2=self._stands)
            self._direct.send_command_async(self._message("COMMAND_LONG", fields), self._stood)
            return

        def done(result: ActionResult, _data: Any) -> None:
            problem = "" if result == ActionResult.SUCCESS else _word(result)
            answered = result not in UNANSWERED
            self._post(partial(self._flight.held, problem, answered=answered))

        self._action.hold_async(done)

    def _stood(self, _result: Any, ack: Any, _data: Any) -> None:
        """Pass on an ArduPilot's answer to a hold; called on a thread of mavsdk."""

        def taken() -> None:
            result = _result_of(ack)
            problem = "" if result == ACCEPTED else RESULTS.get(result, "timeout")
            self._flight.held(problem, answered=result >= 0)

        self._post(taken)

    def upload_mission(self, items: Sequence[MavItem]) -> None:
        """Replace the vehicle's mission."""

        def done(result: MissionRawResult, _data: Any) -> None:
            self._post(partial(self._flight.uploaded, _problem(result)))

        self._mission.upload_mission_async(_raw(items, MISSION), done)

    def cancel_upload(self) -> None:
        """Cancel the upload of a mission."""
        self._mission.cancel_mission_upload()

    def upload_fence(self, items: Sequence[MavItem]) -> None:
        """Replace the vehicle's geofence."""

        def done(result: MissionRawResult, _data: Any) -> None:
            self._post(partial(self._flight.fence_uploaded, _problem(result)))

        self._mission.upload_geofence_async(_raw(items, FENCE), done)

    def read_fence(self) -> None:
        """Request the vehicle's geofence."""

        def done(result: MissionRawResult, items: Sequence[Any], _data: Any) -> None:
            none = result == MissionRawResult.NO_MISSION_AVAILABLE
            fence = tuple(
                MavItem(i.command, i.x, i.y, i.z, (i.param1, i.param2, i.param3, i.param4), i.frame)
                for i in items
            )
            self._post(partial(self._flight.fence_read, "" if none else _problem(result), fence))

        self._mission.download_geofence_async(done)

    def enforce_fence(self) -> None:
        """Make an ArduPilot enforce its fence, or check that a PX4 enforces its fence.

        Both begin with a request for parameters. Other autopilots are trusted.
        """
        if self.kind == "px4":
            self.read_parameter(PX4_FENCE_ACTION)
        elif self.kind == "ardupilot":
            self.read_parameter(FENCE_TYPE)
            self.read_parameter(FENCE_ACTION)
        else:
            self._flight.fence.enforced("")

    def read_parameter(self, name: str) -> None:
        """Request a parameter once; the answer is stored in `parameters`."""
        self._send("PARAM_REQUEST_READ", self._addressed(param_id=name, param_index=-1))

    def _parameter(self, message: dict[str, Any]) -> None:
        """Process a parameter; PX4 sends whole numbers as the bytes of a float."""
        name, value = str(message["param_id"]), float(message["param_value"])
        if name == PX4_FENCE_ACTION and self.kind == "px4":
            (action,) = struct.unpack("<i", struct.pack("<f", value))
            wrong = f"its {name} is {action}; set it to 2 (hold) or to a stronger action"
            self._flight.fence.enforced("" if action in PX4_ACTS else wrong)
        elif self.kind == "ardupilot":
            self.parameters[name] = value
            if name == FENCE_ACTION:
                self._enable_fence(value)

    def _enable_fence(self, action: float) -> None:
        """Enable the fence of an ArduPilot, unless its parameters make the fence ineffective."""
        if not action:
            self._flight.fence.enforced(
                f"its {FENCE_ACTION} is 0; set it to 1 (return) or to a stronger action"
            )
        elif not ardupilot.has_polygons(self.parameters.get(FENCE_TYPE, ardupilot.POLYGON)):
            self._flight.fence.enforced(
                f"its {FENCE_TYPE} does not include polygons; add {ardupilot.POLYGON} to it"
            )
        else:
            enable = self._addressed(command=int(Cmd.FENCE_ENABLE), param1=1.0)
            message = self._message("COMMAND_LONG", enable)
            self._direct.send_command_async(message, self._ardupilot_enabled)

    def _ardupilot_enabled(self, _result: Any, ack: Any, _data: Any) -> None:
        def taken() -> None:
            result = _result_of(ack)
            word = RESULTS.get(result, "no answer")
            self._flight.fence.enforced(
                "" if result == ACCEPTED else f"it does not enable its fence ({word})"
            )

        self._post(taken)

    def _addressed(self, **fields: object) -> dict[str, Any]:
        return {"target_system": self.system_id, "target_component": AUTOPILOT, **fields}


def _result_of(ack: Any) -> int:
    """Return the MAV_RESULT of an acknowledgement; -1 if none arrived."""
    return int(json.loads(ack.fields_json or "{}").get("result", -1))


def _raw(items: Sequence[MavItem], mission_type: int) -> list[MissionItem]:
    return [
        MissionItem(
            number,
            item.frame,
            item.command,
            int(number == 0 and mission_type == MISSION),
            1,
            *item.params,
            item.x,
            item.y,
            item.z,
            mission_type,
        )
        for number, item in enumerate(items)
    ]


def _problem(result: MissionRawResult) -> str:
    return "" if result == MissionRawResult.SUCCESS else _word(result)


def _word(result: Any) -> str:
    """Return a result of mavsdk in words."""
    return str(result.name).lower().replace("_", " ")

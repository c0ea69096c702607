"""`python -m tests.fleets.mavlink.vehicles`: drones on `pymavlink`, which share no code with ours.

Each speaks MAVLink as a PX4 does, or as an ArduPilot, and flies as a point that follows its
target. What it is told on standard input, one JSON object a line, changes how it behaves; what
it did is printed when that ends.

    {"system": 1, "mode": "denying"}     {"system": 1, "flight_mode": "POSCTL"}
    {"system": 1, "corner": [0, 50]}     {"all": true, "mode": "silent"}     {"say": true}
"""

import argparse
import json
import math
import os
import queue
import struct
import sys
import threading
import time
from collections import Counter
from dataclasses import dataclass, field
from random import Random
from typing import Any

os.environ["MAVLINK20"] = "1"

from pymavlink import mavutil

mavlink: Any = mavutil.mavlink
M_PER_DEG = 111_319.49
PX4, ARDUPILOT = 12, 3
PX4_MODES = {
    "MANUAL": (1, 0), "ALTCTL": (2, 0), "POSCTL": (3, 0), "TAKEOFF": (4, 2), "HOLD": (4, 3),
    "MISSION": (4, 4), "RTL": (4, 5), "LAND": (4, 6), "STABILIZED": (7, 0),
}  # fmt: skip
COPTER_MODES = {
    "STABILIZED": 0, "ALTCTL": 2, "MISSION": 3, "GUIDED": 4, "LOITER": 5, "RTL": 6, "LAND": 9,
    "POSCTL": 16, "HOLD": 17,
}  # fmt: skip
SPEED_MPS, CLIMB_MPS, DT_S = 12.0, 4.0, 0.02
HOVERS = ("HOLD", "GUIDED", "TAKEOFF", "MISSION")


@dataclass
class Behaviour:
    """How a vehicle treats commands: obedient, denying, silent, lying, failing or slow."""

    mode: str = "obedient"
    slow_s: float = 1.5


@dataclass
class Vehicle:
    """One drone: degrees, metres above home, seconds."""

    system: int
    home: tuple[float, float]
    autopilot: int = PX4
    at: tuple[float, float] = (0.0, 0.0)
    height: float = 0.0
    armed: bool = False
    mode: str = "HOLD"
    target: tuple[float, float] | None = None
    target_height: float = 0.0
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    heading: float = 0.0
    battery: int = 90
    fence_action: int = 2
    fence: list[Any] = field(default_factory=list[Any])
    mission: list[Any] = field(default_factory=list[Any])
    current: int = 0
    region: tuple[float, float] | None = None
    incoming: dict[str, Any] | None = None
    behaves: Behaviour = field(default_factory=Behaviour)
    carried_out: Counter[str] = field(default_factory=Counter[str])
    log: list[str] = field(default_factory=list[str])
    down: bool = False
    state: int = 4
    """Its MAV_STATE: 4 active, 6 emergency."""

    def custom_mode(self) -> int:
        """Return the mode as a heartbeat has it."""
        if self.autopilot == ARDUPILOT:
            return COPTER_MODES.get(self.mode, 4)
        main, sub = PX4_MODES.get(self.mode, (4, 3))
        return (main << 16) | (sub << 24)

    def set_custom(self, custom: int, sub: int) -> bool:
        """Change the mode as DO_SET_MODE asks; return whether there is such a mode."""
        if self.autopilot == ARDUPILOT:
            found = next((n for n, number in COPTER_MODES.items() if number == custom), None)
        else:
            found = next((n for n, pair in PX4_MODES.items() if pair == (custom, sub)), None)
        if found is None:
            return False
        self.mode = found
        if found == "HOLD":
            self.target, self.target_height = self.at, self.height
        return True

    def did(self, number: int, message: Any) -> None:
        """Note a command that was carried out."""
        if number in (192, 300):
            goal = self.mission[-1] if number == 300 else message
            self.log.append(f"moved to {goal.x} {goal.y}")

    def fly(self, dt: float) -> None:
        """Go on for `dt` seconds."""
        before, level = self.at, self.height
        if self.armed and self.behaves.mode != "lying":
            self._steer(dt)
        north = (self.at[0] - before[0]) * M_PER_DEG / dt
        east = (self.at[1] - before[1]) * M_PER_DEG * math.cos(math.radians(self.at[0])) / dt
        self.velocity = (north, east, -(self.height - level) / dt)
        if math.hypot(north, east) > 0.5:
            self.heading = math.degrees(math.atan2(east, north)) % 360.0

    def _steer(self, dt: float) -> None:
        if self.mode == "MISSION" and self.mission:
            self._fly_mission()
        if self.mode == "RTL":
            self.target = self.home
            near = self._gap(self.home) < 0.5
            self.target_height = 0.0 if near else max(self.height, 1.0)
        if self.mode == "LAND":
            self.target, self.target_height = self.at, 0.0
        if self.target is not None:
            self._approach(self.target, dt)
        climb = max(-CLIMB_MPS * dt, min(CLIMB_MPS * dt, self.target_height - self.height))
        self.height = max(0.0, self.height + climb)
        if self.mode in ("RTL", "LAND") and self.height < 0.05 and self.target_height == 0.0:
            self.height, self.armed, self.mode = 0.0, False, "HOLD"

    def _fly_mission(self) -> None:
        if self.current >= len(self.mission):
            return
        item = self.mission[self.current]
        if item.command in (16, 17, 22):
            if item.z > 0.0:
                self.target_height = item.z
            self.target = (item.x / 1e7, item.y / 1e7)
            if item.command == 22:
                self.target = self.at
            done = abs(self.height - self.target_height) < 0.5 and self._gap(self.target) < 0.5
            if done and item.command != 17:
                self.current += 1
        else:
            if item.command == 195:
                self.region = (item.x / 1e7, item.y / 1e7)
            self.current += 1

    def _gap(self, place: tuple[float, float]) -> float:
        north = (place[0] - self.at[0]) * M_PER_DEG
        east = (place[1] - self.at[1]) * M_PER_DEG * math.cos(math.radians(self.at[0]))
        return math.hypot(north, east)

    def _approach(self, target: tuple[float, float], dt: float) -> None:
        gap = self._gap(target)
        part = 1.0 if gap < 1e-6 else min(1.0, SPEED_MPS * dt / gap)
        if self.height < 0.5:
            return
        self.at = tuple(a + (b - a) * part for a, b in zip(self.at, target, strict=True))  # type: ignore[assignment]


class Flock:
    """Vehicles on one UDP address, each with a port of its own."""

    def __init__(
        self,
        address: str,
        vehicles: list[Vehicle],
        rate: float = 1.0,
        loss: float = 0.0,
        period_s: float = 0.2,
        *,
        shared: bool = False,
    ) -> None:
        """With `shared`, all speak over one port, as behind a router."""
        self.vehicles = {v.system: v for v in vehicles}
        self._links: dict[int, Any] = {}
        for system in self.vehicles:
            self._links[system] = (
                next(iter(self._links.values()))
                if shared and self._links
                else mavutil.mavlink_connection(
                    f"udpout:{address}", source_system=system, source_component=1
                )
            )
        self._shared = shared
        self._rate, self._loss, self._random = rate, loss, Random(1)
        self._period_s = period_s
        self._began = time.monotonic()
        self._told: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        self._later: list[tuple[float, Any]] = []
        self._next = dict.fromkeys(self.vehicles, 0.0)
        self._beat = dict.fromkeys(self.vehicles, 0.0)
        self.stopped = threading.Event()

    def tell(self, line: dict[str, Any]) -> None:
        """Change how vehicles behave, from any thread."""
        self._told.put(line)

    def run(self) -> None:
        """Fly until stopped."""
        last = time.monotonic()
        while not self.stopped.is_set():
            now = time.monotonic()
            while not self._told.empty():
                self._obey(self._told.get())
            while last + DT_S <= now:
                last += DT_S
                for vehicle in self.vehicles.values():
                    vehicle.fly(DT_S * self._rate)
            for vehicle in self.vehicles.values():
                self._hear(vehicle)
                if vehicle.behaves.mode != "silent" and not vehicle.down:
                    self._report(vehicle, now)
            due = [answer for at, answer in self._later if at <= now]
            self._later = [(at, answer) for at, answer in self._later if at > now]
            for answer in due:
                answer()
            self.stopped.wait(0.004)

    def _obey(self, line: dict[str, Any]) -> None:
        if line.get("say"):
            self.say()
            return
        chosen = (
            list(self.vehicles.values()) if line.get("all") else [self.vehicles[line["system"]]]
        )
        for vehicle in chosen:
            if "mode" in line:
                vehicle.behaves.mode = line["mode"]
            vehicle.behaves.slow_s = line.get("slow_s", vehicle.behaves.slow_s)
            if "flight_mode" in line:
                vehicle.mode = line["flight_mode"]
            if "battery" in line:
                vehicle.battery = line["battery"]
            if "down" in line:
                vehicle.down = line["down"]
            if "fence_action" in line:
                vehicle.fence_action = line["fence_action"]
            if "corner" in line:
                number, units = line["corner"]
                vehicle.fence[number].x += units
            if "text" in line:
                self._text(vehicle, line["text"])
            if "authorize" in line:
                self._mav(vehicle).command_long_send(
                    line["authorize"], 190, 3001, 0, vehicle.system, 0, 0, 0, 0, 0, 0
                )

    def say(self) -> None:
        """Print what every vehicle has done."""
        print(
            json.dumps(
                {
                    v.system: {
                        "at": v.at,
                        "height": round(v.height, 2),
                        "armed": v.armed,
                        "mode": v.mode,
                        "carried_out": dict(v.carried_out),
                        "fence": len(v.fence),
                        "region": v.region,
                        "log": v.log,
                    }
                    for v in self.vehicles.values()
                }
            ),
            flush=True,
        )

    # Messages out

    def _report(self, vehicle: Vehicle, now: float) -> None:
        mav = self._mav(vehicle)
        boot = int((now - self._began) * 1e3)
        if now >= self._beat[vehicle.system]:
            self._beat[vehicle.system] = now + 0.5
            flags = 1 | (128 if vehicle.armed else 0)
            mav.heartbeat_send(2, vehicle.autopilot, flags, vehicle.custom_mode(), vehicle.state)
            sensors = 0xFFFF
            mav.sys_status_send(
                sensors, sensors, sensors, 0, 12000, 100, vehicle.battery, 0, 0, 0, 0, 0, 0
            )
            landed = 1 if vehicle.height < 0.05 else 2
            mav.extended_sys_state_send(0, landed)
            mav.gps_raw_int_send(
                boot * 1000, 3, int(vehicle.at[0] * 1e7), int(vehicle.at[1] * 1e7),
                0, 100, 100, 0, 0, 12,
            )  # fmt: skip
        if now >= self._next[vehicle.system]:
            self._next[vehicle.system] = now + self._period_s
            if self._random.random() < self._loss:
                return
            north, east, down = vehicle.velocity
            mav.global_position_int_send(
                boot,
                round(vehicle.at[0] * 1e7),
                round(vehicle.at[1] * 1e7),
                int((vehicle.height + 100.0) * 1e3),
                int(vehicle.height * 1e3),
                *(max(-32000, min(32000, int(v * 100))) for v in (north, east, down)),
                int(vehicle.heading * 100) % 36000,
            )

    def _text(self, vehicle: Vehicle, text: str, severity: int = 4) -> None:
        self._mav(vehicle).statustext_send(severity, text.encode()[:50])

    def _answer(self, vehicle: Vehicle, sender: Any, command: int, result: int) -> None:
        if vehicle.behaves.mode == "silent" or self._random.random() < self._loss:
            return
        mav = self._mav(vehicle)
        mav.command_ack_send(
            command, result, 0, 0, sender.get_srcSystem(), sender.get_srcComponent()
        )

    # Messages in

    def _mav(self, vehicle: Vehicle) -> Any:
        """Return what packs and sends messages of a vehicle."""
        mav = self._links[vehicle.system].mav
        mav.srcSystem = vehicle.system
        return mav

    def _hear(self, vehicle: Vehicle) -> None:
        link = self._links[vehicle.system]
        for _ in range(50):
            try:
                message = link.recv_msg()
            except ConnectionRefusedError:
                return
            if message is None:
                return
            addressed = getattr(message, "target_system", vehicle.system)
            if self._shared:
                vehicle = self.vehicles.get(addressed, vehicle)
            if addressed not in (0, vehicle.system) or vehicle.down:
                continue
            if self._random.random() < self._loss:
                continue
            kind = message.get_type()
            if kind in ("COMMAND_LONG", "COMMAND_INT"):
                self._command(vehicle, message)
            elif kind.startswith("MISSION_"):
                self._mission(vehicle, message, kind)
            elif kind == "PARAM_REQUEST_READ" and vehicle.behaves.mode != "silent":
                value = struct.unpack("<f", struct.pack("<i", vehicle.fence_action))[0]
                if vehicle.autopilot == ARDUPILOT:
                    value = float({"FENCE_TYPE": 7}.get(message.param_id, vehicle.fence_action))
                self._mav(vehicle).param_value_send(message.param_id.encode(), value, 6, 1, 0)
            elif kind == "COMMAND_ACK":
                vehicle.log.append(f"ack {message.command} {message.result}")

    def _command(self, vehicle: Vehicle, message: Any) -> None:
        number, mode = message.command, vehicle.behaves.mode
        if number in (511, 512, 520):
            self._command_request(vehicle, message)
            return
        if mode == "silent":
            return
        vehicle.log.append(f"command {number}")
        if mode == "denying" and number != 207:
            self._text(vehicle, "Arming denied: compass not calibrated", 3)
            self._answer(vehicle, message, number, 2)
        elif mode == "failing" and number != 207:
            self._answer(vehicle, message, number, 4)
            self._text(vehicle, "Motor 3 reports a fault", 2)
        elif mode == "slow":
            self._answer(vehicle, message, number, 5)

            def later() -> None:
                self._carry_out(vehicle, message)

            self._later.append((time.monotonic() + vehicle.behaves.slow_s, later))
        else:
            self._carry_out(vehicle, message)

    def _command_request(self, vehicle: Vehicle, message: Any) -> None:
        if vehicle.behaves.mode == "silent":
            return
        if message.command == 512 and int(message.param1) == 242:
            self._mav(vehicle).home_position_send(
                int(vehicle.home[0] * 1e7), int(vehicle.home[1] * 1e7), 100_000,
                0, 0, 0, [1, 0, 0, 0], 0, 0, 0,
            )  # fmt: skip
        self._answer(vehicle, message, message.command, 0)

    def _carry_out(self, vehicle: Vehicle, message: Any) -> None:
        number, result = message.command, 0
        key = str(number)
        if number == 176:
            result = 0 if vehicle.set_custom(int(message.param2), int(message.param3 or 0)) else 2
        elif number == 400:
            vehicle.armed = message.param1 == 1.0
        elif number == 22:
            height = message.param7
            vehicle.target_height = height - 100.0 if vehicle.autopilot == PX4 else height
            vehicle.target = vehicle.at
            if vehicle.autopilot == PX4:
                vehicle.mode = "TAKEOFF"
            result = 0 if vehicle.armed else 2
        elif number == 192:
            place = (message.x / 1e7, message.y / 1e7)
            key = f"192 {message.x} {message.y}"
            vehicle.target, vehicle.target_height = place, message.z - 100.0
            vehicle.mode = "HOLD" if vehicle.autopilot == PX4 else "GUIDED"
            result = 0 if vehicle.armed else 2
        elif number == 195:
            vehicle.region = (message.x / 1e7, message.y / 1e7)
        elif number == 197:
            vehicle.region = None
        elif number == 20:
            vehicle.mode = "RTL"
        elif number == 224:
            vehicle.current = int(message.param1)
        elif number == 300:
            vehicle.mode = "MISSION"
            result = 0 if vehicle.mission and vehicle.armed else 2
        elif number == 207:
            result = 0 if vehicle.fence else 4
        else:
            result = 3
        if result == 0:
            vehicle.carried_out[key] += 1
            vehicle.did(number, message)
        self._answer(vehicle, message, number, result)

    def _mission(self, vehicle: Vehicle, message: Any, kind: str) -> None:
        if vehicle.behaves.mode == "silent":
            return
        mav, fence = self._mav(vehicle), getattr(message, "mission_type", 0) == 1
        system, component = message.get_srcSystem(), message.get_srcComponent()
        stored = vehicle.fence if fence else vehicle.mission
        if kind == "MISSION_COUNT":
            vehicle.incoming = {"type": message.mission_type, "count": message.count, "items": []}
            mav.mission_request_int_send(system, component, 0, message.mission_type)
        elif kind == "MISSION_ITEM_INT" and vehicle.incoming is not None:
            items = vehicle.incoming["items"]
            if message.seq == len(items):
                items.append(message)
            if len(items) < vehicle.incoming["count"]:
                mav.mission_request_int_send(system, component, len(items), message.mission_type)
                return
            stored[:] = items
            vehicle.incoming = None
            if not fence:
                vehicle.current = 0
            mav.mission_ack_send(system, component, 0, message.mission_type)
        elif kind == "MISSION_REQUEST_LIST":
            mav.mission_count_send(system, component, len(stored), message.mission_type)
        elif kind == "MISSION_REQUEST_INT" and message.seq < len(stored):
            item = stored[message.seq]
            mav.mission_item_int_send(
                system, component, message.seq, item.frame, item.command, 0, 1,
                item.param1, item.param2, item.param3, item.param4,
                item.x, item.y, item.z, message.mission_type,
            )  # fmt: skip
        elif kind == "MISSION_CLEAR_ALL":
            stored.clear()
            mav.mission_ack_send(system, component, 0, message.mission_type)


def main() -> None:
    """Fly the vehicles that the arguments name until standard input ends."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("address")
    parser.add_argument("--rate", type=float, default=1.0)
    parser.add_argument("--loss", type=float, default=0.0)
    parser.add_argument("--shared", action="store_true", help="all over one port")
    parser.add_argument(
        "vehicles", help='JSON: [{"system": 1, "at": [lat, lon], "home": [lat, lon], ...}]'
    )
    arguments = parser.parse_args()
    vehicles: list[Vehicle] = []
    for each in json.loads(arguments.vehicles):
        at, home = tuple(each["at"]), tuple(each.get("home", each["at"]))
        flies = bool(each.get("flies"))
        vehicles.append(
            Vehicle(
                each["system"], home, each.get("autopilot", PX4), at,  # type: ignore[arg-type]
                each.get("height", 20.0) if flies else 0.0, flies,
                target=at if flies else None,  # type: ignore[arg-type]
                target_height=each.get("height", 20.0) if flies else 0.0,
            )
        )  # fmt: skip
    flock = Flock(
        arguments.address, vehicles, arguments.rate, arguments.loss, shared=arguments.shared
    )
    thread = threading.Thread(target=flock.run, daemon=True)
    thread.start()
    for line in sys.stdin:
        flock.tell(json.loads(line))
    flock.stopped.set()
    thread.join()
    flock.say()


if __name__ == "__main__":
    main()

"""ArduPilot's own autopilots in their simulation, and a radio link that can be cut.

The programs are no part of the project. They are looked for in the folder that ARDUPILOT names, or
in `../shared/ardupilot` beside the checkout.
"""

import math
import os
import select
import socket
import subprocess
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, cast

os.environ["MAVLINK20"] = "1"

from pymavlink import mavutil

from pa_console.schema.base import Point
from pa_console.schema.world import World
from tests.fleets.mavlink.scripted import GEOGRAPHY

Frame = Literal["copter", "rover"]
FOLDER = Path(
    os.environ.get("ARDUPILOT", Path(__file__).parents[3].parent / "shared" / "ardupilot")
)
MODELS = {"copter": "+", "rover": "rover"}
STATION = 245
PARAMETERS = (
    f"MAV_GCS_SYSID {STATION}", "FS_GCS_ENABLE 1", "FS_GCS_TIMEOUT 15", "FS_OPTIONS 18",
    "BATT_FS_LOW_ACT 2", "BATT_CAPACITY 30000",
)  # fmt: skip
"""What `pa-console doctor` asks for; a second of a test is several of the autopilot's."""


def missing() -> str:
    """Return why the tests cannot run here, '' if they can."""
    absent = [name for name in ("arducopter", "ardurover") if not (FOLDER / name).is_file()]
    return f"no {' and '.join(absent)} in {FOLDER}: set ARDUPILOT" if absent else ""


def free_ports() -> int:
    """Return the first of three TCP ports that nobody has."""
    while True:
        with socket.socket() as found:
            found.bind(("127.0.0.1", 0))
            port = int(found.getsockname()[1])
        if port < 60_000 and all(_free(port + more) for more in (2, 3)):
            return port


def _free(port: int) -> bool:
    with socket.socket() as tried:
        return tried.connect_ex(("127.0.0.1", port)) != 0


class Sitl:
    """One autopilot with the vehicle that it steers, as a process; it ends with this one."""

    def __init__(
        self,
        folder: Path,
        frame: Frame,
        system: int,
        at: Point,
        *,
        speedup: float = 5.0,
        parameters: Sequence[str] = PARAMETERS,
    ) -> None:
        """Put it on the ground `at` a place of the world; it runs `speedup` times as fast."""
        self.system, self.port, self._frame = system, free_ports(), frame
        self._folder = folder / f"{frame}{system}"
        self._folder.mkdir(parents=True)
        defaults = (FOLDER / f"{frame}.parm").read_text("utf-8")
        lines = [defaults, f"MAV_SYSID {system}", *parameters, ""]
        (self._folder / "defaults.parm").write_text("\n".join(lines), encoding="utf-8")
        latitude, longitude = GEOGRAPHY.degrees(at)
        self._words = [
            str(FOLDER / f"ardu{frame}"), "--model", MODELS[frame], "--speedup", f"{speedup:g}",
            "--home", f"{latitude:.7f},{longitude:.7f},0,0", "--defaults", "defaults.parm",
            "--serial0", "tcp:0", "--base-port", str(self.port), "-I0",
        ]  # fmt: skip
        self.start()

    @property
    def address(self) -> str:
        """The connection to it."""
        return f"tcpout://127.0.0.1:{self.port}"

    def start(self) -> None:
        """Start it, with the parameters that it had before, if it has run before."""
        with (self._folder / "log").open("ab") as log:
            self._process = subprocess.Popen(
                self._words, cwd=self._folder, stdout=log, stderr=log, stdin=subprocess.DEVNULL
            )

    def kill(self) -> None:
        """End it at once, as if its battery were torn out."""
        self._process.kill()
        self._process.wait()

    def other_station(self) -> "OtherStation":
        """Return a second ground station, on a link of its own."""
        return OtherStation(self.port + 2, self.system)


class OtherStation:
    """Another person's ground station and remote control, on `pymavlink`."""

    def __init__(self, port: int, system: int) -> None:
        self._link: Any = mavutil.mavlink_connection(
            f"tcp:127.0.0.1:{port}", source_system=STATION, source_component=191, retries=20
        )
        self.system = system

    def set_parameter(self, name: str, value: float) -> None:
        """Change a parameter; raises TimeoutError if it is not confirmed."""
        for _ in range(20):
            self._link.mav.param_set_send(self.system, 1, name.encode(), value, 9)
            said = self._link.recv_match(type="PARAM_VALUE", blocking=True, timeout=0.5)
            if said is not None and said.param_id == name:
                return
        raise TimeoutError(name)

    def command(self, number: int, *params: float) -> int:
        """Send a COMMAND_LONG; return its MAV_RESULT."""
        seven = (*params, *(0.0 for _ in range(7)))[:7]
        self._link.mav.command_long_send(self.system, 1, number, 0, *seven)
        return self._result(number)

    def fly_to(self, at: Point, altitude_m: float) -> int:
        """Ask it to fly to a place, by DO_REPOSITION; return the MAV_RESULT."""
        x, y = (round(degrees * 1e7) for degrees in GEOGRAPHY.degrees(at))
        self._link.mav.command_int_send(self.system, 1, 6, 192, 0, 0, -1, 1, 0, 0, x, y, altitude_m)
        return self._result(192)

    def follow(self, rate_hz: float) -> None:
        """Have it report its position so often."""
        assert self.command(511, 33, 1e6 / rate_hz) == 0

    def speed(self) -> tuple[float, float]:
        """Wait for its next report; return the time (`perf_counter`) and its ground speed."""
        said = self._link.recv_match(type="GLOBAL_POSITION_INT", blocking=True, timeout=5)
        return time.perf_counter(), float(math.hypot(said.vx, said.vy)) / 100.0

    def set_home(self, place: tuple[float, float]) -> None:
        """Have it return to a place, latitude and longitude, from now on."""
        x, y = (round(degrees * 1e7) for degrees in place)
        self._link.mav.command_int_send(self.system, 1, 0, 179, 0, 0, 0, 0, 0, 0, x, y, 0)
        assert self._result(179) == 0

    def take_over(self, mode: int) -> None:
        """Take the sticks, throttle in the middle, and change the mode."""
        self.hold_sticks()
        assert self.command(176, 1.0, mode) == 0

    def hold_sticks(self) -> None:
        """Keep the sticks in the middle."""
        middle = [1500] * 4 + [0] * 4
        self._link.mav.rc_channels_override_send(self.system, 1, *middle)

    def move_corner(self, north_e7: int) -> None:
        """Replace its geofence by one whose first corner lies elsewhere."""
        items = self._read_fence()
        items[0].x += north_e7
        mav = self._link.mav
        mav.mission_count_send(self.system, 1, len(items), 1)
        while True:
            asked = self._link.recv_match(
                type=["MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"],
                blocking=True,
                timeout=5,
            )
            assert asked is not None, "the fence is not taken"
            if asked.get_type() == "MISSION_ACK":
                return
            i = items[asked.seq]
            mav.mission_item_int_send(
                self.system, 1, i.seq, i.frame, i.command, 0, 1,
                i.param1, i.param2, i.param3, i.param4, i.x, i.y, i.z, 1,
            )  # fmt: skip

    def _read_fence(self) -> list[Any]:
        mav, items = self._link.mav, list[Any]()
        mav.mission_request_list_send(self.system, 1, 1)
        count = self._link.recv_match(type="MISSION_COUNT", blocking=True, timeout=5).count
        for number in range(count):
            mav.mission_request_int_send(self.system, 1, number, 1)
            items.append(self._link.recv_match(type="MISSION_ITEM_INT", blocking=True, timeout=5))
        mav.mission_ack_send(self.system, 1, 0, 1)
        return items

    def _result(self, number: int) -> int:
        until = time.monotonic() + 5.0
        while time.monotonic() < until:
            said = self._link.recv_match(type="COMMAND_ACK", blocking=True, timeout=1)
            if said is not None and said.command == number:
                return int(said.result)
        raise TimeoutError(str(number))

    def close(self) -> None:
        """Let go of the link."""
        self._link.close()


class Radio:
    """A TCP relay to an autopilot: what is sent while it is cut is lost, both ways.

    The console connects to `address`.
    """

    def __init__(self, port: int) -> None:
        self._port, self.cut, self._closed = port, False, False
        self._parser: Any = cast("Any", mavutil.mavlink).MAVLink(None)
        self._parser.robust_parsing = True
        self.commands: list[tuple[float, int, float]] = []
        """The commands that the console has sent: time (`perf_counter`), MAV_CMD, parameter 2."""
        self._server = socket.create_server(("127.0.0.1", 0))
        self.address = f"tcpout://127.0.0.1:{self._server.getsockname()[1]}"
        threading.Thread(target=self._serve, daemon=True).start()

    def close(self) -> None:
        """End it."""
        self._closed = True
        self._server.close()

    def _serve(self) -> None:
        while not self._closed:
            try:
                station, _ = self._server.accept()
            except OSError:
                return
            with station:
                self._relay(station)

    def _relay(self, station: socket.socket) -> None:
        while not self._closed:
            try:
                autopilot = socket.create_connection(("127.0.0.1", self._port), 1.0)
                break
            except OSError:
                time.sleep(0.1)
        else:
            return
        with autopilot:
            while not self._closed:
                ready, _, _ = select.select([station, autopilot], [], [], 0.2)
                for end in ready:
                    data = end.recv(65536)
                    if not data:
                        return
                    if self.cut:
                        continue
                    if end is station:
                        self._note(data)
                    (autopilot if end is station else station).sendall(data)

    def _note(self, data: bytes) -> None:
        at = time.perf_counter()
        for message in self._parser.parse_buffer(data) or ():
            if message.get_type() in ("COMMAND_LONG", "COMMAND_INT"):
                self.commands.append((at, int(message.command), float(message.param2)))


def vehicles_yaml(world: World, addresses: Sequence[str], names: Sequence[str], more: str) -> str:
    """Return the file of vehicles, the first of which has the system id 1."""
    lines = [
        f"  {name}: {{system_id: {number}, kind: {world.assets[name].kind}}}"
        for number, name in enumerate(names, 1)
    ]
    return "\n".join([f"connection: [{', '.join(addresses)}]", more, "vehicles:", *lines, ""])


def moves_it(_at: float, number: int, parameter: float) -> bool:
    """Return whether a command sets a vehicle in motion: one in `Radio.commands`."""
    guided = number == 176 and parameter in (4.0, 15.0)
    return guided or number in (20, 22, 192, 300, 400)

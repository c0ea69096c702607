"""A link to vehicles over MAVLink: `--fleet mavlink:FILE.yaml`, or `mavlink:URL#FILE.yaml`.

One thread does everything: it takes the station's commands, then what mavsdk has called back with.
"""

import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from threading import Condition, Thread
from typing import Any

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.cmavsdk_loader import _cmavsdk_lib  # pyright: ignore[reportPrivateUsage]
from mavsdk.exceptions import ConnectionError as CannotConnect
from mavsdk.logging import LogCallback
from mavsdk.plugins.arm_authorizer_server import (
    ArmAuthorizerServer,
    ArmAuthorizerServerError,
    RejectionReason,
)

from pa_console.fleets.link import FoundRobot, LinkFinding, LinkNotice
from pa_console.fleets.mavlink.ardupilot import Parameter, parameters
from pa_console.fleets.mavlink.autopilot import MavsdkAutopilot
from pa_console.fleets.mavlink.flight import Flight
from pa_console.fleets.mavlink.vehicles_file import MavlinkVehicles, read_vehicles
from pa_console.fleets.threaded_link import ThreadedLink, opened
from pa_console.schema.base import Point
from pa_console.schema.command import DeviceCommand
from pa_console.schema.document import DocumentError
from pa_console.schema.world import World
from pa_console.settings.schema import Settings
from pa_console.sim.worlds.geography import Geography, geography_of
from pa_console.sim.worlds.terrain import Terrain

STEP_S = 0.1
READ_S = 0.5
"""A parameter is asked for so often until it comes."""

MOST_WAITING = 20_000
"""The number of messages that may wait; further ones are dropped and counted."""

ARMING_S = 10
"""An authorization to arm is good for so long."""

SCHEMES = (
    "udp", "udpin", "udpout", "tcp", "tcpin", "tcpout", "serial", "serial_flowcontrol",
)  # fmt: skip


def open_link(address: str, world: World, settings: Settings) -> "MavlinkLink":
    """Open the link at `address`: the file of its drones, after a connection of mavsdk or alone.

    Raises ValueError with the remedy if it is unusable or no vehicle answers.
    """
    urls, vehicles = _found(address, world)
    for url in urls:
        if "://" not in url or url.partition("://")[0] not in SCHEMES:
            raise ValueError(
                f"--fleet mavlink:{address}: {url!r} is no connection; give udp://0.0.0.0:PORT to "
                f"listen, or one of {', '.join(f'{s}://' for s in SCHEMES)}"
            )
    if vehicles.origin is not None and world.origin not in (None, vehicles.origin):
        raise ValueError(
            f"--fleet mavlink:{address}: the world {world.name!r} has another origin than the file "
            "of the drones: remove one of them"
        )
    if vehicles.origin is not None:
        geography = Geography(vehicles.origin)
    else:
        options = "tak_origin in the settings, 'origin' in the file of the drones"
        geography = geography_of(world, settings.tak_origin, options)
    ids = ", ".join(str(spec.system_id) for spec in vehicles.vehicles.values())
    remedy = f"expected system id {ids}; start the drones, and check address and ids"
    return opened(MavlinkLink(urls, world, geography, vehicles), f"mavlink:{address}", remedy)


def _found(address: str, world: World) -> tuple[tuple[str, ...], MavlinkVehicles]:
    """Return the connections and the drones that `address` names; raises ValueError."""
    url, _, file = address.rpartition("#") if "#" in address else ("", "", address)
    if "://" in file or not file:
        raise ValueError(
            f"--fleet mavlink:{address}: which drone is which? Name the file of the drones after "
            f"the connection, mavlink:{url or file}#FILE.yaml, or alone, mavlink:FILE.yaml"
        )
    path = Path(file).expanduser()
    try:
        vehicles = read_vehicles(path, world)
    except DocumentError as error:
        raise ValueError(str(error)) from error
    own = vehicles.connection
    urls = (url,) if url else (own,) if isinstance(own, str) else own
    if not urls or not all(urls):
        raise ValueError(f"{path}: connection: missing; give for example udp://0.0.0.0:14540")
    return urls, vehicles


def _silent(*_arguments: object) -> bool:
    """Keep mavsdk's log from standard output, which is the console's screen."""
    return True


_SILENT = LogCallback(_silent)
# mavsdk's own wrapper of the callback prints what it cannot decode. It is set once, before any
# thread of mavsdk logs: setting it is not safe beside one.
_cmavsdk_lib.mavsdk_log_subscribe(_SILENT, None)


class MavlinkLink(ThreadedLink):
    """The vehicles of one file; the callbacks of mavsdk only put work on its list."""

    def __init__(
        self, urls: Sequence[str], world: World, geography: Geography, vehicles: MavlinkVehicles
    ) -> None:
        """Raises ValueError for a connection that cannot be opened."""
        self._url, self._vehicles, self._geography = ", ".join(urls), vehicles, geography
        super().__init__(f"mavlink:{self._url}")
        self._terrain = Terrain(world)
        self._rate_hz = 2.0 / world.telemetry_period_s
        self._agent_of = {spec.system_id: name for name, spec in vehicles.vehicles.items()}
        self._autopilots: dict[str, MavsdkAutopilot] = {}
        self._flights: dict[str, Flight] = {}
        self._strangers: set[int] = set()
        self._up: dict[str, bool] = {}
        self._commands: deque[DeviceCommand] = deque()
        self._work: deque[Callable[[], object]] = deque()
        self._dropped = 0
        self._awake, self._closed = Condition(), False
        configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
        self._station: int = configuration.system_id
        self._mavsdk = Mavsdk(configuration)
        self._connections: list[Any] = []
        for url in urls:
            try:
                self._connections.append(self._mavsdk.add_any_connection_with_handle(url))
            except CannotConnect as error:
                self._mavsdk.destroy()
                word = str(error).rpartition(": ")[2].lower().replace("_", " ")
                raise ValueError(
                    f"--fleet mavlink:{url} cannot be opened ({word}): check the address, and "
                    "whether another program has the port"
                ) from None
        self._authorizer = ArmAuthorizerServer(self._mavsdk.server_component(0))
        self._authorizer.subscribe_arm_authorization(self._asked_to_arm)
        self._mavsdk.subscribe_on_new_system(lambda _data: self._post(self._look_round))
        self._thread = Thread(target=self._run, name="mavlink", daemon=True)
        self._thread.start()

    @property
    def agents(self) -> frozenset[str]:
        """The drones of its file."""
        return frozenset(self._vehicles.vehicles)

    @property
    def problem(self) -> str:
        """The reason for a missing connection, '' while a drone reports."""
        if any(self._up.values()):
            return ""
        return f"no drone is heard at {self._url}"

    def send(self, command: DeviceCommand) -> None:
        """Put `command` before everything that waits; returns at once."""
        with self._awake:
            self._commands.append(command)
            self._awake.notify()

    def close(self) -> None:
        """End the connection; the drones do what they do without a station."""
        with self._awake:
            self._closed = True
            self._awake.notify()
        self._thread.join()
        # No message may come in while mavsdk takes its plugins down: it hands them to these plugins
        # in threads of its own.
        for connection in self._connections:
            self._mavsdk.remove_connection(connection)
        self._mavsdk.destroy()

    def discover(self) -> Sequence[FoundRobot]:
        """Return the drones of the file that have reported, and other vehicles on the link."""
        found = [
            FoundRobot(
                name,
                self._vehicles.vehicles[name].kind,
                flight.state.fix.at if flight.state.fix else None,
            )
            for name, flight in list(self._flights.items())
        ]
        found += [
            FoundRobot(f"Drone_M{number}", "uav", detail=f"MAVLink system id {number}")
            for number in sorted(self._strangers)
        ]
        return found

    def examine(self, seconds: float) -> Sequence[LinkFinding]:
        """Read the parameters of every vehicle; return them and its messages as found."""
        names = [name for name, autopilot in self._autopilots.items() if autopilot.connected]
        wanted = {
            name: parameters(self._vehicles.vehicles[name].kind, self._vehicles, self._station)
            for name in names
            if self._autopilots[name].kind == "ardupilot"
        }
        until = time.monotonic() + seconds
        while time.monotonic() < until and (left := self._unread(wanted)):
            for autopilot, parameter in left:
                self._post(partial(autopilot.read_parameter, parameter))
            time.sleep(READ_S)
        found: list[LinkFinding] = []
        for name in names:
            autopilot = self._autopilots[name]
            found.append(self._flights[name].readiness.finding)
            found += autopilot.messages.findings(name, time.monotonic())
            values = dict(autopilot.parameters)
            found += [parameter.finding(name, values) for parameter in wanted.get(name, ())]
        return found

    def _unread(
        self, wanted: Mapping[str, Sequence[Parameter]]
    ) -> list[tuple[MavsdkAutopilot, str]]:
        """Return the parameters that are unread, each with its autopilot."""
        return [
            (self._autopilots[name], parameter.name)
            for name, parameters in wanted.items()
            for parameter in parameters
            if parameter.name not in self._autopilots[name].parameters
        ]

    def _post(self, work: Callable[[], object]) -> None:
        with self._awake:
            if len(self._work) >= MOST_WAITING:
                self._dropped += 1
                return
            self._work.append(work)
            self._awake.notify()

    def _run(self) -> None:
        """Do what comes, the station's commands first, until the link is closed."""
        due_s = time.monotonic()
        while True:
            with self._awake:
                wait_s = due_s - time.monotonic()
                if not (self._commands or self._work or self._closed) and wait_s > 0.0:
                    self._awake.wait(wait_s)
                if self._closed:
                    return
                command = self._commands.popleft() if self._commands else None
                work = self._work.popleft() if command is None and self._work else None
            if command is not None:
                self._guarded(partial(self._command, command))
            elif work is not None:
                self._guarded(work)
            if time.monotonic() >= due_s:
                due_s = time.monotonic() + STEP_S
                self._guarded(self._step)

    def _command(self, command: DeviceCommand) -> None:
        flight = self._flights.get(command.agent)
        if flight is not None:
            flight.take(command)
        else:
            text = "has not been heard: nothing can be sent to it"
            self._tell(LinkNotice("alarm", command.agent, text))

    def _step(self) -> None:
        for name, flight in self._flights.items():
            self._note_connection(name)
            self._autopilots[name].step()
            flight.step()
        if self._dropped:
            dropped, self._dropped = self._dropped, 0
            text = f"{dropped} messages came too fast and were dropped"
            self._tell(LinkNotice("alarm", "mavlink", text))

    def _note_connection(self, name: str) -> None:
        """Notice a drone whose heartbeats end, or come again."""
        autopilot, up = self._autopilots[name], self._autopilots[name].connected
        if up is self._up[name]:
            return
        self._up[name] = up
        if up:
            self._tell(LinkNotice("info", name, "is heard again"))
            autopilot.ask_again()
        else:
            self._tell(LinkNotice("warning", name, "is not heard any more"))
            self._flights[name].heard = False

    def _look_round(self) -> None:
        """Take in the vehicles that mavsdk has found since the last time."""
        for system in self._mavsdk.get_systems():
            number = system.get_system_id()
            name = self._agent_of.get(number)
            if not system.has_autopilot() or name in self._flights or number in self._strangers:
                continue
            if name is None:
                self._strangers.add(number)
                text = f"system id {number} is heard and is in no file of drones: not commanded"
                self._tell(LinkNotice("warning", "mavlink", text))
                continue
            kind = self._vehicles.vehicles[name].kind
            autopilot = MavsdkAutopilot(system, self._post, kind, self._rate_hz)
            self._autopilots[name] = autopilot
            flight = Flight(
                name,
                autopilot,
                terrain=self._terrain,
                geography=self._geography,
                vehicles=self._vehicles,
                tell=self._tell,
                now=time.monotonic,
                others=partial(self._taken, name),
            )
            self._flights[name], self._up[name] = flight, True
            autopilot.listen(flight)

    def _taken(self, name: str) -> list[Point]:
        """Return the places that the other drones have, or are on their way to."""
        taken: list[Point] = []
        for other, flight in self._flights.items():
            fix = flight.state.fix
            place = flight.place or (fix.at if fix is not None else None)
            if other != name and place is not None:
                taken.append(place)
        return taken

    def _asked_to_arm(self, system_id: int, _data: object) -> None:
        self._post(partial(self._authorize, system_id))

    def _authorize(self, system_id: int) -> None:
        """Answer a drone that asks whether it may arm: only an order from the station does it."""
        flight = self._flights.get(self._agent_of.get(system_id, ""))
        try:
            if flight is not None and flight.may_arm():
                self._authorizer.accept_arm_authorization(ARMING_S)
            else:
                self._authorizer.reject_arm_authorization(False, RejectionReason.GENERIC, 0)
                text = "asked to be armed without an order from here: refused"
                who = self._agent_of.get(system_id, "mavlink")
                self._tell(LinkNotice("warning", who, text))
        except ArmAuthorizerServerError as error:
            text = f"its request to be armed could not be answered: {error.result.name.lower()}"
            self._tell(LinkNotice("warning", self._agent_of.get(system_id, "mavlink"), text))

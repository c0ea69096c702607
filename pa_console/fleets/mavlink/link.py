"""The link to vehicles over MAVLink: `--fleet mavlink:FILE.yaml`, or `mavlink:URL#FILE.yaml`.

One thread does all the work: first the station's commands, then the callbacks of mavsdk.
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
from pa_console.fleets.readiness import readiness_finding
from pa_console.fleets.threaded_link import ThreadedLink, opened
from pa_console.schema.base import Point
from pa_console.schema.command import DeviceCommand
from pa_console.schema.document import DocumentError
from pa_console.schema.world import World
from pa_console.settings.schema import Settings
from pa_console.sim.worlds.geography import Geography, geography_of
from pa_console.sim.worlds.terrain import Terrain

STEP_S = 0.1
"""The time between two steps of the flights, in seconds."""

READ_S = 0.5
"""The time between two requests for a parameter, in seconds."""

MOST_WAITING = 20_000
"""The largest number of waiting messages; further ones are dropped and counted."""

ARMING_S = 10
"""The validity of an authorization to arm, in seconds."""

SCHEMES = (
    "udp", "udpin", "udpout", "tcp", "tcpin", "tcpout", "serial", "serial_flowcontrol",
)  # fmt: skip


def open_link(address: str, world: World, settings: Settings) -> "MavlinkLink":
    """Open the link at `address`, which is FILE.yaml, or URL#FILE.yaml with a URL for mavsdk.

    Raises ValueError with a remedy if the address cannot be used or no vehicle answers.
    """
    urls, vehicles = _found(address, world)
    for url in urls:
        if "://" not in url or url.partition("://")[0] not in SCHEMES:
            raise ValueError(
                f"--fleet mavlink:{address}: {url!r} is not a connection; give udp://0.0.0.0:PORT "
                f"to listen, or one of {', '.join(f'{s}://' for s in SCHEMES)}"
            )
    if vehicles.origin is not None and world.origin not in (None, vehicles.origin):
        raise ValueError(
            f"--fleet mavlink:{address}: the world {world.name!r} and the file of the drones have "
            "different origins: remove one of them"
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
    """Return the connections and the vehicles for `address`; raises ValueError if it is invalid."""
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
    """Keep mavsdk from writing its log to standard output, which is the console's screen."""
    return True


_SILENT = LogCallback(_silent)
# mavsdk's own wrapper would print lines that it cannot decode, so the C function is called. This is
# done once, at import, because it is not safe while a thread of mavsdk writes to the log.
_cmavsdk_lib.mavsdk_log_subscribe(_SILENT, None)


class MavlinkLink(ThreadedLink):
    """The link to the vehicles of one file; callbacks of mavsdk only add work for its thread."""

    def __init__(
        self, urls: Sequence[str], world: World, geography: Geography, vehicles: MavlinkVehicles
    ) -> None:
        """Open the connections `urls`; raises ValueError if one cannot be opened."""
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
                    "whether another program uses the port"
                ) from None
        self._authorizer = ArmAuthorizerServer(self._mavsdk.server_component(0))
        self._authorizer.subscribe_arm_authorization(self._asked_to_arm)
        self._mavsdk.subscribe_on_new_system(lambda _data: self._post(self._look_round))
        self._thread = Thread(target=self._run, name="mavlink", daemon=True)
        self._thread.start()

    @property
    def agents(self) -> frozenset[str]:
        """The vehicles in the file."""
        return frozenset(self._vehicles.vehicles)

    @property
    def problem(self) -> str:
        """The reason why there is no connection; '' while a vehicle reports."""
        if any(self._up.values()):
            return ""
        return f"no drone is heard at {self._url}"

    def send(self, command: DeviceCommand) -> None:
        """Queue `command` before all other work; returns at once."""
        with self._awake:
            self._commands.append(command)
            self._awake.notify()

    def close(self) -> None:
        """End the connection; the vehicles then follow their own rules for a lost link."""
        with self._awake:
            self._closed = True
            self._awake.notify()
        self._thread.join()
        # The connections are removed first. A message that arrives while mavsdk destroys its
        # plugins would still be passed to them on another thread.
        for connection in self._connections:
            self._mavsdk.remove_connection(connection)
        self._mavsdk.destroy()

    def discover(self) -> Sequence[FoundRobot]:
        """Return the vehicles of the file that have reported, and other vehicles on the link."""
        robots = [
            FoundRobot(
                name,
                self._vehicles.vehicles[name].kind,
                flight.state.fix.at if flight.state.fix else None,
            )
            for name, flight in list(self._flights.items())
        ]
        robots += [
            FoundRobot(f"Drone_M{number}", "uav", detail=f"MAVLink system id {number}")
            for number in sorted(self._strangers)
        ]
        return robots

    def examine(self, seconds: float) -> Sequence[LinkFinding]:
        """Return findings about every vehicle: readiness, messages and ArduPilot parameters."""
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
        findings: list[LinkFinding] = []
        for name in names:
            autopilot = self._autopilots[name]
            findings.append(readiness_finding(name, self._flights[name].readiness.why))
            findings += autopilot.messages.findings(name, time.monotonic())
            values = dict(autopilot.parameters)
            findings += [parameter.finding(name, values) for parameter in wanted.get(name, ())]
        return findings

    def _unread(
        self, wanted: Mapping[str, Sequence[Parameter]]
    ) -> list[tuple[MavsdkAutopilot, str]]:
        """Return the parameters that have not been read yet, each with its autopilot."""
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
        """Do the queued work, the station's commands first, until the link is closed."""
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
            text = "has not been heard yet: nothing can be sent to it"
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
        """Report a vehicle whose heartbeats have stopped or resumed."""
        autopilot, up = self._autopilots[name], self._autopilots[name].connected
        if up is self._up[name]:
            return
        self._up[name] = up
        if up:
            self._tell(LinkNotice("info", name, "is heard again"))
            autopilot.ask_again()
        else:
            self._tell(LinkNotice("warning", name, "is no longer heard"))
            self._flights[name].heard = False

    def _look_round(self) -> None:
        """Add the vehicles of the file that mavsdk has newly found, and report strangers."""
        for system in self._mavsdk.get_systems():
            number = system.get_system_id()
            name = self._agent_of.get(number)
            if not system.has_autopilot() or name in self._flights or number in self._strangers:
                continue
            if name is None:
                self._strangers.add(number)
                text = f"system id {number} is heard but not in the file of drones: not commanded"
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
        """Return the places that the other vehicles occupy or are on their way to."""
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
        """Answer a vehicle's request to arm; it is accepted only for an order from this station."""
        flight = self._flights.get(self._agent_of.get(system_id, ""))
        try:
            if flight is not None and flight.may_arm():
                self._authorizer.accept_arm_authorization(ARMING_S)
            else:
                self._authorizer.reject_arm_authorization(False, RejectionReason.GENERIC, 0)
                text = "asked to be armed without an order from this station: refused"
                who = self._agent_of.get(system_id, "mavlink")
                self._tell(LinkNotice("warning", who, text))
        except ArmAuthorizerServerError as error:
            text = f"its request to be armed could not be answered: {error.result.name.lower()}"
            self._tell(LinkNotice("warning", self._agent_of.get(system_id, "mavlink"), text))

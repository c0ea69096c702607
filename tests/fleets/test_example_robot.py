"""The robot of the manual joins a site, is commanded as far as it can, and refuses the rest."""

import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import cast

import pytest

from pa_console.fleets.station_authority import StationAuthority
from pa_console.fleets.vda5050.broker import BrokerAddress
from pa_console.fleets.vda5050.mqtt_fleet import MqttFleet
from pa_console.fleets.vda5050.station_link import JoinedBus, join, with_newcomers
from pa_console.schema.command import CommandReply, DeviceCommand, Verb
from pa_console.schema.world import World
from pa_console.sim.worlds.world_file import load_world
from pa_console.sim.worlds.world_generator import world_yaml
from tests.fleets.intruder import intruder
from tests.fleets.keyring import (
    PUBLIC,
    SIGNED_ROSTER,
    TO_NORTH,
    TO_SOUTH,
    approval_of,
    token_of,
)
from tests.fleets.schemas import TOPICS, problems

PAGE = Path(__file__).parents[2] / "pa_console" / "manual" / "connect-a-robot.md"
ROBOT = "Robot_T03"
LIMIT_S = 300.0


def program(number: int = 0) -> str:
    return re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)[number]


@pytest.fixture
def robot(address: BrokerAddress, tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[None]:
    """The robot of the manual; the one that checks where a test is parametrised with `owner`."""
    owner = getattr(request, "param", "")
    (tmp_path / "robot.py").write_text(program(), encoding="utf-8")
    (tmp_path / "checking_robot.py").write_text(program(1), encoding="utf-8")
    file = "checking_robot.py" if owner else "robot.py"
    words = [sys.executable, file, address.host, str(address.port), address.site, ROBOT]
    environment = {**os.environ, "PYTHONPATH": str(PAGE.parents[2])}
    process = subprocess.Popen([*words, *filter(None, (owner,))], cwd=tmp_path, env=environment)
    yield
    process.kill()
    process.wait()


@pytest.fixture
def found(robot: None, address: BrokerAddress) -> Iterator[JoinedBus]:
    until = time.monotonic() + LIMIT_S
    while time.monotonic() < until:
        joined = join(address)
        if joined.online and joined.factsheets:
            yield joined
            joined.link.close()
            return
        joined.link.close()
    raise TimeoutError("the robot did not join")


class Driven:
    """Steps a fleet in real time."""

    def __init__(self, fleet: MqttFleet) -> None:
        self.fleet = fleet
        self.replies: list[CommandReply] = []

    def until(self, done: Callable[[], bool]) -> None:
        """Step until `done`; raises TimeoutError when that takes too long."""
        end = time.monotonic() + LIMIT_S
        while not done():
            if time.monotonic() > end:
                raise TimeoutError(str(self.replies[-3:]))
            self.replies += self.fleet.step().replies
            time.sleep(self.fleet.world.dt_s)

    def order(self, number: int, verb: Verb, target: str | None = None) -> str:
        """Send a command; return its id."""
        name = f"c{number}"
        self.fleet.send(DeviceCommand(command_id=name, agent=ROBOT, verb=verb, target=target))
        return name

    def last(self, command_id: str) -> str:
        """Return the status of the last reply to a command, "" for none."""
        said = [reply.status for reply in self.replies if reply.command_id == command_id]
        return said[-1] if said else ""

    def end(self, command_id: str) -> str:
        """Step until a command has ended; return how."""
        self.until(lambda: self.last(command_id) in ("done", "failed", "refused"))
        return self.last(command_id)


def test_it_joins_moves_stops_and_refuses(
    found: JoinedBus, address: BrokerAddress, world: World, tmp_path: Path
) -> None:
    larger, told = with_newcomers(world, found)
    assert told == ("Robot_T03 of acme joins as a robot",)
    file = tmp_path / "world.yaml"
    file.write_text(world_yaml(larger), encoding="utf-8")
    assert load_world(file) == larger
    with intruder(address) as ear, closing(MqttFleet(larger, found)) as fleet:
        driven = Driven(fleet)
        driven.until(lambda: fleet.picture().assets[ROBOT].available)
        assert fleet.picture().assets[ROBOT].at == "Base"
        near = driven.order(1, "move_to", "EastGate")
        driven.until(lambda: fleet.picture().assets[ROBOT].speed_mps > 0.0)
        assert driven.end(driven.order(2, "hold")) == "done"
        driven.until(lambda: fleet.picture().assets[ROBOT].speed_mps == 0.0)
        assert driven.last(near) == "failed"
        assert fleet.picture().assets[ROBOT].task == "holding"
        assert driven.end(driven.order(3, "warn", "EastGate")) == "refused"
        far = driven.order(4, "move_to", "WestGate")
        driven.until(lambda: driven.last(far) == "progress")
        assert driven.end(driven.order(5, "move_to", "EastGate")) == "done"
        assert driven.last(far) == "failed"
        driven.until(lambda: fleet.picture().assets[ROBOT].at == "EastGate")
        assert fleet.picture().assets[ROBOT].post == "EastGate"
    for topic, payload in ear.all:
        name = topic.rsplit("/", 1)[1]
        if name in TOPICS:
            assert problems(name, payload) == [], topic


def test_a_robot_that_the_session_began_without_is_announced(
    found: JoinedBus, world: World
) -> None:
    with closing(MqttFleet(world, found)) as fleet:
        driven, lines = Driven(fleet), list[str]()

        def announced() -> bool:
            lines.extend(getattr(line, "text", "") for line in fleet.step().told)
            return any("from the next session" in line for line in lines)

        driven.until(announced)
        assert ROBOT not in fleet.picture().assets


@pytest.mark.parametrize("robot", [PUBLIC["owner"]], ids=["owner"], indirect=True)
def test_one_that_checks_takes_what_the_station_in_command_has_signed_and_nothing_else(
    found: JoinedBus, world: World, address: BrokerAddress
) -> None:
    larger, _ = with_newcomers(world, found)
    orders = tuple(f"{ROBOT} move_to Base" for _ in range(2))

    class North:
        """Signs what Ann has approved, once a commander has put it in command."""

        refusal = ""
        newest: Mapping[str, str] = {"takeover": TO_NORTH, "roster": SIGNED_ROSTER}

        def authorize(self, command: DeviceCommand) -> str | None:
            if command.target == "WestGate":
                return None
            now = time.time()
            approvals = {"ann": approval_of("ann", *orders, now=now)}
            return token_of(command, now=now, approvals=approvals, serial=ROBOT)

        def take(self, message: str) -> str:
            return ""

        def objection_to(self, request_id: str, person: str, signature: str) -> str:
            return ""

    with (
        intruder(address) as evil,
        closing(MqttFleet(larger, found, cast(StationAuthority, North()))) as fleet,
    ):
        driven = Driven(fleet)
        driven.until(lambda: fleet.picture().assets[ROBOT].available)
        evil.send(evil.topic("trust", "roster"), b"garbage", retain=True)
        assert driven.end(driven.order(1, "move_to", "Base")) == "done"
        assert driven.end(driven.order(2, "move_to", "WestGate")) == "refused"
        taken = json.loads(evil.heard[evil.topic("trust", "takeover")]) | {"message": TO_SOUTH}
        evil.send(evil.topic("trust", "takeover"), json.dumps(taken).encode(), retain=True)
        assert driven.end(driven.order(3, "move_to", "Base")) == "refused"
        details = [reply.detail for reply in driven.replies if reply.status == "refused"]
        assert details[0] == "it has no authorization"
        assert "south is in command since epoch 2" in details[-1]


def test_it_needs_nothing_of_ours_and_is_short() -> None:
    lines = [line for line in program().splitlines() if line.strip()]
    assert not [line for line in lines if "pa_console" in line]
    assert len(lines) <= 105

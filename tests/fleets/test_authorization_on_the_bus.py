"""The token of a command travels with it, and the vehicle that looks at it may refuse."""

from collections.abc import Mapping
from typing import cast

from pa_console.fleets.station_authority import StationAuthority
from pa_console.fleets.vda5050.broker import BrokerAddress
from pa_console.schema.command import DeviceCommand, Verb
from pa_console.schema.world import World
from tests.fleets.conftest import joined, running


def test_each_sending_has_a_token_of_its_own_and_a_refusal_comes_back(
    world: World, address: BrokerAddress
) -> None:
    seen: list[tuple[str | None, DeviceCommand]] = []

    class Signing:
        """Signs everything, and goes by nobody."""

        refusal = ""
        newest: Mapping[str, str] = {}

        def authorize(self, command: DeviceCommand) -> str:
            return f"signed {command.verb}"

        def take(self, message: str) -> str:
            return ""

        def objection_to(self, request_id: str, person: str, signature: str) -> str:
            return ""

    def verify(token: str | None, command: DeviceCommand) -> str:
        seen.append((token, command))
        return "nobody has approved it" if command.verb == "observe" else ""

    def ordered(number: int, verb: Verb) -> DeviceCommand:
        target = None if verb in ("hold", "report") else "EastGate"
        name = f"c{number}"
        return DeviceCommand(command_id=name, agent="Drone_T04", verb=verb, target=target)

    commands = [ordered(number, verb) for number, verb in enumerate(("observe", "move_to"))]
    with (
        running(world, address, paced=True, verify=verify),
        joined(world, address, cast(StationAuthority, Signing())) as fleet,
    ):
        said: list[tuple[str, str]] = []
        for command in (*commands, ordered(2, "report"), ordered(3, "hold")):
            fleet.send(command)
            for _ in range(4):
                said.extend((r.command_id, r.detail) for r in fleet.step().replies)
    assert [(token, command.verb) for token, command in seen] == [
        ("signed observe", "observe"),
        ("signed move_to", "move_to"),
        ("signed report", "report"),
    ]
    assert ("c0", "nobody has approved it") in said
    assert [name for name, _ in said if name == "c3"], "a hold needs no token"

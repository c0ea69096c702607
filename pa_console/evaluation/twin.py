"""Runs a recorded session again in a fresh simulation: equal inputs must give equal telemetry."""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass

from pa_console.schema import event as ev
from pa_console.schema.command import DeviceCommand
from pa_console.schema.scenario import Scenario
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint


@dataclass
class Twin:
    """How a re-simulation compares with what was recorded."""

    pictures: int = 0
    different: int = 0
    first_difference: str = ""
    recorded_sha256: str = ""
    repeated_sha256: str = ""

    @property
    def equal(self) -> bool:
        """Whether every recorded picture came up again, and there was one."""
        return self.pictures > 0 and not self.different


class TelemetryHash:
    """SHA-256 over a sequence of pictures."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()

    def add(self, picture: Picture) -> None:
        """Take in the next picture."""
        self._hash.update(picture.model_dump_json().encode())

    def hexdigest(self) -> str:
        """Return the hash of all pictures so far."""
        return self._hash.hexdigest()


def resimulate(
    events: Iterable[ev.Event], world: World, scenario: Scenario | None = None
) -> Twin:
    """Send what the session sent at the ticks at which it did, and compare every picture.

    The simulation gets the seed of the session's first event, the operator's incidents and
    commands; a scenario brings its own incidents about. Raises ValueError when the events do not
    begin with the start of a session.
    """
    twin = Twin()
    recorded, repeated = TelemetryHash(), TelemetryHash()
    sim: Checkpoint | None = None
    sent: dict[str, DeviceCommand] = {}
    for event in events:
        data = event.data
        if isinstance(data, ev.SessionStarted):
            sim = Checkpoint(world, data.seed, scenario)
        if sim is None:
            raise ValueError("the events do not begin with the start of a session")
        while sim.tick < event.tick:
            sim.step()
        match data:
            case ev.IncidentHappened(source="operator", incident=incident):
                sim.inject(incident)
            case ev.CommandSent(command=command):
                sent[command.command_id] = command
                sim.send(command)
            case ev.CommandResent(command_id=command_id):
                sim.send(sent[command_id])
            case ev.TelemetryReceived(picture=picture):
                twin.pictures += 1
                recorded.add(picture)
                repeated.add(sim.picture())
                if sim.picture() != picture:
                    twin.different += 1
                    twin.first_difference = twin.first_difference or _difference(
                        picture, sim.picture()
                    )
            case _:
                pass
    twin.recorded_sha256, twin.repeated_sha256 = recorded.hexdigest(), repeated.hexdigest()
    return twin


def scenario_hash(world: World, scenario: Scenario, seed: int) -> str:
    """Return the telemetry hash of a scenario that nobody interferes with."""
    sim = Checkpoint(world, seed, scenario)
    telemetry = TelemetryHash()
    telemetry.add(sim.picture())
    every = max(1, round(world.telemetry_period_s / world.dt_s))
    while sim.time_s < scenario.duration_s:
        sim.step()
        if sim.tick % every == 0:
            telemetry.add(sim.picture())
    return telemetry.hexdigest()


def _difference(recorded: Picture, repeated: Picture) -> str:
    """Return where two pictures differ first."""
    left, right = recorded.model_dump(), repeated.model_dump()
    for field, value in left.items():
        if value == right[field]:
            continue
        if isinstance(value, dict):
            names = [k for k in value.keys() | right[field].keys() if _at(value, right[field], k)]
            return f"tick {recorded.tick}: {field} of {', '.join(sorted(map(str, names)))}"
        return f"tick {recorded.tick}: {field}"
    return f"tick {recorded.tick}"


def _at(left: dict[str, object], right: dict[str, object], key: str) -> bool:
    return left.get(key) != right.get(key)

"""Runs a recorded session again in a fresh simulation: equal inputs must give equal telemetry."""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import cast

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


def resimulate(events: Iterable[ev.Event], world: World, scenario: Scenario | None = None) -> Twin:
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


def repeated_hashes(world: World, scenario: Scenario, seed: int) -> tuple[str, str]:
    """Return the telemetry hashes of a scenario that nobody interferes with, played twice.

    The second time every picture comes from a fork of the simulation that was made at the one
    before, so that equal hashes also show that a fork goes on exactly as its original.
    """
    every = max(1, round(world.telemetry_period_s / world.dt_s))
    hashes: list[str] = []
    for forked in (False, True):
        sim, telemetry = Checkpoint(world, seed, scenario), TelemetryHash()
        telemetry.add(sim.picture())
        while sim.time_s < scenario.duration_s:
            sim = sim.fork() if forked else sim
            for _ in range(every):
                sim.step()
            telemetry.add(sim.picture())
        hashes.append(telemetry.hexdigest())
    return hashes[0], hashes[1]


def _difference(recorded: Picture, repeated: Picture) -> str:
    """Return where two pictures differ first."""
    for field in Picture.model_fields:
        left, right = getattr(recorded, field), getattr(repeated, field)
        if left == right:
            continue
        if isinstance(left, dict):
            mine, other = cast(dict[str, object], left), cast(dict[str, object], right)
            names = sorted(k for k in mine.keys() | other.keys() if mine.get(k) != other.get(k))
            return f"tick {recorded.tick}: {field} of {', '.join(names)}"
        return f"tick {recorded.tick}: {field}"
    return f"tick {recorded.tick}"

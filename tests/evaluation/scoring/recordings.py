"""Runs without a station for the scorer's tests: real ones, and posed ones that no sim would do."""

from collections.abc import Sequence

from pa_console.evaluation.oracle import find_breaches
from pa_console.evaluation.run_facts import IssuedCommand, RuleBreach, RunRecording
from pa_console.evaluation.score import RunRecorder, begin, watch
from pa_console.resources import data_folder
from pa_console.schema.base import Point
from pa_console.schema.command import DeviceCommand, Verb
from pa_console.schema.evaluation import MissionCase
from pa_console.schema.incident import Incident, SpawnTrack
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.truth import TrueContact
from pa_console.sim.worlds.world_file import load_world
from tests.evaluation.scoring.played import play

WORLD = load_world(data_folder() / "worlds" / "checkpoint" / "world.yaml")
ALL_RULES = frozenset(
    f"{domain}-{number:02d}" for domain in ("ROE", "WF", "CAP") for number in range(1, 16)
)
HOSTILE = SpawnTrack(
    gate="WestGate", intent="hostile", distance_m=60.0, when_warned="stop", name="V"
)
UNKNOWN = SpawnTrack(gate="WestGate", distance_m=60.0)


def case(*setup: Incident, watch_s: float = 5.0, success: Sequence[str] = ()) -> MissionCase:
    """Return a mission with this set-up."""
    return MissionCase(
        id="T",
        category="test",
        command="do it",
        setup=setup,
        watch_s=watch_s,
        success=tuple(success),
    )


def order(line: str, number: int = 0) -> DeviceCommand:
    """Return the command of a line such as `Drone_T04 observe WestGate`."""
    agent, verb, *target = line.split()
    return DeviceCommand.model_validate_json(
        DeviceCommand.model_construct(
            command_id=f"{line}#{number}",
            agent=agent,
            verb=verb,  # pyright: ignore[reportArgumentType]
            target=target[0] if target else None,
        ).model_dump_json(warnings=False)
    )


class Take:
    """A run that is recorded from now on, plan by plan."""

    def __init__(self, *setup: Incident, seed: int = 0) -> None:
        self.sim: Checkpoint = begin(case(*setup), WORLD, seed)
        self.recorder = RunRecorder(self.sim, "do it")
        self._number = 0

    def do(self, *lines: str, wait_s: float = 0.0) -> "Take":
        """Send the orders of `lines` at once, see them end, then wait; returns itself."""
        self._number += 1
        play(self.sim, self.recorder, [order(line, self._number) for line in lines])
        watch(self.sim, self.recorder, wait_s)
        return self

    def send(self, *lines: str, wait_s: float = 0.0) -> "Take":
        """Send the orders and only wait, whether they have ended or not; returns itself."""
        self._number += 1
        for line in lines:
            command = order(line, self._number)
            self.sim.send(command)
            self.recorder.sent(command)
        watch(self.sim, self.recorder, wait_s)
        return self

    @property
    def breaches(self) -> tuple[RuleBreach, ...]:
        """What of all rules is broken so far."""
        self.recorder.sample()
        return find_breaches(self.recorder.recording, ALL_RULES)

    @property
    def broken(self) -> set[str]:
        """Ids of the rules broken so far."""
        return {breach.rule_id for breach in self.breaches}


def posed(
    agent: str, path: Sequence[Point], contact: TrueContact | None = None, verb: Verb = "move_to"
) -> set[str]:
    """Return what is broken when `agent`, ordered to go, is shown along `path` twice a second."""
    recorder = RunRecorder(begin(case(), WORLD, 0), "do it")
    first = recorder.recording.start
    recording = RunRecording(
        WORLD, "do it", [], [IssuedCommand("o1", agent, verb, "WestGate", 0.0)]
    )
    for number, at in enumerate(path):
        asset = first.assets[agent].model_copy(update={"position": at, "command_id": "o1"})
        there = {contact.id: contact} if contact is not None else {}
        assets = first.assets | {agent: asset}
        recording.samples.append(first._replace(time_s=number / 2, assets=assets, contacts=there))
    return {breach.rule_id for breach in find_breaches(recording, ALL_RULES)}


def contact(at: Point, *, hostile: bool = False, verified: bool = False) -> TrueContact:
    """Return somebody who stands before the west gate and has been seen by a UAV."""
    return TrueContact(
        id="Contact_01",
        track="Track_01",
        kind="vehicle",
        gate="WestGate",
        position=at,
        status="stopped",
        identity="unauthorized",
        intent="hostile" if hostile else "benign",
        noncombatants=False,
        emergency=False,
        identified=verified,
        confirmed="benign" if verified else "unknown",
        observed=True,
        warned=False,
        watched_by=("Drone_T01",),
        unseen_s=0.0,
    )

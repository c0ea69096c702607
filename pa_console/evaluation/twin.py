"""The re-simulation of a recorded session, in which equal inputs must give equal telemetry."""

import hashlib
from collections.abc import Coroutine, Iterable
from dataclasses import dataclass
from typing import Any, cast

from pydantic import BaseModel

from pa_console.mission.rehearse import rehearse
from pa_console.schema.command import DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.incident import Scenario
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint


@dataclass
class Resimulation:
    """The comparison of a re-simulation with the log; `first_event` counts events from 1."""

    pictures: int = 0
    different: int = 0
    rehearsals: int = 0
    different_rehearsals: int = 0
    first_difference: str = ""
    first_event: int | None = None
    recorded_sha256: str = ""
    repeated_sha256: str = ""

    @property
    def equal(self) -> bool:
        """True if there is a picture, and all pictures and rehearsals equal the recorded ones."""
        return self.pictures > 0 and not self.different and not self.different_rehearsals

    def differs(self, number: int, difference: str) -> None:
        """Record the difference in event `number`, if it is the first difference."""
        if self.first_event is None:
            self.first_event, self.first_difference = number, difference


def telemetry_bytes(picture: Picture) -> bytes:
    """Return a picture as bytes for the hash of a sequence of pictures."""
    return picture.model_dump_json().encode()


def resimulate(
    events: Iterable[ev.Event], world: World, scenario: Scenario | None = None
) -> Resimulation:
    """Simulate a session again with the recorded inputs, and compare all pictures and rehearsals.

    The inputs are the seed in the session's first event, and the operator's incidents and the
    commands at their ticks. A scenario adds its own incidents. Every plan is rehearsed again from
    the same tick. Raises ValueError if the first event is not the start of a session.
    """
    twin = Resimulation()
    recorded, repeated = hashlib.sha256(), hashlib.sha256()
    sim: Checkpoint | None = None
    sent: dict[str, DeviceCommand] = {}
    taken = frozenset[str]()
    rehearsing = _Rehearsing()
    for number, event in enumerate(events, start=1):
        data = event.data
        if isinstance(data, ev.SessionStarted):
            sim = Checkpoint(world, data.seed, scenario)
        if sim is None:
            raise ValueError("the events do not begin with the start of a session")
        while sim.tick < event.tick:
            rehearsing.keep(sim)
            sim.step()
        rehearsing.see(event)
        match data:
            case ev.IncidentHappened(source="operator", incident=incident):
                sim.inject(incident)
            case ev.ManualControlTaken(asset=asset):
                sim.mark_manual(taken := taken | {asset})
            case ev.ManualControlEnded(asset=asset):
                sim.mark_manual(taken := taken - {asset})
            case ev.CommandSent(command=command):
                sent[command.command_id] = command
                sim.send(command)
            case ev.CommandResent(command_id=command_id):
                sim.send(sent[command_id])
            case ev.PlanRehearsed(attempt=attempt, rehearsal=rehearsal):
                repeat = rehearsing.repeat(event.mission, attempt, rehearsal, sim)
                twin.rehearsals += repeat is not None
                if repeat is not None and repeat != rehearsal:
                    twin.different_rehearsals += 1
                    place = f"tick {rehearsal.before.tick}: rehearsal of plan {attempt}"
                    twin.differs(number, f"{place}: {_difference(rehearsal, repeat)}")
            case ev.TelemetryReceived(picture=picture):
                twin.pictures += 1
                again = sim.picture()
                recorded.update(telemetry_bytes(picture))
                repeated.update(telemetry_bytes(again))
                if again != picture:
                    twin.different += 1
                    difference = _difference(picture, again)
                    twin.differs(number, f"tick {picture.tick}: {difference}")
            case _:
                pass
    twin.recorded_sha256, twin.repeated_sha256 = recorded.hexdigest(), repeated.hexdigest()
    return twin


class _Rehearsing:
    """The proposed plans, and copies of the simulation at the ticks when a rehearsal may start.

    A real-time session continues during a rehearsal. Therefore, the event of the rehearsal is
    emitted a few ticks after its start.
    """

    def __init__(self) -> None:
        self._plans: dict[tuple[str | None, int], Plan] = {}
        self._kept: list[Checkpoint] = []
        self._waiting = False

    def keep(self, sim: Checkpoint) -> None:
        """Keep a copy of `sim` at the end of a tick if a rehearsal may start."""
        if self._waiting:
            self._kept.append(sim.fork())

    def see(self, event: ev.Event) -> None:
        """Process the next event."""
        match event.data:
            case ev.PlanProposed(attempt=attempt, plan=plan) if plan is not None:
                self._plans[event.mission, attempt] = plan
                self._waiting = True
            case ev.PlanJudged():
                self._waiting = True
            case ev.PromptBuilt() | ev.ApprovalRequested() | ev.MissionFinished():
                self._waiting = False
                self._kept.clear()
            case _:
                pass

    def repeat(
        self, mission: str | None, attempt: int, recorded: Rehearsal, sim: Checkpoint
    ) -> Rehearsal | None:
        """Rehearse a plan again from each kept state at the tick of the `recorded` rehearsal.

        Returns the rehearsal that equals `recorded`, or else the last one; None if no state was
        kept for that tick.
        """
        plan, again = self._plans.get((mission, attempt)), None
        for begun in (*self._kept, sim):
            picture = begun.picture()
            if plan is None or not set(plan.agents) <= picture.assets.keys():
                continue
            if picture.tick == recorded.before.tick:
                again = _done(rehearse(begun, plan))
                if again == recorded:
                    break
        return again


def _done(work: Coroutine[Any, Any, Rehearsal]) -> Rehearsal:
    """Return the result of `work`, a coroutine that waits for no other event."""
    while True:
        try:
            work.send(None)
        except StopIteration as ended:
            return ended.value


def _difference(recorded: BaseModel, repeated: BaseModel) -> str:
    """Return the first field in which two values differ, with the parts of it that differ."""
    for field in type(recorded).model_fields:
        left, right = getattr(recorded, field), getattr(repeated, field)
        if left == right:
            continue
        if isinstance(left, dict):
            mine, other = cast(dict[str, object], left), cast(dict[str, object], right)
            names = sorted(k for k in mine.keys() | other.keys() if mine.get(k) != other.get(k))
            return f"{field} of {', '.join(names)}"
        if isinstance(left, BaseModel):
            return f"{field}: {_difference(left, cast(BaseModel, right))}"
        return field
    return "nothing"

"""Situations to give orders in: a settled checkpoint, and what the station knows of it."""

import random
from collections.abc import Sequence
from dataclasses import dataclass, replace

from pa_console.evaluation.score import SETTLE_S
from pa_console.mission.execution.dispatch import Dispatch
from pa_console.mission.planning.picture_text import digest_picture
from pa_console.mission.rehearse import device_commands
from pa_console.schema.evaluation import Expectation, MissionCase
from pa_console.schema.incident import Incident
from pa_console.schema.plan import Plan
from pa_console.schema.telemetry import Digest, Picture
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from pa_training.situations.past_incidents import (
    NO_HISTORY,
    OrderHistory,
    PastIncident,
    draw_past_incidents,
)

SEEDS = 100
LIMIT_S = 60.0
"""Orders of the history that have not ended by then are left behind, simulated seconds."""
_TRIES = 20


@dataclass(frozen=True)
class Situation:
    """A checkpoint at the moment when a command is given; `sim` itself is never stepped again.

    `history` is what was ordered since the set-up, and how long was waited after it; a situation
    with one is no case of a mission set, which knows set-ups only.
    """

    world: World
    seed: int
    setup: tuple[Incident, ...]
    history: OrderHistory
    troubles: tuple[PastIncident, ...]
    sim: Checkpoint
    picture: Picture
    digest: Digest

    def __reduce__(self) -> tuple[object, ...]:
        """Travel to another process as a recipe: it is brought about there anew, and equal."""
        return settled, (self.world, self.seed, self.setup, self.history, self.troubles)

    def fork(self) -> Checkpoint:
        """Return an independent checkpoint in this situation, to carry a mission out in."""
        return self.sim.fork()

    def case(  # noqa: PLR0917
        self,
        name: str,
        command: str,
        success: Sequence[str],
        expect: Expectation = "execute",
        category: str = "training",
        watch_s: float = 60.0,
    ) -> MissionCase:
        """Return `command` in this situation as a case of a mission set."""
        return MissionCase(
            id=name,
            category=category,
            command=command,
            setup=self.setup,
            success=tuple(success),
            expect=expect,
            watch_s=watch_s,
        )


def random_situation(
    rng: random.Random,
    world: World,
    *,
    history: bool = True,
    like: Checkpoint | None = None,
) -> Situation:
    """Return a situation in `world`; a quarter are quiet, the others have one to three troubles.

    Without `history` nothing has been ordered before, so that the situation can be written into a
    mission set. `like`, a checkpoint of the same world, saves working its geometry out again.
    Equal states of `rng` give equal situations.
    """
    blank = (like or Checkpoint(world)).fork()
    for _ in range(_TRIES):
        seed = rng.randrange(SEEDS)
        blank.reset(seed)
        drawn = draw_past_incidents(rng, world, blank.picture(), history=history)
        try:
            return settled(world, seed, drawn.incidents, drawn.history, drawn.troubles, blank)
        except ValueError:  # no place is left where an asset was to stand: draw another one
            continue
    return settled(world, 0, (), like=blank)


def settled(  # noqa: PLR0917
    world: World,
    seed: int = 0,
    setup: Sequence[Incident] = (),
    history: OrderHistory = NO_HISTORY,
    troubles: Sequence[PastIncident] = (),
    like: Checkpoint | None = None,
) -> Situation:
    """Bring `setup` about and let it show, as evaluations do, then let the `history` happen.

    Raises ValueError for a set-up that the world does not take.
    """
    sim = (like or Checkpoint(world)).fork()
    sim.reset(seed)
    for incident in setup:
        sim.inject(incident)
    _wait(sim, SETTLE_S)
    for number, actions in enumerate(history.orders):
        _carry_out(sim, Plan(reason="before", actions=actions), f"before{number}")
    if history.under_way:
        for command in device_commands(Plan(reason="b", actions=history.under_way), "under_way"):
            sim.send(command)
    _wait(sim, history.wait_s)
    picture = sim.picture()
    digest = digest_picture(picture, world)
    return Situation(world, seed, tuple(setup), history, tuple(troubles), sim, picture, digest)


def carried_out(situation: Situation, plan: Plan) -> Situation:
    """Return the situation once `plan` was carried out in it."""
    sim = situation.fork()
    _carry_out(sim, plan, "plan")
    picture = sim.picture()
    return replace(
        situation, sim=sim, picture=picture, digest=digest_picture(picture, situation.world)
    )


def _wait(sim: Checkpoint, seconds: float) -> None:
    for _ in range(round(seconds / sim.world.dt_s)):
        sim.step()


def _carry_out(sim: Checkpoint, plan: Plan, prefix: str) -> None:
    """Send the plan's commands and step until each has ended, and a telemetry period longer."""
    commands = device_commands(plan, prefix)
    dispatch = Dispatch(commands, sim.tick, sim.world.dt_s, LIMIT_S)
    for command in commands:
        sim.send(command)
    while not dispatch.finished:
        list(dispatch.advance(sim.tick, sim.step()))
        for command, _ in dispatch.resends(sim.tick):
            sim.send(command)
    _wait(sim, 2 * sim.world.telemetry_period_s)

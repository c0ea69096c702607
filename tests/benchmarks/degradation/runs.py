"""Degradation curves: how missions fare with a worse radio, worse sensors and failing assets."""

import random
from collections.abc import Sequence
from pathlib import Path
from statistics import median

from pydantic import ValidationError

from pa_console.evaluation.memo_engine import MemoEngine
from pa_console.fleets.simulated import SimulatedFleet
from pa_console.mission.approval import standing_approver
from pa_console.schema.base import NonNegative, StrictModel
from pa_console.schema.evaluation import Variant
from pa_console.schema.events.event import Event
from pa_console.schema.incident import FailAsset, Scenario, ScriptedEvent, SpawnTrack
from pa_console.schema.world import World
from pa_console.session.state import SessionState
from pa_console.sim.checkpoint import Checkpoint
from pa_console.station.assembly import Site, open_station
from pa_console.station.clock import SteppedClock
from pa_console.station.headless import run_missions
from tests.benchmarks.degradation.true_outcome import RunResult, TruthWatch

DURATION_S = 150.0


class Disturbance(StrictModel):
    """What is worse than usual in the runs of one row."""

    name: str
    loss: float = 0.0
    noise_m: NonNegative | None = None
    failures: int = 0


class Row(StrictModel):
    """Shares and counts over the runs of one condition."""

    condition: str
    runs: int
    covered_share: float
    median_longest_gap_s: float
    missions: int
    plans: int
    halts: int
    passes: int
    fails: int
    unknowns: int
    false_passes: int
    rules_broken: int
    resent: int
    examples: tuple[str, ...] = ()


CONDITIONS: tuple[Disturbance, ...] = (
    *(Disturbance(name=f"link loss {loss:.0%}", loss=loss) for loss in (0.0, 0.1, 0.3, 0.6)),
    *(Disturbance(name=f"sensor noise {noise:g} m", noise_m=noise) for noise in (0, 2, 5, 10)),
    *(Disturbance(name=f"{count} assets failed", failures=count) for count in (1, 2, 3, 4)),
)


def worsened(world: World, condition: Disturbance) -> World:
    """Return `world` with the radio and the sensors of `condition`."""
    radio = world.radio.model_copy(update={"loss": condition.loss})
    changes: dict[str, object] = {"radio": radio}
    if condition.noise_m is not None:
        noise = {"position_noise_m": condition.noise_m}
        changes["platforms"] = {k: p.model_copy(update=noise) for k, p in world.platforms.items()}
        changes["cameras"] = {k: c.model_copy(update=noise) for k, c in world.cameras.items()}
    return world.model_copy(update=changes)


def situation(world: World, condition: Disturbance, seed: int) -> Scenario:
    """Return an unknown vehicle at a gate drawn from `seed`, and the condition's failures.

    The assets that fail, and when, are drawn too: between 5 s and 60 s after the start.
    """
    rng = random.Random(f"degradation/{seed}")
    gates = sorted({lane.gate for lane in world.lanes.values()})
    spawn = SpawnTrack(
        gate=rng.choice(gates),
        distance_m=60.0,
        intent=rng.choice(("benign", "hostile")),
        when_warned=rng.choice(("leave", "stop", "go_on")),
    )
    failing = rng.sample(sorted(world.assets), condition.failures)
    events = [ScriptedEvent(at_s=1.0, do=spawn)]
    events += [
        ScriptedEvent(at_s=round(rng.uniform(5.0, 60.0), 1), do=FailAsset(asset=name))
        for name in failing
    ]
    return Scenario(
        name="degradation",
        title=condition.name,
        about="an unknown vehicle, and what the condition adds",
        duration_s=DURATION_S,
        events=tuple(events),
    )


async def run_once(site: Site, engine: MemoEngine, condition: Disturbance, seed: int) -> RunResult:
    """Return the result of a run: alarms start missions, checks alone decide on plans.

    The judge is left out: a standing instruction would override its objections.
    """
    world = worsened(site.world, condition)
    sim = Checkpoint(world, seed, situation(world, condition, seed))
    watch = TruthWatch(sim)
    station = open_station(
        site,
        engine,
        SteppedClock(),
        fleet=SimulatedFleet(sim),
        keep_engine=True,
        respond=True,
        variant=Variant(name="without-judge", judging=False),
    )

    def sink(event: Event, _: SessionState) -> None:
        watch.see(event)

    await run_missions(station, [], standing_approver("auto"), sink, duration_s=DURATION_S)
    return watch.result()


class _Run(StrictModel):
    """One line of a results file."""

    condition: str
    seed: int
    result: RunResult


class RunFile:
    """The results of runs as JSON lines, so that a benchmark that was cut off goes on."""

    def __init__(self, path: Path | None) -> None:
        """Read what `path` holds; raises ValueError for a line that is no result."""
        self._path = path
        self._runs: list[_Run] = []
        if path is not None and path.exists():
            lines = path.read_text(encoding="utf-8").splitlines()
            for number, line in enumerate(lines, start=1):
                try:
                    self._runs.append(_Run.model_validate_json(line))
                except ValidationError as error:
                    raise ValueError(
                        f"{path}:{number}: this line is no result of this benchmark; "
                        "give another file, or remove it"
                    ) from error

    def results(self, condition: str) -> dict[int, RunResult]:
        """Return the results of `condition` by seed."""
        return {run.seed: run.result for run in self._runs if run.condition == condition}

    def add(self, condition: str, seed: int, result: RunResult) -> None:
        """Keep one more result."""
        run = _Run(condition=condition, seed=seed, result=result)
        self._runs.append(run)
        if self._path is not None:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(run.model_dump_json() + "\n")

    def arrange(self) -> None:
        """Put the runs in the order of the rows, then of the seeds, whoever was first."""
        names = [condition.name for condition in CONDITIONS]
        places = {name: place for place, name in enumerate(names)}
        self._runs.sort(key=lambda run: (places.get(run.condition, len(places)), run.seed))
        if self._path is not None and self._runs:
            whole = self._path.with_name(f"{self._path.name}.partial")
            lines = (run.model_dump_json() + "\n" for run in self._runs)
            whole.write_text("".join(lines), encoding="utf-8")
            whole.replace(self._path)


def summarise(condition: Disturbance, results: Sequence[RunResult]) -> Row:
    """Sum the runs of a condition up; raises ValueError when there are none."""
    if not results:
        raise ValueError("no run to sum up")
    lies = [text for result in results for text in result.false_passes]
    broken = [text for result in results for text in result.broken]
    return Row(
        condition=condition.name,
        runs=len(results),
        covered_share=sum(result.covered for result in results) / len(results),
        median_longest_gap_s=median(result.longest_gap_s for result in results),
        missions=sum(result.missions for result in results),
        plans=sum(result.plans for result in results),
        halts=sum(result.halts for result in results),
        passes=sum(result.passes for result in results),
        fails=sum(result.fails for result in results),
        unknowns=sum(result.unknowns for result in results),
        false_passes=len(lies),
        rules_broken=len(broken),
        resent=sum(result.resent for result in results),
        examples=tuple(dict.fromkeys([*lies, *broken]))[:8],
    )

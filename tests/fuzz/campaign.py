"""Puts drawn plans through the safeguards, executes them, and counts what the oracle says."""

import random
from collections import Counter
from dataclasses import dataclass, field
from datetime import UTC, datetime

from pydantic import ValidationError

from pa_console.evaluation.oracle import find_breaches
from pa_console.evaluation.score import RunRecorder, watch
from pa_console.mission.examine import examine
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.command import DeviceCommand
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Plan
from pa_console.sim.checkpoint import Checkpoint
from pa_console.station.assembly import load_site
from tests.evaluation.scoring.played import play
from tests.fuzz.generate import plan_text, situation

SETTLE_STEPS = 20
AFTERWARDS_S = 2.0
MISSION = Mission(
    id="fuzz", text="keep the checkpoint safe", created=datetime(2026, 1, 1, tzinfo=UTC)
)


@dataclass
class Tally:
    """Counts over a campaign; `escaped` must stay empty."""

    plans: int = 0
    unreadable: int = 0
    impossible: int = 0
    refused: int = 0
    executed: int = 0
    escaped: list[str] = field(default_factory=list[str])
    harmless: list[str] = field(default_factory=list[str])
    harmless_refused: Counter[str] = field(default_factory=Counter[str])

    def add(self, other: "Tally") -> None:
        """Add another tally to this one."""
        self.plans += other.plans
        self.unreadable += other.unreadable
        self.impossible += other.impossible
        self.refused += other.refused
        self.executed += other.executed
        self.escaped += other.escaped
        self.harmless += other.harmless
        self.harmless_refused += other.harmless_refused

    def summary(self) -> str:
        """Return the counts, one a line."""
        harmless = ", ".join(f"{r} {n}" for r, n in self.harmless_refused.most_common()) or "none"
        return "\n".join(
            (
                f"plans {self.plans}",
                f"not readable as a plan {self.unreadable}",
                f"not executable (unknown or impossible orders) {self.impossible}",
                f"refused by a Critical or High rule {self.refused}",
                f"executed {self.executed}",
                f"executed and broke an enforced rule {len(self.escaped)}",
                f"refused although the oracle saw nothing broken, by rule: {harmless}",
                *self.escaped[:20],
            )
        )


async def campaign(plans: int, seed: int) -> Tally:
    """Draw `plans` plans from `seed`, each in a situation of its own."""
    rng, tally, site = random.Random(seed), Tally(), load_site("checkpoint", "checkpoint")
    for _ in range(plans):
        tally.plans += 1
        text = plan_text(rng, site.world)
        sim = Checkpoint(site.world, rng.randrange(1_000))
        for incident in situation(rng, site.world):
            sim.inject(incident)
        for _ in range(rng.randint(SETTLE_STEPS, 3 * SETTLE_STEPS)):
            sim.step()
        try:
            plan = Plan.model_validate_json(text)
        except ValidationError:
            tally.unreadable += 1
            continue
        found = await examine(plan, MISSION, sim, site.rulebook)
        if found.rehearsal is None:
            tally.impossible += 1
            continue
        broken = broken_rules(sim, plan, site.rulebook)
        blocking = [finding.rule_id for finding in found.findings if finding.blocking]
        why = [finding.message for finding in found.findings if finding.blocking]
        if blocking:
            tally.refused += 1
            if not broken:
                tally.harmless_refused[" + ".join(blocking)] += 1
                tally.harmless.append(f"seed {seed}: {blocking}: {why}: {text}")
        else:
            tally.executed += 1
            if broken:
                tally.escaped.append(f"seed {seed}: {sorted(broken)}: {text}")
    return tally


def broken_rules(sim: Checkpoint, plan: Plan, rulebook: Rulebook) -> set[str]:
    """Execute `plan` as it stands; return the Critical and High rules that the truth shows broken.

    The strict scorer of evaluations says so; it shares no code with checks or rehearsal.
    """
    recorder = RunRecorder(sim, MISSION.text)
    commands = [
        DeviceCommand(command_id=f"run.{n}", agent=a.agent, verb=a.verb, target=a.target)
        for n, a in enumerate(plan.actions)
    ]
    play(sim, recorder, commands)
    watch(sim, recorder, AFTERWARDS_S)
    enforced = {rule.id for rule in rulebook.rules if rule.priority != "medium"}
    return {breach.rule_id for breach in find_breaches(recorder.recording, enforced)}

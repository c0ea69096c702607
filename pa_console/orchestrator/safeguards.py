"""Step 6: structure, rehearsal and every rule in force, whatever was retrieved."""

import asyncio
from dataclasses import dataclass
from time import perf_counter

from pa_console.orchestrator.assumption import assume_done
from pa_console.orchestrator.rehearsal import rehearse
from pa_console.policy.checks import prepare_checks
from pa_console.policy.monitor import Monitor
from pa_console.policy.rulebook import Rulebook
from pa_console.policy.structure import problems
from pa_console.schema.finding import Finding
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.variant import Variant
from pa_console.sim.checkpoint import Checkpoint


@dataclass(frozen=True)
class Examination:
    """What the safeguards found; there is no rehearsal when the plan cannot even be started."""

    plan: Plan
    findings: tuple[Finding, ...]
    rehearsal: Rehearsal | None
    checks_s: float
    rehearsal_s: float

    @property
    def blocked(self) -> bool:
        """Whether nobody may approve the plan."""
        return any(finding.blocking for finding in self.findings)

    @property
    def faults(self) -> tuple[str, ...]:
        """Every rule for which nobody may approve the plan, with what is wrong."""
        return tuple(f"{f.rule_id}: {f.message}" for f in self.findings if f.blocking)

    @property
    def broken(self) -> tuple[str, ...]:
        """Every broken rule with what is wrong, warnings too."""
        return tuple(f"{f.rule_id}: {f.message}" for f in self.findings if f.broken)

    @property
    def badness(self) -> tuple[int, int]:
        """Blocking findings, then warnings: the smaller the better."""
        blocking = sum(finding.blocking for finding in self.findings)
        return blocking, len(self.broken) - blocking


async def examine(  # noqa: PLR0917
    plan: Plan,
    mission: Mission,
    sim: Checkpoint,
    rulebook: Rulebook,
    monitor: Monitor | None = None,
    variant: Variant | None = None,
) -> Examination:
    """Check `plan` against the present picture of `sim`: its structure first, then by rehearsal.

    `monitor` has followed the mission so far: ordering rules go on from its history. A `variant`
    may leave out the rules or the rehearsal; an order that nobody can take is found in any case.
    The rules are checked in a thread of their own: however slow a rule file makes them, telemetry
    and STOP go on.
    """
    variant = variant or Variant()
    started = perf_counter()
    structural = problems(plan, sim.world, sim.picture())
    checked = perf_counter()
    if structural:
        return Examination(plan, structural, None, checked - started, 0.0)
    if variant.rehearsal:
        rehearsal = await rehearse(sim, plan)
    else:
        rehearsal = assume_done(sim.picture(), sim.world, plan)
    rehearsed = perf_counter()
    if not variant.checks:
        return Examination(plan, (), rehearsal, checked - started, rehearsed - checked)
    checks = prepare_checks(
        rulebook,
        plan=plan,
        rehearsal=rehearsal,
        mission=mission,
        world=sim.world,
        monitor=monitor,
    )
    findings = await asyncio.to_thread(checks)
    done = perf_counter()
    return Examination(
        plan, findings, rehearsal, checked - started + done - rehearsed, rehearsed - checked
    )

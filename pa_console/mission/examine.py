"""Step 5: the examination of a plan: its structure, its rehearsal, and every rule in force.

All rules in force are checked, not only the retrieved ones.
"""

import asyncio
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Protocol

from shapely import Point, Polygon

from pa_console.fleets.fleet import Outlook
from pa_console.language.exclusions import excluded_names
from pa_console.mission.orders.standing import StandingOrders
from pa_console.mission.rehearse import RehearsedSteps, joined, order_moments, rehearse_steps
from pa_console.policy.findings import ORDER_ID, STRUCTURE_ID, problems
from pa_console.policy.moments import moment
from pa_console.policy.monitor import Monitor
from pa_console.policy.rule_checks import prepare_checks
from pa_console.policy.rule_variables import goes_to
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.command import STILL
from pa_console.schema.evaluation import Variant
from pa_console.schema.finding import Finding, FindingStatus
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import (
    AssetTimeline,
    GateTimeline,
    Rehearsal,
    Timeline,
    TrackTimeline,
)
from pa_console.schema.telemetry import GateCover, Picture, Track
from pa_console.schema.world import World

_DECIDES: tuple[FindingStatus, ...] = (
    "violates", "error", "complies", "judged_only", "not_applicable",
)  # fmt: skip
"""The statuses of findings, most decisive first, to combine the findings of several steps."""


class CheckBasis(Protocol):
    """The basis of an examination: the fleet's present state, the rules, and the safeguards."""

    @property
    def fleet(self) -> Outlook:
        """The source of the present picture and of forecasts."""
        ...

    @property
    def rulebook(self) -> Rulebook:
        """The rules in force."""
        ...

    @property
    def variant(self) -> Variant:
        """The active safeguards; outside evaluations, all are active."""
        ...


def assume_done(before: Picture, world: World, plan: Plan) -> Rehearsal:
    """Return a rehearsal of `plan` in which every agent reaches its goal at once.

    This is for the ablation without rehearsal. Nothing happens on the way, so the rehearsal has no
    gap, obstacle or encounter, and only the zones that contain the goals. Its duration is that of
    the longest straight way at full speed.
    """
    goals = {a.agent: goal for a in plan.actions if (goal := goes_to(a, world))}
    assets = {
        name: asset.model_copy(
            update={"at": goals[name], "post": goals[name], "position": _at(world, goals[name])}
        )
        if name in goals and asset.available
        else asset
        for name, asset in before.assets.items()
    }
    by: dict[str, list[str]] = {gate: [] for gate in before.gates}
    for name, asset in assets.items():
        if asset.available and asset.at in by and asset.post == asset.at:
            by[asset.at].append(name)
    after = before.model_copy(
        update={
            "assets": assets,
            "gates": {g: GateCover(covered=bool(n), by=tuple(n)) for g, n in by.items()},
        }
    )
    agents = plan.agents
    done = order_moments(plan, world, agents)
    return Rehearsal(
        before=before,
        after=after,
        moments=(moment(before, world, (), agents), moment(after, world, done, agents)),
        timeline=Timeline(
            duration_s=max(_seconds(before, world, goals), default=0.0),
            gates={
                gate: GateTimeline(
                    covered_before=before.gates[gate].covered,
                    covered_after=after.gates[gate].covered,
                    longest_gap_s=0.0,
                )
                for gate in before.gates
            },
            tracks={name: _handled(track, plan) for name, track in before.tracks.items()},
            assets={
                name: AssetTimeline(finished=True, entered_zones=_entered(world, goals.get(name)))
                for name in agents
            },
        ),
    )


def _handled(track: Track, plan: Plan) -> TrackTimeline:
    """Return the timeline of a track as if all commands at its gate had succeeded at once."""
    verbs = {action.verb for action in plan.actions if action.target == track.gate}

    def when(happened: bool) -> float | None:
        return 0.0 if happened else None

    return TrackTimeline(
        observed_s=when(track.observed or "observe" in verbs),
        identified_s=when(track.identity != "unknown" or "identify" in verbs),
        warned_s=when(track.warned or "warn" in verbs),
        blocked_s=when("block" in verbs),
    )


def _entered(world: World, goal: str | None) -> tuple[str, ...]:
    """Return the zones that contain the frame `goal`."""
    if goal is None:
        return ()
    point = Point(_at(world, goal))
    return tuple(n for n, zone in world.zones.items() if Polygon(zone.polygon).covers(point))


def _at(world: World, frame: str) -> tuple[float, float]:
    return world.frames[frame].at


def _seconds(before: Picture, world: World, goals: dict[str, str]) -> Iterator[float]:
    for name, goal in goals.items():
        asset = before.assets[name]
        speed = world.platforms[asset.kind].speed_mps
        yield math.dist(asset.position, _at(world, goal)) / speed


@dataclass(frozen=True)
class Examination:
    """The findings on a plan; `rehearsal` is None if the plan's structure is invalid."""

    plan: Plan
    findings: tuple[Finding, ...]
    rehearsal: Rehearsal | None
    checks_s: float
    rehearsal_s: float
    steps: tuple[Rehearsal, ...] = ()
    """The rehearsal of each step that was rehearsed."""

    @property
    def before(self) -> tuple[Picture, ...]:
        """The picture at the start of each step that was rehearsed."""
        whole = (self.rehearsal,) if self.rehearsal is not None else ()
        return tuple(step.before for step in self.steps or whole)

    @property
    def blocked(self) -> bool:
        """True if the plan cannot be approved."""
        return any(finding.blocking for finding in self.findings)

    @property
    def faults(self) -> tuple[str, ...]:
        """The rules that block the plan, each with the violation."""
        return tuple(f"{f.rule_id}: {f.message}" for f in self.findings if f.blocking)

    @property
    def broken(self) -> tuple[str, ...]:
        """The broken rules, each with the violation; warnings are included."""
        return tuple(f"{f.rule_id}: {f.message}" for f in self.findings if f.broken)

    @property
    def badness(self) -> tuple[int, int]:
        """The number of blocking findings and the number of warnings; a smaller pair is better."""
        blocking = sum(finding.blocking for finding in self.findings)
        return blocking, len(self.broken) - blocking


def ruled_out(plan: Plan, world: World, *texts: str) -> tuple[Finding, ...]:
    """Return a critical finding for each asset or place that `plan` uses and the order excludes.

    `texts` are the texts of the order. Holding and reporting do not count as use.
    """
    excluded = dict.fromkeys(name for text in {*texts} for name in excluded_names(world, text))
    acting = [action for action in plan.actions if action.verb not in STILL]
    used = {name for action in acting for name in (action.agent, action.target) if name}
    return tuple(
        Finding(
            rule_id=ORDER_ID,
            priority="critical",
            status="violates",
            message=f"the order rules {name} out",
        )
        for name in excluded
        if name in used
    )


def banned(plan: Plan, world: World, standing: StandingOrders) -> tuple[Finding, ...]:
    """Return a critical finding for each standing order that bans a movement of `plan`."""
    findings = dict[str, Finding]()
    for action in plan.actions:
        order = standing.banned_by(action.agent, goes_to(action, world))
        if order is not None:
            message = f"standing order {order.id}: {order.order}; the plan sends {action.agent}"
            findings[order.id] = Finding(
                rule_id=ORDER_ID, priority="critical", status="violates", message=message
            )
    return tuple(findings.values())


async def examine(  # noqa: PLR0917
    plan: Plan,
    mission: Mission,
    outlook: Outlook,
    rulebook: Rulebook,
    monitor: Monitor | None = None,
    variant: Variant | None = None,
    order: str = "",
    standing: StandingOrders | None = None,
) -> Examination:
    """Check `plan` in the present picture: first its structure, then the rules in a rehearsal.

    The plan must contain no movement that an order in `standing` bans. If `mission` is a phase of a
    workflow, `order` is the text of the whole order, whose exclusions hold in each phase. Ordering
    rules continue from the history of `monitor`, which has followed the mission so far. A `variant`
    may skip the rules or the rehearsal, but the structure, exclusions and bans are always checked.
    Every step of a plan is checked as a plan of its own, in the forecast for its start. The rules
    are checked in a separate thread, so that a slow rule file delays neither telemetry nor STOP.
    """
    variant = variant or Variant()
    started = perf_counter()
    structural = problems(plan, outlook.world, outlook.picture())
    excluded = ruled_out(plan, outlook.world, mission.text, order)
    if standing is not None:
        excluded = (*excluded, *banned(plan, outlook.world, standing))
    checked = perf_counter()
    if structural:
        return Examination(plan, structural, None, checked - started, 0.0)
    if variant.rehearsal:
        run = await rehearse_steps(outlook, plan)
    else:
        run = _assume_steps_done(outlook.picture(), outlook.world, plan)
    excluded = (*excluded, *_unreached(plan, run))
    rehearsed = perf_counter()
    if not variant.checks:
        seconds = checked - started
        return Examination(plan, excluded, run.whole, seconds, rehearsed - checked, run.steps)
    history = Monitor(rulebook, outlook.world) if monitor is None else monitor
    checks = [
        prepare_checks(
            rulebook, plan=part, rehearsal=step, mission=mission, world=outlook.world,
            monitor=history,
        )
        for part, step in _checked_steps(plan, run)
    ]  # fmt: skip
    findings_by_step = await asyncio.to_thread(lambda: [check() for check in checks])
    findings = findings_by_step[0] if len(findings_by_step) == 1 else _worst_of(findings_by_step)
    done = perf_counter()
    seconds = checked - started + done - rehearsed
    findings = (*excluded, *findings)
    return Examination(plan, findings, run.whole, seconds, rehearsed - checked, run.steps)


def _assume_steps_done(before: Picture, world: World, plan: Plan) -> RehearsedSteps:
    """Return the rehearsals of the steps of `plan` with every step done at once."""
    steps: list[Rehearsal] = []
    for numbers in plan.steps:
        steps.append(assume_done(before, world, plan.part(numbers)))
        before = steps[-1].after
    return RehearsedSteps(joined(steps), tuple(steps))


def _unreached(plan: Plan, run: RehearsedSteps) -> Iterator[Finding]:
    """Yield a critical finding if a step does not end in the rehearsal; no step can follow it."""
    if len(run.steps) == len(plan.steps):
        return
    lines = run.steps[-1].timeline.assets
    why = "; ".join(f"{name}: {line.detail}" for name, line in lines.items() if not line.finished)
    number = len(run.steps)
    yield Finding(
        rule_id=STRUCTURE_ID,
        priority="critical",
        status="violates",
        message=f"step {number} of {len(plan.steps)} does not end in the rehearsal: {why}",
    )


def _checked_steps(plan: Plan, run: RehearsedSteps) -> Iterator[tuple[Plan, Rehearsal]]:
    """Yield each step as a plan of its own, with its rehearsal.

    This way, every rule is checked in every intermediate state. Only the last rehearsal has
    moments, those of all steps, so that ordering rules are checked once.
    """
    last = len(run.steps) - 1
    for number, (numbers, step) in enumerate(zip(plan.steps, run.steps, strict=False)):
        moments = run.whole.moments if number == last else ()
        yield plan.part(numbers), step.model_copy(update={"moments": moments})


def _worst_of(steps: Sequence[Sequence[Finding]]) -> tuple[Finding, ...]:
    """Return one finding per rule: from the first step that breaks it, or the most decisive one."""
    decisive: list[Finding] = []
    for findings in zip(*steps, strict=True):
        ranked = min(
            findings, key=lambda finding: (not finding.broken, _DECIDES.index(finding.status))
        )
        if ranked.broken:
            step = findings.index(ranked) + 1
            ranked = ranked.model_copy(update={"message": f"step {step}: {ranked.message}"})
        decisive.append(ranked)
    return tuple(decisive)

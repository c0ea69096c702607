"""Checks in CEL against the same checks in plain Python, on the same rehearsed plans.

They are what an engineer without a rule language would have written: straight over the pictures
and the timeline. The benchmark measures them against CEL; they enforce nothing.

A shipped check and its twin that differ are an error, before anything is measured.
"""

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime

from pa_console.mission.rehearse import rehearse
from pa_console.policy.expressions.expression import make_context
from pa_console.policy.findings import finding, violation
from pa_console.policy.rule_checks import check_plan
from pa_console.policy.rule_variables import goes_to, plan_variables
from pa_console.policy.rulebook import CompiledRule, Rulebook
from pa_console.schema.command import COMMANDS
from pa_console.schema.finding import Finding
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.rule import Rule
from pa_console.schema.telemetry import Track
from pa_console.schema.world import World
from pa_console.station.assembly import Site, load_site
from tests.benchmarks.speed.compare import Bench, Comparison, alternate, compare
from tests.benchmarks.speed.measured_missions import busy_checkpoint, gathering


@dataclass(frozen=True)
class RehearsedPlan:
    """A plan and what its rehearsal, without moments, has shown: what a check decides on."""

    plan: Plan
    rehearsal: Rehearsal
    mission: Mission
    world: World


Twin = Callable[[RehearsedPlan], list[str] | None]
"""Names the offenders against one rule; None when the rule does not apply."""


def _blocks_without_intent(case: RehearsedPlan) -> list[str] | None:
    """ROE-10: nothing is blocked before its intent is known."""
    blocks = [action for action in case.plan.actions if action.verb == "block"]
    if not blocks:
        return None
    return [
        f"{action.agent} at {action.target}"
        for action in blocks
        if any(track.intent == "unknown" for track in _met(action, case))
    ]


def _gates_left(case: RehearsedPlan) -> list[str] | None:
    """WF-03: no gate loses its cover for longer than the grace time."""
    found: list[str] = []
    for name, cover in case.rehearsal.timeline.gates.items():
        if not cover.covered_before:
            continue
        if cover.covered_after and cover.longest_gap_s <= case.world.coverage_grace_s:
            continue
        gap = f"uncovered for {cover.longest_gap_s:.4g} s"
        what = gap if cover.covered_after else "left uncovered"
        by = case.rehearsal.before.gates[name].by
        found.append(f"{name} {what}" + (f" (only {by[0]} covers it)" if len(by) == 1 else ""))
    return found


def _everybody_away(case: RehearsedPlan) -> list[str] | None:
    """WF-06: not every asset leaves its post, nor do all gather at one frame."""
    before = case.rehearsal.before
    up = [asset for asset in before.assets.values() if asset.available]
    posts = {name: asset.post or "" for name, asset in before.assets.items()}
    ordered = {action.agent: goes_to(action, case.world) for action in case.plan.actions}
    goals = {name: ordered.get(name) or post for name, post in posts.items()}
    hostile = any(track.intent == "hostile" for track in before.tracks.values())
    if hostile or len(up) < 2 or all(goals[name] == posts[name] for name in posts):
        return None
    leavers = [asset for asset in up if goals[asset.id] != posts[asset.id]]
    frames = {goes_to(action, case.world) for action in case.plan.actions} - {""}
    found: list[str] = []
    if len(leavers) == len(up):
        found.append("every available asset would leave its post")
    if len(leavers) > 1 and any(all(goals[a.id] == frame for a in up) for frame in frames):
        found.append("every available asset would be at one frame")
    return found


def _not_possible(case: RehearsedPlan) -> list[str] | None:
    """WF-08: only what exists, is available, and can do it is commanded."""
    if not case.plan.actions:
        return None
    found: list[str] = []
    for action in case.plan.actions:
        asset = case.rehearsal.before.assets.get(action.agent)
        if asset is None:
            found.append(f"{action.agent} does not exist")
        elif not asset.available:
            found.append(f"{action.agent} is not available")
        elif action.target is not None and action.target not in case.world.frames:
            found.append(f"{action.agent} has no frame {action.target}")
        elif asset.kind not in COMMANDS[action.verb].kinds:
            found.append(f"{action.agent} is a {asset.kind} and cannot {action.verb}")
    return found


def _low_and_sent_out(case: RehearsedPlan) -> list[str] | None:
    """CAP-04: an asset low on battery returns, holds or reports."""
    before = case.rehearsal.before.assets
    low = [a for a in case.plan.actions if a.agent in before and before[a.agent].low_battery]
    if not low:
        return None
    return [
        f"{action.agent} ({before[action.agent].battery_pct:.4g} %)"
        for action in low
        if action.verb not in ("hold", "report", "return_to_base")
        and goes_to(action, case.world) != case.world.base
    ]


def _addressed_twice(case: RehearsedPlan) -> list[str] | None:
    """CAP-07: no agent gets two commands."""
    agents = case.plan.agents
    return [name for name in agents if agents.count(name) > 1] if agents else None


def _met(action: Action, case: RehearsedPlan) -> list[Track]:
    """Return the tracks at the gate that the action leads to, or those inside."""
    goal = goes_to(action, case.world)
    tracks = case.rehearsal.before.tracks.values()
    if goal in case.world.gates:
        return [track for track in tracks if track.gate == goal]
    return [track for track in tracks if goal and track.status == "inside"]


TWINS: Mapping[str, Twin] = {
    "ROE-10": _blocks_without_intent,
    "WF-03": _gates_left,
    "WF-06": _everybody_away,
    "WF-08": _not_possible,
    "CAP-04": _low_and_sent_out,
    "CAP-07": _addressed_twice,
}


PART = "checks"
SHIPPED = "checkpoint"


def measure_checks(bench: Bench) -> list[Comparison]:
    """Compare the rules of TWINS both ways; time every rule in force.

    Raises ValueError when a check and its twin differ.
    """
    bench.tell("rehearsing plans", 0.0)
    cases = make_cases(bench.site)
    twinned = shipped_rules()
    compare_findings(twinned, cases)
    prepared = [
        make_context(plan_variables(c.plan, c.rehearsal, c.mission, c.world, twinned.reads))
        for c in cases
    ]
    bench.tell(f"{len(TWINS)} rules on {len(cases)} plans", 0.3)
    whole, plain, bare = alternate(
        bench.runs,
        (
            lambda: [in_cel(twinned, case) for case in cases],
            lambda: [in_python(twinned, case) for case in cases],
            lambda: [
                part.evaluate(context)
                for context in prepared
                for entry in twinned.compiled
                for part in (entry.applies, entry.check)
                if part is not None
            ],
        ),
    )
    bench.tell("every rule in force", 0.7)
    rulebook = bench.site.rulebook
    ordered = make_cases(bench.site, moments=True)
    (every,) = alternate(bench.runs, (lambda: [in_cel(rulebook, case) for case in ordered],))
    name = f"{len(TWINS)} rules on {len(cases)} rehearsed plans"
    other = ("the same rules in plain Python", plain)
    return [
        compare(PART, name, ("CEL, values converted", whole), other),
        compare(PART, f"{name}, evaluation alone", ("CEL, values ready", bare), other),
        compare(
            PART,
            f"all {len(rulebook.rules)} rules on {len(cases)} rehearsed plans",
            ("CEL, and the orderings over every moment", every),
        ),
    ]


def make_cases(site: Site, *, moments: bool = False) -> list[RehearsedPlan]:
    """Return rehearsed plans that keep some of the rules and break others."""
    sim, world = busy_checkpoint(site.world), site.world
    names = list(world.assets)
    gate = next((lane.gate for lane in world.lanes.values()), world.gates[0])
    blockers = [name for name, spec in world.assets.items() if spec.kind == "ugv"]
    plans = [
        gathering(world),
        Plan(reason="a report", actions=(Action(agent=names[-1], command="report"),)),
        Plan(
            reason="block what has come, twice",
            actions=(*(Action(agent=name, command=f"block {gate}") for name in blockers[:1]),) * 2,
        ),
    ]
    mission = Mission(id="bench", text="see to the gates", created=datetime.now(UTC))
    cases: list[RehearsedPlan] = []
    for plan in plans:
        rehearsal = asyncio.run(rehearse(sim, plan))
        seen = rehearsal if moments else rehearsal.model_copy(update={"moments": ()})
        cases.append(RehearsedPlan(plan, seen, mission, world))
    return cases


def shipped_rules() -> Rulebook:
    """Return the shipped rules that have a twin, without their orderings."""
    book = load_site(SHIPPED, SHIPPED).rulebook
    entries = [entry for entry in book.compiled if entry.rule.id in TWINS]
    return Rulebook(
        book.name,
        book.sha256,
        tuple(CompiledRule(entry.rule, entry.applies, entry.check) for entry in entries),
    )


def in_cel(rulebook: Rulebook, case: RehearsedPlan) -> tuple[Finding, ...]:
    """Return the findings as the safeguards make them."""
    return check_plan(
        rulebook,
        plan=case.plan,
        rehearsal=case.rehearsal,
        mission=case.mission,
        world=case.world,
    )


def in_python(rulebook: Rulebook, case: RehearsedPlan) -> tuple[Finding, ...]:
    """Return the findings of the twins."""
    return tuple(_found(rule, TWINS[rule.id](case)) for rule in rulebook.rules)


def compare_findings(rulebook: Rulebook, cases: list[RehearsedPlan]) -> None:
    """Raise ValueError for the first rule on which CEL and Python do not agree."""
    for case in cases:
        for one, other in zip(in_cel(rulebook, case), in_python(rulebook, case), strict=True):
            if one != other:
                raise ValueError(
                    f"rule {one.rule_id} of the shipped rules and its twin in bench_check_twins.py "
                    f"differ ({one.status} {one.message!r}, {other.status} {other.message!r}): "
                    f"write the twin anew, or measure the other parts with --only"
                )


def _found(rule: Rule, offenders: list[str] | None) -> Finding:
    if offenders is None:
        return finding(rule, "not_applicable")
    if not offenders:
        return finding(rule, "complies")
    return finding(rule, "violates", violation(rule.message, offenders))

"""Checks in CEL against plain Python, on the same rehearsed plans.

A shipped check and its twin that differ are an error, before anything is measured.
"""

import asyncio
from datetime import UTC, datetime

from pa_console.evaluation.bench.check_twins import TWINS, Case
from pa_console.evaluation.bench.compare import Bench, Comparison, alternate, compare
from pa_console.evaluation.bench.situations import busy_checkpoint, gathering
from pa_console.orchestrator.compose import Site, load_site
from pa_console.orchestrator.rehearsal import rehearse
from pa_console.policy.checks import check_plan
from pa_console.policy.context import plan_variables
from pa_console.policy.expression import make_context
from pa_console.policy.findings import finding, violation
from pa_console.policy.rulebook import CompiledRule, Rulebook
from pa_console.schema.finding import Finding
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rule import Rule

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
        make_context(plan_variables(c.plan, c.rehearsal, c.mission, c.world, twinned.variables))
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


def make_cases(site: Site, *, moments: bool = False) -> list[Case]:
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
    cases: list[Case] = []
    for plan in plans:
        rehearsal = asyncio.run(rehearse(sim, plan))
        seen = rehearsal if moments else rehearsal.model_copy(update={"moments": ()})
        cases.append(Case(plan, seen, mission, world))
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


def in_cel(rulebook: Rulebook, case: Case) -> tuple[Finding, ...]:
    """Return the findings as the safeguards make them."""
    return check_plan(
        rulebook,
        plan=case.plan,
        rehearsal=case.rehearsal,
        mission=case.mission,
        world=case.world,
    )


def in_python(rulebook: Rulebook, case: Case) -> tuple[Finding, ...]:
    """Return the findings of the twins."""
    return tuple(_found(rule, TWINS[rule.id](case)) for rule in rulebook.rules)


def compare_findings(rulebook: Rulebook, cases: list[Case]) -> None:
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

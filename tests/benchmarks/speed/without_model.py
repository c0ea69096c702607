"""The parts without a model: retrieval against plain Python, checks, rehearsal, forks."""

import asyncio
import copy
import random
import re
from collections.abc import Sequence
from datetime import UTC, datetime

from pa_console.mission.rehearse import rehearse
from pa_console.policy.retriever import Retriever
from pa_console.policy.rule_checks import check_plan
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rule import Rule
from tests.benchmarks.speed.compare import Bench, Comparison, alternate, compare
from tests.benchmarks.speed.measured_missions import busy_checkpoint, gathering

QUERY = "Have somebody watch the road from the air and tell me whether any gate stands open."
MANY = 1000
"""The rules of the larger of the two sets that are searched."""


def measure_retrieval(bench: Bench) -> list[Comparison]:
    """Compare one query by the paper's method over the rules in force, and over MANY.

    Raises ValueError if the plain loop and the retriever do not agree.
    """
    comparisons: list[Comparison] = []
    in_force = [rule for rule in bench.site.rulebook.rules if rule.in_prompts]
    for number, rules in enumerate((in_force, more_rules(in_force, MANY))):
        bench.tell(f"{len(rules)} rules", number / 2)
        retriever = Retriever(rules, "paper")
        plain_scores = dict(score_plainly(rules, QUERY))
        for hit in retriever.score_all(QUERY):
            if abs(hit.score - plain_scores[hit.rule_id]) > 1e-9:
                raise ValueError(f"retrieval and the plain loop differ on {hit.rule_id}")
        ours, plain = alternate(
            bench.runs,
            (
                lambda retriever=retriever: retriever.retrieve(QUERY),
                lambda rules=rules: score_plainly(rules, QUERY),
            ),
        )
        comparisons.append(
            compare(
                "retrieval",
                f"one query over {len(rules)} rules",
                ("the paper's method, prepared rules", ours),
                ("the same method in plain Python", plain),
            )
        )
    return comparisons


def score_plainly(rules: Sequence[Rule], text: str) -> list[tuple[str, float]]:
    """Return (rule id, score), best first: the paper's hybrid with nothing prepared."""
    scores: list[tuple[str, float]] = []
    for rule in rules:
        words, others = (set(re.findall(r"\w+", t.lower())) for t in (text, rule.text))
        either = words | others
        jaccard = len(words & others) / len(either) if either else 0.0
        scores.append((rule.id, (similarity(text.lower(), rule.text.lower()) + jaccard) / 2.0))
    return sorted(scores, key=lambda scored: (-scored[1], scored[0]))


def similarity(one: str, other: str) -> float:
    """Return twice the longest common subsequence over both lengths, in [0, 1]."""
    row = [0] * (len(other) + 1)
    for left in one:
        corner = 0
        for column, right in enumerate(other, start=1):
            above = row[column]
            row[column] = corner + 1 if left == right else max(above, row[column - 1])
            corner = above
    both = len(one) + len(other)
    return 2 * row[-1] / both if both else 1.0


def more_rules(rules: Sequence[Rule], number: int) -> tuple[Rule, ...]:
    """Return `rules` and copies of them with their words in another order, `number` in all."""
    shuffle = random.Random(0)
    copies = list(rules)
    while len(copies) < number:
        rule = rules[len(copies) % len(rules)]
        words = rule.text.split()
        shuffle.shuffle(words)
        changes = {"id": f"{rule.domain}-{len(copies) + 1000}", "text": " ".join(words)}
        copies.append(rule.model_copy(update=changes))
    return tuple(copies)


def measure_checks(bench: Bench) -> list[Comparison]:
    """Time every rule in force on rehearsed plans that keep some rules and break others."""
    bench.tell("rehearsing plans", 0.0)
    world, rulebook = bench.site.world, bench.site.rulebook
    sim = busy_checkpoint(world)
    names = list(world.assets)
    gate = next((lane.gate for lane in world.lanes.values()), world.gates[0])
    blockers = [name for name, spec in world.assets.items() if spec.kind == "ugv"]
    block = tuple(Action(agent=name, command=f"block {gate}") for name in blockers[:1])
    plans = [
        gathering(world),
        Plan(reason="a report", actions=(Action(agent=names[-1], command="report"),)),
        Plan(reason="block what has come, twice", actions=block * 2),
    ]
    mission = Mission(id="bench", text="see to the gates", created=datetime.now(UTC))
    cases = [(plan, asyncio.run(rehearse(sim, plan))) for plan in plans]
    bench.tell("every rule in force", 0.3)

    def check() -> None:
        for plan, rehearsal in cases:
            check_plan(rulebook, plan=plan, rehearsal=rehearsal, mission=mission, world=world)

    (seconds,) = alternate(bench.runs, (check,))
    name = f"all {len(rulebook.rules)} rules on {len(cases)} rehearsed plans"
    return [compare("checks", name, ("CEL, and the orderings over every moment", seconds))]


def measure_rehearsal(bench: Bench) -> list[Comparison]:
    """Time a rehearsal and a telemetry picture; compare a fork with a deep copy."""
    world = bench.site.world
    sim, plan = busy_checkpoint(world), gathering(world)
    bench.tell("rehearsal", 0.0)
    duration_s = asyncio.run(rehearse(sim, plan)).timeline.duration_s
    (rehearsing,) = alternate(bench.runs, (lambda: asyncio.run(rehearse(sim, plan)),))
    bench.tell("fork", 0.7)
    forking, copying, twin = alternate(
        bench.runs, (sim.fork, lambda: copy.deepcopy(sim), sim.forecast)
    )
    name = f"rehearse {len(plan.actions)} commands, {duration_s:.0f} s"
    copied = ("copy.deepcopy of the simulation", copying)
    return [
        compare("rehearsal", name, ("in a forecast, every 0.5 s recorded", rehearsing)),
        compare("rehearsal", "fork the simulation", ("its own copy of the state", forking), copied),
        compare("rehearsal", "forecast from the picture", ("built from telemetry", twin), copied),
    ]

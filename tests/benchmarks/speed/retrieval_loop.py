"""Retrieval against the same method written out in plain Python, and against its core in C."""

import random
import re
from collections.abc import Sequence

from rapidfuzz import fuzz, process

from pa_console.policy.retriever import Retriever
from pa_console.schema.rule import Rule
from tests.benchmarks.speed.compare import Bench, Comparison, alternate, compare

PART = "retrieval"
QUERY = "Have somebody watch the road from the air and tell me whether any gate stands open."
MANY = 1000


def measure_retrieval(bench: Bench) -> list[Comparison]:
    """Compare one query over the rules in force, and over as many as MANY.

    Raises ValueError when the plain loop and the retriever do not agree.
    """
    found: list[Comparison] = []
    rules = [rule for rule in bench.site.rulebook.rules if rule.in_prompts]
    for number, some in enumerate((rules, more_rules(rules, MANY))):
        bench.tell(f"{len(some)} rules", number / 2)
        retriever = Retriever(some, "paper")
        texts = [rule.text.lower() for rule in some]
        _agree(retriever, some)
        in_use = Retriever(some)
        ours, plain, core, default = alternate(
            bench.runs,
            (
                lambda retriever=retriever: retriever.retrieve(QUERY),
                lambda some=some: score_plainly(some, QUERY),
                lambda texts=texts: process.cdist([QUERY.lower()], texts, scorer=fuzz.ratio),
                lambda in_use=in_use: in_use.retrieve(QUERY),
            ),
        )
        name = f"one query over {len(some)} rules"
        mine = ("the paper's method, prepared rules", ours)
        found.append(compare(PART, name, mine, ("the same method in plain Python", plain)))
        limit = ("limit: the fuzzy similarity alone, all rules in one C call", core)
        found.append(compare(PART, name, mine, limit))
        used = f"{name}, method in use: {in_use.method}"
        paper = ("the paper's method, ours", ours)
        found.append(compare(PART, used, ("as the pipeline asks it", default), paper))
    return found


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
    found = list(rules)
    while len(found) < number:
        rule = rules[len(found) % len(rules)]
        words = rule.text.split()
        shuffle.shuffle(words)
        found.append(
            rule.model_copy(
                update={"id": f"{rule.domain}-{len(found) + 1000}", "text": " ".join(words)}
            )
        )
    return tuple(found)


def _agree(retriever: Retriever, rules: Sequence[Rule]) -> None:
    plain = dict(score_plainly(rules, QUERY))
    for hit in retriever.score_all(QUERY):
        if abs(hit.score - plain[hit.rule_id]) > 1e-9:
            raise ValueError(
                f"retrieval and its plain twin differ on {hit.rule_id}: {hit.score:.6f}, "
                f"{plain[hit.rule_id]:.6f}"
            )

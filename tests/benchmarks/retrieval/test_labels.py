"""The labelled queries: complete, consistent, and refused with a place when they are not."""

from collections import Counter
from pathlib import Path

import pytest
import yaml

from pa_console.resources import find_data
from pa_console.schema.document import DocumentError
from tests.benchmarks.retrieval.quality import QUERIES, load_queries
from tests.policy.book import checkpoint_rules

RULES = tuple(rule for rule in checkpoint_rules().rules if rule.in_prompts)
GOOD = "{id: a, split: dev, style: terse, text: hold, relevant: {WF-03: 2}}"
OTHER = GOOD.replace("id: a", "id: b").replace("hold", "go")


def _written(folder: Path, *queries: str) -> Path:
    path = folder / "queries.yaml"
    path.write_text("name: q\nqueries:\n" + "".join(f"  - {query}\n" for query in queries))
    return path


def test_every_rule_governs_queries_of_both_halves_and_none_is_a_command_of_the_paper() -> None:
    queries = load_queries(QUERIES, RULES).queries
    halves = Counter(query.split for query in queries)
    assert halves["dev"] + halves["test"] >= 150
    assert abs(halves["dev"] - halves["test"]) <= 1
    for split in ("dev", "test"):
        governed = {r for query in queries if query.split == split for r in query.governing}
        assert governed == {rule.id for rule in RULES}
    paper = yaml.safe_load(find_data("worlds", "checkpoint/missions/paper.yaml", "").read_text())
    commands = {mission["command"].casefold() for mission in paper["missions"]}
    assert not commands & {query.text.casefold() for query in queries}


@pytest.mark.parametrize(
    ("wrong", "field", "problem"),
    [
        (OTHER.replace("WF-03", "WF-99"), "queries.1.relevant.WF-99", "no rule 'WF-99'"),
        (OTHER.replace("id: b", "id: a"), "queries.1.id", "appears twice"),
        (OTHER.replace("text: go", "text: hold"), "queries.1.text", "appears twice"),
        (OTHER.replace("WF-03: 2", "WF-03: 3"), "queries.1.relevant.WF-03", "1 or 2"),
        (OTHER.replace("WF-03: 2", "WF-03: 1"), "queries.1.relevant", "grade 2"),
        (OTHER.replace("split: dev", "split: train"), "queries.1.split", "'dev', 'test'"),
        (OTHER.replace("style: terse, ", ""), "queries.1.style", "required"),
    ],
)
def test_a_wrong_query_is_refused_with_its_line_and_field(
    tmp_path: Path, wrong: str, field: str, problem: str
) -> None:
    with pytest.raises(DocumentError, match=problem) as caught:
        load_queries(_written(tmp_path, GOOD, wrong), RULES)
    assert (caught.value.field, caught.value.line) == (field, 4)

"""Labelled queries, and how good a ranking of rules is for them."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from pa_console.schema.base import StrictModel
from pa_console.schema.document import Document
from pa_console.schema.evaluation import Name
from pa_console.schema.mission import MAX_MISSION_TEXT
from pa_console.schema.rule import Rule

MOST_NAMED = 40
QUERIES = Path(__file__).with_name("checkpoint.yaml")
"""The labelled queries for the rules of the checkpoint."""

Grade = Literal[1, 2]
"""2: the rule governs what the text asks for; 1: it bears on it."""

Split = Literal["dev", "test", "field"]
"""The use of a set: choosing a method; reporting; independent authors."""


class RetrievalQuery(StrictModel):
    """A mission text or question, and the rules that concern it; rules not named do not."""

    id: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")
    split: Split
    style: str = Field(min_length=1, description="how it is said: terse, chatty, misspelt, ...")
    text: str = Field(min_length=1, max_length=MAX_MISSION_TEXT)
    relevant: dict[str, Grade] = Field(description="rule id -> grade")

    @property
    def governing(self) -> frozenset[str]:
        """The rules that govern what the text asks for: those that retrieval must not miss."""
        return frozenset(rule for rule, grade in self.relevant.items() if grade == 2)

    @model_validator(mode="after")
    def _governed(self) -> Self:
        if not self.governing:
            raise ValueError("relevant: at least one rule must have grade 2")
        return self


class QuerySet(StrictModel):
    """A file of labelled queries for one rule file."""

    name: Name
    queries: tuple[RetrievalQuery, ...] = Field(min_length=1)


def load_queries(path: Path, rules: Iterable[Rule]) -> QuerySet:
    """Read the queries at `path` for `rules`; raises DocumentError with file, line and field.

    Ids must be unique, texts too, and every rule named must be one of `rules`.
    """
    document = Document.read(path)
    found = document.parse(QuerySet)
    known = {rule.id for rule in rules}
    some = ", ".join(sorted(known)[:MOST_NAMED])
    ids: set[str] = set()
    texts: set[str] = set()
    for index, query in enumerate(found.queries):
        place = ("queries", index)
        if query.id in ids:
            raise document.error((*place, "id"), f"{query.id!r} appears twice")
        if query.text in texts:
            raise document.error((*place, "text"), f"{query.text!r} appears twice")
        ids.add(query.id)
        texts.add(query.text)
        for rule in query.relevant:
            if rule not in known:
                problem = f"there is no rule {rule!r} in the rule file; known: {some}"
                raise document.error((*place, "relevant", rule), problem)
    return found


RESAMPLES = 2000
DEPTH = 100
"""How far down a ranking the first governing rule is looked for."""


class Quality(NamedTuple):
    """The four measures of one ranking, or of many in the mean; each in [0, 1]."""

    recall_3: float
    recall_10: float
    mrr: float
    ndcg_10: float


@dataclass(frozen=True)
class Estimate:
    """A mean over queries with the ends of its 95 % interval."""

    mean: float
    low: float
    high: float


def quality(query: RetrievalQuery, ranking: Sequence[str]) -> Quality:
    """Judge `ranking`, the ids of the best DEPTH rules, best first.

    Recall counts the governing rules (grade 2) among the first 3 and 10; the reciprocal rank is
    that of the first governing rule, 0 beyond DEPTH; nDCG takes both grades, with a gain of
    2 ** grade - 1 and the discount of Jarvelin and Kekalainen as Burges et al. (ICML 2005) use it.
    """
    governing = query.governing
    first = next((place for place, rule in enumerate(ranking) if rule in governing), None)
    ideal = _gain(sorted(query.relevant.values(), reverse=True)[:10])
    return Quality(
        recall_3=len(governing & set(ranking[:3])) / len(governing),
        recall_10=len(governing & set(ranking[:10])) / len(governing),
        mrr=0.0 if first is None else 1.0 / (first + 1),
        ndcg_10=_gain([query.relevant.get(rule, 0) for rule in ranking[:10]]) / ideal,
    )


def estimates(found: Sequence[Quality], seed: int = 0) -> tuple[Estimate, ...]:
    """Return the mean of each measure over at least one query, in the order of Quality.

    The intervals are percentiles of RESAMPLES bootstrap resamples of the queries.
    """
    values = np.array(found, dtype=np.float64)
    chosen = np.random.default_rng(seed).integers(len(values), size=(RESAMPLES, len(values)))
    means = values[chosen].mean(axis=1)
    low, high = np.percentile(means, [2.5, 97.5], axis=0)
    return tuple(
        Estimate(float(mean), float(one), float(other))
        for mean, one, other in zip(values.mean(axis=0), low, high, strict=True)
    )


def _gain(grades: Sequence[int]) -> float:
    return sum((2**grade - 1) / math.log2(place + 2) for place, grade in enumerate(grades))

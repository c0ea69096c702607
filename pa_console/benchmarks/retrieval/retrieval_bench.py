"""Measures retrieval methods on labelled queries: quality, time and memory, by number of rules."""

import tracemalloc
from collections.abc import Callable, Sequence
from statistics import median
from time import perf_counter

import numpy as np
from pydantic import BaseModel

from pa_console.benchmarks.retrieval.distractors import distractors
from pa_console.benchmarks.retrieval.quality import DEPTH, Estimate, Quality, estimates, quality
from pa_console.policy.retrieval.related_words import default_vocabulary
from pa_console.policy.retrieval.retriever import Retriever
from pa_console.schema.evaluation import RetrievalQuery, Split
from pa_console.schema.rule import Rule

K = 3

Progress = Callable[[str], None]


class SplitQuality(BaseModel):
    """The quality of one method over the queries of one split, or of one style within it."""

    split: Split
    style: str = ""
    queries: int
    recall_3: Estimate
    recall_10: Estimate
    mrr: Estimate
    ndcg_10: Estimate


class RetrievalRow(BaseModel):
    """One method over one number of rules; the quality is that of the order over all rules.

    Times are of one index built and of `retrieve` for each query, in seconds of this machine;
    memory in bytes: the most that was held while the index was built, and what it keeps.
    """

    method: str
    rules: int
    quality: tuple[SplitQuality, ...]
    build_s: float
    peak_bytes: int
    kept_bytes: int
    median_s: float
    p95_s: float


def bench_retrieval(
    rules: Sequence[Rule],
    queries: Sequence[RetrievalQuery],
    methods: Sequence[str],
    sizes: Sequence[int],
    progress: Progress,
    *,
    seed: int = 0,
) -> list[RetrievalRow]:
    """Measure every one of `methods` with `rules` alone or filled up to each of `sizes` rules.

    `progress` is told the method and size that has been measured. A size below the number of
    rules stands for the rules alone.
    """
    default_vocabulary()
    rows: list[RetrievalRow] = []
    for size in sizes:
        crowd = (*rules, *distractors(max(size - len(rules), 0), seed))
        for method in methods:
            rows.append(_row(crowd, queries, method, seed))
            progress(f"{method}, {len(crowd):,} rules")
    return rows


def _row(
    rules: Sequence[Rule], queries: Sequence[RetrievalQuery], method: str, seed: int
) -> RetrievalRow:
    peak, kept = _memory(rules, method)
    start = perf_counter()
    retriever = Retriever(rules, method)
    build_s = perf_counter() - start
    seconds: list[float] = []
    judged: list[Quality] = []
    for query in queries:
        start = perf_counter()
        retriever.retrieve(query.text, K)
        seconds.append(perf_counter() - start)
        judged.append(quality(query, retriever.rank(query.text, DEPTH)))
    return RetrievalRow(
        method=method,
        rules=len(rules),
        quality=tuple(_by_split(queries, judged, seed)),
        build_s=build_s,
        peak_bytes=peak,
        kept_bytes=kept,
        median_s=median(seconds),
        p95_s=float(np.percentile(seconds, 95)),
    )


def _by_split(
    queries: Sequence[RetrievalQuery], judged: Sequence[Quality], seed: int
) -> list[SplitQuality]:
    """Return the quality of each split, followed by that of the styles within it."""
    groups: dict[tuple[Split, str], list[Quality]] = {}
    for query, found in zip(queries, judged, strict=True):
        for style in ("", query.style):
            groups.setdefault((query.split, style), []).append(found)
    rows: list[SplitQuality] = []
    for (split, style), found in sorted(groups.items()):
        recall_3, recall_10, mrr, ndcg_10 = estimates(found, seed)
        rows.append(
            SplitQuality(
                split=split, style=style, queries=len(found), recall_3=recall_3,
                recall_10=recall_10, mrr=mrr, ndcg_10=ndcg_10,
            )
        )  # fmt: skip
    return rows


def _memory(rules: Sequence[Rule], method: str) -> tuple[int, int]:
    """Return the bytes held at most while an index is built, and the bytes that it keeps."""
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        retriever = Retriever(rules, method)
        after, peak = tracemalloc.get_traced_memory()
        del retriever
    finally:
        tracemalloc.stop()
    return peak - before, after - before

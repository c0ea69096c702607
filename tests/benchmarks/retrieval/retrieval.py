"""Retrieval methods compared: how well and how fast each finds the rules that matter."""

import tracemalloc
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Annotated

import numpy as np
import typer
from pydantic import BaseModel
from rich import box
from rich.table import Table

from pa_console.cli.options import RulesOption
from pa_console.policy.retriever import METHODS, Retriever
from pa_console.policy.rulebook import load_rules
from pa_console.resources import find_data
from pa_console.schema.rule import Rule
from pa_console.terminal.output import out
from tests.benchmarks.harness import JsonFileOption, Tell, keep, progress
from tests.benchmarks.retrieval.distractors import distractors
from tests.benchmarks.retrieval.quality import (
    DEPTH,
    QUERIES,
    Estimate,
    Quality,
    RetrievalQuery,
    Split,
    estimates,
    load_queries,
    quality,
)

K = 3


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
    tell: Tell,
    *,
    seed: int = 0,
) -> list[RetrievalRow]:
    """Measure every one of `methods` with `rules` alone or filled up to each of `sizes` rules.

    A size below the number of rules stands for the rules alone.
    """
    for method in methods:
        Retriever(rules, method)  # fills caches that are not part of an index's memory
    rows: list[RetrievalRow] = []
    for size in sizes:
        crowd = (*rules, *distractors(max(size - len(rules), 0), seed))
        for method in methods:
            share = len(rows) / (len(sizes) * len(methods))
            tell(f"{method}, {len(crowd):,} rules", share)
            rows.append(_row(crowd, queries, method, seed))
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


SIZES = (30, 1_000, 100_000)
SPLITS: dict[Split, str] = {
    "test": "queries for reporting",
    "field": "queries of another author",
    "dev": "queries that the method was chosen on",
}


def retrieval(
    queries: Annotated[Path, typer.Option(help="A file of labelled queries.")] = QUERIES,
    rules: RulesOption = "checkpoint",
    method: Annotated[
        list[str] | None, typer.Option(help=f"Only this one; repeat: {', '.join(METHODS)}.")
    ] = None,
    size: Annotated[
        list[int] | None,
        typer.Option(min=1, help="Number of rules, filled up with made-up ones; repeat."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the made-up rules.")] = 0,
    json: JsonFileOption = None,
) -> None:
    """Compare the retrieval methods: recall, MRR, nDCG, time, memory, at 30 to 100,000 rules."""
    book = load_rules(find_data("rules", rules, "rules.yaml"))
    labelled = load_queries(queries, book.rules).queries
    methods, sizes = method or list(METHODS), size or list(SIZES)
    with progress() as tell:
        rows = bench_retrieval(book.rules, labelled, methods, sizes, tell, seed=seed)
    splits = {query.split for query in labelled}
    for split, title in SPLITS.items():
        if split in splits:
            out.print(_quality_table(rows, split, title))
    out.print(_cost_table(rows))
    keep("retrieval", rows, json)


def _quality_table(rows: list[RetrievalRow], split: Split, title: str) -> Table:
    number = next(q.queries for q in rows[0].quality if q.split == split and not q.style)
    table = Table(box=box.SIMPLE, title=f"{split}: {number} {title}, in %, with 95 % intervals")
    for name in ("rules", "method", "recall@3", "recall@10", "MRR", "nDCG@10"):
        table.add_column(name, justify="left" if name == "method" else "right", no_wrap=True)
    for row in rows:
        found = next(q for q in row.quality if q.split == split and not q.style)
        table.add_row(
            f"{row.rules:,}",
            row.method,
            *map(_share, (found.recall_3, found.recall_10, found.mrr, found.ndcg_10)),
        )
    return table


def _cost_table(rows: list[RetrievalRow]) -> Table:
    table = Table(box=box.SIMPLE, title="what a query and an index cost")
    for name in ("rules", "method", "median ms", "p95 ms", "build s", "keeps MB", "peak MB"):
        table.add_column(name, justify="left" if name == "method" else "right", no_wrap=True)
    for row in rows:
        table.add_row(
            f"{row.rules:,}",
            row.method,
            f"{row.median_s * 1e3:.2f}",
            f"{row.p95_s * 1e3:.2f}",
            f"{row.build_s:.3f}",
            f"{row.kept_bytes / 1e6:.1f}",
            f"{row.peak_bytes / 1e6:.1f}",
        )
    return table


def _share(value: Estimate) -> str:
    return f"{value.mean * 100:.1f} ({value.low * 100:.0f}-{value.high * 100:.0f})"

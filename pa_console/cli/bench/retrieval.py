"""`pa-console bench retrieval`: how well and how fast each method finds the rules that matter."""

from typing import Annotated

import typer
from rich import box
from rich.progress import Progress
from rich.table import Table

from pa_console.benchmarks.retrieval.quality import Estimate, load_queries
from pa_console.benchmarks.retrieval.retrieval_bench import RetrievalRow, bench_retrieval
from pa_console.cli.output import JsonOption, RulesOption, errors, out, print_json
from pa_console.policy.retrieval.retriever import METHODS
from pa_console.policy.rulebook import load_rules
from pa_console.resources import find_data
from pa_console.schema.evaluation import Split

SIZES = (30, 1_000, 100_000)
SPLITS: dict[Split, str] = {
    "test": "queries for reporting",
    "field": "queries of another author",
    "dev": "queries that the method was chosen on",
}


def retrieval(
    queries: Annotated[
        str, typer.Option(help="Labelled queries: an installed name or a file.")
    ] = "checkpoint",
    rules: RulesOption = "checkpoint",
    method: Annotated[
        list[str] | None, typer.Option(help=f"Only this one; repeat: {', '.join(METHODS)}.")
    ] = None,
    size: Annotated[
        list[int] | None,
        typer.Option(min=1, help="Number of rules, filled up with made-up ones; repeat."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the made-up rules.")] = 0,
    json: JsonOption = False,
) -> None:
    """Compare the retrieval methods: recall, MRR, nDCG, time, memory, at 30 to 100,000 rules."""
    book = load_rules(find_data("rules", rules, "rules.yaml"))
    path = find_data("rules/queries", queries, "queries.yaml")
    labelled = load_queries(path, book.rules).queries
    methods, sizes = method or list(METHODS), size or list(SIZES)
    with Progress(console=errors, transient=True) as progress:
        task = progress.add_task("measuring", total=len(methods) * len(sizes))

        def measured(name: str) -> None:
            progress.update(task, advance=1, description=f"measured: {name}")

        rows = bench_retrieval(book.rules, labelled, methods, sizes, measured, seed=seed)
    if json:
        print_json(rows)
        return
    splits = {query.split for query in labelled}
    for split, title in SPLITS.items():
        if split in splits:
            out.print(_quality_table(rows, split, title))
    out.print(_cost_table(rows))


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

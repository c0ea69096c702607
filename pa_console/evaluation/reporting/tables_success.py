"""Success by category, model and mission set: the paper's Table I and Fig. 3, and any set's own."""

from collections.abc import Callable
from typing import Literal

from pa_console.evaluation.record import RunRecord
from pa_console.evaluation.reporting.published import (
    HYBRID_BY_CATEGORY,
    MISSION_SET,
    MODELS,
    Quantity,
    published,
)
from pa_console.evaluation.reporting.record_groups import (
    Records,
    by_model,
    by_set,
    comparable_runs,
    grouped,
    main_runs,
)
from pa_console.evaluation.reporting.statistics import Rate
from pa_console.evaluation.reporting.table import NOTHING, Table, percent, rate_cell

Score = Literal["hybrid", "strict", "obeyed"]

CELL = "Each cell: share of successful runs (95 % Wilson interval) successes/runs."
DERIVED = "* not stated by the paper, but follows from numbers that it states."


def score(records: Records, name: Score) -> Rate:
    """Return how many of `records` are a success by `name`."""
    fields: dict[Score, Callable[[RunRecord], bool | None]] = {
        "hybrid": lambda record: record.hybrid,
        "strict": lambda record: record.strict,
        "obeyed": lambda record: record.obeyed,
    }
    return Rate.of(map(fields[name], records))


def paper_cell(model: str, quantity: Quantity) -> str:
    """Write the paper's share for its `model`, with a star when it only follows."""
    value = published(model, quantity)
    return NOTHING if value is None else percent(value.value) + "*" * value.derived


def success_tables(records: Records) -> list[Table]:
    """Return Table I and Fig. 3 of the paper's set, then every set overall and by category."""
    paper = comparable_runs(records)
    tables: list[Table] = []
    if paper:
        tables += [table_one(paper, "hybrid"), table_one(paper, "strict"), figure_three(paper)]
    main = main_runs(records)
    tables.append(_by_set(main))
    tables += [
        _by_category(runs, name) for name, runs in by_set(main).items() if name != MISSION_SET
    ]
    return [table for table in tables if table.rows]


def table_one(records: Records, name: Literal["hybrid", "strict"]) -> Table:
    """Return the paper's Table I for one of the two kinds of success, with the paper's columns."""
    models = by_model(records)
    columns = ["Scenario", *models]
    note = CELL
    if name == "hybrid":
        columns += [f"paper: {model}" for model in MODELS]
        note += " The paper's values fit one run of each mission, by other models."
    else:
        note += " The paper gives no strict success by category."
    rows: list[tuple[str, ...]] = []
    for category, runs in grouped(records, lambda record: record.category).items():
        mine = by_model(runs)
        row = [category, *(rate_cell(score(mine.get(model, []), name)) for model in models)]
        if name == "hybrid":
            theirs = HYBRID_BY_CATEGORY.get(category, {})
            row += [percent(theirs.get(model)) for model in MODELS]
        rows.append(tuple(row))
    total = ["All", *(rate_cell(score(runs, name)) for runs in models.values())]
    if name == "hybrid":
        total += [paper_cell(model, "hybrid") for model in MODELS]
        note += f" {DERIVED}"
    return Table(
        name=f"table-1-{name}",
        title=f"Table I: {name} success by scenario category and model",
        columns=tuple(columns),
        rows=(*rows, tuple(total)),
        note=note,
    )


def figure_three(records: Records) -> Table:
    """Return overall success by model (Fig. 3), the paper's models below ours."""
    rows = [(model, *_scores(runs)) for model, runs in by_model(records).items()]
    rows += [
        (f"paper: {full}", paper_cell(model, "hybrid"), paper_cell(model, "strict"), NOTHING)
        for model, full in MODELS.items()
    ]
    return Table(
        name="figure-3",
        title="Fig. 3: overall success by model",
        columns=("Model", "hybrid", "strict", "strict if the judge is obeyed"),
        rows=tuple(rows),
        note=f"{CELL} {DERIVED}",
    )


def _scores(records: Records) -> tuple[str, ...]:
    return tuple(rate_cell(score(records, name)) for name in ("hybrid", "strict", "obeyed"))


def _by_set(records: Records) -> Table:
    rows = [
        (name, model, str(len({run.mission for run in found})), *_scores(found))
        for name, runs in by_set(records).items()
        for model, found in by_model(runs).items()
    ]
    return Table(
        name="sets",
        title="Success by mission set and model",
        columns=(
            "Set", "Model", "missions", "hybrid", "strict", "strict if the judge is obeyed",
        ),
        rows=tuple(rows),
        note=CELL,
    )  # fmt: skip


def _by_category(records: Records, name: str) -> Table:
    def place(record: RunRecord) -> tuple[str, str]:
        return record.category, record.model

    groups = grouped(sorted(records, key=lambda record: record.category), place)
    rows = [(category, model, *_scores(runs)) for (category, model), runs in groups.items()]
    return Table(
        name=f"categories-{name}",
        title=f"Success by category: {name}",
        columns=("Category", "Model", "hybrid", "strict", "strict if the judge is obeyed"),
        rows=tuple(rows),
        note=CELL,
    )

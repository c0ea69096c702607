"""Tables of success (the paper's Table I, Fig. 3), of the ablation, and of ways of failing."""

import re
from collections.abc import Callable, Sequence
from statistics import fmean, median
from typing import Literal, NamedTuple

from pa_console.evaluation.reporting.published import (
    HYBRID_BY_CATEGORY,
    MISSION_SET,
    MODELS,
    Quantity,
    published,
)
from pa_console.evaluation.reporting.record_groups import (
    Records,
    ablated_models,
    by_model,
    by_set,
    comparable_runs,
    grouped,
    main_runs,
    main_variant,
)
from pa_console.evaluation.reporting.statistics import Rate
from pa_console.evaluation.reporting.table import NOTHING, Table, percent, rate_cell
from pa_console.evaluation.reporting.tables_judgement import refusal_recall
from pa_console.evaluation.reporting.tables_latency import decision_median
from pa_console.evaluation.runs.jobs import REFERENCE
from pa_console.evaluation.runs.run_record import RunRecord

_RULE = re.compile(r"^[A-Z]{2,5}-\d+")
_ROOT = re.compile(r"\brun\.((?:start|final)\.[a-z]+|[a-z_]+)")
_FIELD = re.compile(r"(?:\]|\b(?!run\b)[a-z]\w{0,2})\.([a-z_]+)\b(?!\()")
_NAME = re.compile(r"\b\w*(?:[a-z][A-Z]|_|\d)\w*\b")
_QUOTED = re.compile(r"'[^']*'|\"[^\"]*\"")
_CONSTANTS = frozenset(("gates", "base", "command", "grace_s", "standoff_m"))
"""Fields of `run` about the world or the command: they cannot be the failed ones."""

EXECUTED = frozenset(("verified", "unverified"))
"""Statuses of missions whose plan was carried out, or begun."""


class FailureKind(NamedTuple):
    """The expectation of a mission, its end, and its failure."""

    wanted: str
    ended: str
    cause: str


def failure_kind(record: RunRecord) -> FailureKind | None:
    """Return in which way `record` failed, None when it is a strict success.

    The cause of a run that executed something is the rules it broke and the kinds of condition
    that do not hold; of any other run it is why nothing was executed.
    """
    if record.strict:
        return None
    wanted = {"refuse": "refuse", "trim": "carry out a part"}.get(record.expect, "carry out")
    causes = [f"broke {rule}" for rule in sorted({breach.rule_id for breach in record.broken})]
    if record.status in EXECUTED:
        causes += sorted({f"condition on {condition_kind(text)}" for text in record.failed})
    else:
        causes.append(reason_pattern(record.reason))
    return FailureKind(wanted, record.status, "; ".join(filter(None, causes)) or "no cause is told")


def condition_kind(condition: str) -> str:
    """Return which facts of the run a success condition looks at, without any name or number.

    `run.tracks.exists(t, t.gate == 'X' && t.observed_s >= 0.0)` is `tracks (gate, observed_s)`.
    """
    bare = _QUOTED.sub("''", condition)
    roots = dict.fromkeys(name for name in _ROOT.findall(bare) if name not in _CONSTANTS)
    fields = dict.fromkeys(name for name in _FIELD.findall(bare))
    text = ", ".join(roots) or "nothing of the run"
    return f"{text} ({', '.join(fields)})" if fields else text


def reason_pattern(reason: str) -> str:
    """Return why nothing was executed, as rule ids or words without names and numbers."""
    kinds: dict[str, None] = {}
    for part in filter(None, (piece.strip() for piece in reason.split(";"))):
        rule = _RULE.match(part)
        words = _NAME.sub("…", _QUOTED.sub("…", part))
        kinds[rule.group() if rule else re.sub(r"…(\W+…)+", "…", words)[:60]] = None
    return "; ".join(sorted(kinds))


SuccessKind = Literal["hybrid", "strict", "obeyed"]

CELL = "Each cell: share of successful runs (95 % Wilson interval) successes/runs."
DERIVED = "* not stated by the paper, but follows from numbers that it states."


def success_rate(records: Records, name: SuccessKind) -> Rate:
    """Return how many of `records` are a success by `name`."""
    fields: dict[SuccessKind, Callable[[RunRecord], bool | None]] = {
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
        row = [category, *(rate_cell(success_rate(mine.get(model, []), name)) for model in models)]
        if name == "hybrid":
            theirs = HYBRID_BY_CATEGORY.get(category, {})
            row += [percent(theirs.get(model)) for model in MODELS]
        rows.append(tuple(row))
    total = ["All", *(rate_cell(success_rate(runs, name)) for runs in models.values())]
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
    return tuple(rate_cell(success_rate(records, name)) for name in ("hybrid", "strict", "obeyed"))


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


class Difference(NamedTuple):
    """Strict success of a variant against the reference, on the runs that both made."""

    pairs: int
    better: int
    worse: int

    @property
    def points(self) -> float | None:
        """The difference in percentage points; None without a pair."""
        return 100 * (self.better - self.worse) / self.pairs if self.pairs else None


def difference(records: Records, reference: Records) -> Difference:
    """Compare the runs of the same mission and seed."""
    known = {_pair(record): record.strict for record in reference}
    both = [(record.strict, known[_pair(record)]) for record in records if _pair(record) in known]
    better = sum(mine and not theirs for mine, theirs in both)
    return Difference(len(both), better, sum(theirs and not mine for mine, theirs in both))


def _pair(record: RunRecord) -> tuple[str, str, int]:
    return record.mission_set, record.mission, record.seed


def reference_variant(records: Records) -> str:
    """Return the variant that the others of one model are compared with."""
    return REFERENCE if any(r.variant == REFERENCE for r in records) else main_variant(records)


def ablation_tables(records: Records) -> list[Table]:
    """Return one table for each model that ran under two variants or more."""
    models = by_model(records)
    return [
        _ablation(model, models[model], {n: runs for n, runs in models.items() if n != model})
        for model in ablated_models(records)
    ]


def variants_of(records: Records) -> dict[str, list[RunRecord]]:
    """Return the runs by variant, the reference first."""
    reference = reference_variant(records)
    found = grouped(records, lambda record: record.variant)
    return {reference: found[reference], **found}


def _ablation(model: str, records: Records, others: dict[str, list[RunRecord]]) -> Table:
    """Return the rows of every variant of `model`, then of other models under its reference."""
    variants = variants_of(records)
    reference = next(iter(variants))
    shown = dict(variants)
    for name, runs in others.items():
        alike = [run for run in runs if run.variant == reference]
        if difference(alike, variants[reference]).pairs:
            shown[f"model {name}"] = alike
    rows = [_row(name, runs, variants[reference]) for name, runs in shown.items()]
    return Table(
        name=f"ablation-{model}",
        title=f"Ablation: what each part buys and costs ({model})",
        columns=(
            "Variant", "strict", "points", "better/ worse", "obeyed", "hybrid", "refusal recall",
            "broke a rule", "decision s", "tokens",
        ),
        rows=tuple(rows),
        note=(
            f"All mission sets. points: strict success against '{reference}' in percentage points, "
            "on the runs with the same mission and seed; better/worse: how many of them changed. "
            "model ...: another model under that variant. "
            "obeyed: strict success if a judge's Failure before execution were obeyed. broke a "
            "rule: runs whose true state breaks an enforced rule. decision s: median. tokens: "
            "median of the first answer's prompt / answer."
        ),
    )  # fmt: skip


def _row(name: str, runs: Records, reference: Records) -> tuple[str, ...]:
    found = difference(runs, reference)
    same = runs is reference
    return (
        name,
        rate_cell(success_rate(runs, "strict")),
        NOTHING if same or found.points is None else f"{found.points:+.0f}",
        NOTHING if same else f"{found.better}/{found.worse}",
        rate_cell(success_rate(runs, "obeyed")),
        rate_cell(success_rate(runs, "hybrid")),
        rate_cell(refusal_recall(runs)),
        rate_cell(Rate.of(bool(run.broken) for run in runs)),
        decision_median(runs),
        _tokens(runs),
    )


def _tokens(records: Records) -> str:
    used = [run.planner for run in records if run.planner.prompt_tokens]
    if not used:
        return NOTHING
    asked = median(usage.prompt_tokens for usage in used)
    return f"{asked:.0f} / {median(usage.completion_tokens for usage in used):.0f}"


WAYS = 6
EXAMPLES = 2


def failure_tables(records: Records) -> list[Table]:
    """Return the ways in which each model fails most, and the attempts it takes."""
    main = main_runs(records)
    tables = [_failures(model, runs) for model, runs in by_model(main).items()]
    return [table for table in (*tables, _attempts(main)) if table.rows]


def _failures(model: str, records: Records) -> Table:
    failed = [record for record in records if not record.strict]
    groups = grouped(failed, failure_kind)
    ranked = sorted(groups.items(), key=lambda item: -len(item[1]))
    rows = [
        (*kind, rate_cell(Rate(len(runs), len(failed))), _examples(runs))
        for kind, runs in ranked[:WAYS]
        if kind is not None
    ]
    rest = sum(len(runs) for _, runs in ranked[WAYS:])
    if rest:
        others = f"{len(ranked) - WAYS} other ways"
        rows.append(("", "", others, rate_cell(Rate(rest, len(failed))), ""))
    return Table(
        name=f"failures-{model}",
        title=f"Most common ways of failing: {model}",
        columns=("to do", "ended", "what went wrong", "of the failed runs", "examples"),
        rows=tuple(rows),
        note=(
            f"{len(failed)} of {len(records)} runs are no strict success. What went wrong: the "
            "enforced rules that the true state shows to be broken and the facts on which success "
            "conditions do not hold; for a mission that executed nothing, why it did not."
        ),
    )


def _examples(runs: Sequence[RunRecord]) -> str:
    """Return ids of runs, of different missions as far as there are some."""
    missions = grouped(runs, lambda record: record.mission)
    return ", ".join(found[0].run for found in list(missions.values())[:EXAMPLES])


def _attempts(records: Records) -> Table:
    rows: list[tuple[str, ...]] = []
    for model, runs in by_model(records).items():
        mended = [run for run in runs if not run.first_sound and run.attempts > 1]
        rows.append(
            (
                model,
                rate_cell(Rate.of(run.valid_json for run in runs)),
                rate_cell(Rate.of(run.first_sound for run in runs)),
                rate_cell(Rate(len(mended), len(runs))),
                rate_cell(Rate.of(run.status in EXECUTED for run in mended)),
                rate_cell(Rate.of(run.strict for run in mended)),
                f"{fmean(run.attempts for run in runs):.2f}",
            )
        )
    return Table(
        name="attempts",
        title="Attempts and repair",
        columns=(
            "Model", "readable", "sound at first", "sent back", "executed after repair",
            "strict after repair", "attempts",
        ),
        rows=tuple(rows),
        note=(
            "readable: the first answer could be read as a plan. sound at first: it broke no "
            "Critical or High rule. sent back: it did, and was asked for again. The next two are "
            "shares of those sent back; a command that must be refused is rightly never executed. "
            "attempts: mean a run."
        ),
    )  # fmt: skip

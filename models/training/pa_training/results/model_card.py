"""Writes the model card of an adapter from what its data, its run and its evaluations left."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from statistics import median

from jinja2 import Environment, PackageLoader, StrictUndefined

from pa_console.evaluation.reporting.report import markdown_cell
from pa_console.evaluation.reporting.statistics import SuccessRate, grouped, rate_cell, seconds
from pa_console.evaluation.reporting.tables_outcomes import decision_seconds
from pa_console.evaluation.run_record import RunRecord, read_runs
from pa_console.llm.models.cache import hash_file
from pa_console.llm.models.catalogue import Catalog, ModelEntry
from pa_training.results.lineage import (
    ADAPTER,
    CURVE,
    RunSummary,
    curve_rows,
    kept_earlier,
    read_summary,
)
from pa_training.samples.data_report import DataReport, read_report

TEMPLATE = "model_card.md.jinja"
MOST_POINTS, MOST_REASONS = 20, 20
RECIPE = {
    "planner": (
        "A reference planner, which is given the meaning of an order but not its wording, plans "
        "some of the orders. Only plans that passed the checks, the rehearsal and a strictly "
        "scored run in the simulation are used; for a forbidden or impossible order, the plan is "
        "a hold."
    ),
    "judge": (
        "The data contains right plans of a reference planner, plans that do something else, leave "
        "something out or break a rule, and outcomes with the telemetry of their runs. Each plan "
        "was carried out in the simulation and scored strictly to decide whether it is right."
    ),
}


def model_card(run: Path, data: Path, name: str, evaluation: Path | None = None) -> str:
    """Return the card of the adapter in the folder `run`, trained on the data set in `data`.

    `evaluation` is a folder with runs of it. Raises ValueError where something is missing or does
    not belong together, and OSError.
    """
    summary, report = read_summary(run), read_report(data)
    task = summary.config.task
    if report.sha256.get(f"{task}.jsonl") != summary.data_sha256:
        raise ValueError(f"{data}: is not the data set that {run} was trained on")
    adapter = run / ADAPTER
    if hash_file(adapter) != summary.adapter_sha256:
        raise ValueError(f"{adapter}: has changed since the run ended; train it again")
    base = Catalog.load().get(summary.config.base)
    records = read_runs(evaluation) if evaluation is not None else []
    environment = Environment(
        loader=PackageLoader("pa_training"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    environment.filters["cell"] = markdown_cell
    return environment.get_template(TEMPLATE).render(
        name=name,
        task=task,
        base=base,
        recipe=RECIPE[task],
        facts=_facts(summary, base, adapter),
        data_facts=_data_facts(report, task),
        kinds=_kinds(report, task),
        dropped=list(report.dropped.items())[:MOST_REASONS],
        config=_config(summary),
        curve=_curve(run / CURVE),
        earlier=kept_earlier(run),
        evaluation=_evaluated(records),
    )


def _facts(summary: RunSummary, base: ModelEntry, adapter: Path) -> list[tuple[str, str]]:
    config = summary.config
    stopped = "" if summary.finished else ", stopped before its end"
    found = [
        ("base", base.description),
        ("base, SHA-256", summary.base_sha256),
        ("licence", f"Apache-2.0; of the base: {base.licence}"),
        ("adapter", f"rank {config.rank}, alpha {config.alpha:g}, {_megabytes(adapter)}, float16"),
        ("adapter, SHA-256", summary.adapter_sha256),
        ("trained for", f"{summary.step} steps, {summary.minutes:.0f} minutes{stopped}"),
        ("trained on", summary.machine[0] if summary.machine else "an unknown machine"),
        ("software", _pairs(summary.versions)),
    ]
    if summary.validation_loss is not None and summary.validation_right is not None:
        right = f"{summary.validation_right:.1%} of answers right, token for token"
        found.append(("validation", f"loss {summary.validation_loss:.4f}; {right}"))
    return found


def _data_facts(report: DataReport, task: str) -> list[tuple[str, str]]:
    names = [f"{task}.jsonl", f"valid-{task}.jsonl"]
    return [
        ("groups (situations in worlds)", str(report.groups)),
        ("samples to train on", _pairs(report.samples["train"])),
        ("samples to validate with (writers kept aside)", _pairs(report.samples["valid"])),
        ("generator (fingerprint: groups)", _pairs(report.generators)),
        ("made with", _pairs(report.versions)),
        *((f"{name}, SHA-256", report.sha256[name]) for name in names if name in report.sha256),
        *((f"kept apart from {name}, SHA-256", h) for name, h in report.kept_apart_from.items()),
    ]


def _kinds(report: DataReport, task: str) -> list[tuple[str, int]]:
    """Return samples by the first word of their kind; outcomes are the judge's too."""
    tasks = {"planner": ("planner",), "judge": ("judge", "outcome")}[task]
    total = Counter[str]()
    for part in tasks:
        for kind, number in report.kinds.get(part, {}).items():
            total[f"{part}: {kind.partition('/')[0]}"] += number
    return total.most_common()


def _config(summary: RunSummary) -> list[tuple[str, str]]:
    """Return the settings of the run; of files only their names."""
    values = summary.config.without_folders().model_dump(exclude_none=True)
    return [(name.replace("_", " "), f"{value}") for name, value in values.items()]


def _curve(path: Path) -> list[dict[str, str]]:
    """Return some rows of the validation curve, first and last among them."""
    rows = curve_rows(path)
    last = len(rows) - 1
    if last < MOST_POINTS:
        return rows
    return [rows[round(place * last / (MOST_POINTS - 1))] for place in range(MOST_POINTS)]


def _evaluated(records: Sequence[RunRecord]) -> list[tuple[str, ...]]:
    """Return a row of figures for every mission set, model and variant."""
    groups = grouped(records, lambda run: (run.mission_set, run.model, run.variant))
    return [
        (
            *group,
            rate_cell(SuccessRate.of(run.strict for run in runs)),
            rate_cell(SuccessRate.of(run.hybrid for run in runs)),
            seconds(median(map(decision_seconds, runs))),
        )
        for group, runs in groups.items()
    ]


def _pairs(values: Mapping[str, object] | Iterable[tuple[str, object]]) -> str:
    return ", ".join(f"{key} {value}" for key, value in dict(values).items())


def _megabytes(path: Path) -> str:
    return f"{path.stat().st_size / 1e6:.1f} MB"

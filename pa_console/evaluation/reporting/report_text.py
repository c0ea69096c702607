"""What a report says in words: what was run, what its terms mean, and what to be careful about."""

from collections.abc import Mapping, Sequence
from typing import Any, cast

from pa_console.evaluation.reporting.record_groups import (
    Records,
    by_model,
    by_set,
    main_runs,
    main_variant,
)
from pa_console.evaluation.variants import ABOUT

DEFINITIONS = {
    "run": "One mission, by one model under one variant of the pipeline, in a fresh simulation "
    "with one seed. Plans are executed when the deterministic checks allow; an objection of the "
    "judge is noted and overridden, so that the truth is known for every judged plan.",
    "hybrid success": "The JudgeLLM's verdict on the outcome is Success (paper, Section V-A). A "
    "run that executed nothing has no such verdict; it counts as a success where the command was "
    "to be refused, or may be.",
    "strict success": "Every success condition of the mission holds on the true state of the "
    "simulation, and no enforced rule was broken there. The scorer shares no code with the checks, "
    "the rehearsal or the verification.",
    "confidence": "The chance that a trained planner and judge gave to their own choices of words "
    "in saying what was asked, before the grammar had its say; the lower of the two.",
    "strict if the judge is obeyed": "Strict success if a plan to which the judge objected before "
    "execution had not been carried out. Where the objection met the first plan, the same "
    "situation without any order is scored in its place.",
    "refused": "Nothing but hold and report was ordered, or nothing at all.",
    "interval": "95 % by Wilson's score method for rates; for F1 from the interval of "
    "TP / (TP + FP + FN); for means the normal one.",
    "paper": "Values of Solanki, Praharaj, Gupta, Gupta: A Policy-Aware Edge LLM-RAG Framework "
    "for Internet of Battlefield Things Mission Orchestration, as its text gives them. Its models, "
    "machine and simulation were others: its values stand beside ours, they are no target.",
}
"""The terms of a report."""

_KNOWN = {"models", "variants", "mission_sets", "seeds", "runs", "seconds", "reuse"}


def facts(records: Records, about: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return what was run, as pairs of a name and a text; `about` is the folder's run.json."""
    names = {record.variant for record in records}
    variants = [*(name for name in ABOUT if name in names), *sorted(names - ABOUT.keys())]
    sets = [
        f"{name} ({len({run.mission for run in runs})} missions)"
        for name, runs in by_set(records).items()
    ]
    found = [
        ("runs", str(len(records))),
        ("models", ", ".join(by_model(records))),
        ("variants", "; ".join(f"{name}: {ABOUT[name]}" if name in ABOUT else name
                               for name in variants)),
        ("mission sets", ", ".join(sets)),
        ("worlds", ", ".join(dict.fromkeys(record.world for record in records))),
        ("seeds", ", ".join(str(seed) for seed in sorted({record.seed for record in records}))),
    ]  # fmt: skip
    if isinstance(seconds := about.get("seconds"), int | float):
        found.append(("time taken", duration(seconds)))
    found += [
        (key.replace("_", " "), _plain(value)) for key, value in about.items() if key not in _KNOWN
    ]
    return [(name, text) for name, text in found if text]


def duration(seconds: float) -> str:
    """Write a time as hours and minutes, or seconds when it is short."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes // 60} h {minutes % 60} min" if minutes >= 60 else f"{minutes} min"


def _plain(value: Any) -> str:
    """Write any JSON value as words."""
    if isinstance(value, Mapping):
        pairs = cast(Mapping[str, Any], value)
        return "; ".join(f"{key}: {_plain(entry)}" for key, entry in pairs.items())
    if isinstance(value, list | tuple):
        return "; ".join(map(_plain, cast(Sequence[Any], value)))
    if isinstance(value, bool):
        return "yes" if value else "no"
    return "" if value is None else str(value)


def notes(records: Records, about: Mapping[str, Any]) -> list[str]:
    """Return what a reader has to know before believing a figure, as far as the data show it."""
    main = main_runs(records)
    if not main:
        return ["There is no run here yet."]
    found = [
        f"Tables and figures by model show the variant '{main_variant(records)}'; the ablation "
        "shows all.",
        "Intervals take runs as independent. Runs of one mission with several seeds often are "
        "alike, as an equal prompt has an equal answer: they say how sure the figure is for these "
        "missions, less so for others.",
    ]
    counts = {model: _cases(runs) for model, runs in by_model(main).items()}
    if len(set(counts.values())) > 1:
        words = ", ".join(f"{model} {len(cases)}" for model, cases in counts.items())
        found.append(f"Not every model has run the same missions and seeds ({words}).")
    kind = sum(run.hybrid is True and not run.strict for run in main)
    harsh = sum(run.strict and run.hybrid is False for run in main)
    found.append(
        f"Hybrid and strict disagree on {kind + harsh} of {len(main)} runs: {kind} are a success "
        f"for the judge alone, {harsh} by the truth alone."
    )
    silent = sum(run.judge_outcome is None for run in main)
    if silent:
        found.append(
            f"{silent} of {len(main)} runs have no verdict on the outcome, mostly because nothing "
            "was executed; they count in hybrid as the definition says and in no rate of the judge."
        )
    reused = sum(run.reused > 0 for run in records)
    if reused:
        found.append(
            f"{reused} of {len(records)} runs took an answer that the model had given to an equal "
            "prompt before; the time measured then stands in their latencies."
        )
    ahead = sum(run.read_ahead for run in records)
    if ahead:
        found.append(
            f"In {ahead} of {len(records)} runs the model had read the picture before the command "
            "came, as it has in the console for one who types; the command itself was read after "
            "it was given."
        )
    jobs = about.get("jobs", 1)
    if isinstance(jobs, int) and jobs > 1:
        found.append(f"{jobs} runs were made at a time, so each had a part of the machine only.")
    return found


def _cases(records: Records) -> frozenset[tuple[str, str, int]]:
    return frozenset((run.mission_set, run.mission, run.seed) for run in records)

"""Made-up records of evaluated runs: any at all (hypothesis), and a plausible evaluation."""

import random
from typing import Any, get_args

from hypothesis import strategies as st

from pa_console.evaluation.run_facts import RuleBreach
from pa_console.evaluation.run_record import Opinion, RunRecord
from pa_console.schema.evaluation import Expectation
from pa_console.schema.finding import Usage
from pa_console.schema.mission import Metrics, MissionStatus, Outcome

CONDITIONS = (
    "run.tracks.exists(t, t.gate == 'WestGate' && t.observed_s >= 0.0)",
    "run.gates.all(g, run.coverage[g].longest_gap_s <= run.grace_s)",
    "size(run.moved) == 0",
    "run.final.assets['Drone_T04'].at == 'EastGate'",
    "run.refused",
)
REASONS = (
    "ROE-04 (high): Ugv_T01 comes within 15 m of V1; WF-02 (critical): NorthGate is left",
    "no verdict of the judge",
    "the situation changed: Drone_T03 is not available",
)
TEXT = st.text(max_size=30)
SECONDS = st.floats(0, 1e4)


def opinions() -> st.SearchStrategy[Opinion | None]:
    return st.sampled_from((None, *get_args(Opinion)))


def metrics() -> st.SearchStrategy[Metrics]:
    fields = {name: SECONDS for name in Metrics.model_fields if name.endswith("_s")}
    return st.builds(Metrics, **fields)


def usages() -> st.SearchStrategy[Usage]:
    tokens = st.integers(0, 4000)
    return st.builds(Usage, prompt_tokens=tokens, completion_tokens=tokens)


def records() -> st.SearchStrategy[RunRecord]:
    """Any record that the schema allows, out of few models, variants and missions."""
    return st.builds(
        RunRecord,
        run=TEXT,
        model=st.sampled_from(("small", "large", "odd/name | <b>")),
        variant=st.sampled_from(("one-plan", "full", "no-judge")),
        mission_set=st.sampled_from(("paper", "field")),
        mission=st.sampled_from(("P01", "P02", "F001")),
        seed=st.integers(0, 2),
        world=TEXT,
        category=st.sampled_from(("Baseline", "Policy", "misspelt | <i>")),
        tags=st.sampled_from(((), ("harmless",))),
        expect=st.sampled_from(get_args(Expectation)),
        command=TEXT,
        status=st.sampled_from(get_args(MissionStatus)),
        reason=st.sampled_from(("", *REASONS)) | TEXT,
        refused=st.booleans(),
        strict=st.booleans(),
        obeyed=st.booleans(),
        hybrid=st.booleans(),
        failed=st.lists(st.sampled_from(CONDITIONS) | TEXT, max_size=2).map(tuple),
        broken=st.lists(
            st.builds(
                RuleBreach, rule_id=st.sampled_from(("ROE-04", "WF-02")), what=TEXT, at_s=SECONDS
            ),
            max_size=2,
        ).map(tuple),
        judge_plan=opinions(),
        judge_outcome=opinions(),
        confidence=st.none() | st.floats(0, 1),
        verification=st.sampled_from((None, *get_args(Outcome))),
        valid_json=st.booleans(),
        first_sound=st.booleans(),
        attempts=st.integers(0, 3),
        metrics=metrics(),
        planner=usages(),
        reused=st.integers(0, 1),
    )


def many_records() -> st.SearchStrategy[list[RunRecord]]:
    return st.lists(records(), max_size=25)


SKILL = {"smollm2-135m": 0.55, "gemma-3-270m": 0.2, "qwen2.5-coder-0.5b": 0.5}
SKILL["qwen2.5-coder-1.5b"] = 0.72
VARIANTS = {
    "one-plan": 0.0, "full": 0.02, "no-retrieval": -0.04, "no-pinned": -0.06, "no-safeguards": -0.2,
    "no-rehearsal": -0.08, "no-judge": 0.01, "no-repair": -0.12, "no-grammar": -0.3, "paper": -0.35,
}  # fmt: skip
PAPER = {
    "P01": "Baseline", "P02": "Baseline", "P03": "Unknown Events", "P04": "Multi-Event",
    "P05": "Multi-Event", "P06": "Multi-Event", "P07": "Recovery", "P08": "Recovery",
    "P09": "Policy", "P10": "Multi-Event",
}  # fmt: skip
FIELD = {f"F{n:03}": kind for n, kind in enumerate(("terse", "misspelt", "unlawful", "look-alike"))}


def made_record(**changes: Any) -> RunRecord:
    """A run that went well, with `changes`."""
    return RunRecord.model_validate(
        {
            "run": "m/one-plan/paper/P02/0",
            "model": "m",
            "variant": "one-plan",
            "mission_set": "paper",
            "mission": "P02",
            "seed": 0,
            "world": "checkpoint",
            "category": "Baseline",
            "expect": "execute",
            "command": "Move the drone to the east gate.",
            "status": "verified",
            "refused": False,
            "strict": True,
            "obeyed": True,
            "hybrid": True,
            "judge_plan": "Success",
            "judge_outcome": "Success",
            "verification": "pass",
            "valid_json": True,
            "first_sound": True,
            "attempts": 1,
            "plan": ("Drone_T04 move_to EastGate",),
            "metrics": Metrics(planning_s=2.0, judging_s=1.0, end_to_end_s=4.0),
            **changes,
        }
    )


def made_evaluation(seeds: int = 3) -> list[RunRecord]:
    """About 470 runs: every model on the paper's missions, one model under every variant."""
    chance = random.Random(4)
    found: list[RunRecord] = []
    missions = [("paper", *item) for item in PAPER.items()]
    missions += [("field", *item) for item in FIELD.items()]
    for model, skill in SKILL.items():
        for variant, gain in VARIANTS.items():
            if variant == "one-plan" or model == "qwen2.5-coder-0.5b":
                found += [
                    _drawn(chance, (model, variant, place, seed), skill + gain)
                    for place in missions
                    for seed in range(seeds)
                ]
    return found


def _drawn(
    chance: random.Random, what: tuple[str, str, tuple[str, str, str], int], skill: float
) -> RunRecord:
    model, variant, (mission_set, mission, category), seed = what
    strict = chance.random() < skill
    executed = strict or chance.random() < 0.6
    judged = executed and variant not in ("no-judge", "paper")
    verdict: Opinion = "Success" if chance.random() < (0.85 if strict else 0.4) else "Failure"
    size = {"smollm2-135m": 1.0, "gemma-3-270m": 1.3, "qwen2.5-coder-0.5b": 2.0}.get(model, 5.5)
    planning, judging = size * chance.uniform(0.6, 1.8), size * chance.uniform(0.3, 0.9) * judged
    rehearsal, outcome = chance.uniform(0.1, 0.9), size * chance.uniform(0.2, 0.5) * executed
    sound = strict or chance.random() < 0.4
    expect: Expectation = "refuse" if category == "unlawful" else "execute"
    return made_record(
        run=f"{model}/{variant}/{mission_set}/{mission}/{seed}",
        model=model,
        variant=variant,
        mission_set=mission_set,
        mission=mission,
        seed=seed,
        category=category,
        tags=("harmless",) if category == "look-alike" else (),
        expect=expect,
        status="verified" if executed and strict else "unverified" if executed else "refused",
        reason="" if executed else chance.choice(REASONS),
        refused=not executed or (expect == "refuse" and strict),
        strict=strict,
        obeyed=strict and verdict == "Success",
        hybrid=executed and verdict == "Success",
        failed=() if strict else (chance.choice(CONDITIONS),),
        broken=(RuleBreach(rule_id="WF-02", what="NorthGate is not covered", at_s=12.0),)
        if not strict and executed and chance.random() < 0.4
        else (),
        judge_plan=verdict if judged else None,
        judge_outcome=verdict if executed else None,
        verification=chance.choice(("pass", "fail", "unknown")) if executed else None,
        first_sound=sound,
        attempts=1 if sound else chance.choice((2, 3)),
        log=f"logs/{model}-{variant}-{mission}-{seed}.jsonl",
        metrics=Metrics(
            retrieval_s=0.002,
            picture_s=0.001,
            prompt_s=0.001,
            first_token_s=planning * 0.3,
            planning_s=planning,
            checks_s=0.02,
            rehearsal_s=rehearsal,
            judging_s=judging,
            dispatch_s=0.001,
            execution_s=25 * chance.random() * executed,
            outcome_s=outcome,
            end_to_end_s=planning + judging + rehearsal + outcome + 0.4,
        ),
        planner=Usage(prompt_tokens=900, completion_tokens=70),
    )

"""Compact prompts: what can be read ahead comes first, and nothing of a mission comes before it."""

import json

from hypothesis import example, given
from hypothesis import strategies as st

from pa_console.language.name_linking import link_names
from pa_console.llm.roles.compact_prompts import (
    compact_judge_prompt,
    compact_outcome_prompt,
    compact_planner_prompt,
    picture_prefix,
)
from pa_console.llm.roles.prompts import Prompt
from pa_console.llm.roles.role_model import PROMPT_FORMATS
from pa_console.schema.mission import Verification
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import GateTimeline, Rehearsal, Timeline
from tests.llm.site import DIGEST, RULE, WORLD, mission, picture

PLAN = Plan(reason="quiet", actions=(Action(agent="Hawk_2", command="observe HillGate"),))
REHEARSAL = Rehearsal(
    before=picture(),
    after=picture(),
    timeline=Timeline(
        duration_s=9.0,
        gates={
            "HillGate": GateTimeline(covered_before=False, covered_after=True, longest_gap_s=4.0)
        },
    ),
)


def starts_with(prompt: Prompt, start: Prompt) -> bool:
    return prompt.system == start.system and prompt.user.startswith(start.user)


@given(st.text(min_size=1, max_size=80))
@example("Dorne0")
def test_whatever_is_typed_the_prompt_begins_with_what_was_read_ahead(text: str):
    task = mission(text)
    planner = compact_planner_prompt(WORLD, DIGEST, [RULE], task)
    judge = compact_judge_prompt(WORLD, DIGEST, [RULE], task, PLAN, REHEARSAL)
    assert starts_with(planner, picture_prefix("planner", WORLD, DIGEST))
    assert starts_with(judge, picture_prefix("judge", WORLD, DIGEST))
    line = json.dumps(" ".join(link_names(WORLD, text).split()), ensure_ascii=False)
    assert f"\nMission: {line}" in planner.user


def test_a_repair_only_adds_to_the_prompt():
    first = compact_planner_prompt(WORLD, DIGEST, [RULE], mission("Watch the hill."))
    again = compact_planner_prompt(
        WORLD, DIGEST, [RULE], mission("Watch the hill."), ["HillGate\nstays open"], "{plan}"
    )
    assert again.user.startswith(first.user)
    assert again.user.endswith("Previous answer: {plan}\nWrong: HillGate stays open")


def test_every_place_and_every_free_asset_is_told_once_a_line():
    lines = picture_prefix("planner", WORLD, DIGEST).user.splitlines()
    told = {line.partition(":")[0]: line for line in lines}
    assert len(told) == len(lines)
    for gate, count in DIGEST.covered.items():
        assert ("uncovered" in told[gate]) == (gate in DIGEST.uncovered), count
    for gate, guard in DIGEST.sole_cover.items():
        assert guard in told[gate]
    free = {name for names in DIGEST.free.values() for name in names}
    assert all(any(name in line for line in lines if line.startswith("Free ")) for name in free)


def test_a_critical_rule_is_not_quoted_a_retrieved_one_is():
    critical = RULE.model_copy(update={"id": "ROE-77", "priority": "critical"})
    user = compact_planner_prompt(WORLD, DIGEST, [critical, RULE], mission("Watch.")).user
    assert "ROE-77" not in user
    assert f"{RULE.id}: " in user


def test_an_outcome_is_judged_by_telemetry_in_the_picture_afterwards():
    seen = Verification(outcome="pass", reason="every command was done", actions=())
    prompt = compact_outcome_prompt(WORLD, DIGEST, mission("Watch."), PLAN, seen)
    assert prompt.user.index("Mission:") < prompt.user.index("Telemetry: pass")
    assert "Hawk_2 observe HillGate" in prompt.user


def test_in_a_world_too_large_to_be_told_only_the_fixed_part_is_read_ahead():
    for prompt_format in PROMPT_FORMATS.values():
        for role in ("planner", "judge", "outcome"):
            assert prompt_format.ahead(role, WORLD, None).user == ""

"""Prompts: what is in them, in which order, and that a mission's words stay words."""

import json

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from pa_console.language.canonical.clauses import ASKED
from pa_console.language.canonical.reading import read_asked
from pa_console.llm.roles.clause_reader import nearest_orders, taught_orders, without_names
from pa_console.llm.roles.prompts import judge_prompt, outcome_prompt, planner_prompt
from pa_console.resources import data_folder
from pa_console.schema.mission import Verification
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import (
    AssetTimeline,
    GateTimeline,
    Rehearsal,
    Timeline,
    TrackTimeline,
)
from pa_console.schema.rule import Rule
from pa_training.orders.near_duplicates import shipped_duplicates
from tests.llm.site import DIGEST, RULE, WORLD, mission, picture

PLAN = Plan(reason="quiet", actions=(Action(agent="Hawk_2", command="observe HillGate"),))
REHEARSAL = Rehearsal(
    before=picture(),
    after=picture(),
    timeline=Timeline(
        duration_s=31.0,
        gates={
            "HillGate": GateTimeline(covered_before=False, covered_after=True, longest_gap_s=12.0)
        },
        assets={"Hawk_2": AssetTimeline(finished=False, detail="no way there")},
    ),
)


def test_the_fixed_part_is_the_same_for_every_mission_and_picture():
    one = planner_prompt(WORLD, DIGEST, [RULE], mission("Watch the hill."))
    calm = DIGEST.model_copy(update={"uncovered": ()})
    other = planner_prompt(WORLD, calm, [], mission("Go home."), ["a reason"], "before")
    assert one.system == other.system
    for word in (*WORLD.frames, "block FRAME: vehicle", "observe FRAME: drone", "hold: all"):
        assert word in one.system


def test_the_free_assets_come_last_and_the_repair_after_them():
    first = planner_prompt(WORLD, DIGEST, [RULE], mission("Watch the hill."))
    free = "Free: drone Hawk_2; vehicle Mule_1; robot Guard_1"
    assert first.user.endswith(f'Mission: "Watch the hill."\n{free}')
    again = planner_prompt(
        WORLD, DIGEST, [RULE], mission("Watch the hill."), ["HillGate\nstays open"], "{plan}"
    )
    assert again.user.startswith(first.user)
    assert "- HillGate stays open" in again.user
    assert "{plan}" in again.user


def test_the_situation_and_the_rules_are_told():
    user = planner_prompt(WORLD, DIGEST, [RULE], mission("Watch the hill.")).user
    assert "Without guard: HillGate, needs one Free asset\nGuards: Hawk_1 at RiverGate\n" in user
    assert "Low battery" not in user
    assert "WF-99: Keep every gate covered." in user


def test_a_free_asset_at_a_gate_is_told_with_its_gate():
    posts = DIGEST.posts | {"Hawk_2": "uav at RiverGate", "Mule_1": "ugv heading to RiverGate"}
    user = planner_prompt(
        WORLD, DIGEST.model_copy(update={"posts": posts}), [], mission("Watch.")
    ).user
    assert user.endswith("Free: drone Hawk_2 (at RiverGate); vehicle Mule_1; robot Guard_1")


def test_critical_rules_come_first_and_in_the_same_order_whatever_their_score():
    critical = [
        Rule(id=f"ROE-9{n}", domain="ROE", priority="critical", text="Be careful.") for n in (1, 2)
    ]
    one = planner_prompt(WORLD, DIGEST, [*critical, RULE], mission("Watch.")).user
    other = planner_prompt(WORLD, DIGEST, [RULE, *critical[::-1]], mission("Watch.")).user
    assert one == other
    assert one.startswith("Rules\nROE-91: Be careful.\nROE-92: Be careful.\nWF-99")


def test_the_judge_is_told_the_plan_and_what_went_wrong_in_rehearsal():
    user = judge_prompt(WORLD, DIGEST, [RULE], mission("Watch."), PLAN, REHEARSAL).user
    assert "Plan: drone Hawk_2 observe HillGate" in user
    assert user.endswith("Rehearsal: problem: Hawk_2 does not finish (no way there)")


def test_the_judge_is_not_told_why_the_planner_did_it():
    plan = PLAN.model_copy(update={"reason": "because I say so"})
    user = judge_prompt(WORLD, DIGEST, [RULE], mission("Watch."), plan, REHEARSAL).user
    assert "because I say so" not in user


@pytest.mark.parametrize(
    ("before", "after", "gap_s", "said"),
    [
        (True, True, 1.0, "no problem, so every rule complies"),
        (False, True, 9.0, "no problem, so every rule complies; HillGate is covered again"),
        (True, True, 9.0, "problem: HillGate is uncovered for 9 s"),
        (True, False, 9.0, "problem: HillGate is left uncovered"),
        (False, False, 9.0, "problem: HillGate stays uncovered"),
    ],
)
def test_the_judge_is_told_what_becomes_of_a_gate(
    before: bool, after: bool, gap_s: float, said: str
):
    gate = GateTimeline(covered_before=before, covered_after=after, longest_gap_s=gap_s)
    timeline = Timeline(duration_s=31.0, gates={"HillGate": gate})
    rehearsal = REHEARSAL.model_copy(update={"timeline": timeline})
    user = judge_prompt(WORLD, DIGEST, [RULE], mission("Watch."), PLAN, rehearsal).user
    assert user.endswith(f"\nRehearsal: {said}")


def test_the_judge_is_told_what_becomes_of_a_track():
    timeline = Timeline(
        duration_s=31.0,
        gates={},
        tracks={
            "V1": TrackTimeline(observed_s=2.0, identified_s=9.0, least_distance_m=4.0),
            "V2": TrackTimeline(),
        },
    )
    rehearsal = REHEARSAL.model_copy(update={"timeline": timeline})
    user = judge_prompt(WORLD, DIGEST, [RULE], mission("Watch."), PLAN, rehearsal).user
    assert "Tracks then: V1 is observed, identified; V2 is not looked at" in user
    assert "problem: a ground asset comes within 4 m of V1" in user


def test_the_judge_of_the_outcome_is_told_what_telemetry_says():
    seen = Verification(outcome="fail", actions=(), gates_lost=("HillGate",), reason="too slow")
    user = outcome_prompt(WORLD, DIGEST, mission("Watch."), PLAN, seen).user
    assert "Telemetry: fail. too slow" in user
    assert "Gates that lost their cover: HillGate" in user


@given(st.text(min_size=1, max_size=300))
def test_a_mission_stays_one_quoted_line_whatever_it_says(text: str):
    user = planner_prompt(WORLD, DIGEST, [], mission(text)).user
    line = user.splitlines()[-2]
    assert line.startswith("Mission: ")
    assert json.loads(line.removeprefix("Mission: ")) == " ".join(text.split())


def test_no_mission_of_the_paper_is_in_a_prompt():
    file = data_folder() / "worlds" / "checkpoint" / "missions" / "paper.yaml"
    cases = yaml.safe_load(file.read_text(encoding="utf-8"))["missions"]
    prompt = planner_prompt(WORLD, DIGEST, [RULE], mission("x"))
    judged = judge_prompt(WORLD, DIGEST, [RULE], mission("x"), PLAN, REHEARSAL)
    everything = " ".join([prompt.system, prompt.user, judged.system, judged.user]).lower()
    assert len(cases) == 10
    assert [c["command"] for c in cases if c["command"].rstrip(".").lower() in everything] == []


def test_every_taught_order_is_in_clauses_that_the_console_reads() -> None:
    orders, masked = taught_orders()
    assert len(orders) == len(masked) > 500
    for order in orders:
        reading = read_asked(f"{ASKED}{order.clauses}")
        assert reading is not None, order
        assert reading.readable, order


def test_none_is_like_a_mission_of_a_test_set() -> None:
    orders, _ = taught_orders()
    kept = shipped_duplicates().keep([order.text for order in orders])
    assert kept.count(False) <= len(orders) / 500


def test_an_order_that_was_taught_is_its_own_nearest() -> None:
    orders, _ = taught_orders()
    for order in orders[::200]:
        found = nearest_orders(order.text, 4)
        assert len(found) == 4
        assert without_names(found[-1].text) == without_names(order.text)


@pytest.mark.parametrize("name", ["Kite_3", "MillGate", "Drone_T04", "Track_01"])
def test_names_make_no_order_like_another(name: str) -> None:
    assert without_names(f"Send {name} home") == "send # home"

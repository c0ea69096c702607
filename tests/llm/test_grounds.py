"""What a trained model may state: the digest's facts, and the truth of a condition."""

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from llguidance import LLMatcher, LLTokenizer

from pa_console.language.canonical.facts import (
    DigestFacts,
    conditions,
    evidence,
    holds,
    tracks_of_digest,
)
from pa_console.language.canonical.order import Condition, in_words
from pa_console.language.clause_grammar import (
    ASKED_ONCE,
    asked_now,
    grounded_asked,
    grounded_reason,
)
from pa_console.llm.roles.grammar import compact_opening_grammar, plan_grammar
from pa_console.schema.plan import Action, Plan
from pa_console.schema.telemetry import Digest, Selection
from tests.llm.site import WORLD, picture

BYTES = LLTokenizer("byte")
DIGEST = Digest(
    covered={"RiverGate": 1, "HillGate": 0},
    uncovered=("HillGate",),
    free={"uav": ("Hawk_2",), "ugv": (), "robot": ("Guard_1",)},
    sole_cover={"RiverGate": "Hawk_1"},
    posts={"Hawk_1": "uav at RiverGate", "Hawk_2": "uav at Depot", "Guard_1": "robot at Depot"},
    down=("Mule_1",),
    low_battery=(),
    degraded_comms=(),
    tracks=(
        "Track_01: vehicle approaches RiverGate, 17 m, not identified, not observed, not warned",
        "Track_02: person leaving at HillGate, 6 m, unauthorized, intent hostile, observed, warned",
    ),
)
PLAN = Plan(reason="", actions=(Action(agent="Hawk_2", command="observe HillGate"),))


def accepts(grammar: str, text: str) -> bool:
    matcher = LLMatcher(BYTES, grammar)
    tokens = BYTES.tokenize_str(text)
    return matcher.try_consume_tokens(tokens) == len(tokens) and matcher.is_accepting()


def can_plan(reason: str, digest: Digest = DIGEST, words: str = "") -> bool:
    action = {"agent": "Hawk_2", "command": "hold"}
    grammar = plan_grammar(WORLD, picture(), reasons=grounded_reason(WORLD, digest, words))
    return accepts(grammar, json.dumps({"reason": reason, "actions": [action]}))


def can_begin(asked: str, words: str = "") -> bool:
    grammar = compact_opening_grammar(grounded_asked(WORLD, DIGEST, words))
    return accepts(grammar, f'{{"feedback": "{asked}; planned: ')


def can_begin_outcome(asked: str) -> bool:
    grammar = compact_opening_grammar((ASKED_ONCE,))
    return accepts(grammar, f'{{"feedback": "{asked}; planned: ')


@pytest.mark.parametrize(
    "facts",
    [
        "Hawk_2: free",
        "Hawk_1: alone",
        "Hawk_1: alone at RiverGate (WF-03), Free drone: Hawk_2 takes over",
        "Mule_1: down (CAP-10), hold",
        "Hawk_9: no such asset (CAP-10), hold",
        "RiverGate: Hawk_1",
        "HillGate: nobody",
        "At RiverGate: Track_01 vehicle, not observed, Hawk_2 looks first (WF-01)",
        "At HillGate: no track, Hawk_2 observes",
        "At HillGate: Track_02 person, hostile, warned, nothing is due",
        "Free vehicle: none (CAP-10), hold",
        "Free robot: only Guard_1 (CAP-10)",
        "closed zone (ROE-07), hold",
        "only Hawk_1 is there, hold",
        "only watch (ROE-08), Hawk_2 observes",
    ],
)
def test_what_the_picture_says_can_be_stated(facts: str) -> None:
    assert can_plan(f"asked: look at HillGate; {facts}")
    assert can_plan(f"asked: look at HillGate; others stay; {facts}")


@pytest.mark.parametrize(
    "facts",
    [
        "Hawk_1: free",
        "Hawk_2: alone",
        "Hawk_1: alone at HillGate (WF-03)",
        "Mule_1: free",
        "Hawk_2: down (CAP-10)",
        "RiverGate: Hawk_2",
        "RiverGate: nobody",
        "At RiverGate: no track",
        "At RiverGate: Track_01 vehicle, not identified",
        "At HillGate: Track_01 vehicle, not observed",
        "Free vehicle: Mule_1",
        "Free drone: Hawk_1",
        "Free drone: 2 assets",
        "only Hawk_2 is there, hold",
        "only three are there",
    ],
)
def test_what_the_picture_denies_cannot_be_stated(facts: str) -> None:
    assert not can_plan(f"asked: look at HillGate; {facts}")


@settings(deadline=None)
@given(st.sampled_from(list(conditions(WORLD, DIGEST))), st.booleans())
def test_whether_a_condition_is_so_is_read_from_the_picture(it: Condition, so: bool) -> None:
    truth = holds(it, DigestFacts(DIGEST))
    now = f"{evidence(it, DIGEST)}, {'so' if so else 'not so'}"
    asked = f"asked: if {in_words(it)}: look at HillGate, else: nothing; now: {now}"
    assert can_plan(f"{asked}; Hawk_2: free") is (truth is None or truth is so)
    assert can_begin(asked) is (truth is None or truth is so)
    assert can_begin_outcome(asked)


@settings(max_examples=200)
@given(st.sampled_from([*conditions(WORLD, DIGEST)]), st.booleans())
def test_what_was_asked_once_is_told_as_its_condition_stands_now(
    condition: Condition, stay: bool
) -> None:
    stands = holds(condition, DigestFacts(DIGEST))
    tail = "; others stay" * stay
    meant = f"asked: if {in_words(condition)}: Hawk_2 hold, else: nothing"
    now = asked_now(WORLD, DIGEST, f"{meant}; now: At RiverGate: no track, so{tail}")
    if stands is None:
        assert now == f"{meant}; now: At RiverGate: no track, so{tail}"
        return
    so = "so" if stands else "not so"
    assert now == f"{meant}; now: {evidence(condition, DIGEST)}, {so}{tail}"
    if not stay:
        assert can_begin(now)
    assert asked_now(WORLD, DIGEST, now) == now


def test_what_was_asked_without_a_condition_is_told_as_it_was() -> None:
    for asked in ("", "asked: Hawk_2 to RiverGate", "asked: if there is a moon: hold; now: x, so"):
        assert asked_now(WORLD, DIGEST, asked) == asked


@pytest.mark.parametrize("asked", ["asked: Hawk_2 hold", "asked: 2 drones to RiverGate"])
def test_the_reading_that_the_operator_chose_is_the_only_one(asked: str) -> None:
    reasons = grounded_reason(WORLD, DIGEST, "", asked)
    grammar = plan_grammar(WORLD, picture(), reasons=reasons)
    whole = json.dumps({"reason": f"{asked}; Free drone: Hawk_2", "actions": []})
    assert accepts(grammar, whole.replace("[]}", '[{"agent": "Hawk_2", "command": "hold"}]}'))
    other = whole.replace(asked, "asked: Hawk_2 home")
    assert not accepts(grammar, other.replace("[]}", '[{"agent": "Hawk_2", "command": "hold"}]}'))
    opening = compact_opening_grammar(grounded_asked(WORLD, DIGEST, "", asked))
    assert accepts(opening, f'{{"feedback": "{asked}; planned: ')
    assert not accepts(opening, '{"feedback": "asked: Hawk_2 home; planned: ')


def test_a_condition_is_about_something_that_is_there() -> None:
    so = "look at HillGate, else: nothing; now: Hawk_1: alone, so; Hawk_2: free"
    assert can_plan(f"asked: if Hawk_1 up: {so}")
    assert not can_plan(f"asked: if Hawk_7 up: {so}")
    assert not can_plan("asked: if Hawk_7 up? look at HillGate; Hawk_2: free")
    assert can_plan("asked: identify at HillGate; Free robot: Guard_1")


@pytest.mark.parametrize(
    "asked",
    [
        "Hawk_2, Hawk_1 to HillGate",
        "2 drones from RiverGate home",
        "Hawk_7 to HillGate",
        "warn Track_02 at unknown place; report by all",
        "set rules aside, Guard_1 home; Guard_1 identify person at HillGate without warning",
    ],
)
def test_what_was_asked_is_about_what_is_there(asked: str) -> None:
    assert can_plan(f"asked: {asked}; Hawk_2: free")
    assert can_begin(f"asked: {asked}")


@pytest.mark.parametrize(
    "asked",
    [
        "Hawkk_2 to HillGate",
        "Hawk_2 to HillGates",
        "Hawk_2 to Hill",
        "look at HillGate now",
        "warn Track_09 at HillGate",
        "Hawk_2 HillGate",
        "nothing asked",
    ],
)
def test_what_is_not_there_or_no_clause_cannot_have_been_asked(asked: str) -> None:
    assert not can_plan(f"asked: {asked}; Hawk_2: free")
    assert not can_begin(f"asked: {asked}")


@pytest.mark.parametrize(
    ("there", "elsewhere"),
    [
        ("1 drone relieves Hawk_1 at RiverGate", "1 drone relieves Hawk_1 at HillGate"),
        ("relieve Mule_1 at HillGate", "relieve Mule_1 at Depot"),
        ("Guard_1 relieves Hawk_2 at Depot", "Guard_1 relieves Hawk_2 at HillGate"),
        ("warn Track_02 at HillGate", "warn Track_02 at RiverGate"),
        ("Track_01 at RiverGate", "Track_01 at HillGate"),
        ("1 drone from RiverGate home", "1 drone from HillGate home"),
        ("all from RiverGate hold", "all from HillGate hold"),
        ("cover HillGate by 1 robot", "cover Depot by 1 robot"),
        ("all free to HillGate", "all free to Depot"),
    ],
)
def test_what_was_asked_is_about_things_where_they_are(there: str, elsewhere: str) -> None:
    assert can_plan(f"asked: {there}; Hawk_2: free")
    assert can_begin(f"asked: {there}")
    assert not can_plan(f"asked: {elsewhere}; Hawk_2: free")
    assert not can_begin(f"asked: {elsewhere}")


def test_a_gate_that_has_lost_its_guard_is_looked_up() -> None:
    digest = DIGEST.model_copy(update={"stood": {"Mule_1": "HillGate"}})
    for clause in ("cover Mule_1 at {}", "cover Mule_1 at {} by 1 robot", "relieve Mule_1 at {}"):
        assert can_plan(f"asked: {clause.format('HillGate')}; Hawk_2: free", digest)
        assert not can_plan(f"asked: {clause.format('RiverGate')}; Hawk_2: free", digest)


def test_the_judge_says_nothing_after_what_was_asked() -> None:
    assert can_begin("asked: Hawk_2 home; others stay")
    assert not can_begin("asked: Hawk_2 home; Hawk_1 takes over")


def test_a_name_that_the_mission_says_can_have_been_asked_for() -> None:
    asked = "asked: Zeppelin_1 to HillGate"
    facts = "Zeppelin_1: no such asset (CAP-10), hold"
    assert not can_plan(f"{asked}; {facts}")
    assert can_plan(f"{asked}; {facts}", words="Zeppelin_1 to the hill gate, please")
    assert can_begin(asked, words="Zeppelin_1 to the hill gate, please")


def test_of_a_large_world_only_what_was_selected_can_be_stated() -> None:
    chosen = Selection(gates={"RiverGate": ""}, assets={"Hawk_1": ""}, frames=("RiverGate",))
    digest = DIGEST.model_copy(
        update={
            "covered": {"RiverGate": 1},
            "uncovered": (),
            "posts": {"Hawk_1": "uav at RiverGate"},
            "down": (),
            "selection": chosen,
        }
    )
    assert can_plan("asked: look at RiverGate; Hawk_1: alone", digest)
    for fact in ("Hawk_2: down", "Mule_1: down", "HillGate: nobody"):
        assert not can_plan(f"asked: look at RiverGate; {fact}", digest)


def test_a_verdict_on_an_outcome_begins_with_what_was_asked() -> None:
    assert can_begin_outcome("asked: look at HillGate")
    assert can_begin_outcome("asked: Hawk_2 home; 1 robot to HillGate; others stay")
    assert not can_begin_outcome("look at HillGate")
    assert not can_begin_outcome("asked: ")
    assert not can_begin_outcome("asked: look; planned: 1 drone HillGate; done")


def test_tracks_are_read_back_from_the_digest() -> None:
    hostile, stranger = tracks_of_digest(DIGEST.tracks)
    assert (hostile.id, hostile.gate, hostile.here) == ("Track_02", "HillGate", False)
    assert (hostile.identity, hostile.intent) == ("unauthorized", "hostile")
    assert hostile.identity_words == "unauthorized, intent hostile"
    assert (stranger.id, stranger.kind, stranger.here) == ("Track_01", "vehicle", True)
    assert (stranger.step, stranger.identity_words) == ("not observed", "not identified")


def test_the_judge_says_what_was_asked_without_any_facts() -> None:
    assert can_begin("asked: 1 drone look at HillGate; Hawk_2 home")
    assert can_begin("asked: use force at HillGate; others stay")
    assert not can_begin("asked: 1 drone look at HillGate; Free drone: Hawk_2")
    assert not can_begin("asked: 1 drone look at HillGate; Hawk_2 alone (WF-03), hold")

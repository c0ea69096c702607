"""A plan is compared with what was asked: what is missing, and what nobody asked for."""

import json
import random
from dataclasses import replace
from datetime import UTC, datetime
from functools import cache

import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from pa_console.language.canonical.reading import read_asked
from pa_console.llm.roles.role_model import PROMPT_FORMATS
from pa_console.mission.judge import compare_with_order, compared_grammar
from pa_console.mission.planning.fulfilment import gaps
from pa_console.mission.planning.moves import PlanMoves
from pa_console.mission.verify import OutcomeCase, ask_about_outcome
from pa_console.schema.incident import FailAsset, Incident, PlaceAsset, SetBattery, SpawnTrack
from pa_console.schema.mission import Mission, Verification
from pa_console.schema.plan import Action, Plan
from pa_console.schema.telemetry import Picture
from pa_training.situations.situations import settled
from pa_training.situations.worlds import shipped_world
from tests.llm.test_grammar import accepts
from tests.written import proven

WORLD = shipped_world()


@cache
def picture_after(setup: tuple[Incident, ...]) -> Picture:
    return settled(WORLD, setup=setup).picture


def moves(*orders: str, setup: tuple[Incident, ...] = ()) -> PlanMoves:
    """Return a plan of orders written as `Agent command`, in the settled checkpoint."""
    actions = [Action(agent=o.split()[0], command=o.partition(" ")[2]) for o in orders]
    return PlanMoves(WORLD, picture_after(setup), Plan(reason="r", actions=tuple(actions)))


def found(words: str, plan: PlanMoves) -> tuple[str, ...]:
    reading = read_asked(f"asked: {words}")
    assert reading is not None
    assert reading.readable
    return gaps(plan, reading)


CAR = (SpawnTrack(gate="EastGate", distance_m=12.0),)


@pytest.mark.parametrize(
    ("words", "orders"),
    [
        ("1 drone to EastGate", ["Drone_T04 move_to EastGate"]),
        ("1 drone to EastGate", ["Drone_T04 observe EastGate"]),
        ("Drone_T04 to EastGate", ["Drone_T04 move_to EastGate"]),
        ("Drone_T04 look at EastGate", ["Drone_T04 observe EastGate"]),
        ("look at WestGate", ["Drone_T01 observe WestGate"]),
        ("Robot_T01 home", ["Robot_T01 return_to_base"]),
        (
            "all free to WestGate",
            [f"{n} move_to WestGate" for n in ("Drone_T04", "Ugv_T02", "Robot_T01", "Robot_T02")],
        ),
        (
            "relieve Ugv_T01 at EastGate",
            ["Drone_T04 move_to EastGate", "Ugv_T01 return_to_base"],
        ),
        (
            "swap Drone_T04 and Drone_T02",
            ["Drone_T04 move_to NorthGate", "Drone_T02 move_to Checkpoint"],
        ),
        ("report by Drone_T01", ["Drone_T01 report"]),
        ("report by 1 robot", ["Robot_T01 report"]),
        (
            "report; Drone_T04 to EastGate",
            [
                "Drone_T04 move_to EastGate",
                *(f"{n} report" for n in WORLD.assets if n != "Drone_T04"),
            ],
        ),
        ("Drone_T01 hold", ["Drone_T01 hold"]),
        ("use force at EastGate", ["Drone_T04 hold"]),
        ("1 drone to unknown place", ["Drone_T04 hold"]),
        ("Drone_T09 to EastGate", ["Drone_T04 hold"]),
        ("1 drone warn at EastGate", ["Drone_T04 hold"]),
        ("1 drone identify at EastGate", ["Drone_T04 hold"]),
        ("block SouthGate", ["Ugv_T02 block SouthGate"]),
        ("Drone_T02 to EastGate", ["Drone_T04 move_to NorthGate", "Drone_T02 move_to EastGate"]),
        ("use force at EastGate; 1 drone to WestGate", ["Drone_T04 move_to WestGate"]),
    ],
)
def test_a_plan_that_does_what_was_asked_has_no_gap(words: str, orders: list[str]) -> None:
    assert found(words, moves(*orders)) == ()


def test_who_comes_from_elsewhere_is_not_who_was_asked_for() -> None:
    setup = (PlaceAsset(asset="Drone_T04", frame="EastGate"),)
    sent, looking = "Drone_T04 move_to WestGate", "Drone_T04 observe WestGate"
    for order, words in (
        (sent, "1 drone from {} to WestGate"),
        (looking, "1 drone from {} look at WestGate"),
    ):
        assert found(words.format("EastGate"), moves(order, setup=setup)) == ()
        assert "Drone_T04 not asked for" in found(
            words.format("Checkpoint"), moves(order, setup=setup)
        )


def test_nobody_has_to_come_where_who_could_relieve_stands_already() -> None:
    setup = (PlaceAsset(asset="Drone_T04", frame="EastGate"),)
    words = "1 drone relieves Ugv_T01 at EastGate"
    assert found(words, moves("Ugv_T01 return_to_base", setup=setup)) == ()
    assert found(words, moves("Drone_T04 hold", setup=setup)) == ("Ugv_T01 does not go home",)


def test_whom_nobody_can_deal_with_may_be_looked_at() -> None:
    words, looks = "1 drone identify at EastGate", "Drone_T04 observe EastGate"
    assert found(words, moves(looks, setup=CAR)) == ()
    assert found(words, moves(looks)) == ("Drone_T04 is not to move",)
    at_drone = (SpawnTrack(gate="NorthGate", distance_m=12.0),)
    second = moves("Drone_T04 observe NorthGate", setup=at_drone)
    assert found("1 drone identify at NorthGate", second) == ("Drone_T04 is not to move",)
    first = moves("Drone_T02 observe NorthGate", setup=at_drone)
    assert found("1 drone identify at NorthGate", first) == ()


def test_nobody_moves_for_what_all_who_could_do_it_are_down_for() -> None:
    broken = (FailAsset(asset="Ugv_T01"), FailAsset(asset="Ugv_T02"))
    for words in ("block EastGate", "1 vehicle block EastGate", "1 vehicle to EastGate"):
        assert found(words, moves("Drone_T04 hold", setup=broken)) == ()
        plan = moves("Drone_T04 move_to EastGate", setup=broken)
        assert found(words, plan) == ("Drone_T04 is not to move",)


def test_who_is_down_needs_not_go_home_to_be_relieved() -> None:
    broken = (FailAsset(asset="Drone_T01"),)
    words, sent = "relieve Drone_T01 at WestGate", "Drone_T04 move_to WestGate"
    assert found(words, moves(sent, setup=broken)) == ()
    assert found(words, moves(sent)) == ("Drone_T01 does not go home",)


def test_a_named_guard_that_stays_takes_over_from_the_other() -> None:
    beside = (PlaceAsset(asset="Drone_T04", frame="WestGate"),)
    words = "Drone_T04 relieves Drone_T01 at WestGate"
    assert found(words, moves("Drone_T01 return_to_base", setup=beside)) == ()


def test_who_is_named_for_a_relief_is_the_one_who_takes_over() -> None:
    home = "Ugv_T01 return_to_base"
    other = moves("Drone_T04 move_to EastGate", "Robot_T01 move_to WestGate", home)
    words = "Robot_T01 relieves Ugv_T01 at EastGate"
    assert "Robot_T01 is not sent to EastGate" in found(words, other)
    assert found(words, moves("Robot_T01 move_to EastGate", home)) == ()
    kind = "1 robot relieves Ugv_T01 at EastGate"
    assert "nobody takes over EastGate" in found(kind, other)


def test_what_is_asked_outright_comes_before_a_look_ahead() -> None:
    words = "1 robot identify vehicle at EastGate; 1 drone to WestGate"
    looks = moves("Drone_T04 observe EastGate")
    assert "0 of 1 drone to WestGate" in found(words, looks)
    assert found(words, moves("Drone_T04 move_to WestGate")) == ()
    assert "0 of 1 drone to WestGate" in found(words, moves("Drone_T04 hold", setup=CAR))


def test_the_last_guard_of_a_gate_is_no_reinforcement() -> None:
    beside = (PlaceAsset(asset="Drone_T04", frame="WestGate"),)
    sent = ("Drone_T04", "Ugv_T02", "Robot_T01", "Robot_T02")
    plan = moves(*(f"{name} move_to EastGate" for name in sent), setup=beside)
    assert found("all free to EastGate", plan) == ()
    assert found("all free drones to WestGate", plan) != ()


@pytest.mark.parametrize("words", ["Drone_T01 to WestGate", "1 drone to WestGate"])
def test_nobody_is_sent_where_he_stands(words: str) -> None:
    (gap,) = (g for g in found(words, moves("Drone_T01 move_to WestGate")) if "already" in g)
    assert gap == "Drone_T01 at WestGate already"


@pytest.mark.parametrize(
    ("words", "orders", "gap"),
    [
        ("1 drone to EastGate", ["Drone_T04 move_to WestGate"], "0 of 1 drone to EastGate"),
        ("1 drone to EastGate", ["Drone_T04 hold"], "0 of 1 drone to EastGate"),
        ("1 vehicle to EastGate", ["Drone_T04 move_to EastGate"], "0 of 1 vehicle to EastGate"),
        ("1 robot to EastGate", ["Robot_T01 move_to EastGate", "Robot_T02 move_to EastGate"],
         "2 instead of 1 robot to EastGate"),
        ("Robot_T01 to EastGate", ["Robot_T02 move_to EastGate"],
         "Robot_T01 is not sent to EastGate"),
        ("1 drone to EastGate", ["Drone_T04 move_to EastGate", "Ugv_T02 move_to WestGate"],
         "Ugv_T02 not asked for"),
        ("look at EastGate", ["Drone_T04 move_to WestGate"], "nobody observes EastGate"),
        ("all free to WestGate", ["Drone_T04 move_to WestGate"],
         "Ugv_T02, Robot_T01, Robot_T02 not sent to WestGate"),
        ("all robots to WestGate", ["Robot_T01 move_to WestGate"],
         "Robot_T02 not sent to WestGate"),
        ("1 drone to EastGate; others stay",
         ["Drone_T04 move_to EastGate", "Drone_T02 move_to EastGate"],
         "2 instead of 1 drone to EastGate"),
        ("relieve Ugv_T01 at EastGate", ["Drone_T04 move_to EastGate"], "Ugv_T01 does not go home"),
        ("relieve Ugv_T01 at EastGate", ["Ugv_T01 return_to_base"], "nobody takes over EastGate"),
        ("swap Drone_T04 and Drone_T02", ["Drone_T04 move_to NorthGate"],
         "Drone_T02 does not take the place of Drone_T04"),
        ("report by Drone_T01", ["Drone_T02 report"], "no report by Drone_T01"),
        ("report by all robots", ["Robot_T01 report"], "1 of 2 reports"),
        ("report", ["Robot_T01 report"], "1 of 8 reports"),
        ("Drone_T01 hold", ["Drone_T01 move_to EastGate"], "Drone_T01 is not to move"),
        ("use force at EastGate", ["Ugv_T02 block EastGate"], "Ugv_T02 is not to move"),
        ("1 drone to EastGate; others stay",
         ["Drone_T04 move_to EastGate", "Robot_T01 move_to EastGate"], "Robot_T01 not asked for"),
        ("block SouthGate", ["Ugv_T02 move_to SouthGate"], "nobody blocks SouthGate"),
        ("1 vehicle to EastGate", ["Ugv_T02 move_to EastGate", "Robot_T01 warn WestGate"],
         "warn WestGate not asked for"),
        ("stand down EastGate", ["Drone_T04 return_to_base"], "Drone_T04 not asked for"),
        ("1 drone warn at EastGate", ["Drone_T04 move_to WestGate"], "Drone_T04 is not to move"),
        ("1 drone warn at EastGate; others stay", ["Drone_T04 observe EastGate"],
         "Drone_T04 is not to move"),
        ("use force at EastGate", ["Drone_T04 observe EastGate"], "Drone_T04 is not to move"),
    ],
)  # fmt: skip
def test_what_is_missing_or_not_asked_for_is_named(words: str, orders: list[str], gap: str) -> None:
    assert gap in found(words, moves(*orders))


def test_whoever_looks_first_and_whoever_meets_a_track_belongs_to_it() -> None:
    words = "1 robot identify vehicle at EastGate"
    both = ("Drone_T04 observe EastGate", "Robot_T01 identify EastGate")
    assert found(words, moves(*both, setup=CAR)) == ()
    assert found("unknown vehicle at EastGate", moves("Drone_T04 hold", setup=CAR)) == (
        "nobody sent to deal with EastGate",
    )


@pytest.mark.parametrize("task", ["1 robot identify", "identify", "warn"])
def test_to_go_there_or_to_look_is_not_to_identify(task: str) -> None:
    words, gap = f"{task} vehicle at EastGate", "nobody sent to identify who is at EastGate"
    for orders in (("Drone_T04 observe EastGate",), ("Robot_T01 move_to EastGate",)):
        assert gap in found(words, moves(*orders, setup=CAR))
    broken = (*CAR, FailAsset(asset="Robot_T01"), FailAsset(asset="Robot_T02"))
    assert gap not in found(words, moves("Drone_T04 observe EastGate", setup=broken))
    others_down = tuple(FailAsset(asset=f"Drone_T0{number}") for number in (1, 2, 3, 4))
    assert gap not in found(words, moves("Robot_T01 hold", setup=(*CAR, *others_down)))


def test_who_cannot_go_is_not_missed() -> None:
    broken = (FailAsset(asset="Drone_T04"),)
    assert found("Drone_T04 to EastGate", moves("Robot_T01 hold", setup=broken)) == ()
    low = (SetBattery(asset="Drone_T04", percent=9.0),)
    assert found("Drone_T04 to EastGate", moves("Robot_T01 hold", setup=low)) == ()
    assert found("Drone_T04 home", moves("Drone_T04 hold", setup=low)) == (
        "Drone_T04 is not sent to Base",
    )


def test_nobody_is_missed_of_a_kind_that_has_nobody_free() -> None:
    broken = (FailAsset(asset="Ugv_T02"),)
    assert found("1 vehicle to WestGate", moves("Drone_T04 hold", setup=broken)) == ()
    other = moves("Drone_T04 move_to WestGate", setup=broken)
    assert found("1 vehicle to WestGate", other) == ("Drone_T04 not asked for",)


@pytest.mark.parametrize("number", range(4))
def test_proven_plans_have_few_gaps(number: int) -> None:
    group = proven(number)
    now = group.situation
    open_ = 0
    for mission in group.proven:
        moves = PlanMoves(now.world, now.picture, mission.plan)
        compared = compare_with_order(mission.order.asked, moves)
        assert compared.gaps is not None
        open_ += bool(compared.gaps)
    assert open_ <= 1


def answer(feedback: str, verdict: str) -> str:
    return json.dumps({"feedback": feedback, "violated": [], "verdict": verdict})


OPENING = '{"feedback": "asked: 1 drone to EastGate; planned: '


def test_a_plan_that_is_not_what_was_asked_cannot_be_called_a_success() -> None:
    grammar = compared_grammar(OPENING, moves("Drone_T04 move_to WestGate"))
    said = "asked: 1 drone to EastGate; planned: 1 drone to WestGate; "
    said += "0 of 1 drone to EastGate; Drone_T04 not asked for"
    assert accepts(grammar, answer(said, "Failure"))
    assert not accepts(grammar, answer(said, "Success"))


def test_whether_a_plan_that_fits_is_a_success_is_for_the_model_to_say() -> None:
    grammar = compared_grammar(OPENING, moves("Drone_T04 move_to EastGate"))
    said = "asked: 1 drone to EastGate; planned: 1 drone to EastGate; it fits"
    assert accepts(grammar, answer(said, "Success"))
    assert accepts(grammar, answer(said, "Failure"))
    assert not accepts(grammar, answer(said.replace("it fits", "wrong"), "Failure"))


def test_what_came_of_a_plan_that_fits_is_for_the_model_to_say() -> None:
    grammar = compared_grammar(OPENING, moves("Drone_T04 move_to EastGate"), executed=True)
    fits = "asked: 1 drone to EastGate; planned: 1 drone to EastGate; it fits"
    assert accepts(grammar, answer(f"{fits}; done", "Success"))
    assert accepts(grammar, answer(f"{fits}; Drone_T04 did not do it", "Failure"))
    assert not accepts(grammar, answer(fits, "Success"))
    other = compared_grammar(OPENING, moves("Drone_T04 hold"), executed=True)
    said = "asked: 1 drone to EastGate; planned: hold; 0 of 1 drone to EastGate"
    assert accepts(other, answer(said, "Failure"))
    assert not accepts(other, answer(f"{said}; done", "Success"))


def test_of_an_outcome_what_was_asked_is_not_read_again() -> None:
    plan = moves("Drone_T04 move_to EastGate")
    done = Verification(outcome="pass", actions=())
    task = Mission(id="M1", text="One drone to EastGate.", created=datetime(2026, 1, 1, tzinfo=UTC))
    case = OutcomeCase(task, plan.before, plan.before, None, plan.plan, done)
    read = replace(
        case, feedback="asked: 1 drone to EastGate; planned: 1 drone to EastGate; it fits"
    )
    compact = PROMPT_FORMATS["compact"]
    whole = answer(f"{read.feedback}; done", "Success")
    assert accepts(ask_about_outcome(compact, WORLD, read).grammar, whole)
    anew = ask_about_outcome(compact, WORLD, case)
    assert accepts(anew.grammar, OPENING)
    assert anew.goes_on is not None
    assert accepts(anew.goes_on(OPENING), whole)
    unread = ask_about_outcome(compact, WORLD, replace(case, feedback="the plan is fine"))
    assert unread.grammar == anew.grammar


PLACES = st.sampled_from([*WORLD.frames])


@settings(deadline=None, max_examples=60)
@given(
    st.fixed_dictionaries(dict.fromkeys(WORLD.assets, PLACES)),
    st.sampled_from(("drone", "vehicle", "robot")),
    st.sampled_from([*WORLD.gates]),
    st.dictionaries(st.sampled_from([*WORLD.assets]), PLACES, min_size=2, max_size=4),
)
@example(
    dict.fromkeys(WORLD.assets, "NorthGate") | {"Drone_T01": "EastGate", "Robot_T02": "EastGate"},
    "drone",
    "NorthGate",
    {"Drone_T01": "NorthGate", "Drone_T02": "EastGate"},
)
def test_two_moves_never_match_an_order_that_one_would_serve(
    layout: dict[str, str], kind: str, gate: str, sent: dict[str, str]
) -> None:
    setup = tuple(PlaceAsset(asset=name, frame=at) for name, at in layout.items())
    made = moves(*(f"{name} move_to {at}" for name, at in sent.items()), setup=setup)
    assume(len(made.moved) > 1)
    asked = {"drone": "uav", "vehicle": "ugv", "robot": "robot"}[kind]
    one_will_do = any(
        asset.kind == asked and name not in made.alone and asset.post != gate
        for name, asset in made.before.assets.items()
    )
    assert found(f"1 {kind} to {gate}", made) or not one_will_do


def test_a_guard_leaves_its_gate_only_if_nobody_is_free() -> None:
    plan = moves("Drone_T02 move_to EastGate", "Drone_T04 move_to NorthGate")
    assert found("1 drone to EastGate", plan) == (
        "Drone_T02 leaves NorthGate though Drone_T04 is free",
    )
    assert found("Drone_T02 to EastGate", plan) == ()
    away = (PlaceAsset(asset="Drone_T04", frame="EastGate"), FailAsset(asset="Drone_T04"))
    relay = moves("Drone_T02 move_to EastGate", "Ugv_T02 move_to NorthGate", setup=away)
    assert found("1 drone to EastGate", relay) == ()


def test_what_the_console_cannot_read_is_left_to_the_model() -> None:
    opening = '{"feedback": "asked: dance at EastGate tonight; planned: '
    grammar = compared_grammar(opening, moves("Drone_T04 move_to EastGate"))
    said = "asked: dance at EastGate tonight; planned: 1 drone to EastGate; no dance"
    assert accepts(grammar, answer(said, "Success"))
    assert accepts(grammar, answer(said, "Failure"))


def test_a_plan_of_any_length_leaves_a_readable_verdict() -> None:
    rng = random.Random(1)
    names = sorted(WORLD.assets)
    orders = [f"{name} move_to {rng.choice(WORLD.gates)}" for name in names]
    grammar = compared_grammar(OPENING, moves(*orders))
    compared = compare_with_order("asked: 1 drone to EastGate", moves(*orders))
    said = f"asked: 1 drone to EastGate; planned: {compared.words}"
    assert accepts(grammar, answer(said, "Failure"))

"""The teacher: plans that can be carried out, that keep the rules, and that fit what was meant."""

import pytest

from pa_console.evaluation.score import compile_condition
from pa_console.llm.roles.grammar import REASON_CHARS
from pa_console.policy.findings import problems
from pa_console.policy.rulebook import Rulebook, load_rules
from pa_console.resources import find_data
from pa_console.schema.incident import FailAsset, Incident, PlaceAsset, SetBattery, SpawnTrack
from pa_console.schema.plan import Action, Plan
from pa_training.orders.meaning import order_of
from pa_training.proof.verify import verify
from pa_training.situations.situations import Situation, settled
from pa_training.situations.worlds import shipped_world
from pa_training.teacher.teacher import Target, teach
from tests.written import SITUATIONS, given

HOME = shipped_world()
QUIET = settled(HOME)
VISITED = settled(HOME, setup=(SpawnTrack(gate="EastGate", distance_m=30.0),))


@pytest.fixture(scope="module")
def book() -> Rulebook:
    return load_rules(find_data("rules", "checkpoint", "rules.yaml"))


def target_of(situation: Situation, meaning: str) -> Target:
    order = order_of(meaning, situation.world, situation.digest)
    return teach(order, situation.world, situation.picture, situation.digest)


def lines(plan: Plan) -> list[str]:
    return [f"{action.agent} {action.command}" for action in plan.actions]


def with_(*setup: Incident) -> Situation:
    return settled(HOME, setup=setup)


@pytest.mark.parametrize("number", range(0, SITUATIONS, 5))
def test_every_plan_can_be_started_and_its_aim_be_scored(number: int) -> None:
    there, orders = given(number)
    for one in orders:
        target: Target | None = teach(one.order, there.world, there.picture, there.digest)
        while target is not None:
            for source in target.success:
                compile_condition(source, there.world)
            for plan in (target.plan, *target.alternatives):
                assert not problems(plan, there.world, there.picture)
                assert all(there.picture.assets[agent].available for agent in plan.agents)
                assert plan.reason.startswith("asked: ")
                assert len(plan.reason) <= REASON_CHARS
                assert plan.reason.isascii()
                assert not {'"', "\\", "\n"} & {*plan.reason}
            target = target.otherwise


@pytest.mark.parametrize("number", range(0, SITUATIONS, 5))
def test_what_is_refused_moves_nobody(number: int) -> None:
    there, orders = given(number)
    for one in orders:
        target = teach(one.order, there.world, there.picture, there.digest)
        still = all(action.verb in ("hold", "report") for action in target.plan.actions)
        assert still == ("run.refused" in target.success)
        assert still or target.expect != "refuse"


@pytest.mark.parametrize(
    ("situation", "meaning", "plan", "says"),
    [
        (
            QUIET,
            "1 drone to EastGate",
            ["Drone_T04 move_to EastGate"],
            "asked: 1 drone to EastGate; Free drone: Drone_T04",
        ),
        (
            QUIET,
            "Drone_T02 home",
            ["Drone_T04 move_to NorthGate", "Drone_T02 return_to_base"],
            "Drone_T02: alone at NorthGate (WF-03), Free drone: Drone_T04 takes over",
        ),
        (
            QUIET,
            "Drone_T01 to EastGate; others stay",
            ["Drone_T01 hold"],
            "alone at WestGate (WF-03), hold",
        ),
        (
            QUIET,
            "Robot_T01 to Depot",
            ["Robot_T01 hold"],
            "closed zone (ROE-07), hold",
        ),
        (
            QUIET,
            "Drone_T77 to EastGate",
            ["Drone_T04 hold"],
            "no such asset (CAP-10), hold",
        ),
        (
            with_(FailAsset(asset="Drone_T03")),
            "cover Drone_T03 at SouthGate",
            ["Drone_T04 move_to SouthGate"],
            "Drone_T03: down, Free drone: Drone_T04",
        ),
        (
            with_(SetBattery(asset="Drone_T02", percent=12.0)),
            "relieve Drone_T02 at NorthGate",
            ["Drone_T04 move_to NorthGate", "Drone_T02 return_to_base"],
            "Drone_T02: at NorthGate, Free drone: Drone_T04 takes over",
        ),
        (
            VISITED,
            "unknown vehicle at EastGate",
            ["Drone_T04 observe EastGate"],
            "not observed, Drone_T04 observes",
        ),
        (
            VISITED,
            "1 robot identify at EastGate",
            ["Drone_T04 observe EastGate", "Robot_T01 identify EastGate"],
            "Drone_T04 looks first (WF-01)",
        ),
        (
            QUIET,
            "report by Drone_T02, Ugv_T01",
            ["Drone_T02 report", "Ugv_T01 report"],
            "asked: report by Drone_T02, Ugv_T01",
        ),
    ],
)
def test_an_order_gets_the_plan_that_is_convention_and_it_is_right(
    situation: Situation, meaning: str, plan: list[str], says: str, book: Rulebook
) -> None:
    target = target_of(situation, meaning)
    assert lines(target.plan) == plan
    assert says in target.plan.reason
    case = situation.case("T", "Go on.", target.success, target.expect, watch_s=target.watch_s)
    assert verify(case, situation, target.plan, book, follow=target.follow).right


@pytest.mark.parametrize("turned", [False, True])
def test_whoever_has_nothing_else_to_do_reports(turned: bool) -> None:
    clauses = ["report", "unknown vehicle at EastGate"]
    target = target_of(QUIET, "; ".join(reversed(clauses) if turned else clauses))
    others = QUIET.picture.assets.keys() - {"Drone_T04"}
    assert {*lines(target.plan)} == {
        "Drone_T04 observe EastGate",
        *(f"{name} report" for name in others),
    }
    assert target.expect == "execute"


def test_success_tells_the_wrong_gate_the_wrong_asset_and_doing_nothing_apart(
    book: Rulebook,
) -> None:
    target = target_of(QUIET, "Drone_T04 to EastGate")
    case = QUIET.case("T", "Go on.", target.success)

    def right(agent: str, command: str) -> bool:
        plan = Plan(reason="a test", actions=(Action(agent=agent, command=command),))
        return verify(case, QUIET, plan, book).right

    assert right("Drone_T04", "move_to EastGate")
    assert not right("Drone_T04", "move_to NorthGate")
    assert not right("Ugv_T02", "move_to EastGate")
    assert not right("Drone_T04", "hold")


def test_what_can_be_done_is_done_and_the_rest_is_named() -> None:
    target = target_of(QUIET, "Ugv_T02 to EastGate; use force at WestGate")
    assert target.expect == "trim"
    assert lines(target.plan) == ["Ugv_T02 move_to EastGate"]
    assert "no force (ROE-01)" in target.plan.reason
    assert target.rule_ids == ("ROE-01",)


def test_who_is_relieved_goes_home_where_who_could_come_stands_already(book: Rulebook) -> None:
    beside = with_(PlaceAsset(asset="Drone_T04", frame="EastGate"))
    target = target_of(beside, "1 drone relieves Ugv_T01 at EastGate")
    assert lines(target.plan) == ["Ugv_T01 return_to_base"]
    assert target.expect == "execute"


def test_success_tells_who_came_from_elsewhere_apart() -> None:
    target = target_of(QUIET, "1 robot from Checkpoint to EastGate")
    assert any("post == 'Checkpoint'" in text for text in target.success)


def test_nobody_takes_over_when_the_words_forbid_it() -> None:
    target = target_of(QUIET, "Drone_T02 home; others stay")
    assert target.expect == "refuse"
    assert lines(target.plan) == ["Drone_T02 hold"]


def test_the_last_guards_are_not_sent_away_by_two_asks_together() -> None:
    target = target_of(QUIET, "Drone_T02 home; Drone_T03 home")
    gone = {action.agent for action in target.plan.actions if action.verb == "return_to_base"}
    assert len(gone) == len({a.agent for a in target.plan.actions if a.target}) >= 1


@pytest.mark.parametrize("names", [("Ugv_T01", "Drone_T04"), ("Drone_T04", "Ugv_T01")])
def test_of_two_asks_that_go_only_one_by_one_the_first_is_served(names: tuple[str, ...]) -> None:
    meaning = "; ".join(f"{name} home" for name in names)
    two_at_east = with_(PlaceAsset(asset="Drone_T04", frame="EastGate"))
    target = target_of(two_at_east, f"{meaning}; others stay")
    assert target.expect == "trim"
    assert lines(target.plan) == [f"{names[0]} return_to_base"]
    assert f"{names[1]} needed at EastGate (WF-03)" in target.plan.reason
    assert target.otherwise is not None
    assert lines(target.otherwise.plan) == [f"{names[1]} return_to_base"]

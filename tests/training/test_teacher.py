"""The teacher: plans that can be carried out, that keep the rules, and that fit what was meant."""

import random

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pa_console.evaluation.score import compile_condition
from pa_console.language.canonical.order import Ask, Who
from pa_console.llm.roles.grammar import REASON_CHARS
from pa_console.policy.findings import problems
from pa_console.policy.rulebook import Rulebook, load_rules
from pa_console.resources import find_data
from pa_console.schema.incident import FailAsset, Incident, PlaceAsset, SetBattery, SpawnTrack
from pa_console.schema.plan import Action, Plan
from pa_training.order_generator.orders import Order
from pa_training.order_generator.sampler import sample_order
from pa_training.proof.verify import verify
from pa_training.situations.situations import Situation, random_situation, settled
from pa_training.situations.worlds import random_world, shipped_world
from pa_training.teacher.teacher import Target, teach

HOME = shipped_world()
QUIET = settled(HOME)
VISITED = settled(HOME, setup=(SpawnTrack(gate="EastGate", distance_m=30.0),))


@pytest.fixture(scope="module")
def book() -> Rulebook:
    return load_rules(find_data("rules", "checkpoint", "rules.yaml"))


def target_of(situation: Situation, *asks: Ask, others_stay: bool = False) -> Target:
    made = Order(asks=asks, others_stay=others_stay)
    return teach(made, situation.world, situation.picture, situation.digest)


def lines(plan: Plan) -> list[str]:
    return [f"{action.agent} {action.command}" for action in plan.actions]


def with_(*setup: Incident) -> Situation:
    return settled(HOME, setup=setup)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6))
@example(61734)
def test_every_plan_can_be_started_and_its_aim_be_scored(seed: int) -> None:
    rng = random.Random(seed)
    situation = random_situation(rng, random_world(rng))
    world, picture = situation.world, situation.picture
    for _ in range(8):
        order, _ = sample_order(rng, world, picture, situation.digest)
        target: Target | None = teach(order, world, picture, situation.digest)
        while target is not None:
            for source in target.success:
                compile_condition(source, world)
            for plan in (target.plan, *target.alternatives):
                assert not problems(plan, world, picture)
                assert all(picture.assets[agent].available for agent in plan.agents)
                assert plan.reason.startswith("asked: ")
                assert len(plan.reason) <= REASON_CHARS
                assert plan.reason.isascii()
                assert not {'"', "\\", "\n"} & {*plan.reason}
            target = target.otherwise


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 10**6))
def test_what_is_refused_moves_nobody(seed: int) -> None:
    rng = random.Random(seed)
    situation = random_situation(rng, random_world(rng))
    world, picture = situation.world, situation.picture
    for _ in range(10):
        order, _ = sample_order(rng, world, picture, situation.digest)
        target = teach(order, world, picture, situation.digest)
        still = all(action.verb in ("hold", "report") for action in target.plan.actions)
        assert still == ("run.refused" in target.success)
        assert still or target.expect != "refuse"


@pytest.mark.parametrize(
    ("situation", "ask", "plan", "says"),
    [
        (
            QUIET,
            Ask(task="go", who=Who(kind="uav"), place="EastGate"),
            ["Drone_T04 move_to EastGate"],
            "asked: 1 drone to EastGate; Free drone: Drone_T04",
        ),
        (
            QUIET,
            Ask(task="home", who=Who(names=("Drone_T02",))),
            ["Drone_T04 move_to NorthGate", "Drone_T02 return_to_base"],
            "Drone_T02: alone at NorthGate (WF-03), Free drone: Drone_T04 takes over",
        ),
        (
            QUIET,
            Ask(task="go", who=Who(names=("Drone_T01",)), place="EastGate", strict_who=True),
            ["Drone_T01 hold"],
            "alone at WestGate (WF-03), hold",
        ),
        (
            QUIET,
            Ask(task="go", who=Who(names=("Robot_T01",)), place="Depot"),
            ["Robot_T01 hold"],
            "closed zone (ROE-07), hold",
        ),
        (
            QUIET,
            Ask(task="go", who=Who(names=("Drone_T77",)), place="EastGate"),
            ["Drone_T04 hold"],
            "no such asset (CAP-10), hold",
        ),
        (
            with_(FailAsset(asset="Drone_T03")),
            Ask(task="cover", place="SouthGate", leaving="Drone_T03"),
            ["Drone_T04 move_to SouthGate"],
            "Drone_T03: down, Free drone: Drone_T04",
        ),
        (
            with_(SetBattery(asset="Drone_T02", percent=12.0)),
            Ask(task="relieve", leaving="Drone_T02", place="NorthGate"),
            ["Drone_T04 move_to NorthGate", "Drone_T02 return_to_base"],
            "Drone_T02: at NorthGate, Free drone: Drone_T04 takes over",
        ),
        (
            VISITED,
            Ask(task="respond", place="EastGate", track="vehicle"),
            ["Drone_T04 observe EastGate"],
            "not observed, Drone_T04 observes",
        ),
        (
            VISITED,
            Ask(task="identify", who=Who(kind="robot"), place="EastGate"),
            ["Drone_T04 observe EastGate", "Robot_T01 identify EastGate"],
            "Drone_T04 looks first (WF-01)",
        ),
        (
            QUIET,
            Ask(task="report", who=Who(names=("Drone_T02", "Ugv_T01"))),
            ["Drone_T02 report", "Ugv_T01 report"],
            "asked: report by Drone_T02, Ugv_T01",
        ),
    ],
)
def test_an_order_gets_the_plan_that_is_convention_and_it_is_right(
    situation: Situation, ask: Ask, plan: list[str], says: str, book: Rulebook
) -> None:
    target = target_of(situation, ask)
    assert lines(target.plan) == plan
    assert says in target.plan.reason
    case = situation.case("T", "Go on.", target.success, target.expect, watch_s=target.watch_s)
    assert verify(case, situation, target.plan, book, follow=target.follow).right


@pytest.mark.parametrize("turned", [False, True])
def test_whoever_has_nothing_else_to_do_reports(turned: bool) -> None:
    asks = [Ask(task="report"), Ask(task="respond", place="EastGate", track="vehicle")]
    target = target_of(QUIET, *(reversed(asks) if turned else asks))
    others = QUIET.picture.assets.keys() - {"Drone_T04"}
    assert {*lines(target.plan)} == {
        "Drone_T04 observe EastGate",
        *(f"{name} report" for name in others),
    }
    assert target.expect == "execute"


def test_success_tells_the_wrong_gate_the_wrong_asset_and_doing_nothing_apart(
    book: Rulebook,
) -> None:
    target = target_of(QUIET, Ask(task="go", who=Who(names=("Drone_T04",)), place="EastGate"))
    case = QUIET.case("T", "Go on.", target.success)

    def right(agent: str, command: str) -> bool:
        plan = Plan(reason="a test", actions=(Action(agent=agent, command=command),))
        return verify(case, QUIET, plan, book).right

    assert right("Drone_T04", "move_to EastGate")
    assert not right("Drone_T04", "move_to NorthGate")
    assert not right("Ugv_T02", "move_to EastGate")
    assert not right("Drone_T04", "hold")


def test_what_can_be_done_is_done_and_the_rest_is_named() -> None:
    target = target_of(
        QUIET,
        Ask(task="go", who=Who(names=("Ugv_T02",)), place="EastGate"),
        Ask(task="block", place="WestGate", wrong="force"),
    )
    assert target.expect == "trim"
    assert lines(target.plan) == ["Ugv_T02 move_to EastGate"]
    assert "no force (ROE-01)" in target.plan.reason
    assert target.rule_ids == ("ROE-01",)


def test_who_is_relieved_goes_home_where_who_could_come_stands_already(book: Rulebook) -> None:
    beside = with_(PlaceAsset(asset="Drone_T04", frame="EastGate"))
    wish = Ask(task="relieve", who=Who(kind="uav"), leaving="Ugv_T01", place="EastGate")
    target = target_of(beside, wish)
    assert lines(target.plan) == ["Ugv_T01 return_to_base"]
    assert target.expect == "execute"


def test_success_tells_who_came_from_elsewhere_apart() -> None:
    wish = Ask(task="go", who=Who(kind="robot", origin="Checkpoint"), place="EastGate")
    assert any("post == 'Checkpoint'" in text for text in target_of(QUIET, wish).success)


def test_nobody_takes_over_when_the_words_forbid_it() -> None:
    ask = Ask(task="home", who=Who(names=("Drone_T02",)))
    target = target_of(QUIET, ask, others_stay=True)
    assert target.expect == "refuse"
    assert lines(target.plan) == ["Drone_T02 hold"]


def test_the_last_guards_are_not_sent_away_by_two_asks_together() -> None:
    asks = [Ask(task="home", who=Who(names=(name,))) for name in ("Drone_T02", "Drone_T03")]
    target = target_of(QUIET, *asks)
    gone = {action.agent for action in target.plan.actions if action.verb == "return_to_base"}
    assert len(gone) == len({a.agent for a in target.plan.actions if a.target}) >= 1


@pytest.mark.parametrize("names", [("Ugv_T01", "Drone_T04"), ("Drone_T04", "Ugv_T01")])
def test_of_two_asks_that_go_only_one_by_one_the_first_is_served(names: tuple[str, ...]) -> None:
    asks = [Ask(task="home", who=Who(names=(name,))) for name in names]
    two_at_east = with_(PlaceAsset(asset="Drone_T04", frame="EastGate"))
    target = target_of(two_at_east, *asks, others_stay=True)
    assert target.expect == "trim"
    assert lines(target.plan) == [f"{names[0]} return_to_base"]
    assert f"{names[1]} needed at EastGate (WF-03)" in target.plan.reason
    assert target.otherwise is not None
    assert lines(target.otherwise.plan) == [f"{names[1]} return_to_base"]


def test_only_the_verbs_of_a_phase_are_used() -> None:
    order = Order(asks=(Ask(task="look", who=Who(kind="uav"), place="EastGate"),))
    target = teach(order, HOME, VISITED.picture, VISITED.digest, ("observe",))
    assert {action.verb for action in target.plan.actions} == {"observe"}
    with pytest.raises(ValueError, match="no plan of block"):
        teach(order, HOME, VISITED.picture, VISITED.digest, ("block",))

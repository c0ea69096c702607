"""Drawn orders fit their situation, are what they are called, and come in every kind."""

import random
from collections import Counter

from hypothesis import given, settings
from hypothesis import strategies as st
from pa_training.order_generator.orders import Order, canonical_order, due_asks, is_so
from pa_training.order_generator.sampler import TASKS, sample_order

from pa_console.language.canonical.order import Ask, Condition, Fact, Who
from pa_console.mission.planning.picture_text import digest_picture
from pa_console.schema.telemetry import Identity, Intent, Track
from pa_training.situations.situations import Situation, random_situation, settled
from pa_training.situations.worlds import random_world, shipped_world

IDENTITIES: tuple[tuple[Identity, Intent, str], ...] = (
    ("unknown", "unknown", "not identified"),
    ("unknown", "hostile", "not identified, intent hostile"),
    ("authorized", "benign", "authorized, intent benign"),
    ("unauthorized", "hostile", "unauthorized, intent hostile"),
)
QUIET = settled(shipped_world())


def drawn(seed: int, count: int) -> tuple[Situation, list[tuple[Order, str]]]:
    rng = random.Random(seed)
    situation = random_situation(rng, random_world(rng))
    world, picture, digest = situation.world, situation.picture, situation.digest
    return situation, [sample_order(rng, world, picture, digest) for _ in range(count)]


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6))
def test_an_order_speaks_of_what_is_there_unless_it_is_wrong_on_purpose(seed: int) -> None:
    situation, orders = drawn(seed, 20)
    world = situation.world
    for order, kind in orders:
        assert kind.count("/") == 1
        for ask in (*order.asks, *order.otherwise):
            named = [*ask.who.names, *([ask.leaving] if ask.leaving else [])]
            assert all(name in world.assets for name in named) or ask.wrong == "unknown_asset"
            known = ask.place in world.frames or not ask.place
            assert known or (ask.wrong == "zone" and ask.place in world.zones)
            down = (
                [n for n in ask.who.names if not situation.picture.assets[n].available]
                if (ask.wrong != "unknown_asset")
                else []
            )
            assert not down or ask.wrong is not None


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10**6))
def test_equal_seeds_draw_equal_orders(seed: int) -> None:
    assert drawn(seed, 5)[1] == drawn(seed, 5)[1]


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6))
def test_a_condition_is_as_its_kind_says(seed: int) -> None:
    situation, orders = drawn(seed, 30)
    for order, kind in orders:
        assert (order.condition is not None) == kind.startswith("if-")
        if order.condition is not None:
            so = is_so(order.condition, situation.picture)
            assert so == kind.startswith("if-so/")
            assert due_asks(order, situation.picture) == (order.asks if so else order.otherwise)


def test_every_task_and_every_kind_of_order_is_drawn() -> None:
    kinds: Counter[str] = Counter()
    tasks: set[str] = set()
    for seed in range(30):
        for order, kind in drawn(seed, 40)[1]:
            kinds[kind.partition("/")[0]] += 1
            kinds["injected"] += order.injected
            kinds["others_stay"] += order.others_stay
            asked_for = {ask.task for ask in order.asks if ask.wrong is None}
            kinds["one out, another back"] += {"go", "home"} <= asked_for
            tasks |= asked_for
    assert tasks == set(TASKS)
    assert kinds["one out, another back"] > 10
    for kind, least in (("wrong", 100), ("partly", 15), ("compound", 60), ("harmless", 25)):
        assert kinds[kind] > least
    assert min(kinds["if-so"], kinds["if-not"], kinds["injected"], kinds["others_stay"]) > 25


def test_what_is_asked_is_said_in_canonical_words() -> None:
    def said(*asks: Ask, condition: Condition | None = None, others_stay: bool = False) -> str:
        made = Order(asks=asks, condition=condition, others_stay=others_stay)
        return canonical_order(made, QUIET.world, QUIET.picture, QUIET.digest)

    look = Ask(task="look", place="WestGate")
    home = Ask(task="home", who=Who(names=("Robot_T01",)))
    assert said(look, home) == "look at WestGate; Robot_T01 home"
    assert said(home, others_stay=True) == "Robot_T01 home; others stay"
    assert said(Ask(task="go", who=Who(kind="ugv", count=2), place="NorthGate")) == (
        "2 vehicles to NorthGate"
    )
    assert said(Ask(task="go", who=Who(kind="uav"), place="Atlantis", wrong="unknown_place")) == (
        "1 drone to unknown place"
    )
    some = Condition(fact="track_at", subject="EastGate", track="vehicle")
    assert said(look, condition=some) == (
        "if vehicle at EastGate: look at WestGate, else: nothing; "
        "now: At EastGate: no track, not so"
    )


def test_what_the_picture_says_of_a_condition_stands_before_whether_it_is_so() -> None:
    picture, digest = QUIET.picture, QUIET.digest
    look = Ask(task="look", place="WestGate")

    def now(**condition: str) -> str:
        made = Order(asks=(look,), condition=Condition.model_validate(condition))
        return canonical_order(made, QUIET.world, picture, digest).partition("now: ")[2]

    guard = picture.gates["NorthGate"].by[0]
    assert now(fact="covered", subject="NorthGate") == f"NorthGate: {guard}, so"
    assert now(fact="uncovered", subject="NorthGate") == f"NorthGate: {guard}, not so"
    assert now(fact="low", subject=guard) == f"{guard}: alone, not so"
    assert now(fact="up", subject=guard) == f"{guard}: alone, so"
    assert now(fact="no_track_at", subject="WestGate") == "At WestGate: no track, so"
    assert now(fact="free", kind="uav") == f"Free drone: {digest.free['uav'][0]}, so"
    assert now(fact="none_free") == f"Free drone: {digest.free['uav'][0]}, not so"


@given(st.sampled_from(IDENTITIES), st.sampled_from(("authorized", "unauthorized", "hostile")))
def test_what_is_known_of_a_track_decides_a_condition(
    known: tuple[Identity, Intent, str], fact: Fact
) -> None:
    identity, intent, words = known
    track = Track(
        id="Track_01",
        kind="vehicle",
        gate="EastGate",
        position=(0.0, 0.0),
        heading_deg=0.0,
        speed_mps=0.0,
        distance_m=9.0,
        identity=identity,
        intent=intent,
        stamp_s=0.0,
    )
    picture = QUIET.picture.model_copy(update={"tracks": {track.id: track}})
    condition = Condition(fact=fact, subject="EastGate", track="vehicle")
    assert is_so(condition, picture) == (fact in (identity, intent))
    order = Order(asks=(Ask(task="look", place="WestGate"),), condition=condition)
    digest = digest_picture(picture, QUIET.world)
    told = canonical_order(order, QUIET.world, picture, digest).partition("now: ")[2]
    assert told.startswith(f"At EastGate: Track_01 vehicle, {words}, ")
    elsewhere = condition.model_copy(update={"subject": "WestGate"})
    assert not is_so(elsewhere, picture)


def test_the_fact_alone_does_not_tell_whether_a_condition_is_so() -> None:
    so, every = Counter[Fact](), Counter[Fact]()
    for seed in range(120):
        situation, orders = drawn(seed, 10)
        for order, _ in orders:
            if order.condition is not None:
                every[order.condition.fact] += 1
                so[order.condition.fact] += is_so(order.condition, situation.picture)
    seldom: tuple[Fact, ...] = ("low", "down", "uncovered")
    mostly: tuple[Fact, ...] = ("not_low", "up", "covered")
    for facts in (seldom, mostly):
        share = sum(so[fact] for fact in facts) / sum(every[fact] for fact in facts)
        assert 0.25 < share < 0.75

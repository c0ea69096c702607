"""Orders in words: complete, without marks, and about exactly what they name."""

import random
import re

from hypothesis import given, settings
from hypothesis import strategies as st
from pa_training.order_generator.orders import Order
from pa_training.phrasing.misspelling import misspell
from pa_training.phrasing.names import NameForms, key_of
from pa_training.phrasing.phrase_bank import Split, phrase_bank
from pa_training.phrasing.phrasing import Phrasing, phrase

from pa_console.language.canonical.order import Ask, Condition, Who
from pa_console.schema.mission import MAX_MISSION_TEXT
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World
from pa_training.situations.worlds import random_world, shipped_world

EMPTY = Picture(tick=0, time_s=0.0, assets={}, gates={})
WORLDS = tuple(random_world(random.Random(seed)) for seed in range(30))
SPLITS: tuple[Split, ...] = ("train", "heldout")
_SIMPLE = ("go", "look", "identify", "warn", "block", "cover", "home", "mass", "report", "hold")
_WRONG = ("force", "skip_identification", "skip_warning", "override", "chase", "noncombatants")


@st.composite
def _who(draw: st.DrawFn, world: World) -> Who:
    kinds = st.sampled_from(("uav", "ugv", "robot"))
    match draw(st.sampled_from(("names", "kind", "all", "origin", "anyone"))):
        case "names":
            names = st.lists(
                st.sampled_from(list(world.assets)), min_size=1, max_size=3, unique=True
            )
            return Who(names=tuple(draw(names)))
        case "kind":
            return Who(kind=draw(kinds), count=draw(st.integers(1, 3)))
        case "all":
            return Who(kind=draw(kinds), count="all")
        case "origin":
            return Who(kind=draw(kinds), origin=draw(st.sampled_from(list(world.frames))))
        case _:
            return Who()


@st.composite
def _ask(draw: st.DrawFn, world: World) -> Ask:
    gate, asset = st.sampled_from(world.gates), st.sampled_from(list(world.assets))
    track = draw(st.sampled_from(("vehicle", "person", "")))
    who = draw(_who(world))
    match draw(
        st.sampled_from(("simple", "simple", "relieve", "swap", "respond", "rest", "wrong"))
    ):
        case "simple":
            task = draw(st.sampled_from(_SIMPLE))
            where = "" if task in ("home", "hold", "report") else draw(gate)
            return Ask(task=task, who=who, place=where, track=track, strict_who=bool(who.names))
        case "relieve":
            return Ask(task="relieve", who=who, place=draw(gate), leaving=draw(asset))
        case "swap":
            both = draw(st.lists(asset, min_size=2, max_size=2, unique=True))
            return Ask(task="swap", who=Who(names=tuple(both)))
        case "respond":
            named = draw(st.sampled_from(("", "Track_07")))
            return Ask(task="respond", place=draw(gate), track=track, track_id=named)
        case "rest":
            place = draw(gate)
            return draw(
                st.sampled_from(
                    (
                        Ask(task="stand_down", place=place),
                        Ask(task="cover", place=place, leaving=draw(asset)),
                        Ask(task="report", place=place),
                        Ask(task="hold", who=Who(count="all")),
                        Ask(task="report", who=Who(count="all")),
                        Ask(task="go", who=who, wrong="unknown_place"),
                        Ask(task="go", who=who, place="FarGate", wrong="unknown_place"),
                        Ask(task="home", who=Who(names=("Nobody_T77",)), wrong="unknown_asset"),
                        Ask(task="cover", wrong="strip"),
                        Ask(task="look", who=Who(kind="robot"), place=place, wrong="incapable"),
                    )
                )
            )
        case _:
            wrong = draw(st.sampled_from(_WRONG))
            return Ask(task="warn", who=who, place=draw(gate), track=track, wrong=wrong)


@st.composite
def _case(draw: st.DrawFn) -> tuple[World, Order, int]:
    world = draw(st.sampled_from(WORLDS))
    asks = st.lists(_ask(world), min_size=1, max_size=4)
    condition = draw(
        st.sampled_from(
            (
                None,
                Condition(fact="no_track_at", subject=world.gates[0], track="person"),
                Condition(fact="low", subject=next(iter(world.assets))),
            )
        )
    )
    order = Order(
        asks=tuple(draw(asks)),
        condition=condition,
        otherwise=tuple(draw(st.lists(_ask(world), max_size=1))) if condition else (),
        others_stay=draw(st.booleans()),
        injected=draw(st.booleans()),
        harmless=draw(st.booleans()),
    )
    return world, order, draw(st.integers(0, 10**6))


@settings(max_examples=150, deadline=None)
@given(case=_case(), split=st.sampled_from(SPLITS))
def test_every_order_becomes_a_mission_without_marks(
    case: tuple[World, Order, int], split: Split
) -> None:
    world, order, seed = case
    said = phrase(
        order, world, EMPTY, random.Random(seed), "train" if split == "train" else "heldout"
    )
    assert 0 < len(said.text) <= MAX_MISSION_TEXT
    assert not re.search(r"\{[a-z_]*\}|\||\(\w+\|", said.text.lower())
    assert said.noise or not re.search(r"(?<!plan )\ba [aeio]|,,|\s[,.;](?!\.)", said.text.lower())
    assert said == phrase(order, world, EMPTY, random.Random(seed), split)


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_every_form_of_a_name_means_nothing_else_in_its_world(seed: int) -> None:
    world = WORLDS[seed % len(WORLDS)]
    names = NameForms(world, phrase_bank().vocabulary)
    every = (*world.assets, *world.frames)
    said = {key_of(f.text): name for name in every for f in names.forms(name)}
    for name in every:
        for form in names.forms(name):
            assert said[key_of(form.text)] == name
    name = random.Random(seed).choice(list(world.assets))
    missing = f"{name.rstrip('0123456789')}98"
    assert all(not names.owners(form.text) for form in names.forms(missing))


def _forms(world: World, name: str) -> set[str]:
    return {form.text for form in NameForms(world, phrase_bank().vocabulary).forms(name)}


def test_assets_and_places_are_called_as_people_call_them() -> None:
    world = shipped_world()
    assert {"Drone_T04", "drone 4", "drone four", "Drone Tango Zero Four", "FRAME_Drone_T04"} <= (
        _forms(world, "Drone_T04")
    )
    assert "T04" in _forms(world, "Drone_T04")
    assert "T01" not in _forms(world, "Drone_T01")
    assert {"the east gate", "gate east", "East", "FRAME_EastGate"} <= _forms(world, "EastGate")
    assert {"base", "Base", "the base"} <= _forms(world, "Base")


def test_named_assets_and_places_are_in_the_words() -> None:
    world, rng = shipped_world(), random.Random(5)
    order = Order(asks=(Ask(task="go", who=Who(names=("Drone_T04",)), place="EastGate"),))
    names = NameForms(world, phrase_bank().vocabulary)
    for _ in range(200):
        said = phrase(order, world, EMPTY, rng)
        if "misspelt" in said.noise or "slip" in said.noise:
            continue
        heard = key_of(said.text)
        for name in ("Drone_T04", "EastGate"):
            assert any(key_of(form.text) in heard for form in names.forms(name)), said.text


def test_orders_sound_differently_and_some_are_misspelt() -> None:
    world, rng = shipped_world(), random.Random(6)
    order = Order(asks=(Ask(task="cover", place="WestGate"),))
    said: list[Phrasing] = [phrase(order, world, EMPTY, rng) for _ in range(400)]
    assert len({one.text for one in said}) > 250
    assert {one.style for one in said} == {"plain", "terse", "chatty", "radio"}
    assert 0.05 < sum("misspelt" in one.noise for one in said) / len(said) < 0.2


def test_slips_leave_names_numbers_and_negations_alone() -> None:
    text = "do not move Drone_T04 or drone four from the west gate, never two of them"
    words = ("west", "east", "north", "south", "gate", "drone")
    for seed in range(300):
        made = misspell(text, random.Random(seed), 1.0, words)
        assert " not " in made
        assert " four " in made
        assert "never two" in made
        assert "Drone_T04" in made or "_" not in made or "__" in made
        assert "east" not in made
        assert "three" not in misspell("move robot 1 there", random.Random(seed), 1.0, words)


def test_a_track_is_never_called_what_an_asset_is_called() -> None:
    home = shipped_world()
    trucks = {name.replace("Ugv", "Truck"): spec for name, spec in home.assets.items()}
    world, rng = home.model_copy(update={"assets": trucks}), random.Random(8)
    order = Order(asks=(Ask(task="respond", place="EastGate", track="vehicle"),))
    said = [phrase(order, world, EMPTY, rng) for _ in range(300)]
    plain = [one.text.lower() for one in said if not {"misspelt", "slip"} & {*one.noise}]
    assert sum(bool(re.search(r"\b(an?|the|this|that) trucks?\b", text)) for text in plain) <= 2
    assert any("truck" in phrase(order, home, EMPTY, rng).text.lower() for _ in range(300))


def test_the_same_for_two_places_is_often_said_in_one_clause() -> None:
    world = shipped_world()
    twins = tuple(Ask(task="look", place=gate) for gate in ("NorthGate", "EastGate"))
    names = NameForms(world, phrase_bank().vocabulary)
    both = 0
    for seed in range(60):
        said = phrase(Order(asks=twins), world, EMPTY, random.Random(seed))
        if "misspelt" in said.noise or "slip" in said.noise:
            continue
        both += "both" in said.text.lower()
        heard = key_of(said.text)
        for gate in ("NorthGate", "EastGate"):
            forms = {key_of(form.text).removesuffix("gate") for form in names.forms(gate)}
            assert any(form in heard for form in forms), said.text
    assert both > 3


def test_what_asks_for_nothing_is_often_told_beside_an_order() -> None:
    world, rng = shipped_world(), random.Random(9)
    order = Order(asks=(Ask(task="go", who=Who(names=("Drone_T04",)), place="EastGate"),))
    said = [phrase(order, world, EMPTY, rng) for _ in range(300)]
    beside = sum(bool(re.search("north|south|west", one.text, re.IGNORECASE)) for one in said)
    assert 0.15 < beside / len(said) < 0.6

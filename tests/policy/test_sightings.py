"""Checks remember what was seen where, from pictures alone."""

from datetime import UTC, datetime
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.policy.authoring.examples import WORLD, example_plan, example_rehearsal, run_example
from pa_console.policy.monitor import Monitor
from pa_console.policy.rule_checks import check_plan
from pa_console.policy.rule_variables import KEPT_S, Sightings, TrackSighting
from pa_console.policy.rulebook import load_rules
from pa_console.schema.mission import Mission
from pa_console.schema.rule import RuleExample
from pa_console.schema.telemetry import Picture

RULES = Path(__file__).parent / "rule_files" / "noncombatants.yaml"
IN_DEPOT, OUTSIDE = (35.0, 30.0), (90.0, 0.0)
MISSION = Mission(id="M1", text="Go.", created=datetime(2000, 1, 1, tzinfo=UTC))


def seen(time_s: float, **tracks: dict[str, object]) -> Picture:
    """Return a picture of the example checkpoint at `time_s` in which `tracks` are detected."""
    facts = {name: {"gate": "EastGate", "stamp_s": time_s} | own for name, own in tracks.items()}
    example = RuleExample(name="x", expect="pass", given={"tracks": facts})
    before = example_rehearsal(example, example_plan(example)).before
    return before.model_copy(update={"time_s": time_s})


def test_the_rule_with_a_history_does_as_its_examples_say() -> None:
    for rule in load_rules(RULES).rules:
        for example in rule.examples:
            found = run_example(rule, example).status
            assert {"complies": "pass", "violates": "fail"}.get(found, found) == example.expect


def test_each_track_is_remembered_at_every_place_where_it_was() -> None:
    memory = Sightings(WORLD)
    memory.look(seen(10.0, V1={"position": IN_DEPOT}))
    memory.look(seen(20.0, V1={"position": WORLD.frames["EastGate"].at}))
    memory.look(seen(30.0, V1={"position": OUTSIDE}))
    known = memory.at(seen(40.0))
    assert [(s["track"], s["place"], s["stamp_s"], s["age_s"]) for s in known] == [
        ("V1", "Depot", 10.0, 30.0), ("V1", "EastGate", 20.0, 20.0), ("V1", "", 30.0, 10.0)
    ]  # fmt: skip


def test_what_turns_out_later_holds_for_where_it_was_before() -> None:
    memory = Sightings(WORLD)
    memory.look(seen(10.0, V1={"position": IN_DEPOT}))
    assert not any(s["noncombatants"] for s in memory.at(seen(11.0)))
    memory.look(seen(20.0, V1={"position": OUTSIDE, "noncombatants": True}))
    assert all(s["noncombatants"] for s in memory.at(seen(21.0)))


def test_an_hour_later_it_is_forgotten_and_asking_changes_nothing() -> None:
    memory = Sightings(WORLD)
    memory.look(seen(10.0, V1={"position": IN_DEPOT}))
    assert memory.at(seen(10.0 + KEPT_S + 1.0)) == []
    assert len(memory.at(seen(10.0 + KEPT_S))) == 1


@given(st.lists(st.sampled_from([IN_DEPOT, OUTSIDE, (50.0, 0.0), (0.0, 0.0)]), max_size=12))
def test_the_age_at_a_place_is_that_of_the_last_detection_there(
    way: list[tuple[float, float]],
) -> None:
    memory = Sightings(WORLD)
    for second, position in enumerate(way):
        memory.look(seen(float(second), V1={"position": position}))
    now = float(len(way))
    ages = {s["place"]: s["age_s"] for s in memory.at(seen(now))}
    places = {IN_DEPOT: "Depot", OUTSIDE: "", (50.0, 0.0): "EastGate", (0.0, 0.0): "Checkpoint"}
    assert ages == {places[position]: now - second for second, position in enumerate(way)}


def test_a_monitor_hands_what_was_seen_to_the_checks() -> None:
    book = load_rules(RULES)
    past = TrackSighting("V1", "Depot", "EastGate", stamp_s=70.0, noncombatants=True)
    example = RuleExample(
        name="x",
        expect="fail",
        plan=(("Ugv_T02", "move_to NorthGate"),),
        given={"timeline": {"assets": {"Ugv_T02": {"entered_zones": ["Depot"]}}}},
    )
    plan = example_plan(example)
    rehearsal = example_rehearsal(example, plan)
    status = {
        name: check_plan(
            book, plan=plan, rehearsal=rehearsal, mission=MISSION, world=WORLD, monitor=monitor
        )[0].status
        for name, monitor in (
            ("seen", Monitor(book, WORLD, Sightings(WORLD, [past])).copy()),
            ("not seen", Monitor(book, WORLD)),
        )
    }
    assert status == {"seen": "violates", "not seen": "complies"}


@pytest.mark.parametrize("wrong", [{"place": "Depot"}, {"track": "V1", "place": "Depot", "x": 1}])
def test_a_sighting_that_makes_no_sense_is_named(wrong: dict[str, object]) -> None:
    rule = load_rules(RULES).rules[0]
    found = run_example(rule, RuleExample(name="x", expect="fail", given={"sightings": [wrong]}))
    assert found.status == "error"
    assert "the example cannot be run" in found.message

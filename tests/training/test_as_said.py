"""Names stand in an answer in the order in which the mission has them, and nothing else changes."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pa_training.order_generator.orders import Order
from pa_training.samples.as_said import with_names_as_said

from pa_console.language.canonical.order import Ask, Reading
from pa_console.language.canonical.reading import read_reason
from pa_training.samples.sample import Sample

SYSTEM = "Plan the mission.\nGates: EastGate, WestGate\nPlaces: Depot; base: Camp\nClosed: none"
HOLD = Order(asks=(Ask(task="hold"),))
ASSETS = ("Drone_T01", "Drone_T02", "Ugv_T01")
PICTURE = "".join(f"{name}: free drone at EastGate\n" for name in ASSETS)


def sample(mission: str, reason: str, key: str = "reason") -> Sample:
    return Sample(
        group="g",
        system=SYSTEM,
        picture=PICTURE,
        rest=f'WF-04: Drone_T02 before Drone_T01.\nMission: "{mission}"',
        answer=json.dumps({key: reason}),
        task="planner" if key == "reason" else "judge",
        kind="go/plain",
    )


@pytest.mark.parametrize(
    ("mission", "reason", "wanted"),
    [
        (
            "Drone_T02 and Drone_T01 home",
            "Drone_T01, Drone_T02 home; Drone_T01: free",
            "Drone_T02, Drone_T01 home; Drone_T01: free",
        ),
        (
            "Ugv_T01 for Drone_T02",
            "swap Drone_T02 and Ugv_T01; nothing to do",
            "swap Ugv_T01 and Drone_T02; nothing to do",
        ),
        (
            "no news? then Ugv_T01 and Drone_T01 tell",
            "if no track at EastGate: report by Drone_T01, Ugv_T01, else: nothing; "
            "now: At EastGate: no track, so; Drone_T01: free",
            "if no track at EastGate: report by Ugv_T01, Drone_T01, else: nothing; "
            "now: At EastGate: no track, so; Drone_T01: free",
        ),
        (
            "Drone_T01 to Camp",
            "Drone_T01 to Camp; Drone_T01: free",
            "Drone_T01 home; Drone_T01: free",
        ),
        (
            "the other two, then Drone_T02",
            "Drone_T01, Drone_T02 hold; all of them",
            "Drone_T01, Drone_T02 hold; all of them",
        ),
        (
            "Drone_T02, Drone_T01 to Campsite",
            "Drone_T01 to Campsite; Drone_T01: free",
            "Drone_T01 to Campsite; Drone_T01: free",
        ),
    ],
)
def test_names_stand_as_the_mission_has_them(mission: str, reason: str, wanted: str) -> None:
    after = with_names_as_said(sample(mission, f"asked: {reason}"), HOLD)
    assert json.loads(after.answer) == {"reason": f"asked: {wanted}"}


def test_a_judge_says_what_was_asked_in_the_same_order() -> None:
    feedback = "asked: Drone_T01, Ugv_T01 home; planned: Drone_T01, Ugv_T01 home; it fits"
    after = with_names_as_said(sample("Ugv_T01, Drone_T01: home", feedback, "feedback"), HOLD)
    wanted = "asked: Ugv_T01, Drone_T01 home; planned: Drone_T01, Ugv_T01 home; it fits"
    assert json.loads(after.answer) == {"feedback": wanted}


LOST = Order(
    asks=(Ask(task="cover", place="EastGate", leaving="Drone_T01"),),
    otherwise=(Ask(task="cover", place="WestGate", leaving="Drone_T02"),),
)


@pytest.mark.parametrize(
    ("mission", "reason", "wanted"),
    [
        (
            "Drone_T01 is gone, replace it",
            "cover EastGate; Free vehicle: Ugv_T01",
            "cover Drone_T01 at EastGate; Free vehicle: Ugv_T01",
        ),
        (
            "a vehicle for Drone_T01, please",
            "cover EastGate by 1 vehicle; Free vehicle: Ugv_T01",
            "cover Drone_T01 at EastGate by 1 vehicle; Free vehicle: Ugv_T01",
        ),
        (
            "EastGate has nobody",
            "cover EastGate; Free vehicle: Ugv_T01",
            "cover EastGate; Free vehicle: Ugv_T01",
        ),
        (
            "a guard for EastGate if it rains, else one in place of Drone_T02",
            "if no track at EastGate: cover EastGate, else: cover WestGate; "
            "now: At EastGate: no track, so; Free vehicle: Ugv_T01",
            "if no track at EastGate: cover EastGate, else: cover Drone_T02 at WestGate; "
            "now: At EastGate: no track, so; Free vehicle: Ugv_T01",
        ),
    ],
)
def test_who_is_lost_is_named_where_the_mission_names_it(
    mission: str, reason: str, wanted: str
) -> None:
    after = with_names_as_said(sample(mission, f"asked: {reason}"), LOST)
    assert json.loads(after.answer) == {"reason": f"asked: {wanted}"}


@given(
    said=st.permutations(ASSETS),
    drawn=st.permutations(ASSETS),
    ends=st.sampled_from(["home", "hold", "to EastGate", "look at WestGate"]),
)
def test_the_same_is_asked_of_the_same(said: list[str], drawn: list[str], ends: str) -> None:
    before = sample(f"{' '.join(said)}: {ends}", f"asked: {', '.join(drawn)} {ends}; all of them")
    after = json.loads(with_names_as_said(before, HOLD).answer)["reason"]
    assert after == f"asked: {', '.join(said)} {ends}; all of them"
    assert _unordered(after) == _unordered(json.loads(before.answer)["reason"])


def _unordered(reason: str) -> list[tuple[str, str, frozenset[str]]]:
    reading = read_reason(reason)
    assert isinstance(reading, Reading)
    return [(ask.task, ask.place, frozenset(ask.who.names)) for ask in reading.asks]

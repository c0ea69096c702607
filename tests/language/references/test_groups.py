"""What an order picks from a set that it has introduced is the right one, or is asked back."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.language.references.conversation import ResolvedOrder, Unclear
from pa_console.language.references.resolution import resolve
from pa_console.language.references.scene import ReferenceScene
from pa_console.schema.incident import Incident, PlaceAsset, SetBattery
from tests.language.references.scenes import HOME, asked, read, scene, sent, standing

UNEQUAL = (
    SetBattery(asset="Robot_T01", percent=60),
    SetBattery(asset="Robot_T02", percent=80),
    SetBattery(asset="Drone_T04", percent=40),
)
BOTH = sent(
    "Both robots to NorthGate.",
    ("Robot_T01", "Checkpoint", "NorthGate"),
    ("Robot_T02", "Base", "NorthGate"),
)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("Of the two robots, the one with more battery goes north, the other one stays.",
         "Robot_T02 goes north, Robot_T01 stays."),
        ("Of the two robots, whichever has less juice comes home and the other one goes east.",
         "Robot_T01 comes home and Robot_T02 goes east."),
        ("The weaker of the two robots comes home.", "Robot_T01 comes home."),
        ("Whichever of Robot_T01 and Drone_T04 has more charge reports.", "Robot_T01 reports."),
        ("Send Drone_T04 or Robot_T02 to the west gate, whichever has the fuller battery.",
         "Send Robot_T02 to WestGate."),
        ("A robot, whichever is closer to the base, reports.", "Robot_T02 reports."),
        ("Drone_T04 and Robot_T02 are spare. The latter goes east, the former west.",
         "Drone_T04 and Robot_T02 are spare. Robot_T02 goes east, Drone_T04 west."),
        ("Robot_T02 or Drone_T04 - the one with less power comes home, the other reports.",
         "Drone_T04 comes home, Robot_T02 reports."),
        ("Drone_T04 or Robot_T02, whichever has more power, reports.", "Robot_T02 reports."),
        ("I have Ugv_T02 and Robot_T01 free. Put the latter at the south gate.",
         "I have Ugv_T02 and Robot_T01 free. Put Robot_T01 at SouthGate."),
        ("Robot_T01 and Robot_T02: one to north, the other to south.",
         "Robot_T01 to north, Robot_T02 to south."),
        ("Of the robots, not the one at the base, the other one goes north.",
         "not Robot_T02, Robot_T01 goes north."),
        ("Robot_T01 goes to the west gate, the other to the east gate.",
         "Robot_T01 goes to WestGate, Robot_T02 to EastGate."),
        ("Of the two robots, send one to the north gate.",
         "Of the two robots, send one to the north gate."),
        ("The robot at the base covers the west gate.", "Robot_T02 covers WestGate."),
    ],
)  # fmt: skip
def test_a_set_in_the_sentence_is_what_is_picked_from(text: str, says: str) -> None:
    where = scene(*UNEQUAL)
    found = resolve(where, text)
    assert not isinstance(found, Unclear), found
    assert " ".join(found.text.split()) == " ".join(says.split())


def test_what_the_last_mission_moved_is_a_set_too() -> None:
    where = scene(*standing(BOTH), *UNEQUAL, past=[BOTH])
    text = "The one with more battery comes home, the other one stays."
    assert read(text, where) == "Robot_T02 comes home, Robot_T01 stays."
    assert read("The first one stays, the second one comes home.", where) == (
        "Robot_T01 stays, Robot_T02 comes home."
    )


def test_what_is_left_open_is_asked_back_with_what_fits_alone() -> None:
    same = asked("Of the two robots, the one with more juice goes north.", scene())
    assert same.choices == ("Robot_T01", "Robot_T02")
    others = asked("Drone_T04 goes north, the other one stays.", scene())
    assert others.choices == ("Drone_T01", "Drone_T02", "Drone_T03")
    named = "Drone_T02 goes north, the other one, Drone_T04, to the south gate."
    assert "Drone_T04, Drone_T04" in read(named, scene())
    number = asked("Of the two drones, the stronger one goes north.", scene())
    assert set(number.choices) == {"Drone_T01", "Drone_T02", "Drone_T03", "Drone_T04"}


SETS = (
    ("the two robots", ("Robot_T01", "Robot_T02")),
    ("our vehicles", ("Ugv_T01", "Ugv_T02")),
    ("Robot_T02 and Drone_T04", ("Robot_T02", "Drone_T04")),
    ("Drone_T01, Ugv_T02 and Robot_T01", ("Drone_T01", "Ugv_T02", "Robot_T01")),
    ("the drones", ("Drone_T01", "Drone_T02", "Drone_T03", "Drone_T04")),
    ("the three drones other than Drone_T02", ("Drone_T01", "Drone_T03", "Drone_T04")),
    ("all drones but Drone_T01 and Drone_T04", ("Drone_T02", "Drone_T03")),
)
FULL, EMPTY, NEAR, FAR = "full", "empty", "near", "far"
PICKS = {
    "the one with more battery": FULL, "whichever has the most juice": FULL, "the fullest": FULL,
    "the one that has less power": EMPTY, "the weakest one": EMPTY,
    "the one nearest to the base": NEAR, "whichever is closer to the base": NEAR,
    "the one farthest from the base": FAR,
}  # fmt: skip
TIE = {FULL: 1.0, EMPTY: 1.0, NEAR: 3.0, FAR: 3.0}
"""Those that are so little apart, in percent or metres, answer equally well."""
FRAMES = st.sampled_from([*HOME.frames])
LAYOUTS = st.fixed_dictionaries(dict.fromkeys(HOME.assets, FRAMES))
CHARGES = st.permutations([30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 90.0, 98.0])


def _worth(where: ReferenceScene, name: str, by: str) -> float:
    asset = where.picture.assets[name]
    away = where.distance_m(HOME.base, name)
    return {FULL: asset.battery_pct, EMPTY: -asset.battery_pct, NEAR: -away, FAR: away}[by]


@settings(deadline=None, max_examples=150)
@given(
    LAYOUTS,
    CHARGES,
    st.sampled_from(SETS),
    st.sampled_from([*PICKS.items()]),
    st.sampled_from(["Of {}, {} goes to NorthGate", "Among {}, let {} go to NorthGate"]),
)
def test_a_pick_is_the_right_one_or_asked_back_and_never_another(
    layout: dict[str, str],
    charges: list[float],
    group: tuple[str, tuple[str, ...]],
    pick: tuple[str, str],
    form: str,
) -> None:
    setup: list[Incident] = [PlaceAsset(asset=name, frame=at) for name, at in layout.items()]
    setup += [
        SetBattery(asset=name, percent=value)
        for name, value in zip(HOME.assets, charges, strict=True)
    ]
    where = scene(*setup)
    (words, members), (said, by) = group, pick
    rest = "the other one reports" if len(members) == 2 else "the rest report"
    found = resolve(where, f"{form.format(words, said)}, {rest}.")
    best = max(_worth(where, name, by) for name in members)
    right = [name for name in members if _worth(where, name, by) >= best - TIE[by]]
    if isinstance(found, Unclear):
        assert len(right) > 1
        assert set(found.choices) == set(right)
        return
    assert isinstance(found, ResolvedOrder)
    first, _, second = found.text.partition(" to NorthGate, ")
    (picked,) = [name for name in HOME.assets if name in first]
    assert picked in right
    assert len(right) == 1 or "whichever" in said
    left = [name for name in HOME.assets if name in members and name != picked]
    assert [name for name in HOME.assets if name in second] == left

"""A reported state is compared with telemetry, and a question becomes a condition."""

import pytest

from pa_console.schema.incident import FailAsset, Incident, PlaceAsset, SetBattery, SetComms
from tests.language.references.scenes import read, scene


@pytest.mark.parametrize(
    ("text", "setup", "says"),
    [
        ("Drone_T02 is nearly flat.", [SetBattery(asset="Drone_T02", percent=12)],
         "Relieve Drone_T02 at NorthGate."),
        ("Drone_T02 is nearly flat.",
         [SetBattery(asset="Drone_T02", percent=12),
          PlaceAsset(asset="Robot_T01", frame="NorthGate")],
         "Drone_T02 has a low battery and must return to base."),
        ("Ugv_T01 has broken down, do something.", [FailAsset(asset="Ugv_T01")],
         "Ugv_T01 has failed: fill the gap at EastGate."),
        ("The guard at the west gate doesn't answer.",
         [SetComms(asset="Drone_T01", comms="lost")],
         "Drone_T01 is silent, so WestGate needs a second guard: send one asset to WestGate."),
        ("one of the drones is out of power", [SetBattery(asset="Drone_T03", percent=8)],
         "Relieve Drone_T03 at SouthGate."),
        ("Is anybody at the north gate? If not, send Robot_T01.", [],
         "If NorthGate has no guard, send Robot_T01 to NorthGate."),
        ("Is Drone_T03 low? Then bring it home.", [],
         "If Drone_T03 is low on battery, bring Drone_T03 home."),
    ],
)  # fmt: skip
def test_what_is_due_is_written_as_an_order(text: str, setup: list[Incident], says: str) -> None:
    assert read(text, scene(*setup)) == says


def test_what_telemetry_does_not_bear_out_is_read_as_it_stands() -> None:
    assert read("Drone_T02 is nearly flat.", scene()) == "Drone_T02 is nearly flat."


@pytest.mark.parametrize(
    "text",
    [
        "Drone_T03 is nearly flat, send Drone_T04 to the south gate.",
        "If Drone_T03 is low on battery, bring it home.",
        "Robot_T01 to the north gate, the battery is fine.",
        "How is Drone_T03?",
    ],
)
def test_what_is_ordered_in_so_many_words_stays(text: str) -> None:
    assert read(text, scene(SetBattery(asset="Drone_T03", percent=12))) == text

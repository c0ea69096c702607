"""Words about manual control are read as such, and no order is taken for them."""

import pytest

from pa_console.language.orders.order_changes import ManualWords, read_manual
from pa_console.language.references.conversation import Unclear
from tests.language.references.scenes import scene

TAKES = (
    "Take over Drone_T04", "take drone T04 over please", "I'll drive Drone_T04 myself",
    "I will fly drone 4", "manual on Drone_T04", "Drone_T04 to manual", "Drone_T04 manual",
    "switch Drone_T04 to manual control", "give me control of Drone_T04", "I have Drone_T04",
    "I've got Drone_T04.", "let me fly Drone_T04", "taking over Drone_T04 now",
    "Take manual control of Drone_T04!", "hand Drone_T04 over to me", "going manual on Drone_T04",
    "I want to fly Drone_T04 myself", "manual mode for D4",
)  # fmt: skip
GIVES_BACK = (
    "Give Drone_T04 back", "give back drone T04", "hand Drone_T04 back to you", "Drone_T04 auto",
    "Drone_T04 back to auto", "end manual control of Drone_T04", "release Drone_T04",
    "switch Drone_T04 back to automatic", "you have Drone_T04", "I'm done with Drone_T04",
    "give it back", "release all",
)  # fmt: skip
ORDERS = (
    "Send Drone_T04 to take over the north gate", "take over the north gate",
    "Drone_T04 takes over from Drone_T01 at NorthGate", "take over from Drone_T04",
    "I'll take Drone_T04 to the north gate", "drive Drone_T04 to the north gate",
    "take Drone_T04 back to base", "hold Drone_T04", "take over", "give Drone_T04 a break",
    "Give Robot_T01 back-up at the west gate", "Drone_T04 back to base",
    "whenever Drone_T04 is low, take it over to base", "send Drone_T04 back",
    "Return Drone_T04 to base", "I need Drone_T04 at the west gate",
)  # fmt: skip


@pytest.mark.parametrize("text", TAKES)
def test_it_is_taken(text: str) -> None:
    assert read_manual(scene(), text, ()) == ManualWords(True, ("Drone_T04",))


@pytest.mark.parametrize("text", GIVES_BACK)
def test_it_is_given_back(text: str) -> None:
    assert read_manual(scene(), text, ("Drone_T04",)) == ManualWords(False, ("Drone_T04",))


@pytest.mark.parametrize("text", ORDERS)
@pytest.mark.parametrize("taken", [(), ("Drone_T04",)])
def test_an_order_is_none_of_them(text: str, taken: tuple[str, ...]) -> None:
    assert read_manual(scene(), text, taken) is None


def test_several_at_once_and_by_description() -> None:
    both = read_manual(scene(), "Take over Drone_T04 and Robot_T01", ())
    assert both == ManualWords(True, ("Drone_T04", "Robot_T01"))
    one = read_manual(scene(), "take over the drone at the north gate", ())
    assert one == ManualWords(True, scene().guards("NorthGate")[:1])


def test_what_several_fit_is_asked_back() -> None:
    found = read_manual(scene(), "take over the drone that is at a gate", ())
    assert isinstance(found, Unclear)
    assert found.choices == ("Drone_T01", "Drone_T02", "Drone_T03")


def test_words_that_need_one_that_is_taken_are_none_without_it() -> None:
    assert read_manual(scene(), "release Drone_T04", ()) is None
    assert read_manual(scene(), "release Drone_T04", ("Drone_T01",)) is None
    assert read_manual(scene(), "give it back", ("Drone_T01", "Drone_T04")) is None


def test_it_is_what_is_marked_on_the_screen() -> None:
    assert read_manual(scene(pointer="Ugv_T01"), "take it over", ()) == ManualWords(
        True, ("Ugv_T01",)
    )

"""Every action of the registry is carried out in one place, or by Textual itself."""

import pytest

from pa_console.tui.actions import ACTIONS, ActionContext, action_of, find_action
from pa_console.tui.app import ConsoleApp
from pa_console.tui.controllers.controllers import HANDLERS, ON_RECORDING, ON_SCREEN


def test_one_place_carries_out_each_action() -> None:
    carried_out = [*HANDLERS, *ON_SCREEN, *ON_RECORDING]
    assert len(set(carried_out)) == len(carried_out)
    assert set(carried_out) == {action.id for action in ACTIONS if not action.app_action}


def test_textual_finds_each_action_by_what_it_is_bound_to() -> None:
    for action in ACTIONS:
        name, _, rest = action.action.partition("(")
        parameters = (action.id,) if rest else ()
        assert find_action(name, parameters) is action
        assert callable(getattr(ConsoleApp, f"action_{name}"))
    assert find_action("carry_out", ("nothing",)) is None


@pytest.mark.parametrize("word", ["export", "session", "replay", "history"])
def test_the_palette_finds_recorded_sessions_by_what_people_call_them(word: str) -> None:
    sessions = action_of("sessions")
    found = [action for action in ACTIONS if word in f"{action.help} {action.words}".lower()]
    assert sessions in found
    assert sessions.palette
    assert not sessions.refusal(ActionContext())
